"""Compiled loops of the contact between finite element surfaces: closest points, forces, stiffness.

A facet is ``s(xi) = sum_a N_a(xi) y_a`` with ``N_a = sum_k C_ka xi_1^p_k xi_2^q_k``.  The closest point minimises
``phi = |d|^2 / 2``, ``d = x - s(xi)``; where the facet's outward normal says that ``x`` is inside, the gap is ``-|d|``
and the energy of a point is ``penalty weight phi``.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, njit, types, void

from isorod.compiled import F1, F2, F3, I1, I2, STRICT
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


class Pressing(NamedTuple):
    """State of a contact.

    Attributes
    ----------
    energy
        Penalty energy.
    normal_force
        Sum of the forces' sizes.
    area
        Reference area in contact, the mean of both sides.
    force
        Resultant on the first surface, shape ``(3,)``.
    gap
        The smallest one, negative where the surfaces are inside each other.
    """

    energy: float
    normal_force: float
    area: float
    force: Array
    gap: float


_FACET = types.NamedTuple([F2, I2, b1], Facet)
_SURFACE = types.NamedTuple([I2, I2, _FACET], Surface)
_POINTS = types.NamedTuple([I2, F2, F1], Points)
_CLOSEST = types.NamedTuple([F2, I1, F2, F1], Closest)
_PRESSING = types.NamedTuple([f8, f8, f8, F1, f8], Pressing)


@njit(void(F2, I2, f8, f8, F2), **STRICT)
def _surface(c: Array, powers: Index, a: float, b: float, out: Array) -> None:
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
        _surface(c, powers, a, b, s)
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
        _surface(c, powers, a, b, s)
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
            _surface(c, powers, a0 + t * ea, b0 + t * eb, s)
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
        _surface(c, powers, a0 + t * ea, b0 + t * eb, s)
        square = 0.0
        for i in range(3):
            d[i] = x[i] - s[0, i]
            square += d[i] * d[i]
        if square < best:
            best, best_a, best_b = square, a0 + t * ea, b0 + t * eb
    return best_a, best_b, best


@njit(void(F2, I2, i8, F2, F2), **STRICT)
def _coefficients(nodes: Array, facets: Index, facet: int, C: Array, c: Array) -> None:
    """Write the coefficients of a facet's monomials into ``c`` ``(n, 3)``."""
    c[:] = 0.0
    for k in range(C.shape[0]):
        for a in range(C.shape[1]):
            for i in range(3):
                c[k, i] += C[k, a] * nodes[facets[facet, a], i]


@njit(f8(F2, I2, F1, f8, f8, F2), **STRICT)
def _cosine(c: Array, powers: Index, x: Array, a: float, b: float, s: Array) -> float:
    """Return the cosine of the angle between the outward normal at ``a, b`` and the way from there to ``x``."""
    _surface(c, powers, a, b, s)
    n0 = s[1, 1] * s[2, 2] - s[1, 2] * s[2, 1]
    n1 = s[1, 2] * s[2, 0] - s[1, 0] * s[2, 2]
    n2 = s[1, 0] * s[2, 1] - s[1, 1] * s[2, 0]
    d0, d1, d2 = x[0] - s[0, 0], x[1] - s[0, 1], x[2] - s[0, 2]
    sizes = (n0 * n0 + n1 * n1 + n2 * n2) * (d0 * d0 + d1 * d1 + d2 * d2)
    return (d0 * n0 + d1 * n1 + d2 * n2) / np.sqrt(sizes) if sizes > 0.0 else 0.0


@njit(void(F2, _SURFACE, _CLOSEST), **STRICT)
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
        _coefficients(nodes, facets, here, C, c)
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
                _coefficients(nodes, facets, other, C, c)
                other_a, other_b, other_square = _closest_on_facet(c, powers, x[m], triangle, s, d)
                if other_square < square * (1.0 - 1e-12):
                    here, a, b, square = other, other_a, other_b, other_square
                    walking = True
            _coefficients(nodes, facets, here, C, c)
        facet[m], xi[m, 0], xi[m, 1] = here, a, b
        gap[m] = -np.sqrt(square) if cosine < -_STEEP else np.sqrt(square)


@njit(void(F2, _POINTS, F2), **STRICT)
def place(nodes: Array, points: Points, out: Array) -> None:
    """Write where points are into ``out`` ``(m, 3)``."""
    supports, shares, _ = points
    for m in range(out.shape[0]):
        for i in range(3):
            value = 0.0
            for b in range(supports.shape[1]):
                value += shares[m, b] * nodes[supports[m, b], i]
            out[m, i] = value


@njit(void(F2, I2, F2, i8, f8, f8), **STRICT)
def _functions(C: Array, powers: Index, out: Array, n: int, a: float, b: float) -> None:
    """Write ``N_a``, ``N_a,1``, ``N_a,2`` into the rows of ``out`` from column ``n`` on."""
    for j in range(C.shape[1]):
        v = v1 = v2 = 0.0
        for k in range(powers.shape[0]):
            p, q = powers[k, 0], powers[k, 1]
            v += C[k, j] * a**p * b**q
            if p > 0:
                v1 += C[k, j] * p * a ** (p - 1) * b**q
            if q > 0:
                v2 += C[k, j] * q * a**p * b ** (q - 1)
        out[0, n + j], out[1, n + j], out[2, n + j] = v, v1, v2


@njit(_PRESSING(F2, _POINTS, _SURFACE, _CLOSEST, f8, F2), **STRICT)
def add_forces(nodes: Array, points: Points, surface: Surface, found: Closest, penalty: float, out: Array) -> Pressing:
    """Add the gradient of the penalty energy of one surface's points to ``out`` ``(nodes, 3)`` and return their state.

    Parameters
    ----------
    nodes
        Present positions, shape ``(nodes, 3)``.
    points, found
        The points and what `closest` found for them on ``surface``.
    penalty
        Force per volume.
    """
    supports, shares, weights = points
    x, facet, xi, gaps = found
    facets, _, (C, powers, _) = surface
    functions = np.empty((3, C.shape[1]))
    energy = normal = area = 0.0
    resultant = np.zeros(3)
    smallest = np.inf
    for m in range(x.shape[0]):
        gap = gaps[m]
        smallest = min(smallest, gap)
        if gap >= 0.0:
            continue
        _functions(C, powers, functions, 0, xi[m, 0], xi[m, 1])
        stiffness = penalty * weights[m]
        energy += 0.5 * stiffness * gap**2
        normal -= stiffness * gap
        area += weights[m]
        for i in range(3):
            d = x[m, i]
            for a in range(C.shape[1]):
                d -= functions[0, a] * nodes[facets[facet[m], a], i]
            force = stiffness * d
            resultant[i] -= force
            for b in range(supports.shape[1]):
                out[supports[m, b], i] += shares[m, b] * force
            for a in range(C.shape[1]):
                out[facets[facet[m], a], i] -= functions[0, a] * force
    return Pressing(energy, normal, area, resultant, smallest)


@njit(i8(f8, f8, b1, F2), **STRICT)
def _free_directions(a: float, b: float, triangle: bool, way: Array) -> int:
    """Write the directions in which a closest point is free into the rows of ``way``; return how many there are."""
    way[0, 0], way[0, 1], way[1, 0], way[1, 1] = 1.0, 0.0, 0.0, 1.0
    low_a, low_b = a <= 0.0, b <= 0.0
    if triangle:
        slant = a + b >= 1.0
        if not (low_a or low_b or slant):
            return 2
        if (low_a and low_b) or (slant and (low_a or low_b)):
            return 0
        if slant:
            way[0, 0], way[0, 1] = -1.0, 1.0
        elif low_a:
            way[0, 0], way[0, 1] = 0.0, 1.0
        return 1
    fixed_a, fixed_b = low_a or a >= 1.0, low_b or b >= 1.0
    if fixed_a and fixed_b:
        return 0
    if fixed_a:
        way[0, 0], way[0, 1] = 0.0, 1.0
    return 1 if fixed_a or fixed_b else 2


@njit(types.UniTuple(f8, 3)(i8, F2, F2, F1), **STRICT)
def _compliance(free: int, way: Array, s: Array, d: Array) -> tuple[float, float, float]:
    """Return the entries 11, 12, 22 of the inverse of ``phi_xixi`` in the free directions, zero elsewhere."""
    H = np.zeros((2, 2))
    for f in range(free):
        for g in range(free):
            for i in range(3):
                t_f = way[f, 0] * s[1, i] + way[f, 1] * s[2, i]
                t_g = way[g, 0] * s[1, i] + way[g, 1] * s[2, i]
                bend = way[f, 0] * way[g, 0] * s[3, i] + way[f, 1] * way[g, 1] * s[5, i]
                bend += (way[f, 0] * way[g, 1] + way[f, 1] * way[g, 0]) * s[4, i]
                H[f, g] += t_f * t_g - d[i] * bend
    if free == 2:
        det = H[0, 0] * H[1, 1] - H[0, 1] * H[1, 0]
        return H[1, 1] / det, -H[0, 1] / det, H[0, 0] / det
    return (1.0 / H[0, 0] if free == 1 else 0.0), 0.0, 0.0


@njit(void(i8, F2, F2, F2, F1, F2), **STRICT)
def _mixed(free: int, way: Array, share: Array, s: Array, d: Array, out: Array) -> None:
    """Write ``phi_xiq`` in the free directions into the rows of ``out`` ``(2, 3 n)``, zeros into the others."""
    out[:] = 0.0
    for f in range(free):
        for j in range(share.shape[1]):
            slope = way[f, 0] * share[1, j] + way[f, 1] * share[2, j]
            for i in range(3):
                t_f = way[f, 0] * s[1, i] + way[f, 1] * s[2, i]
                out[f, 3 * j + i] = slope * d[i] - share[0, j] * t_f


@njit(void(F2, _POINTS, _SURFACE, _CLOSEST, f8, I2, F3), **STRICT)
def stiffness(
    nodes: Array, points: Points, surface: Surface, found: Closest, penalty: float, numbers: Index, blocks: Array
) -> None:
    """Write the second derivative of each point's energy.

    ``phi_qq - phi_qxi (phi_xixi)^-1 phi_xiq`` for ``q`` the nodes of point and facet and ``xi`` what the closest point
    is free to move in: nothing at a corner, one direction on an edge.

    Parameters
    ----------
    nodes
        Present positions, shape ``(nodes, 3)``.
    points, found
        Points in contact, and what `closest` found for them on ``surface``.
    penalty
        Force per volume.
    numbers, blocks
        Written: the nodes ``(m, n)`` and the matrices ``(m, 3 n, 3 n)``.
    """
    supports, shares, weights = points
    x, facet, xi, _ = found
    facets, _, (C, powers, triangle) = surface
    own, other = supports.shape[1], C.shape[1]
    n = own + other
    share = np.zeros((3, n))
    c = np.empty((other, 3))
    s = np.empty((6, 3))
    d = np.empty(3)
    way = np.empty((2, 2))
    mixed = np.empty((2, 3 * n))
    for m in range(x.shape[0]):
        a, b = xi[m, 0], xi[m, 1]
        numbers[m, :own] = supports[m]
        numbers[m, own:] = facets[facet[m]]
        share[0, :own] = shares[m]
        _functions(C, powers, share, own, a, b)
        share[:, own:] *= -1.0
        _coefficients(nodes, facets, facet[m], C, c)
        _surface(c, powers, a, b, s)
        for i in range(3):
            d[i] = x[m, i] - s[0, i]
        free = _free_directions(a, b, triangle, way)
        i00, i01, i11 = _compliance(free, way, s, d)
        _mixed(free, way, share, s, d, mixed)
        factor = penalty * weights[m]
        for p in range(3 * n):
            for q in range(3 * n):
                value = share[0, p // 3] * share[0, q // 3] if p % 3 == q % 3 else 0.0
                value -= i00 * mixed[0, p] * mixed[0, q] + i11 * mixed[1, p] * mixed[1, q]
                value -= i01 * (mixed[0, p] * mixed[1, q] + mixed[1, p] * mixed[0, q])
                blocks[m, p, q] = factor * value
