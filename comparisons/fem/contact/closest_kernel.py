"""Compiled: the points of a surface, the facets of another, and the closest point on one."""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.compiled import F1, F2, I1, I2, STRICT
from isorod.compiling import njit
from meshes.mesh import Array, Index

# Off the facet's interior, where a surface has kinks or ends, only points about as deep as they are far count as
# inside: cosine of the angle to the normal.
_STEEP = 0.5


_NEWTON_STEPS = 20


_SMALL = 1e-12


class Facet(NamedTuple):
    """The functions of a facet, which all facets share.

    Attributes
    ----------
    coefficients
        ``C_ka``, shape ``(n, n)``.
    powers
        ``p_k, q_k``, shape ``(n, 2)``.
    triangle
        Whether it is the unit triangle, else the unit square.
    """

    coefficients: Array
    powers: Index
    triangle: bool


class Surface(NamedTuple):
    """Facets: their nodes ``(facets, n)``, the facets they share a node with (filled up with -1), their functions."""

    facets: Index
    neighbours: Index
    like: Facet


class Points(NamedTuple):
    """Points of a surface.

    Attributes
    ----------
    supports, shares
        Point ``m`` is at ``sum_b shares[m, b] nodes[supports[m, b]]``, both ``(m, n)``.
    weights
        Reference areas, shape ``(m,)``.
    """

    supports: Index
    shares: Array
    weights: Array


class Closest(NamedTuple):
    """Where points are, and what is closest to them on another surface.

    Attributes
    ----------
    x
        Positions, shape ``(m, 3)``.
    facet, xi
        Facet of the closest point ``(m,)`` and its parameters there ``(m, 2)``.
    gap
        Distance, negative inside, shape ``(m,)``.
    """

    x: Array
    facet: Index
    xi: Array
    gap: Array


FACET = types.NamedTuple([F2, I2, b1], Facet)
SURFACE = types.NamedTuple([I2, I2, FACET], Surface)
POINTS = types.NamedTuple([I2, F2, F1], Points)
CLOSEST = types.NamedTuple([F2, I1, F2, F1], Closest)


@njit(void(F2, I2, f8, f8, F2), **STRICT)
def surface_at(c: Array, powers: Index, a: float, b: float, out: Array) -> None:
    """Write ``s, s_1, s_2, s_11, s_12, s_22`` into the rows of ``out``."""
    out[:] = 0.0
    for k in range(powers.shape[0]):
        p, q = powers[k, 0], powers[k, 1]
        m = a**p * b**q
        m1 = p * a ** (p - 1) * b**q if p > 0 else 0.0
        m2 = q * a**p * b ** (q - 1) if q > 0 else 0.0
        m11 = p * (p - 1) * a ** (p - 2) * b**q if p > 1 else 0.0
        m12 = p * q * a ** (p - 1) * b ** (q - 1) if p > 0 and q > 0 else 0.0
        m22 = q * (q - 1) * a**p * b ** (q - 2) if q > 1 else 0.0
        for i in range(3):
            out[0, i] += m * c[k, i]
            out[1, i] += m1 * c[k, i]
            out[2, i] += m2 * c[k, i]
            out[3, i] += m11 * c[k, i]
            out[4, i] += m12 * c[k, i]
            out[5, i] += m22 * c[k, i]


@njit(types.UniTuple(f8, 3)(F2, I2, F1, b1, F2, F1), **STRICT)
def _closest_on_facet(
    c: Array, powers: Index, x: Array, triangle: bool, s: Array, d: Array
) -> tuple[float, float, float]:
    """Return ``xi_1, xi_2`` of the facet's point closest to ``x`` and its squared distance.

    In one piece: cut into the search inside and that along an edge it takes half as long again.
    """
    a = b = 1.0 / 3.0 if triangle else 0.5
    linear = powers.shape[0] == 3
    for _ in range(_NEWTON_STEPS):
        surface_at(c, powers, a, b, s)
        g1 = g2 = h11 = h12 = h22 = k11 = k12 = k22 = 0.0
        for i in range(3):
            d[i] = x[i] - s[0, i]
            g1 += d[i] * s[1, i]
            g2 += d[i] * s[2, i]
            h11 += s[1, i] * s[1, i]
            h12 += s[1, i] * s[2, i]
            h22 += s[2, i] * s[2, i]
            k11 += d[i] * s[3, i]
            k12 += d[i] * s[4, i]
            k22 += d[i] * s[5, i]
        det = h11 * h22 - h12 * h12
        n11, n12, n22 = h11 - k11, h12 - k12, h22 - k22
        full = n11 * n22 - n12 * n12
        # Newton where it is safe, Gauss-Newton elsewhere.
        if n11 > 0.0 and full > 0.1 * det:
            h11, h12, h22, det = n11, n12, n22, full
        da = (h22 * g1 - h12 * g2) / det
        db = (h11 * g2 - h12 * g1) / det
        a += da
        b += db
        # Far outside nothing is gained by going on: the edges follow.
        if linear or abs(da) + abs(db) < _SMALL or abs(a) + abs(b) > 4.0:
            break
    inside = a >= 0.0 and b >= 0.0 and (a + b <= 1.0 if triangle else (a <= 1.0 and b <= 1.0))
    if inside:
        surface_at(c, powers, a, b, s)
        square = 0.0
        for i in range(3):
            d[i] = x[i] - s[0, i]
            square += d[i] * d[i]
        return a, b, square
    best = np.inf
    best_a = best_b = 0.0
    for edge in range(3 if triangle else 4):
        # From (a0, b0) in direction (ea, eb).
        if edge == 0:
            a0, b0, ea, eb = 0.0, 0.0, 1.0, 0.0
        elif edge == 1:
            a0, b0, ea, eb = 0.0, 0.0, 0.0, 1.0
        elif triangle:
            a0, b0, ea, eb = 1.0, 0.0, -1.0, 1.0
        elif edge == 2:
            a0, b0, ea, eb = 0.0, 1.0, 1.0, 0.0
        else:
            a0, b0, ea, eb = 1.0, 0.0, 0.0, 1.0
        t = 0.5
        for _ in range(_NEWTON_STEPS):
            surface_at(c, powers, a0 + t * ea, b0 + t * eb, s)
            g = h = k = 0.0
            for i in range(3):
                d[i] = x[i] - s[0, i]
                along = ea * s[1, i] + eb * s[2, i]
                g += d[i] * along
                h += along * along
                k += d[i] * (ea * ea * s[3, i] + 2.0 * ea * eb * s[4, i] + eb * eb * s[5, i])
            if h - k > 0.1 * h:
                h -= k
            before = t
            t = min(1.0, max(0.0, t + g / h))
            if linear or abs(t - before) < _SMALL:
                break
        surface_at(c, powers, a0 + t * ea, b0 + t * eb, s)
        square = 0.0
        for i in range(3):
            d[i] = x[i] - s[0, i]
            square += d[i] * d[i]
        if square < best:
            best, best_a, best_b = square, a0 + t * ea, b0 + t * eb
    return best_a, best_b, best


@njit(void(F2, I2, i8, F2, F2), **STRICT)
def coefficients(nodes: Array, facets: Index, facet: int, C: Array, c: Array) -> None:
    """Write the coefficients of a facet's monomials into ``c`` ``(n, 3)``."""
    c[:] = 0.0
    for k in range(C.shape[0]):
        for a in range(C.shape[1]):
            for i in range(3):
                c[k, i] += C[k, a] * nodes[facets[facet, a], i]


@njit(f8(F2, I2, F1, f8, f8, F2), **STRICT)
def _cosine(c: Array, powers: Index, x: Array, a: float, b: float, s: Array) -> float:
    """Return the cosine of the angle between the outward normal at ``a, b`` and the way from there to ``x``."""
    surface_at(c, powers, a, b, s)
    n0 = s[1, 1] * s[2, 2] - s[1, 2] * s[2, 1]
    n1 = s[1, 2] * s[2, 0] - s[1, 0] * s[2, 2]
    n2 = s[1, 0] * s[2, 1] - s[1, 1] * s[2, 0]
    d0, d1, d2 = x[0] - s[0, 0], x[1] - s[0, 1], x[2] - s[0, 2]
    sizes = (n0 * n0 + n1 * n1 + n2 * n2) * (d0 * d0 + d1 * d1 + d2 * d2)
    return (d0 * n0 + d1 * n1 + d2 * n2) / np.sqrt(sizes) if sizes > 0.0 else 0.0


@njit(void(F2, SURFACE, CLOSEST), **STRICT)
def closest(nodes: Array, surface: Surface, found: Closest) -> None:
    """Find the closest points of a surface by walking over its facets.

    Parameters
    ----------
    nodes
        Present positions, shape ``(nodes, 3)``.
    surface
        What is looked at.
    found
        Positions ``x``, and the ``facet`` from which to start, overwritten with where the walk ended; ``xi`` and
        ``gap`` are written.
    """
    x, facet, xi, gap = found
    facets, neighbours, (C, powers, triangle) = surface
    c = np.empty((C.shape[0], 3))
    s = np.empty((6, 3))
    d = np.empty(3)
    for m in range(x.shape[0]):
        here = facet[m]
        coefficients(nodes, facets, here, C, c)
        a, b, square = _closest_on_facet(c, powers, x[m], triangle, s, d)
        walking = True
        while walking:
            walking = False
            cosine = _cosine(c, powers, x[m], a, b, s)
            third = 1.0 - a - b if triangle else min(1.0 - a, 1.0 - b)
            # Seen from inside, a convex surface with kinks has a closest point on each of several facets.
            if cosine > 0.0 and a > 0.0 and b > 0.0 and third > 0.0:
                break
            centre = here
            for j in range(neighbours.shape[1]):
                other = neighbours[centre, j]
                if other < 0:
                    break
                coefficients(nodes, facets, other, C, c)
                other_a, other_b, other_square = _closest_on_facet(c, powers, x[m], triangle, s, d)
                if other_square < square * (1.0 - 1e-12):
                    here, a, b, square = other, other_a, other_b, other_square
                    walking = True
            coefficients(nodes, facets, here, C, c)
        facet[m], xi[m, 0], xi[m, 1] = here, a, b
        gap[m] = -np.sqrt(square) if cosine < -_STEEP else np.sqrt(square)


@njit(void(F2, POINTS, F2), **STRICT)
def place(nodes: Array, points: Points, out: Array) -> None:
    """Write where points are into ``out`` ``(m, 3)``."""
    supports, shares, _ = points
    for m in range(out.shape[0]):
        for i in range(3):
            value = 0.0
            for b in range(supports.shape[1]):
                value += shares[m, b] * nodes[supports[m, b], i]
            out[m, i] = value
