"""B-spline functions at many parameters, and collocation with them."""

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@njit("Tuple((i8[::1], f8[:,::1], f8[:,::1]))(f8[::1], i8, f8[::1])", cache=True, error_model="numpy")
def table(knots: Array, degree: int, u: Array) -> tuple[Index, Array, Array]:
    """Return, for each parameter, the B-splines that live there.

    Parameters
    ----------
    knots, degree
        Clamped knot vector, and degree ``p >= 0``.
    u
        Parameters within the knots, shape ``(t,)``; at a knot the span above it is meant (at the last, below).

    Returns
    -------
    first, values, slopes
        Index of the first of the ``p + 1`` functions ``(t,)``, ``N_j`` and ``dN_j/du``, both ``(t, p + 1)``.
    """
    last = np.searchsorted(knots, knots[-1]) - 1
    first = np.empty(u.size, dtype=np.int64)
    values = np.zeros((u.size, degree + 1))
    slopes = np.zeros((u.size, degree + 1))
    for t in range(u.size):
        span = min(np.searchsorted(knots, u[t], side="right") - 1, last)
        first[t] = span - degree
        values[t, 0] = 1.0
        # The recurrence of Cox and de Boor, degree by degree.
        for d in range(1, degree + 1):
            passed = 0.0
            for k in range(d):
                low, high = knots[span + 1 + k - d], knots[span + 1 + k]
                rise = values[t, k] / (high - low)
                values[t, k] = passed + (high - u[t]) * rise
                passed = (u[t] - low) * rise
                if d == degree:
                    slopes[t, k] -= d * rise
                    slopes[t, k + 1] += d * rise
            values[t, d] = passed
    return first, values, slopes


def transfer(knots: Array, degree: int, finer: Array, finer_degree: int, columns: Array) -> Array:
    """Return the coefficients on nested finer splines ``(finer count, c)`` of functions with coefficients ``columns`` ``(count, c)``.

    Collocation at the finer splines' Greville points is exact for nested spaces, and well conditioned.
    """
    p = finer_degree
    greville = np.clip(np.convolve(finer[1:-1], np.full(p, 1.0 / p), "valid"), finer[0], finer[-1])
    first, values, _ = table(knots, degree, greville)
    wanted = np.einsum("tj,tjc->tc", values, columns[first[:, None] + np.arange(degree + 1)])
    first, values, _ = table(finer, p, greville)
    column = first[:, None] + np.arange(p + 1)
    # LAPACK's band storage, with room for row exchanges.
    band = np.zeros((3 * p + 1, greville.size))
    band[2 * p + np.arange(greville.size)[:, None] - column, column] = values
    result: Array = lapack.dgbsv(p, p, band, wanted)[2]
    return np.ascontiguousarray(result)
