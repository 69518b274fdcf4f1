"""The compiled element loops.

Shapes: ``E`` elements, ``t`` quadrature points along each, ``q`` in the section, ``n`` section functions, ``l = p + 1``
axis functions; an element's nodes run layer by layer.  The sums are factorised: sections first, then along the axis.
"""

import numpy as np
from numba import i8, types, void

from isorod.arrays import Array
from isorod.compiled import F2, F3, F5, FAST, R2, njit
from isorod.space.space import Table

# In the order of the table's fields; points in the section are kept ones.
TABLE = types.NamedTuple([i8, F2, R2, F3, F3, F3, F5, F3], Table)


@njit(void(F2, F3, F3, F3), **FAST)
def push_forward(inverse: Array, across: Array, along: Array, out: Array) -> None:
    """Fill in gradients in space, ``out`` ``(points of all places, 3, 3)``, from those on disk x axis.

    Parameters
    ----------
    inverse
        Inverse Jacobian of each point, shape ``(places points, 9)``.
    across, along
        Derivatives by both coordinates of the disk and by the axis': shapes ``(places, 3, 2 points)``, one coordinate
        behind the other, and ``(places, 3, points)``.
    """
    places, _, points = along.shape
    for p in range(places):
        for a in range(3):
            for q in range(points):
                m = p * points + q
                x, y, z = across[p, a, q], across[p, a, points + q], along[p, a, q]
                for A in range(3):
                    out[m, a, A] = inverse[m, A] * x + inverse[m, 3 + A] * y + inverse[m, 6 + A] * z


@njit(void(F2, F2, F3, F3, F3), **FAST)
def pull_stress(weights: Array, inverse: Array, stress: Array, across: Array, along: Array) -> None:
    """Fill in weighted stresses on disk x axis, in the order of `push_forward`; ``weights`` is ``(places, points)``."""
    places, _, points = along.shape
    for p in range(places):
        for a in range(3):
            for q in range(points):
                m = p * points + q
                x, y, z = (
                    weights[p, q] * stress[m, a, 0],
                    weights[p, q] * stress[m, a, 1],
                    weights[p, q] * stress[m, a, 2],
                )
                across[p, a, q] = inverse[m, 0] * x + inverse[m, 1] * y + inverse[m, 2] * z
                across[p, a, points + q] = inverse[m, 3] * x + inverse[m, 4] * y + inverse[m, 5] * z
                along[p, a, q] = inverse[m, 6] * x + inverse[m, 7] * y + inverse[m, 8] * z


@njit(F5(F3, F3, F3), **FAST)
def mass(section: Array, axial: Array, weights: Array) -> Array:
    """Return the integrals ``(E, l, n, l, n)`` of products of two functions, the weights ``(E, t, q)`` being masses.

    ``section`` ``(q, 3, n)`` and ``axial`` ``(E, t, l)`` are as in `isorod.space.space.Table`.
    """
    elements, along, functions = axial.shape
    points, _, n = section.shape
    result = np.zeros((elements, functions, n, functions, n))
    plane = np.empty((n, n))
    for e in range(elements):
        for t in range(along):
            plane[:] = 0.0
            for q in range(points):
                for i in range(n):
                    x = weights[e, t, q] * section[q, 2, i]
                    for k in range(n):
                        plane[i, k] += x * section[q, 2, k]
            for j in range(functions):
                for i in range(n):
                    for m in range(functions):
                        x = axial[e, t, j] * axial[e, t, m]
                        for k in range(n):
                            result[e, j, i, m, k] += x * plane[i, k]
    return result
