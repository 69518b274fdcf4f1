"""Compiled: the directions in which contact pushes."""

import numpy as np
from numba import void

from isorod.arrays import Array, Index
from isorod.compiled import F2, I1, STRICT, njit
from isorod.contact.force_kernel import rigid_gap
from isorod.contact.mesh_kernel import LEVELS, mesh_gap
from isorod.contact.packed import MESH, PACKED, Packed
from isorod.contact.surface_kernel import evaluate, new_foot, surface_gap


@njit(void(PACKED, F2, I1, F2), **STRICT)
def normals(packed: Packed, positions: Array, active: Index, found: Array) -> None:
    """Fill in the unit normals along which slave points are pushed.

    Parameters
    ----------
    packed
        As the last forces left it.
    positions
        Those of the last forces, ``(nodes, 3)``.
    active
        Points under pressure, rising, ``(m,)``.
    found
        What is filled, ``(m, 3)``.
    """
    foot, stack, k = new_foot(), np.empty(LEVELS, dtype=np.int64), 0
    for m in range(active.size):
        point = active[m]
        while k + 1 < packed.passes.size and packed.passes[k + 1].first_point <= point:
            k += 1
        one = packed.passes[k]
        if one.master == MESH:
            mesh_gap(packed, one, packed.points[point], foot, stack)
        elif one.master < 0:
            rigid_gap(one, packed.points[point], foot.normal)
        else:
            start = packed.starts[point]
            element = packed.elements[start.element]
            evaluate(packed.surfaces[element.surface], element, start.theta, start.s, positions, foot)
            foot.d[:] = packed.points[point] - foot.y[0]
            surface_gap(foot, packed.states[point].edge)
        found[m] = foot.normal
