"""Compiled: what is near a point of a rod's surface, and until when nothing is.

Lemma (searches left out).  Let a point be farther than ``D`` from a surface, and let no control point have moved
farther than ``w`` since.  Then the point is farther than ``D - 2 w`` from the surface, so that there is no contact, and
nothing to search for, while ``w <= D / 2``.  Proof: a point of a surface at fixed parameters is a convex combination of
control points and has moved no farther than ``w`` either; the slave's point **and** the master's may both have
approached.  For a rigid obstacle, whose own displacement is added to ``w``, the condition is ``w <= D``.

``Packed.travel`` grows by the largest displacement of each call, in all by no less than ``w``; ``Packed.clear`` is its
value at which ``D / 2`` is used up.  ``D`` is the distance of the point from balls about sections of the masters, which
also enclose the surface between sections, and from boxes about the balls of an element; after a search, the gap less
that of zero pressure, where the projections are taken for the nearest.  The same lemma keeps the lists of elements near
an element: those made with a margin ``M`` between boxes leave out no element nearer than ``M - 2 w``.

A point that touches an inner surface is within its balls, or outside them by its penetration: half of the wall at most
(`isorod.contact.packed.SURFACE`).  Balls are larger by that, and ``D`` smaller; deeper points count as outside.

A search starts at sections whose balls hold the point, one in each segment of a rod that comes near and goes away
again; a point outside all balls is not in contact.  Of these segments, nearest first, the first that presses the point
counts, so that the result depends on present positions alone.  The search of an active point starts from its last
projection, and anew when it leaves.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, njit
from isorod.contact.packed import ELEMENT_ROW, FUNCTIONS, PACKED, PASS_ROW, SURFACE_ROW, Packed, Row


class Site(NamedTuple):
    """Where a slave point is: its element and arc, and its rows in `Packed.along` and `Packed.around`."""

    element: int
    arc: int
    along: int
    around: int


SITE = types.NamedUniTuple(i8, 4, Site)


@njit(SITE(PASS_ROW, SURFACE_ROW, i8), **FAST)
def site(pass_: Row, slave: Row, point: int) -> Site:
    """Return where a point of a pass is; points go round the section first, then along the elements."""
    around, q = divmod(point - pass_.first_point, pass_.across)
    place, arc = divmod(around, slave.around)
    q += arc * pass_.across
    return Site(slave.first_element + place // pass_.along, arc, pass_.first_along + place, pass_.first_around + q)


@njit(i8(PASS_ROW, SURFACE_ROW), **FAST)
def end_of(pass_: Row, slave: Row) -> int:
    """Return one more than the number of the last point of a pass."""
    return pass_.first_point + slave.elements * pass_.along * slave.around * pass_.across


@njit(b1(f8, f8, f8), **FAST)
def needs_search(multiplier: float, clear: float, travel: float) -> bool:
    """Return whether a slave point may have come near something since it was last known to be clear of all."""
    return multiplier > 0.0 or not clear > travel


@njit(void(PACKED, PASS_ROW, SURFACE_ROW, F2), **FAST)
def _place_points(packed: Packed, pass_: Row, slave: Row, positions: Array) -> None:
    """Fill ``points`` of a pass, except at sections where all are known to be far from all that they may touch."""
    n = slave.around
    section = np.empty((n, 3))
    multipliers, clear, travel = packed.multipliers, packed.clear, packed.travel[0]
    point = pass_.first_point
    for place in range(slave.elements * pass_.along):
        sought = False
        count = n * pass_.across if packed.own[point] else 0
        for k in range(point, point + count):
            sought = sought or needs_search(multipliers[k], clear[k], travel)
        if not sought:
            point += n * pass_.across
            continue
        element = packed.elements[slave.first_element + place // pass_.along]
        r = packed.along[pass_.first_along + place]
        for i in range(n):
            for a in range(3):
                value = 0.0
                for j in range(slave.functions):
                    value += r[j] * positions[element.layers[j] + i, a]
                section[i, a] = value
        for i in range(n):
            before, after = (i - 1) % n, (i + 1) % n
            for q in range(pass_.across):
                f = packed.around[pass_.first_around + i * pass_.across + q]
                for a in range(3):
                    x = f[0] * section[before, a] + f[1] * section[i, a] + f[2] * section[after, a]
                    packed.points[point, a] = x
                point += 1


@njit(void(PACKED, ELEMENT_ROW), **FAST)
def _widen(packed: Packed, element: Row) -> None:
    """Enlarge balls about sections so that they hold the surface between sections, also where the rod is stretched."""
    first, end = element.first_rung, element.first_rung + element.rungs
    last = 0.0
    for rung in range(first, end):
        following = 0.0
        if rung + 1 < end:
            for a in range(3):
                following += (packed.rings[rung + 1, a] - packed.rings[rung, a]) ** 2
        wide = max(element.reach**2, last, following)
        packed.rings[rung, 3] = np.sqrt(packed.rings[rung, 3] ** 2 + wide)
        last = following


@njit(void(PACKED, SURFACE_ROW, i8, F2, F2), **FAST)
def _surround(packed: Packed, surface: Row, row: int, positions: Array, layers: Array) -> None:
    """Fill ``rings`` of an element and the box round them; ``layers`` is work space.

    The centre of an outline is the mean of its control points weighted by their arcs.  Its distance from any of them is
    at most the mean of the layers' distances, weighted by the axis functions.
    """
    n, element, box, arcs = surface.around, packed.elements[row], packed.boxes[row], surface.arcs
    for j in range(surface.functions):
        first = element.layers[j]
        for a in range(3):
            layers[j, a] = 0.0
            for i in range(n):
                layers[j, a] += arcs[i, 6] * positions[first + i, a]
        farthest = 0.0
        for i in range(n):
            square = 0.0
            for a in range(3):
                square += (positions[first + i, a] - layers[j, a]) ** 2
            farthest = max(farthest, square)
        layers[j, 3] = np.sqrt(farthest)
    for rung in range(element.first_rung, element.first_rung + element.rungs):
        for a in range(4):
            value = 0.0
            for j in range(surface.functions):
                value += packed.rungs[rung, j] * layers[j, a]
            packed.rings[rung, a] = value
    _widen(packed, element)
    for a in range(3):
        box[0, a], box[1, a] = np.inf, -np.inf
        for rung in range(element.first_rung, element.first_rung + element.rungs):
            box[0, a] = min(box[0, a], packed.rings[rung, a] - packed.rings[rung, 3])
            box[1, a] = max(box[1, a], packed.rings[rung, a] + packed.rings[rung, 3])


@njit(void(PACKED, F2), **FAST)
def place(packed: Packed, positions: Array) -> None:
    """Fill ``points`` that may touch something, ``rings`` and ``boxes``."""
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        _place_points(packed, pass_, packed.surfaces[pass_.slave], positions)
    layers = np.empty((FUNCTIONS, 4))
    for k in range(packed.surfaces.size):
        surface = packed.surfaces[k]
        if not surface.sought:
            continue
        for row in range(surface.first_element, surface.first_element + surface.elements):
            _surround(packed, surface, row, positions, layers)


@njit(f8(F1, F2), **FAST)
def _beside(x: Array, box: Array) -> float:
    """Return how far a point is from a box, in its farthest coordinate; negative inside."""
    low, high = box[0], box[1]
    return max(low[0] - x[0], x[0] - high[0], low[1] - x[1], x[1] - high[1], low[2] - x[2], x[2] - high[2])


@njit(b1(F2, F2, f8), **FAST)
def _are_near(box: Array, other: Array, margin: float) -> bool:
    """Return whether two boxes are no farther from each other than a margin, in any coordinate."""
    for a in range(3):
        if box[0, a] - other[1, a] > margin or other[0, a] - box[1, a] > margin:
            return False
    return True


@njit(b1(PACKED, i8, f8, i8, f8), **FAST)
def may_touch(packed: Packed, row: int, fraction: float, other: int, other_fraction: float) -> bool:
    """Return whether points at fractions of two elements are of two bodies, or far enough apart along the axis."""
    first, second = packed.elements[row], packed.elements[other]
    surface = packed.surfaces[first.surface]
    if surface.body != packed.surfaces[second.surface].body:
        return True
    length, other_length = first.end - first.begin, second.end - second.begin
    distance = abs(first.begin + fraction * length - second.begin - other_fraction * other_length)
    return min(distance, surface.period - distance) >= np.pi * max(first.radius, second.radius)


@njit(i8(PACKED, PASS_ROW), **FAST)
def _last_row(packed: Packed, pass_: Row) -> int:
    """Return one more than the number of the last element of a pass' masters."""
    last = packed.surfaces[pass_.master + pass_.masters - 1]
    return last.first_element + last.elements


@njit(void(PACKED), **FAST)
def list_near(packed: Packed) -> None:
    """Make the lists of elements that are near each element and may touch it."""
    packed.listed[1] = packed.travel[0]
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        if pass_.master < 0:
            continue
        slave = packed.surfaces[pass_.slave]
        first, last = packed.surfaces[pass_.master].first_element, _last_row(packed, pass_)
        each = pass_.along * slave.around * pass_.across
        for row in range(slave.first_element, slave.first_element + slave.elements):
            if not packed.own[pass_.first_point + (row - slave.first_element) * each]:
                continue
            count = 0
            for other in range(first, last):
                if not _are_near(packed.boxes[row], packed.boxes[other], packed.listed[0]):
                    continue
                # The pairs of ends that are farthest apart.
                if not (may_touch(packed, row, 0.0, other, 1.0) or may_touch(packed, row, 1.0, other, 0.0)):
                    continue
                if count < packed.near.shape[1]:
                    packed.near[row, count] = other
                count += 1
            packed.counts[row] = count


@njit(f8(PACKED, i8, f8, F1, F2, F1), **FAST)
def angle_at(packed: Packed, row: int, fraction: float, x: Array, positions: Array, squares: Array) -> float:
    """Return the angle of the point nearest to a point on the section at an element's rung; exact for a circle.

    Squares of distances from a circle's points, where arcs begin, are a cosine of the angle; three determine it.
    ``squares`` is work space, three longer than there are arcs.
    """
    element = packed.elements[row]
    surface = packed.surfaces[element.surface]
    n, rung = surface.around, element.first_rung + int(fraction * element.rungs)
    at, arcs = 0, surface.arcs
    squares[:] = 0.0
    for k in range(n + 1):
        i, square = (k - 1) % n, 0.0
        for a in range(3):
            here = -x[a]
            for j in range(surface.functions):
                here += packed.rungs[rung, j] * positions[element.layers[j] + i, a]
            square += (arcs[i, 4] * squares[n + a] + (1.0 - arcs[i, 4]) * here) ** 2
            squares[n + a] = here
        # The first iteration is for the control point before the first.
        if k > 0:
            squares[i] = square
            at = i if square < squares[at] else at
    # Half the sine, and half of one minus the cosine, of the arcs before and after.
    last = (at - 1) % n
    sin1, sin2 = arcs[last, 1] / arcs[last, 3], arcs[at, 1] / arcs[at, 3]
    cos1, cos2 = 1.0 / arcs[last, 3] ** 2, 1.0 / arcs[at, 3] ** 2
    before, after = squares[last] - squares[at], squares[(at + 1) % n] - squares[at]
    bent = before * sin2 + after * sin1
    turn = np.arctan((cos2 * before - cos1 * after) / bent) if bent > 0.0 else 0.0
    return arcs[at, 0] - np.pi * arcs[at, 6] + turn


@njit(types.Tuple((i8, f8))(PACKED, PASS_ROW, i8, f8, f8, F2), **FAST)
def find_places(packed: Packed, pass_: Row, point: int, limit: float, reach: float, places: Array) -> tuple[int, float]:
    """Find where searches for the closest points of a point start.

    Of consecutive sections along a rod whose balls hold the point, one that is nearer than its neighbours is a start.
    So the starts with a smaller reach are among those with a larger one.

    Parameters
    ----------
    packed, pass_, point
        All contacts, the pass, and the point.
    limit, reach
        Gap of zero pressure, and the margin by which balls are enlarged, which is no less.
    places
        Is filled: element, fraction of it, and distance from the ball's surface (negative), ``(rungs, 3)``.

    Returns
    -------
    count, free
        Number of starts, and the distance of the point from everything else.
    """
    x, slave = packed.points[point], packed.surfaces[pass_.slave]
    at = site(pass_, slave, point)
    fraction = packed.fractions[at.along]
    listed = packed.counts[at.element] <= packed.near.shape[1]
    first = 0 if listed else packed.surfaces[pass_.master].first_element
    looked_at = packed.counts[at.element] if listed else _last_row(packed, pass_) - first
    # An element that is not in the list may have come nearer than the reach since the list was made.
    free = max(packed.listed[0] - 2.0 * (packed.travel[0] - packed.listed[1]), limit) if listed else reach
    count, last, surface = 0, -2, -1
    before, leaves = np.inf, False
    for k in range(looked_at):
        row = packed.near[at.element, k] if listed else first + k
        distance = _beside(x, packed.boxes[row])
        if distance > reach:
            free = min(free, distance)
            continue
        element = packed.elements[row]
        for t in range(element.rungs):
            ring = packed.rings[element.first_rung + t]
            square = (x[0] - ring[0]) ** 2 + (x[1] - ring[1]) ** 2 + (x[2] - ring[2]) ** 2
            # Its ball does not hold the point, nor is it the nearest so far: most sections are skipped here.
            if square > (ring[3] + free) ** 2:
                continue
            there = (t + 0.5) / element.rungs
            if not may_touch(packed, at.element, fraction, row, there):
                continue
            beside = np.sqrt(square) - ring[3]
            if beside > reach:
                free = min(free, beside)
                continue
            begins = element.first_rung + t != last + 1 or element.surface != surface or (leaves and beside < before)
            leaves = not begins and beside > before
            last, surface, before = element.first_rung + t, element.surface, beside
            if begins or count == 0:
                places[count, 2] = np.inf
                count += 1
            if beside < places[count - 1, 2]:
                places[count - 1, 0], places[count - 1, 1], places[count - 1, 2] = row, there, beside
    return count, free


@njit(b1(PACKED, F2), **FAST)
def add_travel(packed: Packed, positions: Array) -> bool:
    """Add how far a control point has moved since the last call to ``travel``; False if a position is not finite."""
    longest = 0.0
    finite = True
    for node in packed.control_points:
        square = 0.0
        for a in range(3):
            x = positions[node, a]
            square += (x - packed.before[node, a]) ** 2
            packed.before[node, a] = x
        finite = finite and square < np.inf
        longest = max(longest, square)
    packed.travel[0] += np.sqrt(longest)
    return finite
