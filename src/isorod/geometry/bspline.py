"""B-spline functions at many parameters, and collocation with them."""

from functools import lru_cache

import numpy as np
from scipy.linalg import lapack

from isorod.arrays import Array, Index

# Matrices up to this many knots are cached: runs use the same ones again and again.
_KEPT_SIZE = 2**14


def table(knots: Array, degree: int, u: Array) -> tuple[Index, Array, Array]:
    """Return, for each parameter, the B-splines there.

    Parameters
    ----------
    knots, degree
        Clamped knot vector, and degree ``p >= 0``.
    u
        Parameters within the knots, shape ``(t,)``; at a knot those of the span above it (at the last, below).

    Returns
    -------
    first, values, slopes
        Index of the first of the ``p + 1`` functions ``(t,)``, ``N_j`` and ``dN_j/du``, both ``(t, p + 1)``.
    """
    last = np.searchsorted(knots, knots[-1], side="left") - 1
    span = np.minimum(np.searchsorted(knots, u, side="right") - 1, last)
    values, slopes = np.ones((u.size, 1)), np.zeros((u.size, degree + 1))
    # The recurrence of Cox and de Boor, degree by degree.
    for d in range(1, degree + 1):
        reach = span[:, None] + np.arange(1, d + 1)
        low, high = knots[reach - d], knots[reach]
        rise = values / (high - low)
        values = np.zeros((u.size, d + 1))
        values[:, :-1] = (high - u[:, None]) * rise
        values[:, 1:] += (u[:, None] - low) * rise
        if d == degree:
            slopes[:, :-1] = -d * rise
            slopes[:, 1:] += d * rise
    return span - degree, values, slopes


def greville(knots: Array, degree: int) -> Array:
    """Return the Greville points of clamped knots, the means of ``degree`` successive ones, shape ``(m,)``."""
    means = np.convolve(knots[1:-1], np.full(degree, 1.0 / degree), "valid")
    return np.clip(means, knots[0], knots[-1])


def transfer(knots: Array, degree: int, finer: Array, finer_degree: int, columns: Array) -> Array:
    """Return coefficients on nested finer splines ``(finer count, c)`` of functions with ``columns`` ``(count, c)``.

    Collocation at the finer splines' Greville points is exact for nested spaces, and well conditioned.

    Parameters
    ----------
    knots, degree
        The splines.
    finer, finer_degree
        The finer splines.
    columns
        A function's coefficients in each column.
    """
    key = knots.tobytes(), degree, finer.tobytes(), finer_degree
    collocate = _kept_collocation if finer.size <= _KEPT_SIZE else _collocation
    (first, values), factors = collocate(*key)
    target = np.einsum("tj,tjc->tc", values, columns[first[:, None] + np.arange(degree + 1)])
    p = finer_degree
    result: Array = lapack.dgbtrs(factors[0], p, p, target, factors[1])[0]
    return np.ascontiguousarray(result)


def _collocation(knots: bytes, degree: int, finer: bytes, p: int) -> tuple[tuple[Index, Array], tuple[Array, Index]]:
    """Return a spline's functions at the Greville points of a finer one, and factors of the finer one's matrix."""
    fine = np.frombuffer(finer)
    points = greville(fine, p)
    first, values, _ = table(fine, p, points)
    column = first[:, None] + np.arange(p + 1)
    # LAPACK's band storage, with room for row exchanges.
    band = np.zeros((3 * p + 1, points.size))
    band[2 * p + np.arange(points.size)[:, None] - column, column] = values
    return table(np.frombuffer(knots), degree, points)[:2], lapack.dgbtrf(band, p, p)[:2]


_kept_collocation = lru_cache(maxsize=8)(_collocation)
