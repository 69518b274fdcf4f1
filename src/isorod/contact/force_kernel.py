"""The compiled contact forces: search, pressure, and its share to the nodes.

Lemma (searches left out).  Let a point be farther than ``D`` from a surface, and let no carrier have gone a longer way
than ``w`` since.  Then the point is farther than ``D - 2 w`` from the surface, so that there is no contact, and nothing
to search for, while ``w <= D / 2``.  Proof: a point of a surface at fixed parameters is a convex combination of
carriers and has gone no more than ``w`` either; the slave's point **and** the master's, both, may have approached.

``Packed.travel`` grows by the longest way of each call, in all by no less than ``w``; ``Packed.clear`` is its value at
which ``D / 2`` is used up.  ``D`` is how far the point is from the boxes of the masters' control points, which hold
them; after a search, by how much the gap exceeds that of zero pressure, the foot found taken for the nearest.  The same
lemma keeps the lists of elements near an element: those made with a margin ``M`` between boxes leave out no element
nearer than ``M - 2 w``.

A search starts at the nearest of the masters' own slave points, of elements whose boxes hold the point: others are not
in contact, and what is found depends on present positions alone.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, njit
from isorod.contact.packed import ELEMENT_ROW, PACKED, PASS_ROW, PLANE, SURFACE_ROW, Packed, Row
from isorod.contact.surface_kernel import EDGE, END, FOOT, LOST, Foot, arc_of, closest, dot, new_foot, surface_gap

# Element boxes are enlarged by this part of their largest side: a normal may leave the box of a skewed end.
_MARGIN = 0.1


class Pressing(NamedTuple):
    """What contact says, sums over all pairs; NaN where a closest-point search failed or a position is not finite.

    Attributes
    ----------
    energy, force, area
        Energy of the penalty, normal force, reference area in contact.
    deepest
        The deepest gap: negative, or zero where nothing touches.
    """

    energy: float
    force: float
    area: float
    deepest: float


PRESSING = types.NamedUniTuple(f8, 4, Pressing)


class Site(NamedTuple):
    """Where a slave point is: its element and arc, and its rows in `Packed.along` and `Packed.around`."""

    element: int
    arc: int
    along: int
    around: int


SITE = types.NamedUniTuple(i8, 4, Site)


@njit(SITE(PASS_ROW, SURFACE_ROW, i8), **FAST)
def site(one: Row, slave: Row, point: int) -> Site:
    """Return where a point of a pass is; points go round the section first, then along the elements."""
    around, q = divmod(point - one.first_point, one.across)
    place, arc = divmod(around, slave.around)
    return Site(slave.first_element + place // one.along, arc, one.first_along + place, one.first_around + q)


@njit(i8(PASS_ROW, SURFACE_ROW), **FAST)
def end_of(one: Row, slave: Row) -> int:
    """Return the number after that of the last point of a pass."""
    return one.first_point + slave.elements * one.along * slave.around * one.across


@njit(void(SURFACE_ROW, ELEMENT_ROW, F2, F2), **FAST)
def _enclose(surface: Row, element: Row, positions: Array, box: Array) -> None:
    """Fill the box of an element's control points."""
    side = 0.0
    for a in range(3):
        low, high = np.inf, -np.inf
        for j in range(surface.functions):
            for i in range(surface.around):
                x = positions[element.layers[j] + i, a]
                low, high = min(low, x), max(high, x)
        box[0, a], box[1, a] = low, high
        side = max(side, high - low)
    for a in range(3):
        box[0, a] -= _MARGIN * side
        box[1, a] += _MARGIN * side


@njit(void(PACKED, PASS_ROW, SURFACE_ROW, F2), **FAST)
def _place_points(packed: Packed, one: Row, slave: Row, positions: Array) -> None:
    """Fill ``points`` of a pass."""
    n = slave.around
    section = np.empty((n, 3))
    point = one.first_point
    for place in range(slave.elements * one.along):
        element = packed.elements[slave.first_element + place // one.along]
        r = packed.along[one.first_along + place]
        for i in range(n):
            for a in range(3):
                value = 0.0
                for j in range(slave.functions):
                    value += r[j] * positions[element.layers[j] + i, a]
                section[i, a] = value
        for i in range(n):
            before, after = (i - 1) % n, (i + 1) % n
            for q in range(one.across):
                f = packed.around[one.first_around + q]
                for a in range(3):
                    x = f[0] * section[before, a] + f[1] * section[i, a] + f[2] * section[after, a]
                    packed.points[point, a] = x
                point += 1


@njit(void(PACKED, F2), **FAST)
def _place(packed: Packed, positions: Array) -> None:
    """Fill ``points`` and ``boxes``."""
    for k in range(packed.passes.size):
        one = packed.passes[k]
        _place_points(packed, one, packed.surfaces[one.slave], positions)
    for k in range(packed.surfaces.size):
        surface = packed.surfaces[k]
        for row in range(surface.first_element, surface.first_element + surface.elements):
            _enclose(surface, packed.elements[row], positions, packed.boxes[row])


@njit(f8(F1, F2), **FAST)
def _beside(x: Array, box: Array) -> float:
    """Return how far a point is from a box, in its farthest coordinate; negative inside."""
    low, high = box[0], box[1]
    return max(low[0] - x[0], x[0] - high[0], low[1] - x[1], x[1] - high[1], low[2] - x[2], x[2] - high[2])


@njit(f8(F2, F2), **FAST)
def _apart(one: Array, other: Array) -> float:
    """Return how far two boxes are from each other, in their farthest coordinate; negative where they overlap."""
    distance = -np.inf
    for a in range(3):
        distance = max(distance, one[0, a] - other[1, a], other[0, a] - one[1, a])
    return distance


@njit(b1(PACKED, i8, f8, i8, f8), **FAST)
def _may_touch(packed: Packed, row: int, share: float, other: int, other_share: float) -> bool:
    """Return whether two places, at shares of two elements, are of two bodies or far enough apart along the axis."""
    one, two = packed.elements[row], packed.elements[other]
    surface = packed.surfaces[one.surface]
    if surface.body != packed.surfaces[two.surface].body:
        return True
    way = abs(one.begin + share * (one.end - one.begin) - two.begin - other_share * (two.end - two.begin))
    return min(way, surface.period - way) >= np.pi * max(one.radius, two.radius)


@njit(i8(PACKED, PASS_ROW), **FAST)
def _last_row(packed: Packed, one: Row) -> int:
    """Return the number after that of the last element of a pass' masters."""
    last = packed.surfaces[one.master + one.masters - 1]
    return last.first_element + last.elements


@njit(void(PACKED), **FAST)
def _list(packed: Packed) -> None:
    """Make the lists of elements that are near each element and may touch it."""
    packed.listed[1] = packed.travel[0]
    for k in range(packed.passes.size):
        one = packed.passes[k]
        if one.master < 0:
            continue
        slave = packed.surfaces[one.slave]
        first, last = packed.surfaces[one.master].first_element, _last_row(packed, one)
        for row in range(slave.first_element, slave.first_element + slave.elements):
            count = 0
            for other in range(first, last):
                if _apart(packed.boxes[row], packed.boxes[other]) > packed.listed[0]:
                    continue
                # The ends that are farthest from each other.
                if not (_may_touch(packed, row, 0.0, other, 1.0) or _may_touch(packed, row, 1.0, other, 0.0)):
                    continue
                if count < packed.near.shape[1]:
                    packed.near[row, count] = other
                count += 1
            packed.counts[row] = count


@njit(b1(PACKED, PASS_ROW, i8), **FAST)
def _guess(packed: Packed, one: Row, point: int) -> bool:
    """Start the search of a point at the nearest sample; return False if none is near, and until when.

    Samples are slave points of the masters' elements whose boxes hold the point.
    """
    x, slave, start = packed.points[point], packed.surfaces[one.slave], packed.starts[point]
    at = site(one, slave, point)
    share = ((at.along - one.first_along) % one.along + 0.5) / one.along
    listed = packed.counts[at.element] <= packed.near.shape[1]
    first = 0 if listed else packed.surfaces[one.master].first_element
    count = packed.counts[at.element] if listed else _last_row(packed, one) - first
    best, found, row_found = np.inf, -1, -1
    free = packed.listed[0] - 2.0 * (packed.travel[0] - packed.listed[1])
    reach = 0.0
    for k in range(count):
        row = packed.near[at.element, k] if listed else first + k
        distance = _beside(x, packed.boxes[row])
        if distance > 0.0:
            free = min(free, distance)
            continue
        element = packed.elements[row]
        master = packed.surfaces[element.surface]
        own = packed.passes[master.own_pass]
        reach = max(reach, element.spacing)
        for t in range(own.along):
            if not _may_touch(packed, at.element, share, row, (t + 0.5) / own.along):
                continue
            size = master.around * own.across
            begin = own.first_point + ((row - master.first_element) * own.along + t) * size
            for sample in range(begin, begin + size):
                y = packed.points[sample]
                square = (x[0] - y[0]) ** 2 + (x[1] - y[1]) ** 2 + (x[2] - y[2]) ** 2
                if square < best:
                    best, found, row_found = square, sample, row
    if found >= 0:
        best = np.sqrt(best)
        if best <= packed.elements[row_found].radius + reach:
            master = packed.surfaces[packed.elements[row_found].surface]
            own = packed.passes[master.own_pass]
            there, sector = site(own, master, found), 2.0 * np.pi / master.around
            start.element = row_found
            start.theta = master.turn + sector * (
                there.arc - 0.5 + (there.around - own.first_around + 0.5) / own.across
            )
            start.s = 2.0 * ((there.along - own.first_along) % own.along + 0.5) / own.along - 1.0
            return True
        # Deeper than a radius no point is: this one is outside.
        free = min(free, best - reach)
    packed.clear[point] = packed.travel[0] + 0.5 * max(free, 0.0)
    return False


@njit(b1(PACKED, F2), **FAST)
def _travel(packed: Packed, positions: Array) -> bool:
    """Add the longest way of a carrier since the last call to ``travel``; False if a position is not finite."""
    longest = 0.0
    finite = True
    for node in packed.carriers:
        square = 0.0
        for a in range(3):
            x = positions[node, a]
            square += (x - packed.before[node, a]) ** 2
            packed.before[node, a] = x
        finite = finite and square < np.inf
        longest = max(longest, square)
    packed.travel[0] += np.sqrt(longest)
    return finite


@njit(f8(PASS_ROW, F1, F1), **FAST)
def rigid_gap(one: Row, x: Array, normal: Array) -> float:
    """Return the gap of a point to the rigid obstacle of a pass, and fill its normal."""
    height = 0.0
    for a in range(3):
        height += (x[a] - one.point[a]) * one.direction[a]
    if one.master == PLANE:
        for a in range(3):
            normal[a] = one.direction[a]
        return height
    for a in range(3):
        normal[a] = x[a] - one.point[a] - height * one.direction[a]
    distance = np.sqrt(dot(normal, normal))
    for a in range(3):
        normal[a] /= distance
    return distance - one.radius


@njit(f8(PACKED, PASS_ROW, i8, F2, FOOT), **FAST)
def _gap(packed: Packed, one: Row, point: int, positions: Array, foot: Foot) -> float:
    """Return the gap of a slave point and fill the foot on its master.

    Infinite where the point is clear of the master or beyond its end, NaN if no closest point was found.
    """
    x = packed.points[point]
    if one.master < 0:
        return rigid_gap(one, x, foot.normal)
    start = packed.starts[point]
    if start.element < 0 and not _guess(packed, one, point):
        return np.inf
    master = packed.surfaces[packed.elements[start.element].surface]
    outcome = closest(master, packed.elements, x, start, positions, foot)
    if outcome == END:
        return np.inf
    if outcome == LOST:
        return np.nan
    at = site(one, packed.surfaces[one.slave], point)
    share = ((at.along - one.first_along) % one.along + 0.5) / one.along
    if not _may_touch(packed, at.element, share, start.element, 0.5 * (start.s + 1.0)):
        return np.inf
    packed.states[point].edge = outcome == EDGE
    return surface_gap(foot, outcome == EDGE)


@njit(void(SURFACE_ROW, ELEMENT_ROW, i8, F1, F1, F1, F2), **FAST)
def spread(surface: Row, element: Row, arc: int, phi: Array, axial: Array, push: Array, forces: Array) -> None:
    """Add a force ``push`` at a point of a surface to the forces of the nodes there."""
    for j in range(surface.functions):
        for c in range(3):
            node = element.layers[j] + (arc + c - 1) % surface.around
            for a in range(3):
                forces[node, a] += push[a] * axial[j] * phi[c]


@njit(void(PACKED, PASS_ROW, i8, FOOT, f8, F2), **FAST)
def _press(packed: Packed, one: Row, point: int, foot: Foot, force: float, forces: Array) -> None:
    """Add a normal force at a slave point, and its reaction on the master, to the forces of the nodes."""
    push = force * foot.normal
    slave = packed.surfaces[one.slave]
    at = site(one, slave, point)
    phi, axial = packed.around[at.around], packed.along[at.along]
    spread(slave, packed.elements[at.element], at.arc, phi, axial, push, forces)
    if one.master >= 0:
        start = packed.starts[point]
        master = packed.surfaces[packed.elements[start.element].surface]
        arc = arc_of(master, start.theta)
        spread(master, packed.elements[start.element], arc, foot.phi[0], foot.axial[0], -push, forces)


@njit(PRESSING(PACKED, F2, F2), **FAST)
def add_forces(packed: Packed, positions: Array, forces: Array) -> Pressing:
    """Add the forces that contact exerts on the nodes: minus the derivative of the energy by the positions.

    Only nodes that carry the surface (``k = 0``) are read and get forces.  The result depends on ``positions`` and
    ``packed.starts`` alone; what is updated is told in `isorod.contact.packed`.

    Parameters
    ----------
    packed
        From `isorod.contact.tables.pack`.
    positions
        Coefficients of the map, `Space.positions` plus displacement, nodes of all bodies, shape ``(nodes, 3)``.
    forces
        Same shape; is added to.

    Returns
    -------
    pressing
        Where it is NaN, so are the forces.
    """
    if not _travel(packed, positions):
        packed.before[:] = 0.0
        forces[:] = np.nan
        return Pressing(np.nan, np.nan, np.nan, np.nan)
    travel = packed.travel[0]
    _place(packed, positions)
    if 2.0 * (travel - packed.listed[1]) > packed.listed[0]:
        _list(packed)
    energy = force = area = deepest = 0.0
    foot = new_foot()
    for k in range(packed.passes.size):
        one = packed.passes[k]
        for point in range(one.first_point, end_of(one, packed.surfaces[one.slave])):
            state, multiplier = packed.states[point], packed.multipliers[point]
            state.edge = False
            clear = one.master >= 0 and packed.clear[point] > travel
            gap = np.inf if clear else _gap(packed, one, point, positions, foot)
            pressure = multiplier - one.penalty * gap
            state.gap = gap if gap < np.inf else np.nan
            state.pressure = max(pressure, 0.0)
            if pressure <= 0.0:
                # Another part of the surface may be nearer next time.
                packed.starts[point].element = -1
                if gap < np.inf:
                    packed.clear[point] = travel - 0.5 * pressure / one.penalty
                continue
            weight = packed.areas[point]
            energy += 0.5 * weight * (pressure**2 - multiplier**2) / one.penalty
            force += weight * pressure
            area += weight
            deepest = min(deepest, gap)
            _press(packed, one, point, foot, weight * pressure, forces)
    if not np.isfinite(energy):
        forces[:] = np.nan
        return Pressing(np.nan, np.nan, np.nan, np.nan)
    return Pressing(energy, force, area, deepest)
