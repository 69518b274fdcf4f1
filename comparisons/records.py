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
        If a line is not JSON.
    """
    path = folder / f"{study}.jsonl"
    records: list[Record] = []
    for number, text in enumerate(path.read_text().splitlines(), 1):
        try:
            records.append(json.loads(text))
        except ValueError:
            raise InputError(f"results {path}: line {number} is not JSON; remove it") from None
    runs = [record["run"] for record in records if record["part"] == "end"]
    return [record for record in records if runs and record["run"] == runs[-1]]


def part(records: list[Record], name: str) -> list[Record]:
    """Return the records of one part."""
    return [record for record in records if record["part"] == name]
