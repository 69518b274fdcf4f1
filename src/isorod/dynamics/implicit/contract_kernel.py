"""The sums over points of an implicit step's tangent."""

from numba import void

from isorod.arrays import Array
from isorod.compiled import F1, F3, F4, F5, FAST, njit


@njit(void(F1, F5, F3, F4), **FAST)
def contract(weights: Array, moduli: Array, gradient: Array, out: Array) -> None:
    """Fill ``out`` ``(points, 3, 9, n)``, index ``A, (a, b), k``, with weighted moduli times gradients.

    Parameters
    ----------
    weights, moduli
        Shapes ``(points,)`` and ``(points, 3, 3, 3, 3)``.
    gradient
        Gradients of the functions by place, shape ``(points, 3, n)``.
    """
    points, _, functions = gradient.shape
    for m in range(points):
        for A in range(3):
            for a in range(3):
                for b in range(3):
                    x, y, z = (
                        weights[m] * moduli[m, a, A, b, 0],
                        weights[m] * moduli[m, a, A, b, 1],
                        weights[m] * moduli[m, a, A, b, 2],
                    )
                    for k in range(functions):
                        out[m, A, 3 * a + b, k] = x * gradient[m, 0, k] + y * gradient[m, 1, k] + z * gradient[m, 2, k]
