"""Compiled: the lateral surfaces of rods as contact sees them, and the closest point on one.

A surface is ``x(theta, u) = sum_ij Phi_i(theta) R_j(u) x_ij`` (Lu & Zhou 2011, eqs. 7 and 11, on the circle; arcs
need not be equal, `isorod.space.graded`), with control points of the space, or of its trace
(`isorod.contact.traces`); ``s`` in ``[-1, 1]`` is the parameter along an element of its axis.  Closest points are those
of the surface itself.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, njit
from isorod.contact.packed import ELEMENT_ROW, ELEMENTS, FUNCTIONS, START_ROW, SURFACE_ROW, Row, Table

# Outcome of a closest-point search.
FREE, EDGE, END, LOST = 0, 1, 2, 3

_ITERATIONS = 60
_HALVINGS = 10

# Tolerance of projections, relative to the radius (and to the round-off of the coordinates).
_TOLERANCE = 1e-13
_ROUNDING = 2e-15
# After so many iterations only round-off prevents convergence: the tolerance is relaxed.
_SLOW = 20
_LOOSER = 1e3


class Projection(NamedTuple):
    """A point of a surface, and the vector from it to another point.

    Attributes
    ----------
    phi
        Values, first and second derivatives of the control points before, on and after the arc, ``(3, 3)``.
    axial
        The same of the axis functions, ``(3, l)``.
    y
        The point and its derivatives by t, s, tt, ts, ss (t is theta), ``(6, 3)``.
    d
        Vector to the other point, ``(3,)``.
    normal
        Outward unit normal, ``(3,)``; see `surface_gap`.
    """

    phi: Array
    axial: Array
    y: Array
    d: Array
    normal: Array


PROJECTION = types.NamedTuple((F2, F2, F2, F1, F1), Projection)


class Slopes(NamedTuple):
    """Gradient ``g`` of half the squared distance by (theta, s), and the surface's metric ``a``."""

    g1: float
    g2: float
    a11: float
    a12: float
    a22: float


SLOPES = types.NamedUniTuple(f8, 5, Slopes)


@njit(PROJECTION(), **FAST)
def new_projection() -> Projection:
    """Return a projection to be filled."""
    return Projection(np.empty((3, 3)), np.empty((3, FUNCTIONS)), np.empty((6, 3)), np.empty(3), np.empty(3))


@njit(f8(F1, F1), **FAST)
def dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(i8(SURFACE_ROW, f8), **FAST)
def _turns(surface: Row, theta: float) -> int:
    """Return how many fine arcs an angle is from the first, rounded."""
    return int(np.floor((theta - surface.turn) * surface.fine / (2.0 * np.pi) + 0.5))


@njit(i8(SURFACE_ROW, i8), **FAST)
def _arc(surface: Row, fine: int) -> int:
    """Return the arc of a fine arc."""
    return fine if surface.fine == surface.around else surface.arc_of[fine]


@njit(i8(SURFACE_ROW, f8), **FAST)
def arc_of(surface: Row, theta: float) -> int:
    """Return the arc of an angle: that about control point ``arc``."""
    return _arc(surface, _turns(surface, theta) % surface.fine)


@njit(i8(SURFACE_ROW, f8, F2), **FAST)
def section_functions(surface: Row, theta: float, phi: Array) -> int:
    """Fill ``phi`` (see `Projection`), and return the arc."""
    turns, arcs = _turns(surface, theta), surface.arcs
    whole = turns // surface.fine
    number = _arc(surface, turns - whole * surface.fine)
    angle = theta - 2.0 * np.pi * whole - arcs[number, 0]
    cos, sin = np.cos(angle), np.sin(angle)
    ca, flat, steep, before, after = arcs[number, 1], arcs[number, 2], arcs[number, 3], arcs[number, 4], arcs[number, 5]
    for d in range(3):
        if d == 0:
            middle, slope, constant = (cos - ca) * flat, sin * steep, 1.0
        elif d == 1:
            middle, slope, constant = -sin * flat, cos * steep, 0.0
        else:
            middle, slope, constant = -cos * flat, -sin * steep, 0.0
        phi[d, 0] = 0.5 * before * (constant - middle - slope)
        phi[d, 2] = 0.5 * after * (constant - middle + slope)
        phi[d, 1] = constant - phi[d, 0] - phi[d, 2]
    return number


@njit(void(ELEMENT_ROW, i8, f8, F2), **FAST)
def axis_functions(element: Row, count: int, s: float, axial: Array) -> None:
    """Fill ``axial`` (see `Projection`) with those of the ``count`` rational functions of an element."""
    polynomials = element.polynomials
    w0 = w1 = w2 = 0.0
    for j in range(count):
        v0 = polynomials[j, count - 1]
        v1 = v2 = 0.0
        for k in range(count - 2, -1, -1):
            v2 = v2 * s + 2.0 * v1
            v1 = v1 * s + v0
            v0 = v0 * s + polynomials[j, k]
        axial[0, j], axial[1, j], axial[2, j] = v0, v1, v2
        w0 += v0
        w1 += v1
        w2 += v2
    for j in range(count):
        r = axial[0, j] / w0
        dr = (axial[1, j] - r * w1) / w0
        axial[2, j] = (axial[2, j] - 2.0 * dr * w1 - r * w2) / w0
        axial[1, j] = dr
        axial[0, j] = r


@njit(void(SURFACE_ROW, ELEMENT_ROW, f8, f8, F2, PROJECTION), **FAST)
def evaluate(surface: Row, element: Row, theta: float, s: float, positions: Array, projection: Projection) -> None:
    """Fill ``phi``, ``axial`` and ``y`` of a projection.

    Parameters
    ----------
    surface, element
        Rows of `isorod.contact.packed`.
    theta, s
        Parameters of the point: round the section, radians, and along the element, in ``[-1, 1]``.
    positions
        Of the nodes, shape ``(nodes, 3)``.
    projection
        What is filled.
    """
    n, count = surface.around, surface.functions
    phi, axial, y = projection.phi, projection.axial, projection.y
    arc = section_functions(surface, theta, phi)
    axis_functions(element, count, s, axial)
    layers = element.layers
    y[:] = 0.0
    for i in range(3):
        node = (arc + i - 1) % n
        for a in range(3):
            c0 = c1 = c2 = 0.0
            for j in range(count):
                x = positions[layers[j] + node, a]
                c0 += axial[0, j] * x
                c1 += axial[1, j] * x
                c2 += axial[2, j] * x
            y[0, a] += phi[0, i] * c0
            y[1, a] += phi[1, i] * c0
            y[2, a] += phi[0, i] * c1
            y[3, a] += phi[2, i] * c0
            y[4, a] += phi[1, i] * c1
            y[5, a] += phi[0, i] * c2


@njit(SLOPES(PROJECTION, F1), **FAST)
def _slopes(projection: Projection, x: Array) -> Slopes:
    """Fill ``d`` of a projection, its vector to a point ``x``, and return the slopes of their distance."""
    y, d = projection.y, projection.d
    for a in range(3):
        d[a] = x[a] - y[0, a]
    return Slopes(-dot(d, y[1]), -dot(d, y[2]), dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2]))


@njit(types.UniTuple(f8, 2)(PROJECTION, SLOPES, f8, b1, b1), **FAST)
def _newton_step(projection: Projection, at: Slopes, s: float, held: bool, round_first: bool) -> tuple[float, float]:
    """Return Newton's step of (theta, s), with the metric in the place of a Hessian that is not positive.

    ``held`` keeps ``s``.  Where the step leaves the element although the gradient points inward, only one parameter
    changes: theta if ``round_first``.
    """
    y, d = projection.y, projection.d
    h11, h12, h22 = at.a11 - dot(d, y[3]), at.a12 - dot(d, y[4]), at.a22 - dot(d, y[5])
    if held:
        return -at.g1 / (h11 if h11 > 1e-3 * at.a11 else at.a11), 0.0
    det = h11 * h22 - h12 * h12
    if h11 <= 1e-3 * at.a11 or det <= 1e-6 * at.a11 * at.a22:
        h11, h12, h22 = at.a11, at.a12, at.a22
        det = h11 * h22 - h12 * h12
    step_theta = (h12 * at.g2 - h22 * at.g1) / det
    step_s = (h12 * at.g1 - h11 * at.g2) / det
    if (s == 1.0 and step_s > 0.0) or (s == -1.0 and step_s < 0.0):
        # The gradient points inward, the coupled step outward.
        if round_first:
            return -at.g1 / h11, 0.0
        return 0.0, -at.g2 / h22
    return step_theta, step_s


@njit(types.UniTuple(f8, 3)(f8, f8, f8, f8), **FAST)
def _cut(step_theta: float, step_s: float, s: float, longest: float) -> tuple[float, float, float]:
    """Return a step cut to ``longest`` in theta, and to 1 and the element's end in ``s``; and the new ``s``."""
    cut = 1.0
    if abs(step_theta) > longest:
        cut = longest / abs(step_theta)
    if abs(step_s) * cut > 1.0:
        cut = 1.0 / abs(step_s)
    if s + cut * step_s >= 1.0 and step_s > 0.0:
        cut = (1.0 - s) / step_s
        return cut * step_theta, cut * step_s, 1.0
    if s + cut * step_s <= -1.0 and step_s < 0.0:
        cut = (-1.0 - s) / step_s
        return cut * step_theta, cut * step_s, -1.0
    return cut * step_theta, cut * step_s, s + cut * step_s


@njit(i8(SURFACE_ROW, ELEMENTS, F1, START_ROW, F2, PROJECTION), **FAST)
def closest(surface: Row, elements: Table, x: Array, start: Row, positions: Array, projection: Projection) -> int:
    """Find the point of a surface nearest to ``x``, move ``start`` there, and fill ``projection`` but its normal.

    Newton on half the squared distance, with steps halved until that decreases; the search goes from element to
    element through their ends.

    Parameters
    ----------
    surface, elements
        A row, and all elements, of `isorod.contact.packed`.
    x
        The point, shape ``(3,)``.
    start
        Where the search starts; on return where it ended.
    positions
        Of the nodes, shape ``(nodes, 3)``.
    projection
        What is filled.

    Returns
    -------
    outcome
        `FREE`: a stationary point; `EDGE`: on a knot at which the surface has a kink; `END`: on an end of the surface,
        ``x`` lies beyond it; `LOST`: no convergence.
    """
    row, theta, s = start.element, start.theta, start.s
    longest = 2.0 * np.pi / surface.around
    size = max(abs(x[0]), abs(x[1]), abs(x[2]))
    last = np.inf
    old_theta, old_s, step_theta, step_s = theta, s, 0.0, 0.0
    halvings = 0
    switched = False
    outcome = LOST
    for iteration in range(_ITERATIONS):
        element = elements[row]
        evaluate(surface, element, theta, s, positions, projection)
        at = _slopes(projection, x)
        square = 0.5 * dot(projection.d, projection.d)
        # The round-off of the coordinates is in the distance, however small the steps.
        noise = 1e-14 * (at.a11 + square) + _ROUNDING * size * np.sqrt(2.0 * square)
        if square > last + noise and halvings < _HALVINGS:
            halvings += 1
            step_theta *= 0.5
            step_s *= 0.5
            theta = old_theta + step_theta
            s = old_s + step_s
            continue
        r1, r2 = np.sqrt(at.a11), np.sqrt(at.a22)
        limit = (_TOLERANCE * r1 + _ROUNDING * size) * (_LOOSER if iteration > _SLOW else 1.0)
        round_done, along_done = abs(at.g1) <= limit * r1, abs(at.g2) <= limit * r2
        blocked = False
        if (s == 1.0 and at.g2 < 0.0) or (s == -1.0 and at.g2 > 0.0):
            other = element.neighbours[1 if s == 1.0 else 0]
            blocked = other < 0 or switched
            if not blocked and not along_done:
                row, s, switched, last = other, -s, True, np.inf
                old_theta, old_s, step_theta, step_s = theta, s, 0.0, 0.0
                continue
        if round_done and (blocked or along_done):
            outcome = FREE if along_done else EDGE if switched else END
            break
        old_theta, old_s, last, halvings, switched = theta, s, square, 0, False
        step_theta, step_s = _newton_step(projection, at, s, blocked, not round_done)
        step_theta, step_s, s = _cut(step_theta, step_s, s, longest)
        theta += step_theta
    start.element, start.theta, start.s = row, theta, s
    return outcome


@njit(f8(PROJECTION, b1), **FAST)
def surface_gap(projection: Projection, edge: bool) -> float:
    """Return the gap at a closest point (see `closest`) and fill its normal; on an edge it is along ``d``."""
    y, d, normal = projection.y, projection.d, projection.normal
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        normal[a] = y[1, b] * y[2, c] - y[1, c] * y[2, b]
    length = np.sqrt(dot(normal, normal))
    for a in range(3):
        normal[a] /= length
    gap = dot(d, normal)
    distance = np.sqrt(dot(d, d))
    if edge and distance > 0.0:
        gap = distance if gap > 0.0 else -distance
        for a in range(3):
            normal[a] = d[a] / gap
    return gap
