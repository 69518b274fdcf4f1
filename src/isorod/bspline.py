"""B-spline functions at many parameters, and collocation with them; compiled, because every set-up needs them several times."""

from typing import Any

import numpy as np
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import solve_banded

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_OPTIONS: Any = {"cache": True, "error_model": "numpy"}


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
    last = np.searchsorted(knots, knots[-1], side="left") - 1
    span = np.minimum(np.searchsorted(knots, u, side="right") - 1, last)
    values, slopes = np.empty((2, u.size, degree + 1))
    _fill(np.ascontiguousarray(knots), degree, np.ascontiguousarray(u), span, values, slopes)
    return span - degree, values, slopes


def transfer(knots: Array, degree: int, finer: Array, finer_degree: int, columns: Array) -> Array:
    """Return the coefficients on nested finer splines ``(finer count, c)`` of functions with coefficients ``columns`` ``(count, c)``.

    Collocation at the finer splines' Greville points is exact for nested spaces, and well conditioned.
    """
    p = finer_degree
    greville = np.clip(sliding_window_view(finer[1:-1], p).mean(axis=1), finer[0], finer[-1])
    first, values, _ = table(knots, degree, greville)
    wanted = np.einsum("tj,tjc->tc", values, columns[first[:, None] + np.arange(degree + 1)])
    first, values, _ = table(finer, p, greville)
    column = first[:, None] + np.arange(p + 1)
    band = np.zeros((2 * p + 1, greville.size))
    band[p + np.arange(greville.size)[:, None] - column, column] = values
    result: Array = solve_banded((p, p), band, wanted, check_finite=False)
    return result


@njit("void(f8[::1], i8, f8[::1], i8[::1], f8[:,::1], f8[:,::1])", **_OPTIONS)
def _fill(knots: Array, p: int, u: Array, span: Index, values: Array, slopes: Array) -> None:
    """Fill values and slopes by the recurrence of Cox and de Boor, degree by degree."""
    for t in range(u.size):
        s = span[t]
        values[t, 0] = 1.0
        slopes[t, 0] = 0.0
        for d in range(1, p + 1):
            # Function s - d + j of degree d is made of functions j - 1 and j of degree d - 1, counted from s - d + 1.
            below = 0.0
            steep = 0.0
            for j in range(d + 1):
                here = 0.0
                rise = 0.0
                if j < d:
                    low = knots[s - d + 1 + j]
                    width = knots[s + 1 + j] - low
                    rise = values[t, j] / width
                    here = (knots[s + 1 + j] - u[t]) * rise
                if d == p:
                    slopes[t, j] = p * (steep - rise)
                values[t, j] = below + here
                if j < d:
                    below = (u[t] - low) * rise
                    steep = rise
