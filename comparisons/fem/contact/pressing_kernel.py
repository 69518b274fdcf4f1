"""Compiled loops of the contact between finite element surfaces: closest points, forces, stiffness.

A facet is ``s(xi) = sum_a N_a(xi) y_a`` with ``N_a = sum_k C_ka xi_1^p_k xi_2^q_k``.  The closest point minimises
``phi = |d|^2 / 2``, ``d = x - s(xi)``; where the facet's outward normal says that ``x`` is inside, the gap is ``-|d|``
and the energy of a point is ``penalty weight phi``.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from comparisons.fem.contact.closest_kernel import (
    CLOSEST,
    POINTS,
    SURFACE,
    Closest,
    Points,
    Surface,
    coefficients,
    surface_at,
)
from isorod.compiled import F1, F2, F3, I2, STRICT
from isorod.compiling import njit
from meshes.mesh import Array, Index


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


@njit(types.Tuple((f8, f8, f8, F1, f8))(F2, POINTS, SURFACE, CLOSEST, f8, F2), **STRICT)
def add_forces(
    nodes: Array, points: Points, surface: Surface, found: Closest, penalty: float, out: Array
) -> tuple[float, float, float, Array, float]:
    """Add the gradient of the penalty energy of one surface's points to ``out`` ``(nodes, 3)``.

    What is returned, in a plain tuple, makes a `Pressing`.

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
    return energy, normal, area, resultant, smallest


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


@njit(void(F2, POINTS, SURFACE, CLOSEST, f8, I2, F3), **STRICT)
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
        coefficients(nodes, facets, facet[m], C, c)
        surface_at(c, powers, a, b, s)
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
