"""Outlines of sections from files: points ``x, y``, or an airfoil in one of the two orders in use."""

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError

# Above this, both numbers of a line are no place on an airfoil of chord 1, but how many points its two sides have.
_COUNTS = 1.5


class Row(NamedTuple):
    """Two numbers of a file, and the line they are on."""

    line: int
    x: float
    y: float


def read(path: str | Path) -> Array:
    """Return the points ``(m, 2)`` of a closed outline, the first not repeated.

    Lines hold two numbers, between them a comma, a semicolon or blanks; empty ones and what follows a ``#`` are
    skipped, and so is a first line of words, among which an airfoil's name may have numbers.  What ends in ``.dat`` is
    an airfoil of chord 1: round its outline from the trailing edge (Selig's order), or, after a line with two counts,
    the upper and then the lower side, both from the leading edge (Lednicer's).  An airfoil that runs clockwise is
    turned round; points that repeat the one before are left out.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is not two finite numbers: the message names file and line.
    """
    path = Path(path)
    airfoil = path.suffix.lower() == ".dat"
    rows = _rows(path, all if airfoil else any)
    if airfoil and rows and min(rows[0].x, rows[0].y) > _COUNTS:
        rows = _joined(path, rows)
    points = np.array([(row.x, row.y) for row in rows]).reshape(-1, 2)
    points = points[(points != np.roll(points, -1, axis=0)).any(axis=1)]
    if points.shape[0] < 3:
        raise InputError(f"{path}: got {points.shape[0]} different points, an outline needs at least 3")
    after = np.roll(points, -1, axis=0)
    clockwise = np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]) < 0.0
    # The first stays first.
    return np.roll(points[::-1], 1, axis=0) if airfoil and clockwise else points


def _rows(path: Path, counts: Callable[[Iterable[bool]], bool]) -> list[Row]:
    """Return the numbers of all lines but empty ones, and a first one where it does not count which words are some."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as problem:
        raise InputError(f"{path}: {problem.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file; need lines of two numbers x, y") from None
    rows: list[Row] = []
    first = True
    for line, content in enumerate(text.splitlines(), 1):
        words = [word for word in re.split(r"[,;\s]+", content.split("#")[0].strip()) if word]
        if not words:
            continue
        numbers = [_number(word) for word in words]
        found = [number for number in numbers if number is not None and np.isfinite(number)]
        if len(found) == len(numbers) == 2:
            rows.append(Row(line, *found))
        elif not first or counts(number is not None for number in numbers):
            raise InputError(f"{path}: line {line}: got {content.strip()!r:.60}, need two finite numbers x, y")
        first = False
    return rows


def _number(word: str) -> float | None:
    """Return the number that a word is, or None if it is none."""
    try:
        return float(word)
    except ValueError:
        return None


def _joined(path: Path, rows: Sequence[Row]) -> list[Row]:
    """Return the points of Lednicer's order round the outline, from the trailing edge over the upper side."""
    counts, points = rows[0], list(rows[1:])
    if not (counts.x.is_integer() and counts.y.is_integer()):
        raise InputError(
            f"{path}: line {counts.line}: got {counts.x:g} {counts.y:g}, need how many points the two sides have, or a "
            "point of an airfoil of chord 1"
        )
    upper = int(counts.x)
    if len(points) != upper + int(counts.y):
        raise InputError(
            f"{path}: line {counts.line}: says {upper} and {int(counts.y)} points, but {len(points)} follow"
        )
    return points[:upper][::-1] + points[upper:]
