"""The compiled loop of an implicit step over points: moduli pulled back to disk x axis, in the order of the sums."""

from numba import void

from isorod.arrays import Array
from isorod.compiled import F2, F4, F5, FAST, njit


@njit(void(F2, F5, F4, F4, F4, F4), **FAST)
def pull_back(inverse: Array, moduli: Array, across: Array, mixed: Array, turned: Array, along: Array) -> None:
    """Fill in weighted moduli pulled back to disk x axis, of the pairs of directions ``I K`` and components ``a b``.

    Parameters
    ----------
    inverse
        Inverse Jacobian of each point times the root of its weight, shape ``(places points, 9)``.
    moduli
        Shape ``(places points, 3, 3, 3, 3)``, index ``a, A, b, B``.
    across, mixed, turned, along
        Of ``I`` and ``K`` both across (00, 01, 10, 11), the first alone, the second alone, none; shapes ``(places, 9,
        pairs, points)``.
    """
    places, _, _, points = along.shape
    for p in range(places):
        for q in range(points):
            m = p * points + q
            for a in range(3):
                for b in range(3):
                    c = 3 * a + b
                    for i in range(3):
                        # First contraction: the indices of the first function's derivative.
                        x, y, z = 0.0, 0.0, 0.0
                        for A in range(3):
                            f = inverse[m, 3 * i + A]
                            x += f * moduli[m, a, A, b, 0]
                            y += f * moduli[m, a, A, b, 1]
                            z += f * moduli[m, a, A, b, 2]
                        for k in range(3):
                            value = x * inverse[m, 3 * k] + y * inverse[m, 3 * k + 1] + z * inverse[m, 3 * k + 2]
                            if i < 2 and k < 2:
                                across[p, c, 2 * i + k, q] = value
                            elif i < 2:
                                mixed[p, c, i, q] = value
                            elif k < 2:
                                turned[p, c, k, q] = value
                            else:
                                along[p, c, 0, q] = value
