"""Compiled: the distance of a point from a rigid closed mesh of triangles.

The closest point of all triangles is searched in a tree of boxes, nearer ones first.  Its sign follows from the normal
of the face, the edge or the corner on which it lies, the mean of the faces' normals weighted by their angles
(Baerentzen & Aanaes, IEEE Trans. Vis. Comput. Graph. 11 (2005) 243-253).
"""

import numpy as np
from numba import f8, i8, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, njit
from isorod.contact.packed import NODE_ROW, PACKED, PASS_ROW, Packed, Row
from isorod.contact.surface_kernel import PROJECTION, Projection, dot

# Parts of a triangle: the face, one of the edges from corner k to the next, one of the corners.
FACE, EDGES, CORNERS = 0, 1, 4

# Levels of the tree, which is halved at each: more than any number of triangles needs.
_LEVELS = 64


@njit(f8(NODE_ROW, F1), **FAST)
def _away(node: Row, x: Array) -> float:
    """Return the square of the distance of a point from a box."""
    square = 0.0
    for a in range(3):
        side = max(node.low[a] - x[a], x[a] - node.high[a], 0.0)
        square += side * side
    return square


@njit(i8(F2, F1, F1), **FAST)
def nearest(corners: Array, x: Array, y: Array) -> int:
    """Fill ``y`` with the point of a triangle nearest to ``x``; return the part of it on which that is."""
    a, ab, ac, ax = corners[0], corners[1] - corners[0], corners[2] - corners[0], x - corners[0]
    aa, bb, mixed, right1, right2 = dot(ab, ab), dot(ac, ac), dot(ab, ac), dot(ab, ax), dot(ac, ax)
    det = aa * bb - mixed * mixed
    v, w = (bb * right1 - mixed * right2) / det, (aa * right2 - mixed * right1) / det
    if v > 0.0 and w > 0.0 and v + w < 1.0:
        for i in range(3):
            y[i] = a[i] + v * ab[i] + w * ac[i]
        return FACE
    least, at, edge = np.inf, 0.0, 0
    for k in range(3):
        start, end = corners[k], corners[(k + 1) % 3]
        above = below = 0.0
        for i in range(3):
            above += (x[i] - start[i]) * (end[i] - start[i])
            below += (end[i] - start[i]) ** 2
        t, square = min(max(above / below, 0.0), 1.0), 0.0
        for i in range(3):
            square += (x[i] - start[i] - t * (end[i] - start[i])) ** 2
        if square < least:
            least, at, edge = square, t, k
    start, end = corners[edge], corners[(edge + 1) % 3]
    for i in range(3):
        y[i] = start[i] + at * (end[i] - start[i])
    if at == 0.0:
        return CORNERS + edge
    return CORNERS + (edge + 1) % 3 if at == 1.0 else EDGES + edge


@njit(**FAST)
def cross(a: Array, b: Array, out: Array) -> None:
    """Fill ``out`` with the vector product."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = a[j] * b[k] - a[k] * b[j]


@njit(void(F1, F1), **FAST)
def aside(normal: Array, out: Array) -> None:
    """Fill ``out`` with a unit vector normal to a unit vector."""
    a = np.argmin(np.abs(normal))
    for i in range(3):
        out[i] = (1.0 if i == a else 0.0) - normal[a] * normal[i]
    out /= np.sqrt(dot(out, out))


@njit(f8(PACKED, PASS_ROW, F1, PROJECTION), **FAST)
def _resting_gap(packed: Packed, pass_: Row, x: Array, projection: Projection) -> float:
    """Return `mesh_gap` of a mesh at rest."""
    best, place, triangle, size = np.inf, FACE, pass_.masters, 1
    stack = np.empty(_LEVELS, dtype=np.int64)
    y, d, normal, turning = projection.y[0], projection.d, projection.normal, projection.y
    stack[0] = pass_.masters
    while size > 0:
        size -= 1
        row = stack[size]
        node = packed.nodes[row]
        if _away(node, x) >= best:
            continue
        if node.count == 0:
            near, far = row + 1, node.first
            if _away(packed.nodes[far], x) < _away(packed.nodes[near], x):
                near, far = far, near
            stack[size], stack[size + 1] = far, near
            size += 2
            continue
        for k in range(node.first, node.first + node.count):
            where = nearest(packed.corners[k], x, y)
            square = (x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2
            if square < best:
                best, place, triangle = square, where, k
                for a in range(3):
                    d[a] = x[a] - y[a]
    corners = packed.corners[triangle]
    for a in range(3):
        y[a] = x[a] - d[a]
        normal[a] = packed.normals[triangle, place, a]
    height = dot(d, normal)
    turning[1:3] = 0.0
    if place == FACE or best == 0.0:
        return height
    gap = np.sqrt(best) if height >= 0.0 else -np.sqrt(best)
    for a in range(3):
        normal[a] = d[a] / gap
    if place < CORNERS:
        first, last = corners[place - EDGES], corners[(place - EDGES + 1) % 3]
        cross(last - first, normal, turning[1])
        turning[1] /= np.sqrt(dot(turning[1], turning[1]))
        return gap
    aside(normal, turning[1])
    cross(normal, turning[1], turning[2])
    return gap


@njit(f8(PACKED, PASS_ROW, F1, PROJECTION), **FAST)
def mesh_gap(packed: Packed, pass_: Row, x: Array, projection: Projection) -> float:
    """Return the distance of a point from the mesh of a pass, negative inside, and fill its normal.

    Parameters
    ----------
    packed, pass_
        All contacts, and the pass.
    x
        The point, ``(3,)``.
    projection
        Gets ``d`` and ``normal``, and in ``y[1:3]`` the directions in which the normal turns as the point moves, by
        the displacement over the gap: none on a face, one across an edge, two about a corner.
    """
    if pass_.tracks == 0:
        return _resting_gap(packed, pass_, x, projection)
    home, out = np.zeros(3), np.empty(3)
    for a in range(3):
        for b in range(3):
            home[a] += pass_.frame[b, a] * (x[b] - pass_.point[b])
    gap = _resting_gap(packed, pass_, home, projection)
    y = projection.y
    for vector in (projection.d, projection.normal, y[0], y[1], y[2]):
        for a in range(3):
            out[a] = 0.0
            for b in range(3):
                out[a] += pass_.frame[a, b] * vector[b]
        vector[:] = out
    for a in range(3):
        y[0, a] += pass_.point[a]
    return gap
