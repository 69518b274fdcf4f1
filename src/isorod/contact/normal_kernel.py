"""Compiled: the directions in which contact pushes."""

from numba import void

from isorod.arrays import Array, Index
from isorod.compiled import F2, I1, STRICT, njit
from isorod.contact.force_kernel import project
from isorod.contact.packed import PACKED, Packed
from isorod.contact.surface_kernel import new_foot


@njit(void(PACKED, F2, I1, I1, F2), **STRICT)
def normals(packed: Packed, positions: Array, active: Index, passes: Index, found: Array) -> None:
    """Fill in the unit normals along which slave points are pushed.

    Parameters
    ----------
    packed
        As the last forces left it.
    positions
        Those of the last forces, ``(nodes, 3)``.
    active, passes
        Points under pressure, rising, and the pass of each, ``(m,)``.
    found
        What is filled, ``(m, 3)``.
    """
    foot = new_foot()
    for m in range(active.size):
        project(packed, packed.passes[passes[m]], active[m], positions, foot)
        found[m] = foot.normal
