"""Tables of numbers in text files, a row a line."""

import math
import re
from collections.abc import Callable, Iterable
from typing import NamedTuple


class Row(NamedTuple):
    """A line of a file: its number, its text, and the values of its words, NaN where one is no number."""

    line: int
    text: str
    values: list[float]

    @property
    def wrong(self) -> int:
        """Which word, counted from 1, is the first that is no finite number; 0 if none is."""
        return next((k for k, value in enumerate(self.values, 1) if not math.isfinite(value)), 0)


def read(content: bytes, counts: Callable[[Iterable[bool]], bool] = any) -> tuple[list[str], list[Row]]:
    """Return the words of a first line that is a heading, and the rows below it.

    Between values stands a comma, a semicolon or blanks; empty lines and what follows a ``#`` are left out.

    Parameters
    ----------
    content
        Of the file, UTF-8.
    counts
        Says by which of its words are numbers whether the first line is a row.

    Raises
    ------
    UnicodeDecodeError
        If it is no text.
    """
    heading: list[str] = []
    rows: list[Row] = []
    for line, whole in enumerate(content.decode("utf-8-sig").splitlines(), 1):
        text = whole.partition("#")[0].strip()
        words = [word for word in re.split(r"\s*[,;]\s*|\s+", text) if word]
        values = [_number(word) for word in words]
        if rows or heading or counts(not math.isnan(value) for value in values):
            rows += [Row(line, text, values)] if words else []
        else:
            heading = words
    return heading, rows


def _number(word: str) -> float:
    try:
        return math.nan if "_" in word else float(word)
    except ValueError:
        return math.nan
