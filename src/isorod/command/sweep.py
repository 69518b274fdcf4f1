"""``isorod sweep``: a scene is solved for every combination of values of its options, into a table."""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from time import perf_counter
from typing import Any

from isorod import options, scenes
from isorod.command import chosen, ending, grid
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output.words import duration

_HOW = (
    "Options have several values as from:to:count, evenly spaced (--pull 0:10:21), or a,b,c (--nu 0.3,0.4); every "
    "combination is solved, the values of the last option fastest."
)

# Options that change nothing of the numbers: with a value, and without.
_VALUED, _PLAIN = ("--output", "--png", "--of"), ("--json", "--overwrite", "--cold")

# Entries of a list that are printed, and warnings.
_ENTRIES, _WARNINGS = 4, 3


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Run a sweep with our options and PETSc's; return the exit code: 2 where points could not be solved."""
    import numpy as np

    if chosen.usage("sweep", ours, theirs):
        return 0
    if {"-h", "--help"} & {*ours}:
        chosen.find("sweep", ours, theirs, _more)[2].print_help()
        return 0
    points = grid.read(ours, _VALUED)
    scene, found = _understood(points, theirs)
    if scenes.analyses(scene) == ("geometry",):
        raise InputError("sweep: this scene is geometry only, and has no numbers to solve for")
    plot = _plot(scene, found)
    options.initialize(theirs)
    with np.errstate(all="ignore"):
        return _run(points, scene, found, theirs, plot)


def _more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analysis, and of the sweep."""
    parser.epilog = f"{_HOW} {chosen.PETSC}"
    chosen.with_analysis(parser, scene)
    if {"statics", "modal"} & {*scenes.analyses(scene)}:
        parser.add_argument(
            "--no-estimate", action="store_true", help="leave out the estimates of errors, which take as long again"
        )
    parser.add_argument("--cold", action="store_true", help="begin each point from rest, not near those before")
    parser.add_argument("--json", action="store_true", help="print each point as one line of JSON")
    parser.add_argument(
        "--output", metavar="FILE.csv", help="write the table into this file, and go on with one that is not complete"
    )
    parser.add_argument("--overwrite", action="store_true", help="begin anew, whatever is in the file")
    parser.add_argument("--png", metavar="FILE", help="plot the answer against what is varied first")
    parser.add_argument("--of", metavar="NAME", help="which answer is plotted (the first)")


def _understood(points: grid.Grid, theirs: Sequence[str]) -> tuple[Any, argparse.Namespace]:
    """Return scene and options of the first point, having made sure that each value is one of its option's kind."""
    corner = [0] * len(points.shape)
    words = points.at(corner)
    place, scene, parser = chosen.find("sweep", words, theirs, _more)
    for d, one in enumerate(points.swept):
        for k in range(1, len(one.values)):
            beside = points.at([*corner[:d], k, *corner[d + 1 :]])
            parser.known([*beside[:place], *beside[place + 1 :]])
    return scene, parser.known([*words[:place], *words[place + 1 :]])


def _run(points: grid.Grid, scene: Any, found: argparse.Namespace, theirs: Sequence[str], plot: Any) -> int:
    """Solve all points that are not there yet, and tell of all."""
    from isorod.command import printing, sheet
    from isorod.command.points import Points, command
    from isorod.output.progress import Progress

    begin, first = perf_counter(), ending.rank() == 0
    solver = Points(points, theirs, _more, found.cold)
    said = command(points.words, _VALUED, _PLAIN)
    kept = sheet.Sheet(
        found.output if first else None, _identity(said, scene, theirs), _heads(said, scene), found.overwrite
    )
    ready = solver.together({*kept.records})
    total = len(solver.indices)

    def add(record: Mapping[str, Any]) -> None:
        kept.add(record)
        if found.json and first:
            print(json.dumps(kept.records[record["sweep"]["point"]]), flush=True)

    for record in kept.records.values() if found.json and first else ():
        print(json.dumps(record), flush=True)
    progress = Progress(len(ready), total, "point")
    refused: list[dict[str, Any]] = []
    try:
        for number in range(total):
            if number in ready:
                continue
            with printing.apart() if found.json else nullcontext():
                record = solver.solve(number)
            refused.append(record)
            # Where no point can be solved nothing is written.
            if kept.records or not record["sweep"]["status"].startswith("refused: "):
                for one in refused:
                    add(one)
                refused.clear()
            if first:
                progress(float(number + 1))
    except KeyboardInterrupt as problem:
        if found.output is not None:
            problem.add_note(f"{len(kept.records)} of {total} points are in {found.output}; the same command goes on")
        raise
    finally:
        progress.close()
    if refused:
        message = refused[0]["sweep"]["status"].removeprefix("refused: ")
        raise InputError(message if total == 1 else f"none of {total} points can be solved; the first: {message}")
    if first:
        _tell(kept.records, found, perf_counter() - begin, len(ready))
        if plot is not None:
            plot([kept.records[k] for k in sorted(kept.records)])
    failed = sum(one["sweep"]["status"] != sheet.SOLVED for one in kept.records.values())
    problems = [f"{failed} of {total} points could not be solved; the table says why"] if failed else []
    problems += [solver.doubt] if solver.doubt else []
    return ending.fail("isorod", "; ".join(problems)) if problems else 0


def _identity(said: str, scene: Any, theirs: Sequence[str]) -> dict[str, Any]:
    """Return by what a sweep is known again: nothing that numbers depend on may differ."""
    from isorod.output import results

    origin = results.provenance()
    content = json.dumps(scene.content, default=str) if hasattr(scene, "content") else ""
    return {
        "command": said,
        "petsc_options": " ".join(theirs),
        "file": hashlib.sha256(content.encode()).hexdigest() if content else None,
        "versions": origin["versions"],
        "commit": origin["commit"],
    }


def _heads(said: str, scene: Any) -> list[str]:
    """Return the lines at the head of the table: how it came about, and units."""
    return [said, *(f"{name}: {unit}" for name, unit in scene.units.items() if unit)]


def _tell(records: Mapping[int, Mapping[str, Any]], found: argparse.Namespace, seconds: float, before: int) -> None:
    """Print the table, unless JSON was asked for, and say what is to be said beside it."""
    if not found.json:
        for line in _table([records[k] for k in sorted(records)]):
            print(line)
        print(_summary(records, seconds, before))
        sys.stdout.flush()
    said = [(text, one["sweep"]["values"]) for one in records.values() for text in one["sweep"]["warnings"]]
    for text, values in said[:_WARNINGS]:
        at = ", ".join(f"{name} {value}" for name, value in values.items())
        print(f"isorod: warning: {at}: {text}", file=sys.stderr)
    if said[_WARNINGS:]:
        print(f"isorod: warning: {len(said) - _WARNINGS} more warnings are in the records", file=sys.stderr)


def _table(records: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of a table for people."""
    from isorod.command import sheet

    rows = []
    for record in records:
        row = sheet.columns(record)
        many = [name for name in row if name.endswith("]") and int(name.rpartition("[")[2][:-1]) >= _ENTRIES]
        row = {name: value for name, value in row.items() if name not in [*many, "unknowns", "status"]}
        row = {
            name: f"{float(value):.6g}" if name not in record["sweep"]["values"] and value else value
            for name, value in row.items()
        }
        if record.get("newton_iterations"):
            row["Newton"] = str(record["newton_iterations"])
        if record["sweep"]["status"] != sheet.SOLVED:
            row["status"] = record["sweep"]["status"]
        rows.append(row)
    names = list(dict.fromkeys(name for row in sorted(rows, key=len, reverse=True) for name in row if name != "status"))
    names += ["status"] if any("status" in row for row in rows) else []
    widths = {name: max(len(name), *(len(row.get(name, "")) for row in rows)) for name in names}
    yield "  ".join(name.replace("_", " ").rjust(widths[name]) for name in names).rstrip()
    for row in rows:
        yield "  ".join(
            row.get(name, "").rjust(widths[name]) if name != "status" else row.get(name, "") for name in names
        ).rstrip()


def _summary(records: Mapping[int, Mapping[str, Any]], seconds: float, before: int) -> str:
    """Return in a line how many points there are, and how they were begun."""
    parts = [f"{len(records)} points in {duration(seconds)}" + (f", {before} of them there before" if before else "")]
    for start, words in {"near": "begun near those before", "rest": "from rest"}.items():
        counts = [
            one["newton_iterations"]
            for one in records.values()
            if one["sweep"].get("start", "").startswith(start) and one.get("newton_iterations")
        ]
        if counts:
            parts.append(f"{len(counts)} {words}, {sum(counts) / len(counts):.2g} Newton iterations each")
    return "; ".join(parts)


def _plot(scene: Any, found: argparse.Namespace) -> Any:
    """Return what draws the plot that is asked for, None if none is."""
    if found.png is None:
        if found.of is not None:
            raise InputError("--of: it says what is plotted, and goes with --png FILE")
        return None
    from isorod.command import sweep_plot

    return sweep_plot.ready(found.png, found.of, scene)
