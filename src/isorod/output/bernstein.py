"""Bernstein polynomials on triangles and quadrilaterals, and how they are found from values."""

from functools import lru_cache
from math import comb, factorial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index

# The highest degree of patches: a cell has 512 points at most in VTK's fixed arrays, of degree 6 along the axis too.
HIGHEST = 10
_ROOM = 512 // 7


class Shape(NamedTuple):
    """Bernstein polynomials of patches of one shape.

    Attributes
    ----------
    degrees
        ``(q,)`` of a triangle, along the radius and round the section of a quadrilateral.
    powers
        Index of each polynomial by the corners of a triangle, or the directions of a quadrilateral, ``(m, 2)``.
    samples, checks
        Reference points ``(s, 2)`` from which polynomials are found, and others ``(c, 2)`` up to the edges.
    fit
        Coefficients by values at the samples, ``(m, s)``.
    check
        Polynomials at the other points, ``(c, m)``.
    approximation
        Coefficients by values at the other points, ``(m, c)``.
    near
        Which of the other points are next to where each polynomial is largest, ``(m, c)``.
    corners
        Polynomials that are one at a corner, and which of the other points are there, both ``(corners,)``.
    """

    degrees: tuple[int, ...]
    powers: Index
    samples: Array
    checks: Array
    fit: Array
    check: Array
    approximation: Array
    near: NDArray[np.bool_]
    corners: tuple[Index, Index]


def bernstein(degree: int, t: Array) -> Array:
    """Return the Bernstein polynomials ``(s, degree + 1)`` at parameters ``t`` ``(s,)`` from 0 to 1."""
    k = np.arange(degree + 1)
    choices = np.array([float(comb(degree, i)) for i in range(degree + 1)])
    values: Array = choices * np.power(t[:, None], k) * np.power(1.0 - t[:, None], degree - k)
    return values


def triangular(q: int, powers: Index, reference: Array) -> Array:
    """Return the Bernstein polynomials of a triangle at reference points, shape ``(s, m)``."""
    i, j = powers.T
    k = q - i - j
    a, b = reference[:, :1], reference[:, 1:]
    share = np.array(
        [factorial(q) // (factorial(x) * factorial(y) * factorial(z)) for x, y, z in zip(i, j, k, strict=True)]
    )
    values: Array = share * a**i * b**j * (1.0 - a - b) ** k
    return values


@lru_cache(maxsize=16)
def shape_of(q: int, triangle: bool) -> Shape:
    """Return the polynomials of a triangle of degree ``q``, or of a quadrilateral of that degree round the section."""
    if triangle:
        powers = np.array([(i, j) for j in range(q + 1) for i in range(q + 1 - j)])
        inner, edge = (
            np.array([(i + shift, j + shift) for j in range(m + 1) for i in range(m + 1 - j)]) / (m + 3.0 * shift)
            for m, shift in ((2 * q, 1.0 / 3.0), (2 * q + 1, 0.0))
        )
        values, check = (triangular(q, powers, points) for points in (inner, edge))
        return _shape((q,), powers, inner, edge, values, check)
    across = min(q, _ROOM // (q + 1) - 1)
    powers = np.array([(i, j) for j in range(q + 1) for i in range(across + 1)])

    def tensor(points: tuple[Array, Array]) -> tuple[Array, Array]:
        first, second = np.meshgrid(*points, indexing="ij")
        values = (bernstein(across, first.ravel()), bernstein(q, second.ravel()))
        return np.column_stack([first.ravel(), second.ravel()]), values[0][:, powers[:, 0]] * values[1][:, powers[:, 1]]

    inner, values = tensor((_chebyshev(across + 4), _chebyshev(q + 4)))
    edge, check = tensor((np.linspace(0.0, 1.0, 2 * across + 2), np.linspace(0.0, 1.0, 2 * q + 2)))
    return _shape((across, q), powers, inner, edge, values, check)


def _shape(
    degrees: tuple[int, ...], powers: Index, samples: Array, checks: Array, values: Array, check: Array
) -> Shape:
    whole, at = [degrees[0], degrees[-1]], [powers, checks]
    if len(degrees) == 1:
        # A triangle has a third direction.
        whole, at = (
            whole[:1] * 3,
            [np.column_stack([one, total - one.sum(axis=1)]) for one, total in zip(at, (degrees[0], 1), strict=True)],
        )
    middle = at[0] / whole
    near = np.ones((len(powers), len(checks)), dtype=bool)
    for k, degree in enumerate(whole):
        near &= np.abs(middle[:, None, k] - at[1][:, k]) <= 1.0 / degree + 1e-9
    (corners,) = np.nonzero(np.isin(middle, (0.0, 1.0)).all(axis=1))
    there = np.abs(middle[corners, None] - at[1]).sum(axis=2).argmin(axis=1)
    return Shape(
        degrees, powers, samples, checks, np.linalg.pinv(values), check, np.linalg.pinv(check), near, (corners, there)
    )


def _chebyshev(count: int) -> Array:
    """Return as many zeros of Chebyshev's polynomial, from 0 to 1."""
    return 0.5 - 0.5 * np.cos(np.pi * (np.arange(count) + 0.5) / count)
