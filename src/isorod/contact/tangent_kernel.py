"""Second variations of contact, compiled."""

import numpy as np
from numba import i8, njit, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, I1, I2, STRICT
from isorod.contact.force_kernel import rigid_gap
from isorod.contact.surface_kernel import CYLINDER, FUNCTIONS, PACKED, Packed, dot, evaluate, surface_gap

# A point couples at most this many nodes: three control points round each of two sections.
_NODES = 6 * FUNCTIONS


@njit(void(PACKED, I1, I2), **STRICT)
def _patches(packed: Packed, active: Index, keys: Index) -> None:
    """Fill ``keys`` ``(m, 5)`` with pass, slave row and arc, master row and arc (-1 where rigid) of active slave points."""
    for m in range(active.size):
        point = active[m]
        k = np.searchsorted(packed.passes[:, 2], point, side="right") - 1
        surface, master, first, across, along = packed.passes[k, :5]
        n = packed.surfaces[surface, 0]
        rest = (point - first) // across
        keys[m, 0] = k
        keys[m, 1] = packed.surfaces[surface, 2] + rest // (n * along)
        keys[m, 2] = rest % n
        keys[m, 3] = keys[m, 4] = -1
        if master >= 0:
            n = packed.surfaces[master, 0]
            keys[m, 3] = int(packed.starts[point, 0])
            turns = (packed.starts[point, 1] - packed.turns[master, 0]) * n / (2.0 * np.pi)
            keys[m, 4] = int(np.floor(turns + 0.5)) % n


@njit(i8(PACKED, I1, I1), **STRICT)
def _nodes(packed: Packed, key: Index, nodes: Index) -> int:
    """Fill ``nodes`` with those of the slave's patch, then those of the master's; return how many."""
    count = 0
    surface, master = packed.passes[key[0], 0], packed.passes[key[0], 1]
    for side in range(2 if master >= 0 else 1):
        body = surface if side == 0 else master
        n = packed.surfaces[body, 0]
        for j in range(packed.surfaces[body, 1] + 1):
            for c in range(3):
                nodes[count] = packed.layers[key[1 + 2 * side], j] + (key[2 + 2 * side] + c - 1) % n
                count += 1
    return count


@njit(i8(PACKED, F2, I1, i8, i8, F2, F2), **STRICT)
def _variations(packed: Packed, positions: Array, key: Index, point: int, count: int, v: Array, c: Array) -> int:
    """Fill vectors ``v`` ``(6, 3 count)`` and symmetric ``c`` ``(6, 6)``: the gap's first variation is ``v[0]``, its second ``v^T c v``.

    With ``d = x - y`` along the normal and ``D`` its derivative by the nodes at a fixed place, ``t_a = D^T y_a``,
    ``b_a = D_a^T n``, ``k_ab = n . y_ab`` and ``H = a - g k``:
    ``d2g = -t a^-1 k H^-1 t + t H^-1 b + b H^-1 t - g b H^-1 b``.  On an edge only theta varies, and ``(D^T m)^2 / g``
    is added, ``m`` normal to both.  Returns how many vectors there are.
    """
    v[:] = 0.0
    c[:] = 0.0
    k = key[0]
    surface, master, first, across, along, first_around, first_along = packed.passes[k]
    normal = np.empty(3)
    f = packed.around[first_around + (point - first) % across]
    n = packed.surfaces[surface, 0]
    place = (key[1] - packed.surfaces[surface, 2]) * along + (point - first) // (across * n) % along
    r = packed.along[first_along + place]
    mine = 3 * (packed.surfaces[surface, 1] + 1)
    if master < 0:
        gap = rigid_gap(packed, k, point, normal)
        axis = packed.rigid[k, 3:6]
        for m in range(mine):
            scale = r[m // 3] * f[m % 3]
            for a in range(3):
                v[0, 3 * m + a] = scale * normal[a]
                b, e = (a + 1) % 3, (a + 2) % 3
                v[1, 3 * m + a] = scale * (axis[b] * normal[e] - axis[e] * normal[b])
        if master == CYLINDER:
            c[1, 1] = 1.0 / (gap + packed.rigid[k, 6])
        return 2

    phi, axial, y, d = np.empty((3, 3)), np.empty((3, FUNCTIONS)), np.empty((6, 3)), np.empty(3)
    start = packed.starts[point]
    evaluate(
        packed.surfaces[master, 0],
        packed.surfaces[master, 1] + 1,
        packed.turns[master],
        packed.polynomials[key[3]],
        packed.layers[key[3]],
        start[1],
        start[2],
        positions,
        phi,
        axial,
        y,
    )
    for a in range(3):
        d[a] = packed.places[point, a] - y[0, a]
    edge = packed.states[point, 2] == 1.0
    gap = surface_gap(y, d, edge, normal)
    # Directions of t_1, t_2, and of the third vector of an edge.
    directions = np.empty((3, 3))
    for a in range(3):
        b, e = (a + 1) % 3, (a + 2) % 3
        directions[0, a] = normal[a]
        directions[1, a] = y[1, a]
        directions[2, a] = (normal[b] * y[1, e] - normal[e] * y[1, b]) if edge else y[2, a]
    for m in range(count):
        if m < mine:
            scale = r[m // 3] * f[m % 3]
        else:
            i, j = (m - mine) % 3, (m - mine) // 3
            scale = -axial[0, j] * phi[0, i]
            for a in range(3):
                v[3, 3 * m + a] = -axial[0, j] * phi[1, i] * normal[a]
                v[4, 3 * m + a] = -axial[1, j] * phi[0, i] * normal[a]
        for q in range(3):
            for a in range(3):
                v[q, 3 * m + a] = scale * directions[q, a]
    a11, a12, a22 = dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2])
    k11, k12, k22 = dot(normal, y[3]), dot(normal, y[4]), dot(normal, y[5])
    h11, h12, h22 = a11 - gap * k11, a12 - gap * k12, a22 - gap * k22
    if edge:
        c[1, 1] = -k11 / (a11 * h11)
        c[1, 3] = c[3, 1] = 1.0 / h11
        c[3, 3] = -gap / h11
        c[2, 2] = 1.0 / (gap * a11)
        return 5
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
    return 5


@njit(void(PACKED, F2, I1, I2, I1, I1, F1), **STRICT)
def _add_blocks(
    packed: Packed, positions: Array, active: Index, keys: Index, which: Index, begin: Index, values: Array
) -> None:
    """Add the second derivatives of the energy at active points to dense blocks; that of point ``m`` begins at ``begin[which[m]]``."""
    nodes = np.empty(_NODES, dtype=np.int64)
    c = np.empty((6, 6))
    for m in range(active.size):
        point = active[m]
        k = keys[m, 0]
        count = _nodes(packed, keys[m], nodes)
        size = 3 * count
        v = np.empty((6, size))
        vectors = _variations(packed, positions, keys[m], point, count, v, c)
        weight = packed.areas[point]
        pressure = packed.states[point, 1]
        for i in range(6):
            for j in range(6):
                c[i, j] *= -weight * pressure
        c[0, 0] = weight * packed.penalty[k]
        place = begin[which[m]]
        for row in range(size):
            for i in range(vectors):
                value = 0.0
                for j in range(vectors):
                    value += c[j, i] * v[j, row]
                if value != 0.0:
                    for column in range(size):
                        values[place + row * size + column] += value * v[i, column]
