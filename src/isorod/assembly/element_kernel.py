"""The compiled element loops.

Shapes: ``E`` elements, ``t`` quadrature points along each, ``q`` in the section, ``n`` section functions, ``l = p + 1``
axis functions; an element's nodes run layer by layer.  The sums are factorised: sections first, then along the axis.
"""

import numpy as np
from numba import i8, types

from isorod.arrays import Array
from isorod.compiled import F2, F3, F4, F5, FAST, R2, njit
from isorod.space.space import Table

# In the order of the table's fields; points in the section are kept ones.
TABLE = types.NamedTuple([i8, F2, R2, F3, F3, F3, F5, F3], Table)


@njit(F5(TABLE, F4), **FAST)
def deformation_gradients(table: Table, nodal: Array) -> Array:
    """Return ``F`` ``(E, t, q, 3, 3)`` of the nodal displacements ``(E, l, n, 3)``."""
    section, axial, slopes, inverse = table.section, table.axial, table.slopes, table.inverse
    elements, along, functions = axial.shape
    points, _, n = section.shape
    result = np.empty((elements, along, points, 3, 3))
    plane = np.empty((3, n))
    axis = np.empty((3, n))
    h = np.empty((3, 3))
    for e in range(elements):
        for t in range(along):
            for i in range(n):
                for a in range(3):
                    value = 0.0
                    slope = 0.0
                    for j in range(functions):
                        value += axial[e, t, j] * nodal[e, j, i, a]
                        slope += slopes[e, t, j] * nodal[e, j, i, a]
                    plane[a, i] = value
                    axis[a, i] = slope
            for q in range(points):
                for a in range(3):
                    h0 = 0.0
                    h1 = 0.0
                    h2 = 0.0
                    for i in range(n):
                        h0 += plane[a, i] * section[q, 0, i]
                        h1 += plane[a, i] * section[q, 1, i]
                        h2 += axis[a, i] * section[q, 2, i]
                    h[a, 0] = h0
                    h[a, 1] = h1
                    h[a, 2] = h2
                for a in range(3):
                    for b in range(3):
                        result[e, t, q, a, b] = (
                            h[a, 0] * inverse[e, t, q, 0, b]
                            + h[a, 1] * inverse[e, t, q, 1, b]
                            + h[a, 2] * inverse[e, t, q, 2, b]
                        )
                    result[e, t, q, a, a] += 1.0
    return result


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
