"""Time one configuration of isorod.

``python -m comparisons.measure.rod spring|my.toml --section-points 8 ... --repeat 5``.

Prints one JSON line.  The first run is cold; the others, in the same process, are warm.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import process_time
from typing import Any

from comparisons.measure import sampled, timing
from isorod import files, options
from isorod.command import ending, solving
from isorod.command.parser import Parser, add_fields, field_values, split
from isorod.output import results

# The option that measures a scene as ``isorod run`` does.
WHOLE = "--whole"


def find(name: str, values: Mapping[str, Any]) -> Any:
    """Return a scene of the package or of a file, with the given fields that are not None."""
    return files.find(name).with_options(**values)


def solve(
    scene: Any, settings: Mapping[str, Any], repeat: int, whole: bool = False
) -> tuple[Any, list[dict[str, float]]]:
    """Return the last of ``repeat`` solutions, and the wall times of each run by part, and its processor time.

    ``whole`` counts the estimate of the error as a part of each run, as ``isorod run`` has it.
    """
    from petsc4py import PETSc

    runs: list[dict[str, float]] = []
    solution = None
    for _ in range(repeat):
        # The last run's garbage does not count as the next one's.
        solution = None
        PETSc.garbage_cleanup()
        start = process_time()
        solution, seconds = solving.solve(scene, settings)
        if whole:
            estimating = solving.estimate(solution).get("estimate_seconds", 0.0)
            seconds |= {"estimate": estimating, "total": seconds["total"] + estimating}
        runs.append(seconds | {"processor": process_time() - start})
    return solution, runs


def record(
    scene: Any,
    solution: Any,
    runs: Sequence[dict[str, float]],
    settings: Mapping[str, Any],
    petsc: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the record of the result of `solve`: ``seconds`` are the median of the warm runs, or the only run."""
    return {
        "method": "cylindrical",
        **solving.record(scene, solution, timing.median(runs), settings, petsc),
        "warm": len(runs) > 1,
        "runs": list(runs),
        "peak_memory": timing.peak_memory(),
    }


def measure(
    name: str,
    values: dict[str, Any],
    repeat: int,
    petsc: Sequence[str] = (),
) -> dict[str, Any]:
    """Return a record with the scene's quantities and the wall time of ``repeat`` runs, the first one cold.

    ``seconds`` holds the median of the warm runs, or the only run.  ``petsc`` must be what PETSc was started with.
    """
    scene = find(name, values)
    return record(scene, *solve(scene, {}, repeat), {}, petsc)


def main(arguments: Sequence[str]) -> int:
    """Run the command line; return the exit code."""
    return ending.run("comparisons.measure.rod", lambda: _main(arguments))


def _main(arguments: Sequence[str]) -> int:
    ours, theirs = split(arguments)
    name = ours[0] if ours else ""
    known = files.find(name)
    parser = Parser(prog=f"python -m comparisons.measure.rod {name}")
    add_fields(parser, known)
    parser.add_argument("--repeat", type=int, default=6, help="runs in this process, the first one cold (6)")
    parser.add_argument("--spaces", type=json.loads, help="of a file, what the spaces of its rods are, as JSON")
    parser.add_argument("--estimate", action="store_true", help="estimate the error too, apart from the time")
    parser.add_argument(WHOLE, action="store_true", help="the estimate is a part of the time, as in isorod run")
    parser.add_argument("--at", metavar="NPZ", help="where fields are evaluated (comparisons.measure.sampled.Places)")
    parser.add_argument("--fields", metavar="NPZ", help="write them to this file")
    given = parser.known(ours[1:])
    scene = find(name, field_values(given, known) | {"spaces": given.spaces})
    options.initialize(theirs)
    settings = scene.settings()
    solution, runs = solve(scene, settings, given.repeat, given.whole)
    values = record(scene, solution, runs, settings, theirs)
    if given.estimate:
        values |= solving.estimate(solution)
    first = ending.rank() == 0
    if given.fields:
        arrays = sampled.fields(solution, sampled.Places.read(Path(given.at)))
        if first:
            results.write_arrays(Path(given.fields), **arrays)
    if first:
        print(results.line(values), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
