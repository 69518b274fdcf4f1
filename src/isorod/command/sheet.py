"""The files of a sweep: the records of its points, one line of JSON each, and the table that is made of them."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from isorod.errors import InputError, SolveError
from isorod.output import results

# Digits of numbers in a table: Newton's iterations end with forces that balance to 1e-9.
DIGITS = 7

# Errors have two digits, and those below this are 0.
NO_ERROR = 1e-9

SOLVED = "solved"

# Results with one number per mode; any other three numbers are a vector.
_LISTS = ("frequencies", "factors")

Records = dict[int, dict[str, Any]]


def cells(values: Sequence[float]) -> list[str]:
    """Return numbers as they stand in a table: with `DIGITS` digits, of several as many places as the largest has."""
    largest = max(map(abs, values), default=0.0)
    places = DIGITS - 1 - math.floor(math.log10(largest)) if largest else 0
    # Zeros without a sign.
    return [f"{round(value, places) + 0.0:.{DIGITS}g}" for value in values]


def columns(record: Mapping[str, Any]) -> dict[str, str]:
    """Return the row of a point by column; of time histories the last values."""
    sweep = record["sweep"]
    row = dict(sweep["values"])
    for name in sweep.get("units", ()):
        if name in record:
            value = np.asarray(record[name], dtype=float)
            moving = "times" in record and value.shape[:1] == np.shape(record["times"])
            values = np.ravel(value[-1] if moving else value).tolist()
            single = value.ndim == 0 or len(values) == 1
            parts = "xyz" if value.shape[-1:] == (3,) and name not in _LISTS else [*map(str, range(len(values)))]
            names = [name] if single else [f"{name}[{k}]" for k in parts]
            row |= zip(names, cells(values), strict=True)
    if sweep.get("estimated"):
        error = record.get("error_estimate")
        row["error_estimate"] = "" if error is None else f"{error if error >= NO_ERROR else 0.0:.2g}"
    return row | {"unknowns": str(record.get("unknowns", "")), "status": sweep["status"]}


def table(records: Records, notes: Sequence[str]) -> bytes:
    """Return the table of all points, below notes and what is varied as lines that begin with ``#``."""
    rows = [columns(records[k]) for k in sorted(records)]
    # The length of lists may depend on a varied parameter: the longest row has all columns.
    names = [*max(rows, key=len)]
    varied = results.row(list(records[min(records)]["sweep"]["values"])).decode()
    head = "".join(f"# {one}\n" for one in notes) + f"# varied: {varied}"
    lines = [names, *([row.get(name, "") for name in names] for row in rows)]
    return head.encode() + b"".join(map(results.row, lines))


@contextmanager
def attempted(about: dict[str, Any], named: Callable[[str], str] = str) -> Iterator[list[str]]:
    """Solve a point or a load case within: ``about["status"]`` becomes its outcome, of errors ``named``, in one line.

    The list that is given has the warnings in the end, each once and on one line.
    """
    texts: list[str] = []
    about["status"] = SOLVED
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            yield texts
        except (InputError, SolveError) as problem:
            kind = "refused" if isinstance(problem, InputError) else "failed"
            about["status"] = f"{kind}: {named(' '.join(str(problem).split()))}"
    texts += dict.fromkeys(" ".join(str(one.message).split()) for one in warned)


def records_of(path: str) -> Path:
    """Return the file of the records that belongs to a table."""
    return Path(path).with_suffix(".jsonl")


def read(path: str, identity: Mapping[str, Any], overwrite: bool) -> Records:
    """Return the records that are there, by the number of the point.

    Parameters
    ----------
    path
        Of the table; its name ends in ``.csv``.
    identity
        What identifies a sweep: entries of all its records, at the top or in ``sweep``.
    overwrite
        Remove what is there.

    Raises
    ------
    InputError
        If the files cannot be written, or are not of this sweep.
    """
    if Path(path).suffix != ".csv":
        raise InputError(f"output {path}: the name of a sweep's table ends in .csv")
    results.check_folder(str(Path(path).parent))
    kept = records_of(path)
    records: Records = {}
    if overwrite:
        for one in (Path(path), kept):
            try:
                one.unlink(missing_ok=True)
            except OSError as problem:
                raise results.refusal(f"{one}: cannot be written", problem) from None
    elif not kept.exists() and Path(path).exists():
        raise _other(f"{path} is there, without the records of a sweep ({kept.name})")
    if not kept.exists():
        return records
    for number, record in enumerate(results.read(kept), 1):
        sweep = record.get("sweep")
        if not isinstance(sweep, dict) or not {"point", "values", "status"} <= sweep.keys():
            raise _other(f"{kept}:{number} is no record of a sweep")
        for name, here in identity.items():
            there = record.get(name, sweep.get(name))
            if there != here:
                raise _other(f"{kept} is of another sweep ({name}: {there}; here {here})")
        records[sweep["point"]] = record
    return records


def _other(what: str) -> InputError:
    return InputError(f"{what}; name another, or begin anew with --overwrite")
