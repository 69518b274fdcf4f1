"""Second variations of contact, compiled."""

import numpy as np
from numba import b1, f8, from_dtype, i8, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, I1, STRICT, njit
from isorod.contact.force_kernel import project
from isorod.contact.mesh_kernel import aside, cross
from isorod.contact.packed import FUNCTIONS, MESH, PACKED, PLANE, SPHERE, Packed, Row, Table
from isorod.contact.search_kernel import site
from isorod.contact.surface_kernel import FOOT, Foot, arc_of, dot, new_foot

# A point couples at most this many nodes: three control points round each of two sections.
NODES = 6 * FUNCTIONS

# Where two sides touch: pass, element and arc of the slave, element and arc of the master (-1 where it is rigid).
PATCH = np.dtype([(name, np.int64) for name in ("number", "element", "arc", "master_element", "master_arc")])
_PATCH_ROW = from_dtype(PATCH)
_PATCHES = types.Array(_PATCH_ROW, 1, "C")


@njit(void(PACKED, I1, _PATCHES), **STRICT)
def find_patches(packed: Packed, active: Index, patches: Table) -> None:
    """Fill ``patches``, which know their passes, with those of active slave points."""
    for m in range(active.size):
        point, patch = active[m], patches[m]
        one = packed.passes[patch.number]
        at = site(one, packed.surfaces[one.slave], point)
        patch.element, patch.arc = at.element, at.arc
        patch.master_element = patch.master_arc = -1
        if one.master >= 0:
            patch.master_element = packed.starts[point].element
            master = packed.surfaces[packed.elements[patch.master_element].surface]
            patch.master_arc = arc_of(master, packed.starts[point].theta)


@njit(i8(PACKED, i8, i8, i8, I1), **STRICT)
def add_nodes(packed: Packed, surface: int, element: int, arc: int, nodes: Index) -> int:
    """Fill ``nodes`` with the control points round an arc by the layers of an element; return how many."""
    own, layers = packed.surfaces[surface], packed.elements[element].layers
    for j in range(own.functions):
        for c in range(3):
            nodes[3 * j + c] = layers[j] + (arc + c - 1) % own.around
    return 3 * own.functions


@njit(i8(PACKED, _PATCH_ROW, I1), **STRICT)
def patch_nodes(packed: Packed, patch: Row, nodes: Index) -> int:
    """Fill ``nodes`` with those of the slave's side, then those of the master's; return how many."""
    one = packed.passes[patch.number]
    count = add_nodes(packed, one.slave, patch.element, patch.arc, nodes)
    if one.master >= 0:
        master = packed.elements[patch.master_element].surface
        count += add_nodes(packed, master, patch.master_element, patch.master_arc, nodes[count:])
    return count


@njit(void(FOOT, f8, b1, F2), **STRICT)
def _curvature(foot: Foot, gap: float, edge: bool, c: Array) -> None:
    """Fill ``c`` (see `_variations`) where the master is a surface."""
    y, normal = foot.y, foot.normal
    a11, a12, a22 = dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2])
    k11, k12, k22 = dot(normal, y[3]), dot(normal, y[4]), dot(normal, y[5])
    h11, h12, h22 = a11 - gap * k11, a12 - gap * k12, a22 - gap * k22
    if edge:
        c[1, 1] = -k11 / (a11 * h11)
        c[1, 3] = c[3, 1] = 1.0 / h11
        c[3, 3] = -gap / h11
        c[2, 2] = 1.0 / (gap * a11)
        return
    det = h11 * h22 - h12 * h12
    i11, i12, i22 = h22 / det, -h12 / det, h11 / det
    det = a11 * a22 - a12 * a12
    # k H^-1, then a^-1 k H^-1.
    p11, p12 = k11 * i11 + k12 * i12, k11 * i12 + k12 * i22
    p21, p22 = k12 * i11 + k22 * i12, k12 * i12 + k22 * i22
    c[1, 1] = -(a22 * p11 - a12 * p21) / det
    c[1, 2] = c[2, 1] = -(a22 * p12 - a12 * p22) / det
    c[2, 2] = -(a11 * p22 - a12 * p12) / det
    c[1, 3] = c[3, 1] = i11
    c[1, 4] = c[4, 1] = c[2, 3] = c[3, 2] = i12
    c[2, 4] = c[4, 2] = i22
    c[3, 3], c[4, 4] = -gap * i11, -gap * i22
    c[3, 4] = c[4, 3] = -gap * i12


@njit(i8(PACKED, F2, _PATCH_ROW, i8, F2, F2), **STRICT)
def _variations(packed: Packed, positions: Array, patch: Row, point: int, v: Array, c: Array) -> int:
    """Fill vectors ``v`` ``(6, dofs)`` and symmetric ``c`` ``(6, 6)``; return how many vectors there are.

    The gap's first variation is ``v[0]``, its second ``v^T c v``, by the nodes of a patch.  With ``d = x - y`` along
    the normal and ``D`` its derivative by the nodes at a fixed place, ``t_a = D^T y_a``, ``b_a = D_a^T n``,
    ``k_ab = n . y_ab`` and ``H = a - g k``: ``d2g = -t a^-1 k H^-1 t + t H^-1 b + b H^-1 t - g b H^-1 b``.  On an edge
    only theta varies, and ``(D^T m)^2 / g`` is added, ``m`` normal to both.
    """
    v[:] = 0.0
    c[:] = 0.0
    one = packed.passes[patch.number]
    slave = packed.surfaces[one.slave]
    at = site(one, slave, point)
    mine, foot = 3 * slave.functions, new_foot()
    # D at each node, and the directions that it is multiplied by.
    shares, directions = np.empty(v.shape[1] // 3), np.zeros((3, 3))
    for m in range(mine):
        shares[m] = packed.along[at.along, m // 3] * packed.around[at.around, m % 3]
    gap = project(packed, one, point, positions, foot)
    if one.master == MESH:
        directions[1:] = foot.y[1:3]
        if gap != 0.0:
            c[1, 1] = c[2, 2] = 1.0 / gap
    elif one.master < 0:
        if one.master == SPHERE:
            aside(foot.normal, directions[1])
            cross(foot.normal, directions[1], directions[2])
            c[2, 2] = 1.0 / (gap + one.radius)
        else:
            cross(one.direction, foot.normal, directions[1])
        if one.master != PLANE:
            c[1, 1] = 1.0 / (gap + one.radius)
    else:
        edge, phi, axial = packed.states[point].edge, foot.phi, foot.axial
        _curvature(foot, gap, edge, c)
        directions[1:] = foot.y[1:3]
        if edge:
            cross(foot.normal, foot.y[1], directions[2])
        for m in range(mine, shares.size):
            j, i = divmod(m - mine, 3)
            shares[m] = -axial[0, j] * phi[0, i]
            for a in range(3):
                v[3, 3 * m + a] = -axial[0, j] * phi[1, i] * foot.normal[a]
                v[4, 3 * m + a] = -axial[1, j] * phi[0, i] * foot.normal[a]
    directions[0] = foot.normal
    for q in range(3):
        for m in range(shares.size):
            for a in range(3):
                v[q, 3 * m + a] = shares[m] * directions[q, a]
    return 5 if one.master >= 0 else 3


@njit(void(PACKED, F2, I1, _PATCHES, I1, F1), **STRICT)
def add_blocks(packed: Packed, positions: Array, active: Index, patches: Table, begin: Index, values: Array) -> None:
    """Add the second derivatives of the energy to dense blocks.

    Parameters
    ----------
    packed
        As the last forces left it.
    positions
        Those of the last forces, ``(nodes, 3)``.
    active, patches, begin
        Slave points under pressure, their patches, and where in ``values`` their blocks begin, all ``(m,)``.
    values
        Blocks of the degrees of freedom of a patch's nodes (see `patch_nodes`), one after the other; are added to.
    """
    nodes = np.empty(NODES, dtype=np.int64)
    c = np.empty((6, 6))
    for m in range(active.size):
        point = active[m]
        size = 3 * patch_nodes(packed, patches[m], nodes)
        v = np.empty((6, size))
        vectors = _variations(packed, positions, patches[m], point, v, c)
        weight = packed.areas[point]
        c *= -weight * packed.states[point].pressure
        c[0, 0] = weight * packed.passes[patches[m].number].penalty
        block = values[begin[m] : begin[m] + size * size].reshape(size, size)
        for row in range(size):
            for i in range(vectors):
                value = 0.0
                for j in range(vectors):
                    value += c[j, i] * v[j, row]
                if value != 0.0:
                    for column in range(size):
                        block[row, column] += value * v[i, column]
