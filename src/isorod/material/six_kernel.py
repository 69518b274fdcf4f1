"""Symmetric tensors at the points of a block, compiled: six numbers each, 00, 01, 02, 11, 12, 22, in rows."""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import bits, number
from isorod.material.points import GRADIENT, POINTS, ROWS

# Numbers of the components of a symmetric tensor, and how often each counts in a sum over all nine.
PLACE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
FIRST, SECOND = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])
TWICE = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])

_W = np.uint64(POINTS)

Six = tuple[float, float, float, float, float, float]


@njit(**FAST)
def at(row: int) -> Any:
    """Return the offset of a row: a constant, so that the compiler knows that rows do not overlap."""
    return np.uint64(POINTS * row)


@njit(**FAST)
def six(rows: Array, row: int, k: Any) -> Six:
    """Return a symmetric tensor at a point from rows from ``row`` on."""
    n = at(row) + k
    return (
        rows[n],
        rows[n + ROWS[1]],
        rows[n + ROWS[2]],
        rows[n + ROWS[3]],
        rows[n + ROWS[4]],
        rows[n + ROWS[5]],
    )


@njit(**FAST)
def put_six(rows: Array, row: int, k: Any, a: Six) -> None:
    """Fill in a symmetric tensor at a point."""
    n = at(row) + k
    rows[n], rows[n + ROWS[1]], rows[n + ROWS[2]] = a[0], a[1], a[2]
    rows[n + ROWS[3]], rows[n + ROWS[4]], rows[n + ROWS[5]] = a[3], a[4], a[5]


@njit(**FAST)
def gradient(work: Array, k: Any) -> tuple[float, ...]:
    """Return the nine components of ``F`` at a point."""
    return (
        work[ROWS[GRADIENT] + k],
        work[ROWS[GRADIENT + 1] + k],
        work[ROWS[GRADIENT + 2] + k],
        work[ROWS[GRADIENT + 3] + k],
        work[ROWS[GRADIENT + 4] + k],
        work[ROWS[GRADIENT + 5] + k],
        work[ROWS[GRADIENT + 6] + k],
        work[ROWS[GRADIENT + 7] + k],
        work[ROWS[GRADIENT + 8] + k],
    )


@njit(**FAST)
def squares(f: tuple[float, ...]) -> Six:
    """Return ``F^T F``."""
    return (
        f[0] * f[0] + f[3] * f[3] + f[6] * f[6],
        f[0] * f[1] + f[3] * f[4] + f[6] * f[7],
        f[0] * f[2] + f[3] * f[5] + f[6] * f[8],
        f[1] * f[1] + f[4] * f[4] + f[7] * f[7],
        f[1] * f[2] + f[4] * f[5] + f[7] * f[8],
        f[2] * f[2] + f[5] * f[5] + f[8] * f[8],
    )


@njit(**FAST)
def combined(x: float, a: Six, y: float, b: Six, z: float, c: Six) -> Six:
    """Return ``x a + y b + z c``."""
    return (
        x * a[0] + y * b[0] + z * c[0],
        x * a[1] + y * b[1] + z * c[1],
        x * a[2] + y * b[2] + z * c[2],
        x * a[3] + y * b[3] + z * c[3],
        x * a[4] + y * b[4] + z * c[4],
        x * a[5] + y * b[5] + z * c[5],
    )


@njit(**FAST)
def product(a: Six, b: Six) -> tuple[float, ...]:
    """Return the nine components of ``a b``."""
    return (
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
        a[0] * b[1] + a[1] * b[3] + a[2] * b[4],
        a[0] * b[2] + a[1] * b[4] + a[2] * b[5],
        a[1] * b[0] + a[3] * b[1] + a[4] * b[2],
        a[1] * b[1] + a[3] * b[3] + a[4] * b[4],
        a[1] * b[2] + a[3] * b[4] + a[4] * b[5],
        a[2] * b[0] + a[4] * b[1] + a[5] * b[2],
        a[2] * b[1] + a[4] * b[3] + a[5] * b[4],
        a[2] * b[2] + a[4] * b[4] + a[5] * b[5],
    )


@njit(**FAST)
def symmetric(a: Six, u: tuple[float, ...]) -> Six:
    """Return ``a u`` if it is known to be symmetric."""
    return (
        a[0] * u[0] + a[1] * u[3] + a[2] * u[6],
        a[0] * u[1] + a[1] * u[4] + a[2] * u[7],
        a[0] * u[2] + a[1] * u[5] + a[2] * u[8],
        a[1] * u[1] + a[3] * u[4] + a[4] * u[7],
        a[1] * u[2] + a[3] * u[5] + a[4] * u[8],
        a[2] * u[2] + a[4] * u[5] + a[5] * u[8],
    )


@njit(**FAST)
def double(a: Six, b: Six) -> float:
    """Return ``a : b``."""
    return a[0] * b[0] + a[3] * b[3] + a[5] * b[5] + 2.0 * (a[1] * b[1] + a[2] * b[2] + a[4] * b[4])


@njit(**FAST)
def inverted(a: Six) -> tuple[Six, float]:
    """Return the inverse of a symmetric tensor and its determinant."""
    b0, b1, b2 = a[3] * a[5] - a[4] * a[4], a[2] * a[4] - a[1] * a[5], a[1] * a[4] - a[2] * a[3]
    det = a[0] * b0 + a[1] * b1 + a[2] * b2
    x = 1.0 / det
    b3, b4, b5 = a[0] * a[5] - a[2] * a[2], a[1] * a[2] - a[0] * a[4], a[0] * a[3] - a[1] * a[1]
    return (x * b0, x * b1, x * b2, x * b3, x * b4, x * b5), det


@njit(**FAST)
def trace_of(u: tuple[float, ...], v: tuple[float, ...]) -> float:
    """Return the trace of the product of two tensors of nine components."""
    total = u[0] * v[0] + u[4] * v[4] + u[8] * v[8] + u[1] * v[3] + u[3] * v[1]
    return total + u[2] * v[6] + u[6] * v[2] + u[5] * v[7] + u[7] * v[5]


@njit(**FAST)
def largest(rows: Array, row: int) -> float:
    """Return the largest of the numbers in a row, none of which is negative, or NaN where one is not a number."""
    # Their bits are in the same order, and the maximum of integers is a vector instruction.
    best = bits(0.0)
    for k in range(_W):
        best = max(best, bits(rows[at(row) + k]))
    return number(best)


@njit(**FAST)
def least(rows: Array, row: int) -> float:
    """Return the smallest of the numbers in a row, none of which is negative."""
    best = bits(np.inf)
    for k in range(_W):
        best = min(best, bits(rows[at(row) + k]))
    return number(best)


@njit(**FAST)
def put_first(work: Array, k: Any, s: Six, valid: float) -> None:
    """Fill the rows of ``P`` at a point from the second Piola-Kirchhoff stress, times a number."""
    f = gradient(work, k)
    _put_row(work, 0, k, f[0], f[1], f[2], s, valid)
    _put_row(work, 3, k, f[3], f[4], f[5], s, valid)
    _put_row(work, 6, k, f[6], f[7], f[8], s, valid)


@njit(**FAST)
def _put_row(work: Array, row: int, k: Any, x: float, y: float, z: float, s: Six, valid: float) -> None:
    """Fill in a row of ``P`` at a point from that of ``F``."""
    work[ROWS[row] + k] = valid * (x * s[0] + y * s[1] + z * s[2])
    work[ROWS[row + 1] + k] = valid * (x * s[1] + y * s[3] + z * s[4])
    work[ROWS[row + 2] + k] = valid * (x * s[2] + y * s[4] + z * s[5])
