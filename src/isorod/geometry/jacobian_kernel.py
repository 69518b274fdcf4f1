"""The rod's Jacobians at many points, compiled."""

from numba import void

from isorod.arrays import Array
from isorod.compiled import F2, F4, FAST, njit


@njit(void(F2, F2, F2, F4, F2), **FAST)
def inverse_jacobians(first: Array, second: Array, third: Array, inverse: Array, det: Array) -> None:
    """Fill in ``d(xi_1, xi_2, u)/dx`` ``(u, q, 3, 3)`` and ``det dx/d(xi_1, xi_2, u)`` ``(u, q)`` of a rod.

    ``first``, ``second`` and ``third`` ``(q, 3 u)`` are the columns of the Jacobians, sections side by side.
    NumPy computes them: BLAS in compiled code takes longer to load than all of this.
    """
    sections, points = det.shape
    for t in range(sections):
        for q in range(points):
            f0, f1, f2 = first[q, 3 * t], first[q, 3 * t + 1], first[q, 3 * t + 2]
            s0, s1, s2 = second[q, 3 * t], second[q, 3 * t + 1], second[q, 3 * t + 2]
            t0, t1, t2 = third[q, 3 * t], third[q, 3 * t + 1], third[q, 3 * t + 2]
            c0, c1, c2 = s1 * t2 - s2 * t1, s2 * t0 - s0 * t2, s0 * t1 - s1 * t0
            volume = f0 * c0 + f1 * c1 + f2 * c2
            by = 1.0 / volume
            det[t, q] = volume
            inverse[t, q, 0, 0], inverse[t, q, 0, 1], inverse[t, q, 0, 2] = by * c0, by * c1, by * c2
            inverse[t, q, 1, 0] = by * (t1 * f2 - t2 * f1)
            inverse[t, q, 1, 1] = by * (t2 * f0 - t0 * f2)
            inverse[t, q, 1, 2] = by * (t0 * f1 - t1 * f0)
            inverse[t, q, 2, 0] = by * (f1 * s2 - f2 * s1)
            inverse[t, q, 2, 1] = by * (f2 * s0 - f0 * s2)
            inverse[t, q, 2, 2] = by * (f0 * s1 - f1 * s0)
