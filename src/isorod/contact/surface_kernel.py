"""Compiled: the lateral surfaces of rods as contact sees them, and the closest point on one.

A surface is ``x(theta, u) = sum_ij Phi_i(theta) R_j(u) x_ij`` (Lu & Zhou 2011, eqs. 7 and 11, on the circle).  Each
element of its axis is a row of tables; ``s`` in ``[-1, 1]`` is the parameter along one.  Closest points are those of
the surface itself.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, njit, types

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, F3, FAST, I1, I2
from isorod.geometry.axis import MAX_DEGREE

# What a pass has in the place of a second surface.
PLANE, CYLINDER = -1, -2

# Outcome of a closest-point search.
FREE, EDGE, END, LOST = 0, 1, 2, 3

_ITERATIONS = 60
_HALVINGS = 10

# Projections are exact to this, relative to the radius (and to rounding of the coordinates).
_TOLERANCE = 1e-13
_ROUNDING = 2e-15

FUNCTIONS = MAX_DEGREE + 1


class Packed(NamedTuple):
    """All contact pairs of a model as plain arrays, for compiled loops; made by `isorod.contact.pack`.

    With ``S`` surfaces, ``E`` axis elements of all of them, ``P`` passes (one slave surface against one master each),
    ``Q`` slave points and ``l = 7`` places for axis functions.

    Attributes
    ----------
    surfaces
        ``n``, degree, first row, number of rows, and the pass in which the surface is slave (its points start the
        search), ``(S, 5)``.
    turns
        Angle of the first control point of each surface, and cosine and sine of half an arc, ``(S, 3)``.
    layers
        Node (of the model) at which each layer of an element begins, ``(E, l)``.
    polynomials
        Weighted axis functions of an element in powers of ``s``, ``(E, l, l)``.
    neighbours
        Rows of the elements before and after, -1 at an end of the surface, ``(E, 2)``.
    spans
        Middle and half length of the elements in ``u``, ``(E, 2)``.
    passes
        Slave surface, master surface (or `PLANE`, `CYLINDER`), first point, points round an arc, points along an
        element, first row in ``around``, first row in ``along``, ``(P, 7)``.
    penalty
        Force per volume, ``(P,)``.
    rigid
        Point, unit normal or axis, radius, ``(P, 7)``.
    around, along
        The three ``Phi`` at the points of an arc, and the ``R`` at the points of the elements.
    areas
        Reference areas of the points, halved where both surfaces are slaves in turn, ``(Q,)``.
    multipliers
        Pressures of the augmented Lagrangian, zero for a plain penalty, ``(Q,)``.
    starts
        Row, ``theta``, ``s`` of the last projection, row -1 where there is none, ``(Q, 3)``: all there is of history.
    states
        Outcome of the last call: gap (NaN where no projection was needed), pressure, and 1 on an `EDGE`, else 0,
        ``(Q, 3)``.
    places
        Positions of the points in the last call, ``(Q, 3)``.
    boxes
        Scratch: lower and upper corners of the elements, ``(E, 6)``.
    carriers
        Nodes of all surfaces.
    before, travel
        Positions of the nodes in the last call, ``(nodes, 3)``, and the sum of the longest way any carrier has gone in
        each call, ``(1,)``: no point of a surface has moved farther.
    clear
        A point needs no search while ``travel`` is below this, ``(Q,)``: it was too far away.  This saves time and
        changes no result, so that it is no history either; minus infinity asks for a search.
    """

    surfaces: Index
    turns: Array
    layers: Index
    polynomials: Array
    neighbours: Index
    spans: Array
    passes: Index
    penalty: Array
    rigid: Array
    around: Array
    along: Array
    areas: Array
    multipliers: Array
    starts: Array
    states: Array
    places: Array
    boxes: Array
    carriers: Index
    before: Array
    travel: Array
    clear: Array


_FIELDS = (I2, F2, I2, F3, I2, F2, I2, F1, F2, F2, F2, F1, F1, F2, F2, F2, F2, I1, F2, F1, F1)

# The numba type of `Packed`, for explicit signatures of functions that take one.
PACKED = types.NamedTuple(_FIELDS, Packed)


@njit(i8(i8, i8, F1, F2, f8, f8, F2, F2), **FAST)
def functions(
    n: int, count: int, turn: Array, polynomials: Array, theta: float, s: float, phi: Array, axial: Array
) -> int:
    """Fill ``phi`` ``(3, 3)`` and ``axial`` ``(3, l)`` with values, first and second derivatives; return the arc.

    ``phi`` belongs to the control points before, on and after the arc; ``count`` is the number of axis functions.  All
    of `Packed` is not passed on here: it is a kilobyte, copied at each call.
    """
    alpha = np.pi / n
    angle = theta - turn[0]
    arc = int(np.floor(angle / (2.0 * alpha) + 0.5))
    angle -= 2.0 * alpha * arc
    cos, sin = np.cos(angle), np.sin(angle)
    ca, sa = turn[1], turn[2]
    for d in range(3):
        if d == 0:
            middle, slope, one = (cos - ca) * ca / (sa * sa), sin / sa, 1.0
        elif d == 1:
            middle, slope, one = -sin * ca / (sa * sa), cos / sa, 0.0
        else:
            middle, slope, one = -cos * ca / (sa * sa), -sin / sa, 0.0
        phi[d, 0] = 0.25 * (one - middle - slope)
        phi[d, 1] = 0.5 * (one + middle)
        phi[d, 2] = 0.25 * (one - middle + slope)
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
    return arc % n


@njit(i8(i8, i8, F1, F2, I1, f8, f8, F2, F2, F2, F2), **FAST)
def evaluate(
    n: int,
    count: int,
    turn: Array,
    polynomials: Array,
    layers: Index,
    theta: float,
    s: float,
    positions: Array,
    phi: Array,
    axial: Array,
    y: Array,
) -> int:
    """Fill ``y`` ``(6, 3)`` with the point and its derivatives by t, s, tt, ts, ss (t is theta); return the arc."""
    arc = functions(n, count, turn, polynomials, theta, s, phi, axial)
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
    return arc


@njit(f8(F1, F1), **FAST)
def dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(
    types.UniTuple(i8, 2)(PACKED, i8, F1, F1, F2, F2, F2, F2, F1),
    **FAST,
)
def closest(
    packed: Packed, surface: int, x: Array, start: Array, positions: Array, phi: Array, axial: Array, y: Array, d: Array
) -> tuple[int, int]:
    """Find the point of a surface nearest to ``x``, from ``start`` (row, theta, s), which is moved there.

    Newton on half the squared distance, with the metric in the place of the Hessian where that is not positive, steps
    halved until the distance falls, and elements left through their ends one at a time.  Leaves ``phi``, ``axial``,
    ``y`` (see `evaluate`) and ``d = x - y`` of the point found.

    Returns
    -------
    outcome, arc
        `FREE`: a stationary point; `EDGE`: on a knot at which the surface has a kink; `END`: on an end of the surface,
        ``x`` lies beyond it; `LOST`: no convergence.
    """
    row, theta, s = int(start[0]), start[1], start[2]
    n, count, turn = packed.surfaces[surface, 0], packed.surfaces[surface, 1] + 1, packed.turns[surface]
    longest = 2.0 * np.pi / n
    size = max(abs(x[0]), abs(x[1]), abs(x[2]))
    halvings = 0
    last = np.inf
    old_theta, old_s, step_theta, step_s = theta, s, 0.0, 0.0
    switched = False
    outcome = LOST
    arc = 0
    for iteration in range(_ITERATIONS):
        arc = evaluate(n, count, turn, packed.polynomials[row], packed.layers[row], theta, s, positions, phi, axial, y)
        for a in range(3):
            d[a] = x[a] - y[0, a]
        a11, a12, a22 = dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2])
        square = 0.5 * dot(d, d)
        if square > last + 1e-14 * a11 and halvings < _HALVINGS:
            halvings += 1
            step_theta *= 0.5
            step_s *= 0.5
            theta = old_theta + step_theta
            s = old_s + step_s
            continue
        g1, g2 = -dot(d, y[1]), -dot(d, y[2])
        r1, r2 = np.sqrt(a11), np.sqrt(a22)
        limit = _TOLERANCE * r1 + _ROUNDING * size
        if iteration > 20:
            # Rounding keeps it from getting better.
            limit *= 1e3
        blocked = False
        if (s == 1.0 and g2 < 0.0) or (s == -1.0 and g2 > 0.0):
            other = packed.neighbours[row, 1 if s == 1.0 else 0]
            if other < 0 or switched:
                blocked = True
            elif abs(g2) > limit * r2:
                row = other
                s = -s
                switched = True
                last = np.inf
                step_theta = step_s = 0.0
                old_theta, old_s = theta, s
                continue
        if abs(g1) <= limit * r1 and (blocked or abs(g2) <= limit * r2):
            if not blocked or abs(g2) <= limit * r2:
                outcome = FREE
            elif switched:
                outcome = EDGE
            else:
                outcome = END
            break
        h11, h12, h22 = a11 - dot(d, y[3]), a12 - dot(d, y[4]), a22 - dot(d, y[5])
        if blocked:
            h = h11 if h11 > 1e-3 * a11 else a11
            step_theta, step_s = -g1 / h, 0.0
        else:
            det = h11 * h22 - h12 * h12
            if h11 <= 1e-3 * a11 or det <= 1e-6 * a11 * a22:
                h11, h12, h22 = a11, a12, a22
                det = h11 * h22 - h12 * h12
            step_theta = (h12 * g2 - h22 * g1) / det
            step_s = (h12 * g1 - h11 * g2) / det
            if (s == 1.0 and step_s > 0.0) or (s == -1.0 and step_s < 0.0):
                # The gradient points inward, the coupled step outward: one parameter at a time.
                if abs(g1) > limit * r1:
                    step_theta, step_s = -g1 / h11, 0.0
                else:
                    step_theta, step_s = 0.0, -g2 / h22
        cut = 1.0
        if abs(step_theta) > longest:
            cut = longest / abs(step_theta)
        if abs(step_s) * cut > 1.0:
            cut = 1.0 / abs(step_s)
        bound = 0.0
        if s + cut * step_s >= 1.0 and step_s > 0.0:
            cut = (1.0 - s) / step_s
            bound = 1.0
        elif s + cut * step_s <= -1.0 and step_s < 0.0:
            cut = (-1.0 - s) / step_s
            bound = -1.0
        step_theta *= cut
        step_s *= cut
        last, halvings, switched = square, 0, False
        old_theta, old_s = theta, s
        theta += step_theta
        s = bound if bound != 0.0 else s + step_s
    start[0], start[1], start[2] = row, theta, s
    return outcome, arc


@njit(f8(F2, F1, b1, F1), **FAST)
def surface_gap(y: Array, d: Array, edge: bool, normal: Array) -> float:
    """Return the gap at a closest point (see `closest`) and fill the outward normal; on an edge it is along ``d``."""
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
