"""The files of a sweep: a table of its points as CSV, and beside it their records, of which the table is made."""

import fcntl
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.output import results

# Digits of numbers in a table.  Newton's iterations end with forces that balance to 1e-9: wherever they began, numbers
# are the same to that.
DIGITS = 7
EXACT = 1e-9

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


def are_clear(values: Sequence[float]) -> bool:
    """Return whether numbers that are larger or smaller by as much as they are not exact stand so in a table too."""
    margin = EXACT * max(map(abs, values), default=0.0)
    return cells([one - margin for one in values]) == cells([one + margin for one in values])


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
        self._columns: list[str] = []
        self._file: FileIO | None = None
        self._path = None if path is None else Path(path)
        if self._path is None:
            return
        if self._path.suffix != ".csv":
            raise InputError(f"output {path}: the name of a sweep's table ends in .csv")
        results.check_folder(str(self._path.parent))
        self._lines = self._path.with_suffix(".jsonl")
        if overwrite:
            with self._refused(self._path):
                for one in (self._path, self._lines):
                    one.unlink(missing_ok=True)
        elif self._lines.exists():
            self._resume(self._lines)
        elif self._path.exists():
            raise self._other(f"{self._path} is there, without the records of a sweep ({self._lines.name})")

    def add(self, record: Mapping[str, Any]) -> None:
        """Add a point, and have the disk take it; raises `InputError` if it cannot."""
        told = {name: one for name, one in self._sweep.items() if name not in record}
        line = results.line({**record, "sweep": {**told, **record["sweep"]}})
        # As it will be read.
        whole: dict[str, Any] = json.loads(line)
        if self._path is not None:
            self._append(line)
        self.records[whole["sweep"]["point"]] = whole
        if self._path is not None:
            row = self._row(whole)
            if row is None:
                results.write_whole(self._path, self._table())
            else:
                with self._refused(self._path), open(self._path, "ab") as table:
                    table.write(row)
                    table.flush()
                    os.fsync(table.fileno())

    def _append(self, line: str) -> None:
        """Append a record, all of it or nothing."""
        with self._refused(self._lines):
            if self._file is None:
                results.make_folder(str(self._lines.parent))
                self._file = self._opened(self._lines, "x+b")
            size = self._file.seek(0, os.SEEK_END)
            try:
                results.add(self._file, line)
                os.fsync(self._file.fileno())
            except BaseException:
                self._file.truncate(size)
                raise

    def _row(self, record: Mapping[str, Any]) -> bytes | None:
        """Return the line of a record in the table, None if the table so far has not all of its columns."""
        row = columns(record)
        if not row.keys() <= {*self._columns}:
            return None
        return results.row([row.get(name, "") for name in self._columns])

    def _table(self) -> bytes:
        """Return the whole table."""
        rows = [columns(self.records[k]) for k in sorted(self.records)]
        # Points have answers of their own where lists are as long as something that is varied.
        self._columns = list(rows[max(range(len(rows)), key=lambda k: len(rows[k]))])
        head = "".join(f"# {one}\n" for one in self._notes).encode()
        lines = ([row.get(name, "") for name in self._columns] for row in rows)
        return head + results.row(self._columns) + b"".join(map(results.row, lines))

    def _resume(self, path: Path) -> None:
        """Read the points that are there, and make the table one of these."""
        with self._refused(path):
            self._file = self._opened(path, "r+b")
            results.mend(self._file, path)
            self._file.seek(0)
            for number, line in enumerate(self._file.readall().splitlines(), 1):
                record = _record(line)
                if record is None:
                    raise self._other(f"{path}:{number} is no record of a sweep")
                known = {**record, **record["sweep"]}
                differs = next((key for key, told in self._sweep.items() if known.get(key) != told), None)
                if differs is not None:
                    there, here = known.get(differs), self._sweep[differs]
                    raise self._other(f"{path} is of another sweep ({differs}: {there}; here {here})")
                self.records[record["sweep"]["point"]] = record
            assert self._path is not None
            written = self._path.read_bytes() if self._path.exists() else b""
        table = self._table() if self.records else b""
        if not table.startswith(written):
            raise self._other(f"{self._path} is not the table of its records ({path.name})")
        if table != written:
            results.write_whole(self._path, table)

    def _opened(self, path: Path, mode: str) -> FileIO:
        file: Any = open(path, mode, buffering=0)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{path}: another sweep is writing there; name another") from None
        return file

    @contextmanager
    def _refused(self, path: Path) -> Iterator[None]:
        try:
            yield
        except OSError as problem:
            raise results.refusal(f"{path}: cannot be written", problem) from None

    @staticmethod
    def _other(what: str) -> InputError:
        return InputError(f"{what}; name another, or begin anew with --overwrite")


def _record(line: bytes) -> dict[str, Any] | None:
    """Return a record of a sweep, None if it is none."""
    try:
        record = json.loads(line)
        return record if {"point", "values", "status"} <= record["sweep"].keys() else None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
