"""Compiled: Coulomb friction with stick, at the active points of `isorod.contact.force_kernel.add_forces`.

It is a return mapping: a tangential spring of the penalty's stiffness ``eps`` from the stick point (anchor) ``a`` of
the point ``x``, a material point of its master (of an obstacle a point in space), gives the trial traction, force per
reference area, ``-eps s``, ``s = (I - n n^T) (x - a)``, with the normal ``n`` at the present projection; it is limited
to ``mu p``.  Its reaction is on the master at the present projection.

The anchor is fixed during the iterations of an increment.  At the converged state it stays where the point sticks,
follows where it slips, so that ``s`` is as long as Coulomb's law allows, and is removed where the point is no longer
pressed.  It is a material point: it turns with its rod, and projections may cross elements.  Where another rod is now
the nearest, the anchor moves there, with the same ``s``.

The dissipation of a step is the work of the mean of its first and last traction on the slip.  With central differences,
and with steps that take forces at their middle, the work is then the change of the springs' energy plus the
dissipation.
"""

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, njit
from isorod.contact.force_kernel import end_of, obstacle_gap, place_of, press, project, site, stretch_of
from isorod.contact.packed import (
    ANCHOR_ROW,
    ANCHORS,
    CYLINDER,
    FRICTION,
    MESH,
    PACKED,
    PASS_ROW,
    PASSES,
    PLANE,
    STARTS,
    Friction,
    Packed,
    Row,
    Table,
)
from isorod.contact.surface_kernel import LOST, PROJECTION, Projection, closest, dot, new_projection, surface_gap

# A point slips where its traction reaches the limit up to this fraction.
_NEARLY = 1e-9


@njit(void(PACKED, PASS_ROW, i8, F1, F2, STARTS, PROJECTION, ANCHOR_ROW), **FAST)
def _put(
    packed: Packed,
    pass_: Row,
    point: int,
    x: Array,
    positions: Array,
    start: Table,
    projection: Projection,
    anchor: Row,
) -> None:
    """Put an anchor where the master of a point's projection is nearest to ``x``."""
    if pass_.master < 0:
        obstacle_gap(packed, pass_, x, projection)
        anchor.element = 0
        for a in range(3):
            anchor.place[a] = pass_.home[a]
            for b in range(3):
                anchor.place[a] += pass_.frame[b, a] * (projection.y[0, b] - pass_.point[b])
        return
    at, where = packed.starts[point], start[0]
    where.element, where.theta, where.s = at.element, at.theta, at.s
    surface = packed.surfaces[packed.elements[at.element].surface]
    if closest(surface, packed.elements, x, where, positions, projection) == LOST:
        anchor.element, anchor.theta, anchor.s = at.element, at.theta, at.s
        return
    anchor.element, anchor.theta, anchor.s = where.element, where.theta, where.s


@njit(b1(PACKED, i8, i8), **FAST)
def _same_surface(packed: Packed, element: int, other: int) -> bool:
    """Return whether two elements are of one surface."""
    return packed.elements[element].surface == packed.elements[other].surface


@njit(void(PACKED, PASS_ROW, i8, F2, F1), **FAST)
def _slave_at(packed: Packed, pass_: Row, point: int, positions: Array, x: Array) -> None:
    """Fill ``x`` with the position of a slave point, from positions of the nodes."""
    slave = packed.surfaces[pass_.slave]
    at = site(pass_, slave, point)
    layers, phi, axial = packed.elements[at.element].layers, packed.around[at.around], packed.along[at.along]
    x[:] = 0.0
    for j in range(slave.functions):
        for c in range(3):
            for a in range(3):
                x[a] += axial[j] * phi[c] * positions[layers[j] + (at.arc + c - 1) % slave.around, a]


@njit(f8(PACKED, PASS_ROW, i8, F1, F2, STARTS, PROJECTION, ANCHOR_ROW), **FAST)
def _near(
    packed: Packed,
    pass_: Row,
    point: int,
    x: Array,
    positions: Array,
    start: Table,
    projection: Projection,
    anchor: Row,
) -> float:
    """Put an anchor where the master of a point's projection is nearest to ``x``, and return the gap there."""
    _put(packed, pass_, point, x, positions, start, projection, anchor)
    if pass_.master < 0:
        return obstacle_gap(packed, pass_, x, projection)
    place_of(packed, pass_, anchor, positions, projection)
    for a in range(3):
        projection.d[a] = x[a] - projection.y[0, a]
    return surface_gap(projection, packed.states[point].edge)


@njit(void(PACKED, FRICTION, PASSES, F2, F2, ANCHORS), **FAST)
def catch(packed: Packed, friction: Friction, passes: Table, before: Array, ahead: Array, caught: Table) -> None:
    """Set the anchors of active points that have none, at the place where they came into contact.

    That is where the gap closes on the straight path from the start of a step to its predicted end.

    Parameters
    ----------
    packed
        As the last forces left it.
    friction
        Its anchors are changed.
    passes
        Rows of `PASS`, with obstacles at the start of the step.
    before, ahead
        Positions at the start of the step, and predicted ones at its end, shape ``(nodes, 3)``.
    caught
        Anchors set so far, rows of `ANCHOR`: those on the same master are used again.
    """
    projection, x, y = new_projection(), np.empty(3), np.empty(3)
    for k in range(packed.passes.size):
        pass_, was = packed.passes[k], passes[k]
        if friction.coefficients[k] == 0.0:
            continue
        for point in range(pass_.first_point, end_of(pass_, packed.surfaces[pass_.slave])):
            if not packed.own[point]:
                continue
            anchor = friction.anchors[point]
            if anchor.element >= 0 or not packed.states[point].pressure > 0.0:
                continue
            known = caught[point].element
            if known >= 0 and (pass_.master < 0 or _same_surface(packed, known, packed.starts[point].element)):
                friction.anchors[point] = caught[point]
                continue
            _slave_at(packed, pass_, point, ahead, x)
            then = _near(packed, pass_, point, x, ahead, friction.start, projection, anchor)
            # Seen from an obstacle that moves.
            place_of(packed, was, anchor, before, projection)
            y[:] = projection.y[0]
            _slave_at(packed, pass_, point, before, x)
            gap = _near(packed, was, point, x, before, friction.start, projection, anchor)
            fraction = max(0.0, gap) / (gap - then) if gap > then else 0.0
            if fraction > 0.0:
                place_of(packed, was, anchor, before, projection)
                for a in range(3):
                    y[a] = projection.y[0, a] + min(1.0, fraction) * (y[a] - projection.y[0, a])
                _put(packed, was, point, y, before, friction.start, projection, anchor)
            caught[point] = friction.anchors[point]


@njit(void(PACKED, FRICTION, F2, F2), **FAST)
def hang(packed: Packed, friction: Friction, positions: Array, tractions: Array) -> None:
    """Put the anchors of active points so that the tangential tractions are given ones.

    Parameters
    ----------
    packed, positions
        As the last forces left it, and their positions.
    friction
        Its anchors are changed.
    tractions
        Of the points, ``(Q, 3)``; NaN for no anchor.
    """
    projection, there, x = new_projection(), new_projection(), np.empty(3)
    for k in range(packed.passes.size):
        pass_ = packed.passes[k]
        for point in range(pass_.first_point, end_of(pass_, packed.surfaces[pass_.slave])):
            if not packed.own[point]:
                continue
            if not (packed.states[point].pressure > 0.0 and np.isfinite(tractions[point, 0])):
                continue
            project(packed, pass_, point, positions, projection)
            along = dot(tractions[point], projection.normal)
            anchor = friction.anchors[point]
            for a in range(3):
                anchor.traction[a] = tractions[point, a] - along * projection.normal[a]
                x[a] = projection.y[0, a] + anchor.traction[a] / pass_.penalty
            _put(packed, pass_, point, x, positions, friction.start, there, anchor)


@njit(f8(PASS_ROW, PROJECTION, f8, b1, F1, F1), **FAST)
def _work(pass_: Row, projection: Projection, gap: float, edge: bool, t: Array, slip: Array) -> float:
    """Return the work of a traction on the displacement of a point whose projection slips.

    With ``H`` of `isorod.contact.tangent_kernel` it is ``t^a H_ab slip^b``: at a gap from a curved surface the point's
    displacement differs from the projection's.
    """
    work = dot(t, slip)
    if pass_.master == PLANE or pass_.master == MESH or edge:
        return work
    if pass_.master < 0:
        tangential = work
        if pass_.master == CYLINDER:
            for a in range(3):
                for b in range(3):
                    tangential -= t[a] * pass_.direction[a] * slip[b] * pass_.direction[b]
        return work + gap / pass_.radius * tangential
    y, normal = projection.y, projection.normal
    a11, a12, a22 = dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2])
    t1, t2, s1, s2 = dot(t, y[1]), dot(t, y[2]), dot(slip, y[1]), dot(slip, y[2])
    # With upper indices.
    det = a11 * a22 - a12 * a12
    t1, t2 = (a22 * t1 - a12 * t2) / det, (a11 * t2 - a12 * t1) / det
    s1, s2 = (a22 * s1 - a12 * s2) / det, (a11 * s2 - a12 * s1) / det
    bent = t1 * s1 * dot(normal, y[3]) + (t1 * s2 + t2 * s1) * dot(normal, y[4]) + t2 * s2 * dot(normal, y[5])
    return work - gap * bent


@njit(types.UniTuple(f8, 2)(PACKED, FRICTION, F2, b1, F2), **FAST)
def add_friction(
    packed: Packed, friction: Friction, positions: Array, keep: bool, forces: Array
) -> tuple[float, float]:
    """Add the nodal forces of friction.

    Parameters
    ----------
    packed
        As `isorod.contact.force_kernel.add_forces` left it at the same positions.
    friction
        ``tractions`` and ``slipping`` are set.
    positions, forces
        As for that function.
    keep
        Whether the next step starts from this state: anchors are updated.

    Returns
    -------
    energy, dissipated
        Energy of the springs, and the dissipation since anchors were last updated.
    """
    energy = dissipated = 0.0
    if not friction.coefficients.any():
        return energy, dissipated
    projection, there = new_projection(), new_projection()
    s, t, mean = np.empty(3), np.empty(3), np.empty(3)
    for k in range(packed.passes.size):
        mu, pass_ = friction.coefficients[k], packed.passes[k]
        if mu == 0.0:
            continue
        for point in range(pass_.first_point, end_of(pass_, packed.surfaces[pass_.slave])):
            if not packed.own[point]:
                continue
            anchor, pressure, weight = friction.anchors[point], packed.states[point].pressure, packed.areas[point]
            friction.slipping[point] = False
            for a in range(3):
                friction.tractions[point, a] = 0.0
            hangs = anchor.element >= 0
            if not (hangs or pressure > 0.0):
                continue
            if hangs:
                place_of(packed, pass_, anchor, positions, there)
            if not pressure > 0.0:
                for a in range(3):
                    dissipated -= 0.5 * weight * anchor.traction[a] * (packed.points[point, a] - there.y[0, a])
                    if keep:
                        anchor.traction[a] = 0.0
                if keep:
                    anchor.element = -1
                continue
            gap = project(packed, pass_, point, positions, projection)
            if not hangs:
                if keep:
                    _put(packed, pass_, point, projection.y[0], positions, friction.start, there, anchor)
                continue
            length = stretch_of(packed, point, projection, there, s)
            limit, fraction = mu * pressure, 1.0
            if pass_.penalty * length > limit:
                fraction = limit / (pass_.penalty * length)
            slips = pass_.penalty * length >= (1.0 - _NEARLY) * limit
            square = 0.0
            for a in range(3):
                t[a] = -pass_.penalty * fraction * s[a]
                square += t[a] * t[a]
                mean[a] = 0.5 * (anchor.traction[a] + t[a])
                friction.tractions[point, a] = t[a]
            dissipated -= weight * (1.0 - fraction) * _work(pass_, projection, gap, packed.states[point].edge, mean, s)
            energy += 0.5 * weight * square / pass_.penalty
            friction.slipping[point] = slips
            press(packed, pass_, point, projection, weight * t, forces)
            if not keep:
                continue
            other = pass_.master >= 0 and not _same_surface(packed, anchor.element, packed.starts[point].element)
            if fraction < 1.0 or other:
                for a in range(3):
                    s[a] = projection.y[0, a] - fraction * s[a]
                _put(packed, pass_, point, s, positions, friction.start, there, anchor)
            for a in range(3):
                anchor.traction[a] = t[a]
    return energy, dissipated
