"""Tables of numbers in text files, one row per line."""

import math
import re
from collections.abc import Callable, Iterable
from typing import NamedTuple


class Row(NamedTuple):
    """A line of a file: its number, its text, and the values of its words, NaN where one is not a number."""

    line: int
    text: str
    values: list[float]

    @property
    def wrong(self) -> int:
        """Number, from 1, of the first word that is not a finite number; 0 if there is none."""
        return next((k for k, value in enumerate(self.values, 1) if not math.isfinite(value)), 0)


def read(content: bytes, counts: Callable[[Iterable[bool]], bool] = any) -> tuple[list[str], list[Row]]:
    """Return the words of a first line that is a heading, and the rows below it.

    Values are separated by a comma, a semicolon or blanks; empty lines and what follows a ``#`` are left out.

    Parameters
    ----------
    content
        Of the file, UTF-8.
    counts
        Returns whether the first line is a row, from which of its words are numbers.

    Raises
    ------
    UnicodeDecodeError
        If it is not text.
    """
    heading: list[str] = []
    rows: list[Row] = []
    for line, content_line in enumerate(content.decode("utf-8-sig").splitlines(), 1):
        text = content_line.partition("#")[0].strip()
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
