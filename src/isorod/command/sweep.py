"""``isorod sweep``: a scene is solved for every combination of values of its options, into a table."""

import argparse
import hashlib
import json
import re
import shlex
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from time import perf_counter
from typing import Any

from isorod import options, scenes
from isorod.command import chosen, ending, grid, notes, pages
from isorod.command.parser import Parser
from isorod.errors import InputError
from isorod.output.words import duration, percent

_HOW = (
    "Options have several values as from:to:count, evenly spaced (--travel 0:10:21), or a,b,c (--nu 0.3,0.4); every "
    "combination is solved, the values of the last option fastest."
)

# Options without effect on the numbers: with a value, and without.
_VALUED, _PLAIN = ("--output", "--png"), ("--json", "--overwrite")

# Entries of a list that are printed, and warnings.
_ENTRIES, _WARNINGS = 4, 3


def main(ours: Sequence[str], theirs: Sequence[str]) -> int:
    """Run a sweep with our options and PETSc's; return the exit code: 2 where points could not be solved."""
    import numpy as np

    if chosen.usage("sweep", ours, theirs):
        return 0
    if {"-h", "--help"} & {*ours}:
        chosen.find("sweep", ours, theirs, more)[2].print_help()
        return 0
    words = _without_old(ours)
    cases = chosen.find("sweep", words, theirs, more)[1].cases
    if cases and not any(word.partition("=")[0] == "--case" for word in words):
        words += ["--case", ",".join(cases)]
    points = grid.read(words, _VALUED)
    scene, args = _understood(points, theirs)
    if scenes.analyses(scene) == ("geometry",):
        raise InputError("sweep: this scene is geometry only, and has no numbers to solve for")
    if args.png is not None:
        from isorod.output import curves

        curves.check(Path(args.png))
    options.initialize(theirs)
    with np.errstate(all="ignore"):
        return _run(points, _identity(words, scene, theirs), scene, args, theirs)


def _without_old(ours: Sequence[str]) -> list[str]:
    """Return our words without removed options, which have no effect and give a warning for one release."""
    kept, words = [], iter(ours)
    for word in words:
        if word == "--cold":
            warnings.warn("--cold: every point begins from rest; leave it out", FutureWarning, stacklevel=3)
        elif word.partition("=")[0] == "--of":
            warnings.warn("--of: the plot has all answers; leave it out", FutureWarning, stacklevel=3)
            if word == "--of":
                next(words, None)
        else:
            kept.append(word)
    return kept


def more(parser: Parser, scene: Any) -> None:
    """Add options of the scene's analysis, and of the sweep."""
    parser.epilog = f"{_HOW} {pages.PETSC}"
    chosen.with_analysis(parser, scene)
    if {"statics", "modal", "buckling", "harmonic", "random"} & {*scenes.analyses(scene)}:
        parser.add_argument(
            "--no-estimate", action="store_true", help="skip error estimates, which take about as long as the runs"
        )
    parser.add_argument("--json", action="store_true", help="print each point as one line of JSON")
    parser.add_argument("--output", metavar="FILE.csv", help="write the table into this file, or complete it")
    parser.add_argument("--overwrite", action="store_true", help="overwrite the file")
    parser.add_argument("--png", metavar="FILE", help="plot the table, as isorod plot FILE.csv does")


def _understood(points: Sequence[grid.Point], theirs: Sequence[str]) -> tuple[Any, argparse.Namespace]:
    """Return scene and options of the first point, after a check of each value's type."""
    first = points[0]
    place, scene, parser = chosen.find("sweep", first.words, theirs, more)
    for point in points:
        # All values are among those of what differs in one of them.
        if len(point.values.items() - first.values.items()) <= 1:
            parser.known([*point.words[:place], *point.words[place + 1 :]])
    return scene, parser.known([*first.words[:place], *first.words[place + 1 :]])


def _run(
    points: Sequence[grid.Point], identity: dict[str, Any], scene: Any, args: argparse.Namespace, theirs: Sequence[str]
) -> int:
    """Solve all points whose records are not there yet, and print all."""
    from petsc4py import PETSc

    from isorod.command import printing, sheet, solving
    from isorod.output import campbell, curves, results
    from isorod.output.progress import Progress

    start, first = perf_counter(), ending.rank() == 0
    head = [identity["command"], *(f"{name}: {unit}" for name, unit in scene.units.items() if unit)]
    head += [curves.SPEED] if _is_speed(scene, points[0].values) else []
    # Of several ranks the first has the files.
    path = args.output if first else None
    there = {} if path is None else sheet.read(path, identity, args.overwrite)
    _warn_of_commits(there)
    records = PETSc.COMM_WORLD.tompi4py().bcast(there)
    known = {*records}
    total = len(points)

    def add(record: dict[str, Any]) -> None:
        line = results.line(record)
        # As it will be read.
        records[record["sweep"]["point"]] = json.loads(line)
        if path is not None:
            results.make_folder(str(Path(path).parent))
            results.append(sheet.records_of(path), record)
        if args.json and first:
            print(line, flush=True)

    for record in records.values() if args.json and first else ():
        print(results.line(record), flush=True)
    progress = Progress(len(known), total, "point")
    refused: list[dict[str, Any]] = []
    solved = False
    try:
        for number, point in enumerate(points):
            if number in known:
                continue
            with printing.apart() if args.json else nullcontext():
                record = _solve(number, point, theirs)
            record["sweep"] |= {name: one for name, one in identity.items() if name not in record}
            if not solved and record["sweep"]["status"] == sheet.SOLVED:
                solved = True
                solving.refuse_unused()
            refused.append(record)
            # Where no point can be solved nothing is written.
            if records or not record["sweep"]["status"].startswith("refused: "):
                for one in refused:
                    add(one)
                refused.clear()
            if first:
                progress(float(number + 1))
    except KeyboardInterrupt as problem:
        if path is not None:
            problem.add_note(f"{len(records)} of {total} points are in {path}; the same command goes on")
        raise
    finally:
        progress.close()
        table = sheet.table(records, head) if records else b""
        if path is not None and records:
            results.write_whole(Path(path), table)
    if refused:
        message = refused[0]["sweep"]["status"].removeprefix("refused: ")
        raise InputError(message if total == 1 else f"none of {total} points can be solved; the first: {message}")
    if first:
        _print(records, args, perf_counter() - start, len(known))
        columns = {}
        if args.png is not None or curves.SPEED in head:
            columns = curves.columns(table.decode().splitlines(), "sweep")
        if curves.SPEED in head and not args.json:
            for met in campbell.crossings(columns):
                print(met)
        if args.png is not None:
            from isorod.output import picture

            results.make_folder(str(Path(args.png).parent))
            units = {name: unit.strip("()") for name, unit in scene.units.items()}
            curves.draw(columns, str(scene.title if scene.content else scene.name), picture.SIZE, Path(args.png), units)
    failed = sum(one["sweep"]["status"] != sheet.SOLVED for one in records.values())
    return (
        ending.fail("isorod", f"{failed} of {total} points could not be solved; see the table's status column")
        if failed
        else 0
    )


def _solve(number: int, point: grid.Point, theirs: Sequence[str]) -> dict[str, Any]:
    """Run a point as `isorod run` does; return its record, with the reason where it fails."""
    from isorod.command import sheet, solving
    from isorod.output import results

    about: dict[str, Any] = {"point": number, "values": point.values}
    record: dict[str, Any] = {**results.provenance(), "petsc_options": " ".join(theirs)}
    with sheet.attempted(about) as warned, options.petsc_errors():
        scene, args, _ = chosen.choose("sweep", point.words, theirs, more)
        estimated = scene.analysis != "dynamics" and not args.no_estimate
        about |= {"units": dict(scene.units), "estimated": estimated}
        settings = chosen.settings(scene, args)
        solution, seconds = solving.solve(scene, settings)
        solved = solving.record(scene, solution, seconds, settings, theirs)
        solving.warn_of_embedded(scene, solution)
        record = solved | (solving.estimate(solution, bool(scene.stresses)) if estimated else {})
    about["warnings"] = warned
    return record | {"sweep": about}


def _identity(words: Sequence[str], scene: Any, theirs: Sequence[str]) -> dict[str, Any]:
    """Return what identifies a sweep: its words except those without effect on numbers, the file, versions.

    Not the commit: a checkout may be committed to, or be edited, while a sweep runs (`_warn_of_commits`).
    """
    from isorod.output import results

    kept, skip = [], False
    for word in words:
        if skip or word in _PLAIN or word.partition("=")[0] in _VALUED:
            skip = not skip and word in _VALUED
            continue
        kept.append(word)
    content = json.dumps(scene.content, default=str)
    return {
        "command": shlex.join(["isorod", "sweep", *kept]),
        "petsc_options": " ".join(theirs),
        "file": hashlib.sha256(content.encode()).hexdigest() if scene.content else None,
        "versions": results.provenance()["versions"],
    }


def _is_speed(scene: Any, varied: Mapping[str, Any]) -> bool:
    """Return whether the first varied option alone gives the velocity of a spin in modal analysis."""
    name, (first, *rest) = "spin.velocity.", varied
    if scene.analysis != "modal" or not first.startswith(name) or not scene.content:
        return False
    others = [one for k, one in enumerate(scene.content["spin"]["velocity"]) if f"{name}{k}" != first]
    return not any(others) and not any(one.startswith(name) for one in rest)


def _warn_of_commits(records: Mapping[int, Mapping[str, Any]]) -> None:
    """Warn of points that another commit has solved."""
    from isorod.output import results

    here = results.provenance()["commit"]
    others = sorted({str(one.get("commit")) for one in records.values() if one.get("commit") != here})
    if others:
        warnings.warn(f"points that are there are of commit {', '.join(others)}; this is {here}", stacklevel=2)


def _print(records: Mapping[int, Mapping[str, Any]], args: argparse.Namespace, seconds: float, before: int) -> None:
    """Print the table, unless JSON was asked for, and warnings."""
    if not args.json:
        for line in table([records[k] for k in sorted(records)]):
            print(line)
        print(_summary(records, seconds, before))
        sys.stdout.flush()
    notes.show()
    warned = [(text, one["sweep"]["values"]) for one in records.values() for text in one["sweep"]["warnings"]]
    for text, values in warned[:_WARNINGS]:
        at = ", ".join(f"{name} {value}" for name, value in values.items())
        print(f"isorod: warning: {at}: {text}", file=sys.stderr)
    if warned[_WARNINGS:]:
        print(f"isorod: warning: {len(warned) - _WARNINGS} more warnings are in the records", file=sys.stderr)


def table(records: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the lines of a table for people."""
    from isorod.command import sheet

    rows = []
    for record in records:
        row = sheet.columns(record)
        status, error = row.pop("status"), row.pop("error_estimate", None)
        row = {name: value for name, value in row.items() if _shown(name)}
        if error is not None:
            row["error"] = percent(float(error)) if error else ""
        if record.get("newton_iterations"):
            row["Newton"] = str(record["newton_iterations"])
        rows.append(row | ({} if status == sheet.SOLVED else {"status": status}))
    names = list(dict.fromkeys(name for row in sorted(rows, key=len, reverse=True) for name in row if name != "status"))
    widths = {name: max(len(name), *(len(row.get(name, "")) for row in rows)) for name in names}
    head = {name: name.replace("_", " ") for name in names}
    for row in [head | ({"status": "status"} if any("status" in row for row in rows) else {}), *rows]:
        cells = (row.get(name, "").rjust(width) for name, width in widths.items())
        yield "  ".join([*cells, row.get("status", "")]).rstrip()


def _shown(name: str) -> bool:
    """Return whether people are shown a column: of a list only the first few entries."""
    entry = re.search(r"\[(\d+)\]$", name)
    return name != "unknowns" and not (entry and int(entry[1]) >= _ENTRIES)


def _summary(records: Mapping[int, Mapping[str, Any]], seconds: float, before: int) -> str:
    """Return in a line how many points there are, how long they took, and Newton's iterations."""
    parts = [f"{len(records)} points in {duration(seconds)}" + (f", {before} of them there before" if before else "")]
    counts = [one["newton_iterations"] for one in records.values() if one.get("newton_iterations")]
    parts += [f"{sum(counts) / len(counts):.2g} Newton iterations each"] if counts else []
    return "; ".join(parts)
