"""Outlines of sections from files: points ``x, y``, or an airfoil in one of the two orders in use."""

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry import table
from isorod.geometry.table import Row

# If both numbers of a line are above this, they are not a point on an airfoil of chord 1, but the numbers of points of
# its two sides.
_COUNTS = 1.5


def read(path: str | Path) -> Array:
    """Return the points ``(m, 2)`` of a closed outline, the first not repeated.

    Lines hold two numbers, between them a comma, a semicolon or blanks; empty ones and what follows a ``#`` are
    skipped, and so is a first line of words, where an airfoil's name may have numbers.  A file that ends in ``.dat`` is
    an airfoil of chord 1: round its outline from the trailing edge (Selig's order), or, after a line with two counts,
    the upper and then the lower side, both from the leading edge (Lednicer's).  A clockwise airfoil is reversed;
    repeated points are left out.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is not two finite numbers: the message names file and line.
    """
    path = Path(path)
    airfoil = path.suffix.lower() == ".dat"
    rows = _rows(path, all if airfoil else any)
    if airfoil and rows and min(rows[0].values) > _COUNTS:
        rows = _joined(path, rows)
    points = np.array([row.values for row in rows]).reshape(-1, 2)
    points = points[(points != np.roll(points, -1, axis=0)).any(axis=1)]
    if points.shape[0] < 3:
        raise InputError(f"{path}: got {points.shape[0]} different points, an outline needs at least 3")
    after = np.roll(points, -1, axis=0)
    clockwise = np.sum(points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]) < 0.0
    # The first point stays the first.
    return np.roll(points[::-1], 1, axis=0) if airfoil and clockwise else points


def _rows(path: Path, counts: Callable[[Iterable[bool]], bool]) -> list[Row]:
    """Return the rows of two numbers; ``counts`` tells if the first line is one (`isorod.geometry.table.read`)."""
    try:
        _, rows = table.read(path.read_bytes(), counts)
    except OSError as problem:
        raise InputError(f"{path}: {problem.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file; need lines of two numbers x, y") from None
    for row in rows:
        if row.wrong or len(row.values) != 2:
            raise InputError(f"{path}: line {row.line}: got {row.text!r:.60}, need two finite numbers x, y")
    return rows


def _joined(path: Path, rows: Sequence[Row]) -> list[Row]:
    """Return points in Lednicer's order as an outline, from the trailing edge over the upper side."""
    (upper, lower), points = rows[0].values, list(rows[1:])
    where = f"{path}: line {rows[0].line}:"
    if not (upper.is_integer() and lower.is_integer()):
        raise InputError(
            f"{where} got {upper:g} {lower:g}, need how many points the two sides have, or a point of an airfoil of "
            "chord 1"
        )
    if len(points) != upper + lower:
        raise InputError(f"{where} says {upper:g} and {lower:g} points, but {len(points)} follow")
    return points[: int(upper)][::-1] + points[int(upper) :]
