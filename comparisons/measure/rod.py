"""Time one configuration of the cylindrical element.

``python -m comparisons.measure.rod spring --section-points 8 ... --repeat 5``.

Prints one JSON line.  The first run is cold; the others, in the same process, are warm.
"""

import statistics
import sys
from collections.abc import Sequence
from typing import Any

from comparisons.measure import timing
from isorod import options, scenes
from isorod.command import ending, run
from isorod.command.parser import Parser, add_fields, field_values, split
from isorod.output import results


def measure(
    name: str,
    values: dict[str, Any],
    repeat: int,
    settings: dict[str, Any] | None = None,
    petsc: Sequence[str] = (),
) -> dict[str, Any]:
    """Return a record with the scene's quantities and the wall time of ``repeat`` runs, the first one cold.

    ``seconds`` holds the median of the warm runs, or the only run.  ``settings`` are those of the scene's analysis;
    ``petsc`` must be what PETSc was started with.
    """
    from petsc4py import PETSc

    scene = scenes.find(name)(**values)
    runs: list[dict[str, float]] = []
    solution = None
    for _ in range(repeat):
        # What the last run left does not count as the next one's.
        solution = None
        PETSc.garbage_cleanup()
        solution, seconds = run.solve(scene, settings or {})
        runs.append(seconds)
    warm = runs[1:] or runs
    median = {key: statistics.median(one[key] for one in warm) for key in runs[0]}
    return {
        "method": "cylindrical",
        **run.record(scene, solution, median, settings or {}, petsc),
        "warm": repeat > 1,
        "runs": runs,
        "peak_memory": timing.peak_memory(),
    }


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    return ending.run("comparisons.measure.rod", lambda: _main(arguments))


def _main(arguments: Sequence[str]) -> int:
    ours, theirs = split(arguments)
    name = ours[0] if ours else ""
    scene_type = scenes.find(name)
    parser = Parser(prog=f"python -m comparisons.measure.rod {name}")
    add_fields(parser, scene_type)
    parser.add_argument("--repeat", type=int, default=6, help="runs in this process, the first one cold (6)")
    found = parser.known(ours[1:])
    options.initialize(theirs)
    print(results.line(measure(name, field_values(found, scene_type), found.repeat, petsc=theirs)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
