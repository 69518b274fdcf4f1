"""Compiled contact forces: gap, pressure, and nodal forces; `search_kernel` finds what is near."""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, njit
from isorod.contact.mesh_kernel import mesh_gap
from isorod.contact.packed import ANCHOR_ROW, ELEMENT_ROW, MESH, PACKED, PASS_ROW, PLANE, SURFACE_ROW, Packed, Row
from isorod.contact.search_kernel import (
    add_travel,
    angle_at,
    end_of,
    find_places,
    list_near,
    may_touch,
    needs_search,
    place,
    site,
)
from isorod.contact.surface_kernel import (
    EDGE,
    END,
    LOST,
    PROJECTION,
    Projection,
    arc_of,
    closest,
    dot,
    evaluate,
    new_projection,
    surface_gap,
)

# What `add_forces` returns, a plain tuple, see `isorod.compiling.njit`.
PRESSING = types.UniTuple(f8, 4)


@njit(f8(PASS_ROW, F1, F1), **FAST)
def rigid_gap(pass_: Row, x: Array, normal: Array) -> float:
    """Return the gap of a point to the rigid obstacle of a pass, and fill its normal."""
    height = 0.0
    for a in range(3):
        height += (x[a] - pass_.point[a]) * pass_.direction[a]
    if pass_.master == PLANE:
        for a in range(3):
            normal[a] = pass_.direction[a]
        return height
    for a in range(3):
        normal[a] = x[a] - pass_.point[a] - height * pass_.direction[a]
    distance = np.sqrt(dot(normal, normal))
    for a in range(3):
        normal[a] /= distance
    return distance - pass_.radius


@njit(f8(PACKED, PASS_ROW, F1, PROJECTION), **FAST)
def obstacle_gap(packed: Packed, pass_: Row, x: Array, projection: Projection) -> float:
    """Return the gap of a point to the obstacle of a pass, and fill normal and position of a projection."""
    if pass_.master == MESH:
        return mesh_gap(packed, pass_, x, projection)
    gap = rigid_gap(pass_, x, projection.normal)
    for a in range(3):
        projection.y[0, a] = x[a] - gap * projection.normal[a]
    return gap


@njit(f8(PACKED, PASS_ROW, i8, F2, PROJECTION), **FAST)
def project(packed: Packed, pass_: Row, point: int, positions: Array, projection: Projection) -> float:
    """Return the gap of an active point, and fill its projection, that of the last forces."""
    x = packed.points[point]
    if pass_.master < 0:
        return obstacle_gap(packed, pass_, x, projection)
    start = packed.starts[point]
    element = packed.elements[start.element]
    evaluate(packed.surfaces[element.surface], element, start.theta, start.s, positions, projection)
    for a in range(3):
        projection.d[a] = x[a] - projection.y[0, a]
    return surface_gap(projection, packed.states[point].edge)


@njit(void(PACKED, PASS_ROW, ANCHOR_ROW, F2, PROJECTION), **FAST)
def place_of(packed: Packed, pass_: Row, anchor: Row, positions: Array, projection: Projection) -> None:
    """Fill a projection at an anchor of friction; on an obstacle only the first row of ``y``."""
    if pass_.master < 0:
        for a in range(3):
            projection.y[0, a] = pass_.point[a]
            for b in range(3):
                projection.y[0, a] += pass_.frame[a, b] * (anchor.place[b] - pass_.home[b])
        return
    element = packed.elements[anchor.element]
    evaluate(packed.surfaces[element.surface], element, anchor.theta, anchor.s, positions, projection)


@njit(f8(PACKED, i8, PROJECTION, PROJECTION, F1), **FAST)
def stretch_of(packed: Packed, point: int, projection: Projection, there: Projection, s: Array) -> float:
    """Fill ``s``, the tangential vector from a point's anchor to the point, and return its length."""
    along = 0.0
    for a in range(3):
        s[a] = packed.points[point, a] - there.y[0, a]
        along += s[a] * projection.normal[a]
    for a in range(3):
        s[a] -= along * projection.normal[a]
    return np.sqrt(dot(s, s))


class Work(NamedTuple):
    """Work space of searches.

    Starts, at most as many as there are sections, squares of distances, and the distance of a point from the ball of
    its start.
    """

    places: Array
    squares: Array
    away: Array


_WORK = types.NamedTuple((F2, F1, F1), Work)


@njit(_WORK(PACKED), **FAST)
def _new_work(packed: Packed) -> Work:
    """Return work space for all passes."""
    most = 0
    for k in range(packed.surfaces.size):
        most = max(most, packed.surfaces[k].around)
    return Work(np.empty((packed.rings.shape[0], 3)), np.empty(most + 3), np.empty(1))


@njit(b1(PACKED, i8, F2, _WORK, i8), **FAST)
def _start(packed: Packed, point: int, positions: Array, work: Work, count: int) -> bool:
    """Start the search of a point at the nearest of the remaining starts, and remove that; False if there is none."""
    if count == 0:
        return False
    places, start, best = work.places, packed.starts[point], 0
    for k in range(1, count):
        if places[k, 2] < places[best, 2]:
            best = k
    start.element, start.s = int(places[best, 0]), 2.0 * places[best, 1] - 1.0
    x = packed.points[point]
    start.theta = angle_at(packed, start.element, places[best, 1], x, positions, work.squares)
    work.away[0] = places[best, 2]
    for a in range(3):
        places[best, a] = places[count - 1, a]
    return True


@njit(f8(PACKED, PASS_ROW, i8, F2, PROJECTION, _WORK), **FAST)
def _gap(packed: Packed, pass_: Row, point: int, positions: Array, projection: Projection, work: Work) -> float:
    """Return the gap of a slave point, fill its projection, and set the travel up to which it needs no search.

    Infinite where the point is clear of the master or beyond its end, NaN if the search did not converge.
    """
    x = packed.points[point]
    if pass_.master == MESH:
        gap = mesh_gap(packed, pass_, x, projection)
        packed.clear[point] = packed.travel[0] + 0.5 * (gap - packed.multipliers[point] / pass_.penalty)
        return gap
    if pass_.master < 0:
        gap = rigid_gap(pass_, x, projection.normal)
        # The displacement of the obstacle is in the travel.
        packed.clear[point] = packed.travel[0] + gap - packed.multipliers[point] / pass_.penalty
        return gap
    start = packed.starts[point]
    at = site(pass_, packed.surfaces[pass_.slave], point)
    limit, deep = packed.multipliers[point] / pass_.penalty, packed.surfaces[pass_.master].deep
    count, free, nearest = -1, 0.0, np.inf
    while True:
        if start.element < 0:
            if count < 0:
                # Balls show cheaply that a point is far, a search how far: worth it where it has been near before.
                reach = limit + deep + (packed.listed[0] if packed.clear[point] > -np.inf else 0.0)
                count, free = find_places(packed, pass_, point, limit + deep, reach, work.places)
            if not _start(packed, point, positions, work, count):
                packed.clear[point] = packed.travel[0] + 0.5 * max(min(free - deep, nearest) - limit, 0.0)
                return nearest
            count -= 1
        master = packed.surfaces[packed.elements[start.element].surface]
        outcome = closest(master, packed.elements, x, start, positions, projection)
        # A point outside the ball and the wall about it is not in contact; a search that ends deep inside has reached
        # the far side.
        outside = count >= 0 and work.away[0] > limit + deep
        if outcome == LOST and count >= 0 and not outside:
            return np.nan
        gap = np.inf
        if outcome != END and outcome != LOST:
            # A point does not touch its own neighbourhood.
            fraction, there = packed.fractions[at.along], 0.5 * (start.s + 1.0)
            if may_touch(packed, at.element, fraction, start.element, there):
                gap = surface_gap(projection, outcome == EDGE)
                # A point so deep in a wall is not inside the tube.
                if deep > 0.0 and gap <= -deep:
                    gap = np.inf
        if outside and (gap < limit or outcome == LOST):
            gap = work.away[0]
        if gap < limit:
            packed.states[point].edge = outcome == EDGE
            return gap
        if count >= 0:
            nearest = min(nearest, gap)
            # Beyond an end it may come into contact at once.
            free = free if gap < np.inf else -np.inf
        # Something else may be nearer.
        start.element = -1


@njit(void(SURFACE_ROW, ELEMENT_ROW, i8, F1, F1, F1, F2), **FAST)
def spread(surface: Row, element: Row, arc: int, phi: Array, axial: Array, push: Array, forces: Array) -> None:
    """Add a force ``push`` at a point of a surface to the nodal forces."""
    for j in range(surface.functions):
        for c in range(3):
            node = element.layers[j] + (arc + c - 1) % surface.around
            for a in range(3):
                forces[node, a] += push[a] * axial[j] * phi[c]


@njit(void(PACKED, PASS_ROW, i8, PROJECTION, F1, F2), **FAST)
def press(packed: Packed, pass_: Row, point: int, projection: Projection, push: Array, forces: Array) -> None:
    """Add a force ``push`` at a slave point, and its reaction on the master, to the nodal forces."""
    slave = packed.surfaces[pass_.slave]
    at = site(pass_, slave, point)
    spread(slave, packed.elements[at.element], at.arc, packed.around[at.around], packed.along[at.along], push, forces)
    if pass_.master >= 0:
        start = packed.starts[point]
        element = packed.elements[start.element]
        master = packed.surfaces[element.surface]
        spread(master, element, arc_of(master, start.theta), projection.phi[0], projection.axial[0], -push, forces)


@njit(PRESSING(PACKED, F2, F2), **FAST)
def add_forces(packed: Packed, positions: Array, forces: Array) -> tuple[float, float, float, float]:
    """Add the nodal forces of contact: minus the derivative of the energy by the positions.

    Only control points of surfaces are read and get forces, from this rank's own points.  The result depends on
    ``positions`` and ``packed.starts`` alone; `isorod.contact.packed` lists what is updated.

    Parameters
    ----------
    packed
        From `isorod.contact.tables.pack`.
    positions
        Coefficients of the map, `Space.positions` plus displacement, nodes of all bodies, shape ``(nodes, 3)``.
    forces
        Same shape; added to.

    Returns
    -------
    energy, force, area
        Energy of the penalty, normal force, reference area in contact, sums over all pairs; NaN, as the forces then
        are, where a closest-point search failed or a position is not finite.
    deepest
        The deepest gap: negative, or zero where nothing touches.
    """
    if not add_travel(packed, positions):
        packed.before[:] = 0.0
        forces[:] = np.nan
        return np.nan, np.nan, np.nan, np.nan
    place(packed, positions)
    if 2.0 * (packed.travel[0] - packed.listed[1]) > packed.listed[0]:
        list_near(packed)
    energy = force = area = deepest = 0.0
    projection, work = new_projection(), _new_work(packed)
    # Local references: where all points are clear, looking up the tables would take most of the time.
    states, starts, multipliers, clear = packed.states, packed.starts, packed.multipliers, packed.clear
    own, travel = packed.own, packed.travel[0]
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        for point in range(pass_.first_point, end_of(pass_, packed.surfaces[pass_.slave])):
            if not own[point]:
                continue
            state, multiplier = states[point], multipliers[point]
            state.edge = False
            gap = np.inf
            if needs_search(multiplier, clear[point], travel):
                gap = _gap(packed, pass_, point, positions, projection, work)
            pressure = multiplier - pass_.penalty * gap
            state.gap = gap if gap < np.inf else np.nan
            state.pressure = max(pressure, 0.0)
            if pressure <= 0.0:
                # Another part of the surface may be nearer in the next call.
                starts[point].element = -1
                continue
            for a in range(3):
                state.normal[a] = projection.normal[a]
            weight = packed.areas[point]
            energy += 0.5 * weight * (pressure**2 - multiplier**2) / pass_.penalty
            force += weight * pressure
            area += weight
            deepest = min(deepest, gap)
            press(packed, pass_, point, projection, weight * pressure * projection.normal, forces)
    if not np.isfinite(energy):
        forces[:] = np.nan
        return np.nan, np.nan, np.nan, np.nan
    return energy, force, area, deepest
