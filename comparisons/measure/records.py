"""Reading results back: the newest run of a study."""

import json
from pathlib import Path
from typing import Any

from isorod.errors import InputError

Record = dict[str, Any]


def newest(folder: Path, study: str) -> list[Record]:
    """Return the records of the newest complete run of a study, in order; none if there is no complete run.

    A run is complete when it has its closing record (part ``"end"``).

    Raises
    ------
    InputError
        If the file cannot be read, or a line is no record of a study.
    """
    path = folder / f"{study}.jsonl"
    records: list[Record] = []
    try:
        lines = path.read_bytes().splitlines()
    except OSError as problem:
        raise InputError(f"results {path}: cannot be read ({problem.strerror})") from None
    for number, text in enumerate(lines, 1):
        try:
            record = json.loads(text, parse_constant=_refuse)
            record["run"], record["part"]
        except (ValueError, KeyError, TypeError, RecursionError):
            raise InputError(f"results {path}: line {number} is not JSON, or no record of a study; remove it") from None
        records.append(record)
    runs = [record["run"] for record in records if record["part"] == "end"]
    return [record for record in records if runs and record["run"] == runs[-1]]


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is no result")


def is_ours(record: Record) -> bool:
    """Whether a run is isorod's."""
    return bool(record["method"] == "cylindrical")


def family(record: Record) -> str:
    """Return which family of elements a run of isorod was made with (`isorod.space.basis.FAMILIES`)."""
    return " and ".join(dict.fromkeys(one["family"] for one in record["discretisation"]))


def side(record: Record) -> str:
    """Return the program of a run: isorod and its family of elements, or dolfinx and its version."""
    return f"isorod, {family(record)}" if is_ours(record) else f"dolfinx {version(record)}"


def version(record: Record) -> str:
    """Return the version of dolfinx that a run was made with; empty if it has none."""
    return str(record["versions"].get("dolfinx", "")).partition(".post")[0]


def part(records: list[Record], name: str) -> list[Record]:
    """Return the records of one part."""
    return [record for record in records if record["part"] == name]
