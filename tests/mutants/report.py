"""What is printed of the mutants tried."""

from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Any

Record = dict[str, Any]
CAUGHT = {"caught", "timeout"}


def line(record: Record) -> str:
    """Return one mutant in a line, with the change in two more where nothing noticed it."""
    text = f"{record['how']:9} {record['seconds']:5.0f} s  {record['path']}:{record['line']}  {record['operator']}"
    if record["how"] in CAUGHT:
        return f"{text}  {record['by']}"
    left = f"; {record['left_out']} left out" if record["left_out"] else ""
    return f"{text}  {record['tests']} tests{left}\n    - {record['before']}\n    + {record['after']}"


def summary(records: Sequence[Record], run: Record, dropped: Sequence[str]) -> str:
    """Return the survivors, the score by folder and by operator, and the score."""
    alive = sorted((one for one in records if one["how"] not in CAUGHT), key=lambda one: (one["path"], one["line"]))
    parts = ["", "Not noticed:", *(line(one) for one in alive), ""]
    parts += _table("folder", records, lambda one: str(PurePath(one["path"]).parent))
    parts += _table("operator", records, lambda one: one["operator"])
    if dropped:
        parts += [f"Left out, as they did not pass in the copy: {', '.join(dropped)}", ""]
    late = sum(one["how"] == "timeout" for one in records)
    never = sum(one["how"] == "unreached" for one in records)
    score = _share(records)
    parts += [
        f"{len(records)} of {run['population']} mutants, drawn evenly from all that mutmut's operators make "
        f"(seed {run['seed']}),",
        f"each against the tests that reach its line, at most {run['budget']:g} s of them, quickest first:",
        f"{score} caught, {late} of them by a test that did not end; "
        f"{never} of the others are in lines that no test runs",
    ]
    return "\n".join(parts)


def _table(title: str, records: Sequence[Record], key: Callable[[Record], str]) -> list[str]:
    rows = [f"{title:32} caught"]
    for name in sorted({key(one) for one in records}):
        rows.append(f"{name:32} {_share([one for one in records if key(one) == name])}")
    return [*rows, ""]


def _share(records: Sequence[Record]) -> str:
    caught = sum(one["how"] in CAUGHT for one in records)
    return f"{caught} of {len(records)} ({100 * caught / max(1, len(records)):.0f} %)"
