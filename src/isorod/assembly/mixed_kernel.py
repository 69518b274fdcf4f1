"""The compiled loops of the mixed formulation."""

import numpy as np

from isorod.arrays import Array
from isorod.assembly.element_kernel import TABLE
from isorod.compiled import F2, F3, F5, F6, FAST, njit
from isorod.space.space import Table


@njit(F6(TABLE, F5, F2, F3), **FAST)
def coupling(table: Table, slope: Array, across: Array, along: Array) -> Array:
    """Return the matrices ``(E, l, n, 3, l - 1, m)`` of displacements and pressures.

    ``slope`` ``(E, t, q, 3, 3)`` is ``d theta / dF``; ``across`` ``(q, m)`` and ``along`` ``(E, t, l - 1)`` are the
    pressure functions.
    """
    section, axial, slopes, inverse, weights = table.section, table.axial, table.slopes, table.inverse, table.weights
    elements, points_along, functions = axial.shape
    points, _, n = section.shape
    pressures = across.shape[1]
    result = np.zeros((elements, functions, n, 3, functions - 1, pressures))
    plane = np.empty((n, 3, pressures))
    axis = np.empty((n, 3, pressures))
    for e in range(elements):
        for t in range(points_along):
            plane[:] = 0.0
            axis[:] = 0.0
            for q in range(points):
                for a in range(3):
                    s = np.empty(3)
                    for d in range(3):
                        s[d] = weights[e, t, q] * (
                            slope[e, t, q, a, 0] * inverse[e, t, q, d, 0]
                            + slope[e, t, q, a, 1] * inverse[e, t, q, d, 1]
                            + slope[e, t, q, a, 2] * inverse[e, t, q, d, 2]
                        )
                    for i in range(n):
                        x = s[0] * section[q, 0, i] + s[1] * section[q, 1, i]
                        y = s[2] * section[q, 2, i]
                        for k in range(pressures):
                            plane[i, a, k] += x * across[q, k]
                            axis[i, a, k] += y * across[q, k]
            for j in range(functions):
                for i in range(n):
                    for a in range(3):
                        for m in range(functions - 1):
                            x = along[e, t, m] * axial[e, t, j]
                            y = along[e, t, m] * slopes[e, t, j]
                            for k in range(pressures):
                                result[e, j, i, a, m, k] += x * plane[i, a, k] + y * axis[i, a, k]
    return result
