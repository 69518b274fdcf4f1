"""The files of a sweep: a table of its points as CSV, and beside it their records, of which the table is made."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.output import results

# Digits of numbers in a table: Newton's iterations end with forces that balance to 1e-9.
DIGITS = 7

# Errors are told by two digits, and those below this as 0.
NO_ERROR = 1e-9

SOLVED = "solved"


def answers(record: Mapping[str, Any]) -> dict[str, list[float]]:
    """Return the numbers that are the answer of a record of a sweep; of what is over time those at the end."""
    found = {}
    for name in record["sweep"].get("units", ()):
        if name in record:
            value = np.asarray(record[name], dtype=float)
            moving = "times" in record and value.shape[:1] == np.shape(record["times"])
            found[name] = [float(one) for one in np.ravel(value[-1] if moving else value)]
    return found


def cells(values: Sequence[float]) -> list[str]:
    """Return numbers as they stand in a table: with `DIGITS` digits, of several as many places as the largest has."""
    largest = max(map(abs, values), default=0.0)
    return [_cell(one, DIGITS - _exponent(largest) + _exponent(one)) if one else "0" for one in values]


def _cell(value: float, digits: int) -> str:
    return f"{value:.{digits}g}" if digits > 0 else "0"


def _exponent(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def error(value: float) -> str:
    """Return an estimate of an error as it stands in a table."""
    return f"{value if value >= NO_ERROR else 0.0:.2g}"


def columns(record: Mapping[str, Any]) -> dict[str, str]:
    """Return what a table says of a point, by column."""
    sweep = record["sweep"]
    found = dict(sweep["values"])
    for name, values in answers(record).items():
        names = (
            [name] if np.ndim(record[name]) == 0 or len(values) == 1 else [f"{name}[{k}]" for k in range(len(values))]
        )
        found |= zip(names, cells(values), strict=True)
    if sweep.get("estimated"):
        found["error_estimate"] = error(record["error_estimate"]) if "error_estimate" in record else ""
    return found | {"unknowns": str(record.get("unknowns", "")), "status": sweep["status"]}


class Sheet:
    """The points of a sweep that are there, kept in two files if one is named.

    Parameters
    ----------
    path
        Of the table; its name ends in ``.csv``, and that of the records, one line of JSON a point, in ``.jsonl``.
        Nothing is written before the first point is there.  None: nothing is kept.
    sweep
        What all records say of the sweep, and by which it is known again.
    notes
        Lines at the head of the table.
    overwrite
        Begin anew, whatever is there.

    Attributes
    ----------
    records
        By the number of the point.

    Raises
    ------
    InputError
        If the files cannot be written, or are those of something else.
    """

    def __init__(self, path: str | None, sweep: Mapping[str, Any], notes: Sequence[str], overwrite: bool) -> None:
        self.records: dict[int, dict[str, Any]] = {}
        self._sweep, self._notes = sweep, notes
        self._path = None if path is None else Path(path)
        if self._path is None:
            return
        if self._path.suffix != ".csv":
            raise InputError(f"output {path}: the name of a sweep's table ends in .csv")
        results.check_folder(str(self._path.parent))
        self._lines = self._path.with_suffix(".jsonl")
        if overwrite:
            for one in (self._path, self._lines):
                with _refused(one):
                    one.unlink(missing_ok=True)
        elif self._lines.exists():
            self._resume()
        elif self._path.exists():
            raise _other(f"{self._path} is there, without the records of a sweep ({self._lines.name})")

    def add(self, record: Mapping[str, Any]) -> None:
        """Add a point, and have the disk take its record; raises `InputError` if it cannot."""
        about = {name: one for name, one in self._sweep.items() if name not in record}
        whole = {**record, "sweep": {**about, **record["sweep"]}}
        # As it will be read.
        self.records[record["sweep"]["point"]] = json.loads(results.line(whole))
        if self._path is not None:
            results.make_folder(str(self._path.parent))
            results.append(self._lines, whole)

    def write(self) -> None:
        """Write the table of the points that are there."""
        if self._path is None or not self.records:
            return
        rows = [columns(self.records[k]) for k in sorted(self.records)]
        # Points have answers of their own where lists are as long as something that is varied.
        names = list(rows[max(range(len(rows)), key=lambda k: len(rows[k]))])
        head = "".join(f"# {one}\n" for one in self._notes).encode()
        lines = (results.row([row.get(name, "") for name in names]) for row in rows)
        results.write_whole(self._path, head + results.row(names) + b"".join(lines))

    def _resume(self) -> None:
        """Read the points that are there."""
        with _refused(self._lines):
            lines = self._lines.read_bytes().splitlines()
        for number, line in enumerate(lines, 1):
            record = _record(line)
            if record is None:
                if number == len(lines) and results.is_torn(line):
                    # Of a run that was killed: `results.append` takes it off.
                    continue
                raise _other(f"{self._lines}:{number} is no record of a sweep")
            known = {**record, **record["sweep"]}
            differs = next((key for key, one in self._sweep.items() if known.get(key) != one), None)
            if differs is not None:
                there, here = known.get(differs), self._sweep[differs]
                raise _other(f"{self._lines} is of another sweep ({differs}: {there}; here {here})")
            self.records[record["sweep"]["point"]] = record


@contextmanager
def _refused(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as problem:
        raise results.refusal(f"{path}: cannot be written", problem) from None


def _other(what: str) -> InputError:
    return InputError(f"{what}; name another, or begin anew with --overwrite")


def _record(line: bytes) -> dict[str, Any] | None:
    """Return a record of a sweep, None if it is none."""
    try:
        record = json.loads(line)
        return record if {"point", "values", "status"} <= record["sweep"].keys() else None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
