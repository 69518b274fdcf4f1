"""Time one analysis of a coiled wire of any length: ``python -m comparisons.scaling.wire statics order-1 30``.

The wire is the spring's, in so many coils of twelve elements, and as much is asked of each coil however many there are.
Prints one JSON line, on ranks the first one alone: times are the longest of a rank's, memory that of each.
"""

import dataclasses
import gc
import statistics
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from petsc4py import PETSc

from comparisons.measure import timing
from isorod import dynamics, modal, options, statics
from isorod.errors import InputError
from isorod.model import Model, Support
from isorod.output import results
from isorod.scenes.spring import Spring
from isorod.space import Space

# Section functions, by the spring's fields.
FAMILIES: dict[str, dict[str, int]] = {
    "order-1": {"section_points": 6, "order": 1},
    "order-2": {"section_points": 6, "order": 2},
    "polynomials": {"section_degree": 3},
}
ELEMENTS, DEGREE = 12, 3

# Runs after the first.
WARM = 3

# Displacement a coil, length; steel-like density, so that times are of a kind.
PULL, DENSITY = 2.0 / 3.0, 7.8e-9

# Time of explicit dynamics: some hundred steps; and of the one implicit step.
SHORT, STEP = 2e-5, 1e-4


def model(family: str, coils: int, moving: bool) -> Model:
    """Return the wire, clamped at both ends; pulled by the upper one, or ``moving``: with a mass, and at rest."""
    fields: Any = FAMILIES[family] | {"coils": coils, "elements_per_turn": ELEMENTS, "degree": DEGREE}
    scene = Spring(
        helix="paper",
        continuity=DEGREE - 1,
        travel=PULL * coils,
        quadrature="auto",
        formulation="displacement",
        **fields,
    )
    pulled = scene.model()
    if not moving:
        return pulled
    (body,) = pulled.bodies
    held = [Support.end(body.space, "start"), Support.end(body.space, "end")]
    return dataclasses.replace(pulled, bodies=[dataclasses.replace(body, density=DENSITY)], supports=held)


def _statics(wire: Model) -> dict[str, Any]:
    solution = statics.solve(wire)
    return {"solves": solution.newton_iterations, "value": float(solution.reactions[1, 2]), "seconds": solution.seconds}


def _modes(wire: Model) -> dict[str, Any]:
    solution = modal.solve(wire, 10)
    return {"solves": 10, "value": float(solution.frequencies[0]), "seconds": solution.seconds}


def _implicit(wire: Model) -> dict[str, Any]:
    motion = dynamics.solve(wire, STEP, STEP, outputs=1, integrator="implicit", velocity=_velocity(wire))
    return {"solves": motion.newton_iterations, "value": float(motion.kinetic[-1]), "seconds": motion.seconds}


def _explicit(wire: Model) -> dict[str, Any]:
    motion = dynamics.solve(wire, SHORT, outputs=1, velocity=_velocity(wire))
    return {"solves": motion.steps, "value": float(motion.kinetic[-1]), "seconds": motion.seconds}


def _velocity(wire: Model) -> Any:
    """Return a velocity of the nodes that stretches the wire, all degrees of freedom."""
    (body,) = wire.bodies
    space: Space = body.space
    fraction = space.positions[:, 2] / np.abs(space.positions[:, 2]).max()
    return (space.is_control_point[:, None] * fraction[:, None] * np.array([0.0, 0.0, 1e3])).ravel()


ANALYSES: dict[str, Callable[[Model], dict[str, Any]]] = {
    "statics": _statics,
    "modes": _modes,
    "implicit": _implicit,
    "explicit": _explicit,
}


def measure(analysis: str, family: str, coils: int) -> dict[str, Any]:
    """Return the record of one analysis: unknowns, seconds by part, peak memory of each rank.

    ``seconds`` and ``total`` are medians of the warm runs, ``first`` is the total of the first one, which gets its
    memory from the system.
    """
    # A small run before: compiled functions are then read from the disk.
    ANALYSES[analysis](model(family, 1, analysis != "statics"))
    before = timing.peak_memory()
    comm = PETSc.COMM_WORLD.tompi4py()
    totals, runs = [], []
    for _ in range(1 + WARM):
        wire = model(family, coils, analysis != "statics")
        result = ANALYSES[analysis](wire)
        parts = comm.allgather(result["seconds"])
        runs.append({name: max(one[name] for one in parts) for name in parts[0]})
        totals.append(sum(value for name, value in runs[-1].items() if name not in ("total", "loop")))
        gc.collect()
    return {
        "analysis": analysis,
        "family": wire.bodies[0].space.basis.family,
        "coils": coils,
        "ranks": comm.size,
        "unknowns": wire.unknowns,
        "solves": result["solves"],
        "value": result["value"],
        "seconds": {name: statistics.median(one[name] for one in runs[1:]) for name in runs[0]},
        "total": statistics.median(totals[1:]),
        "first": totals[0],
        "memory": comm.allgather(timing.peak_memory()),
        "memory_before": before,
    }


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    if (
        len(arguments) != 3
        or arguments[0] not in ANALYSES
        or arguments[1] not in FAMILIES
        or not arguments[2].isdigit()
    ):
        raise InputError(f"got {' '.join(arguments)!r}, need {'|'.join(ANALYSES)} {'|'.join(FAMILIES)} COILS")
    options.initialize([])
    result = measure(arguments[0], arguments[1], int(arguments[2]))
    if PETSc.COMM_WORLD.getRank() == 0:
        print(results.line(result))
    return 0


if __name__ == "__main__":
    from isorod.command import ending

    sys.exit(ending.run("comparisons.scaling.wire", lambda: main(sys.argv[1:])))
