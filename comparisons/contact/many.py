"""Strands of 7 to 91 wires of one pitch, with friction: ``python -m comparisons.contact.many [DIR] [WIRES ...]``.

Each strand is pulled in a process of its own, on one thread.  In the folder (results) there are then ``many.jsonl``, a
record a run; ``many.md``, a table; and ``many.png``: time and memory a wire, beside the times that a Python code of
beams with friction reports for as many wires (92 to 1,476 s; its friction converged up to 37 wires).  Times are those
of the processor, of one thread.  All are pulled on a finer space too, up to 19 wires on a third, and all forces
compared with those of thin rods that lie on each other without friction (`comparisons.contact.strand`).

``python -m comparisons.contact.many --one LAYERS SECTION_POINTS PARTS`` is one such run, which prints its record.
"""

import sys
from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from comparisons.contact import strand
from comparisons.measure import timing
from comparisons.report.html import columns, markdown
from comparisons.report.plots import pyplot, save
from isorod import options, statics
from isorod.arrays import Array
from isorod.contact import operator
from isorod.contact.packed import Packed
from isorod.errors import InputError
from isorod.geometry.coils import HELIX_ELEMENTS
from isorod.output import results
from isorod.scenes.strand import Strand

# Seconds by wires.
PUBLISHED = {7: 92.0, 19: 239.0, 37: 501.0, 61: 903.0, 91: 1476.0}
# Layers of as many.
LAYERS = {7: 1, 19: 2, 37: 3, 61: 4, 91: 5}

# What all have: the whole first layer goes round once.
SCENE: dict[str, Any] = {"length": 115.0, "strain": 0.002, "friction": 0.115}

# Section points and parts of an element: of all strands, and of those of so many wires and fewer.
SPACE = 6, 1
FINER = {91: (6, 2), 19: (12, 2)}

# In a short first step, in which wires are drawn together, they are thrown less far into each other; once they touch,
# steps double.  It takes more iterations than others.
STEPS, PETSC = 8, {"snes_max_it": 50}


class _Watch:
    """Time that contact takes to find closest points, the forces there included."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._find = operator.add_forces

    def __call__(self, packed: Packed, positions: Array, forces: Array) -> tuple[float, float, float, float]:
        """Do what `isorod.contact.force_kernel.add_forces` does."""
        start = perf_counter()
        pairs = self._find(packed, positions, forces)
        self.seconds += perf_counter() - start
        return pairs


def measure(layers: int, section_points: int, parts: int) -> dict[str, Any]:
    """Return the record of a strand on some space: time, memory, answers."""
    options.initialize([])
    scene = Strand(layers=layers, section_points=section_points, parts=parts, **SCENE)
    # Compiled code is read, or made, before.
    statics.solve(Strand(layers=1, section_points=6, parts=1, length=15.0, strain=1e-4, friction=0.1).model())
    watch = _Watch()
    operator.add_forces = watch  # type: ignore[assignment]
    start = process_time()
    solution = statics.solve(scene.model(), load_steps=STEPS, petsc=PETSC)
    seconds = process_time() - start
    steps = solution.seconds["assembly"] + solution.seconds["solve"]
    return {
        "wires": len(solution.model.bodies),
        "section_points": section_points,
        "parts": parts,
        "dofs": solution.displacement.size,
        "seconds": seconds,
        "memory": timing.peak_memory(),
        "search": watch.seconds / steps,
        "solves": solution.newton_iterations,
        "load_steps": solution.load_steps,
        "cuts": solution.cuts,
        "thin": thin(scene),
        **scene.measure(solution),
    }


def thin(scene: Strand) -> float:
    """Return the force of a strand of thin rods."""
    pitches = (2.0 * np.pi * scene.layer_radius(k) / np.tan(scene.lay_angle) for k in range(1, scene.layers + 1))
    core, wire = (strand.Wire(radius, scene.E, scene.nu) for radius in (scene.core_radius, scene.wire_radius))
    layers = (strand.Layer(6 * k, wire, -((-1) ** k) * pitch) for k, pitch in enumerate(pitches, 1))
    return float(strand.Strand(core, tuple(layers)).stiffness()[0, 0] * scene.strain)


def table(records: Sequence[dict[str, Any]]) -> str:
    """Return the runs as a table in Markdown; the error is against the finest run of as many wires."""

    def off(one: dict[str, Any]) -> str:
        finest = max((other for other in records if other["wires"] == one["wires"]), key=itemgetter("dofs"))
        return "" if one is finest else f"{100.0 * (one['force'] / finest['force'] - 1.0):+.2f} %"

    shown: dict[str, Callable[[dict[str, Any]], object]] = {
        "wires": itemgetter("wires"),
        "points, parts": lambda one: f"{one['section_points']}, {one['parts']}",
        "unknowns": lambda one: f"{one['dofs']:,}",
        "time [s]": lambda one: f"{one['seconds']:.1f}",
        "published [s]": lambda one: f"{PUBLISHED[one['wires']]:.0f}",
        "memory [MB]": lambda one: f"{one['memory'] / 1e6:.0f}",
        "search": lambda one: f"{100.0 * one['search']:.1f} %",
        "solves": itemgetter("solves"),
        "force [N]": lambda one: f"{one['force']:.0f}",
        "to the finest": off,
        "to thin rods": lambda one: f"{100.0 * (one['force'] / one['thin'] - 1.0):+.2f} %",
    }
    return markdown(*columns(records, shown)) + "\n"


def draw(records: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw time and memory a wire by the number of wires."""
    figure, (left, right) = pyplot().subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    for space in sorted({(one["section_points"], one["parts"]) for one in records}):
        runs = [one for one in records if (one["section_points"], one["parts"]) == space]
        wires = [one["wires"] for one in runs]
        name = f"isorod, {space[0]} points a section, {space[1] * HELIX_ELEMENTS} elements"
        left.plot(wires, [one["seconds"] / one["wires"] for one in runs], "o-", label=name)
        right.plot(wires, [one["memory"] / one["wires"] / 1e6 for one in runs], "o-", label=name)
    left.plot(list(PUBLISHED), [time / wires for wires, time in PUBLISHED.items()], "ks--", label="beams, published")
    for axes, what in ((left, "time a wire, one thread [s]"), (right, "memory a wire [MB]")):
        axes.set(xlabel="wires", ylabel=what, ylim=(0.0, None), xticks=list(PUBLISHED))
        axes.grid(True, alpha=0.3)
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=2, frameon=False)
    save(figure, path, 130)


def study(folder: Path, chosen: Sequence[int]) -> str:
    """Run all strands of so many wires; write records, table and plot, after each run anew, and return the table."""
    records: list[dict[str, Any]] = []
    for wires in chosen:
        for space in (SPACE, *(finer for most, finer in FINER.items() if wires <= most)):
            arguments = ["--one", *map(str, (LAYERS[wires], *space))]
            result = timing.run("comparisons.contact.many", arguments, timeout=7200.0)
            results.append(folder / "many.jsonl", results.provenance() | result)
            records.append(result)
            (folder / "many.md").write_text(table(records), encoding="utf-8")
            draw(records, folder / "many.png")
    return table(records)


def main(arguments: Sequence[str]) -> int:
    """Run the study, or one of its measurements."""
    if arguments[:1] == ["--one"]:
        layers, points, parts = map(int, arguments[1:])
        print(results.line(measure(layers, points, parts)))
        return 0
    folder, chosen = (arguments[0] if arguments else "results"), [int(text) for text in arguments[1:]]
    unknown = [wires for wires in chosen if wires not in PUBLISHED]
    if unknown:
        raise InputError(f"wires: got {unknown[0]}, need {', '.join(map(str, PUBLISHED))}")
    print(study(results.make_folder(folder), chosen or list(PUBLISHED)), end="")
    return 0


if __name__ == "__main__":
    from isorod.command import ending

    sys.exit(ending.run("comparisons.contact.many", lambda: main(sys.argv[1:]), "the records written so far are kept"))
