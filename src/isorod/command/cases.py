"""``isorod run`` of a file with load cases: each is solved by itself, and all are lines of one table."""

import sys
import warnings
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from isorod import options
from isorod.command import ending, notes
from isorod.errors import InputError

# What solves a scene, and what keeps its results.
Solve = Callable[[Any, Sequence[str], Namespace], tuple[dict[str, Any], Any]]
Keep = Callable[[dict[str, Any], Any, Namespace, Any], dict[str, Any]]


def run(scene: Any, theirs: Sequence[str], args: Namespace, solve: Solve, keep: Keep) -> int:
    """Run all load cases of a scene; return the exit code: 2 where one could not be solved.

    Results of each go into a folder of its name within that of the output.
    """
    if scene.analysis == "geometry":
        raise InputError("load cases: this scene is geometry only, on which nothing acts; --case chooses one")
    if getattr(args, "checkpoint", None) is not None:
        raise InputError("--checkpoint: it is of one run; choose a load case with --case")
    # An error in any case is raised before the first is solved.
    several = {name: scene.with_options(case=name) for name in scene.cases}
    rows, failed = [], []
    for number, (name, case) in enumerate(several.items()):
        row = _one(number, name, case, theirs, args, solve, keep)
        rows.append(row)
        failed += [name] if row["sweep"]["status"] != "solved" else []
    if ending.rank() == 0:
        _print(scene, rows, args)
        if failed:
            return ending.fail("isorod", f"load cases not solved: {', '.join(failed)}")
    return 2 if failed else 0


def _one(
    number: int, name: str, scene: Any, theirs: Sequence[str], args: Namespace, solve: Solve, keep: Keep
) -> dict[str, Any]:
    """Solve a case, write and print its results if requested; return its row of the table."""
    from isorod.command import printing, sheet
    from isorod.output import results

    about: dict[str, Any] = {"point": number, "values": {"case": name}, "units": scene.units}
    about["estimated"] = scene.analysis != "dynamics" and not getattr(args, "no_estimate", True)
    own = Namespace(**{**vars(args), "case": name})
    record: dict[str, Any] = {}
    with sheet.attempted(about, scene.named) as warned, np.errstate(all="ignore"):
        with printing.apart() if args.json else nullcontext(), options.petsc_errors():
            record, solution = solve(scene, theirs, own)
        if "short" in record:
            about["status"] = record["short"]
        if ending.rank() == 0:
            line = results.line(record)
            if args.output is not None:
                own.output = str(Path(args.output) / name)
                results.check_folder(own.output)
                record = keep(record, solution, own, scene)
                line = results.line(record)
            if args.json:
                print(line, flush=True)
    for text in warned:
        warnings.warn(f"case {name}: {scene.named(text)}", stacklevel=2)
    return {**record, "sweep": about}


def _print(scene: Any, rows: Sequence[Mapping[str, Any]], args: Namespace) -> None:
    """Print the table, unless JSON was asked for, and warnings; what could not be solved stands behind its name."""
    from isorod.command import rates, sweep

    if args.json:
        for row in rows:
            if row["sweep"]["status"] != "solved":
                print(f"isorod: case {row['sweep']['values']['case']}: {row['sweep']['status']}", file=sys.stderr)
    else:
        for line in sweep.table(rows):
            print(line)
        for row in rows:
            if "derivatives" in row:
                print(f"case {row['sweep']['values']['case']}:", *rates.lines(row), sep="\n")
        units = [f"{name.replace('_', ' ')} {unit}" for name, unit in scene.units.items() if unit]
        if units:
            print(f"units: {'; '.join(units)}")
        print(f"{len(rows)} load cases of {scene.name}; --case NAME runs one alone, --output DIR keeps all")
    notes.show()
