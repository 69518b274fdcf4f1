"""Compiled: minus the derivatives of the forces of friction by the nodes, which are not symmetric."""

import numpy as np
from numba import b1, f8, from_dtype, i8, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, I1, STRICT, njit
from isorod.contact.force_kernel import project
from isorod.contact.friction_kernel import FRICTION, Friction, place_of, stretch_of
from isorod.contact.packed import CYLINDER, PACKED, PASS_ROW, PLANE, Packed, Row, Table
from isorod.contact.search_kernel import site
from isorod.contact.surface_kernel import FOOT, Foot, arc_of, dot, new_foot
from isorod.contact.tangent_kernel import PATCH, add_nodes

# A patch with the element and arc of an anchor that is elsewhere on a master (-1 where there is none such).
HANGING = np.dtype([*((name, np.int64) for name in PATCH.names or ()), ("anchor_element", "i8"), ("anchor_arc", "i8")])
_HANGING_ROW = from_dtype(HANGING)
_HANGINGS = types.Array(_HANGING_ROW, 1, "C")


@njit(void(PACKED, FRICTION, I1, _HANGINGS), **STRICT)
def find_hangings(packed: Packed, friction: Friction, active: Index, hangings: Table) -> None:
    """Fill the anchors of ``hangings``, whose patches are filled, of active slave points."""
    for m in range(active.size):
        anchor, hanging = friction.anchors[active[m]], hangings[m]
        hanging.anchor_element = hanging.anchor_arc = -1
        if anchor.element < 0 or hanging.master_element < 0 or friction.coefficients[hanging.number] == 0.0:
            continue
        arc = arc_of(packed.surfaces[packed.elements[anchor.element].surface], anchor.theta)
        if anchor.element != hanging.master_element or arc != hanging.master_arc:
            hanging.anchor_element, hanging.anchor_arc = anchor.element, arc


@njit(i8(PACKED, _HANGING_ROW, I1), **STRICT)
def anchor_nodes(packed: Packed, hanging: Row, nodes: Index) -> int:
    """Fill ``nodes`` with those of an anchor that is elsewhere; return how many."""
    surface = packed.elements[hanging.anchor_element].surface
    return add_nodes(packed, surface, hanging.anchor_element, hanging.anchor_arc, nodes)


@njit(void(FOOT, f8, b1, i8, F1, F2, F2), **STRICT)
def _vary(foot: Foot, gap: float, edge: bool, mine: int, shares: Array, xi: Array, turn: Array) -> None:
    """Fill variations by the nodes: of a foot's parameters ``xi`` ``(2, dofs)``, and of its normal ``(3, dofs)``.

    With ``t``, ``b``, ``k``, ``a`` and ``H`` of `isorod.contact.tangent_kernel`, ``dxi = H^-1 (t - g b)`` and
    ``dn = -y_a a^-1 (k dxi - b)``.  On an edge ``s`` is held, and the normal is ``(x - y) / g``.
    """
    y, normal, phi, axial = foot.y, foot.normal, foot.phi, foot.axial
    a11, a12, a22 = dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2])
    k11, k12, k22 = dot(normal, y[3]), dot(normal, y[4]), dot(normal, y[5])
    h11, h12, h22 = a11 - gap * k11, a12 - gap * k12, a22 - gap * k22
    h, metric = h11 * h22 - h12 * h12, a11 * a22 - a12 * a12
    for m in range(shares.size):
        slope1 = slope2 = 0.0
        if m >= mine:
            j, i = divmod(m - mine, 3)
            slope1, slope2 = -axial[0, j] * phi[1, i], -axial[1, j] * phi[0, i]
        for a in range(3):
            d = 3 * m + a
            beside1, beside2 = slope1 * normal[a], slope2 * normal[a]
            right1 = shares[m] * y[1, a] - gap * beside1
            right2 = shares[m] * y[2, a] - gap * beside2
            if edge:
                xi[0, d], xi[1, d] = right1 / h11, 0.0
                for c in range(3):
                    fixed = (1.0 if c == a else 0.0) - normal[c] * normal[a]
                    turn[c, d] = (shares[m] * fixed - y[1, c] * xi[0, d]) / gap
                continue
            xi[0, d] = (h22 * right1 - h12 * right2) / h
            xi[1, d] = (h11 * right2 - h12 * right1) / h
            tilt1 = k11 * xi[0, d] + k12 * xi[1, d] - beside1
            tilt2 = k12 * xi[0, d] + k22 * xi[1, d] - beside2
            for c in range(3):
                turn[c, d] = -(y[1, c] * (a22 * tilt1 - a12 * tilt2) + y[2, c] * (a11 * tilt2 - a12 * tilt1)) / metric


@njit(void(PASS_ROW, FOOT, f8, F1, F2), **STRICT)
def _vary_rigid(one: Row, foot: Foot, gap: float, shares: Array, turn: Array) -> None:
    """Fill the variation of an obstacle's normal ``(3, dofs)``."""
    turn[:] = 0.0
    if one.master == PLANE:
        return
    for c in range(3):
        for a in range(3):
            fixed = (1.0 if c == a else 0.0) - foot.normal[c] * foot.normal[a]
            if one.master == CYLINDER:
                fixed -= one.direction[c] * one.direction[a]
            for m in range(shares.size):
                turn[c, 3 * m + a] = shares[m] * fixed / (gap + one.radius)


@njit(void(PACKED, FRICTION, F2, I1, _HANGINGS, I1, F1, I1, F1), **STRICT)
def add_friction_blocks(
    packed: Packed,
    friction: Friction,
    positions: Array,
    active: Index,
    hangings: Table,
    begin: Index,
    values: Array,
    aside: Index,
    others: Array,
) -> None:
    """Add minus the derivatives of the forces of friction to dense blocks.

    Parameters
    ----------
    packed, friction
        As the last forces left them.
    positions
        Those of the last forces, ``(nodes, 3)``.
    active, hangings, begin, values
        As for `isorod.contact.tangent_kernel.add_blocks`, with `HANGING` in the place of patches.
    aside, others
        Where in ``others`` the blocks begin, of the patch's degrees of freedom by those of an anchor elsewhere.
    """
    foot, there = new_foot(), new_foot()
    s = np.empty(3)
    for point_of in range(active.size):
        point, hanging = active[point_of], hangings[point_of]
        anchor, one, mu = friction.anchors[point], packed.passes[hanging.number], friction.coefficients[hanging.number]
        if mu == 0.0 or anchor.element < 0:
            continue
        slave = packed.surfaces[one.slave]
        mine, nodes = 3 * slave.functions, 3 * slave.functions
        gap = project(packed, one, point, positions, foot)
        place_of(packed, one, anchor, positions, there)
        length = stretch_of(packed, point, foot, there, s)
        if one.master >= 0:
            nodes += 3 * packed.surfaces[packed.elements[hanging.master_element].surface].functions
        shares = np.empty(nodes)
        at = site(one, slave, point)
        for m in range(mine):
            shares[m] = packed.along[at.along, m // 3] * packed.around[at.around, m % 3]
        for m in range(mine, nodes):
            j, i = divmod(m - mine, 3)
            shares[m] = -foot.axial[0, j] * foot.phi[0, i]
        xi, turn = np.zeros((2, 3 * nodes)), np.empty((3, 3 * nodes))
        if one.master >= 0:
            _vary(foot, gap, packed.states[point].edge, mine, shares, xi, turn)
        else:
            _vary_rigid(one, foot, gap, shares, turn)
        normal, n_d = foot.normal, 0.0
        for c in range(3):
            n_d += normal[c] * (packed.points[point, c] - there.y[0, c])
        slips = friction.slipping[point]
        # Traction per stretch, and the directions in which a change of the stretch changes nothing.
        stiffness = mu * packed.states[point].pressure / length if slips else one.penalty
        spring = np.empty((3, 3))
        for c in range(3):
            for a in range(3):
                spring[c, a] = stiffness * ((1.0 if c == a else 0.0) - normal[c] * normal[a])
                if slips:
                    spring[c, a] -= stiffness * s[c] * s[a] / length**2
        # Of the traction, by the nodes of the patch.
        change = np.empty((3, 3 * nodes))
        for m in range(nodes):
            for a in range(3):
                d = 3 * m + a
                n_turn = 0.0
                for c in range(3):
                    n_turn += turn[c, d] * (packed.points[point, c] - there.y[0, c])
                for c in range(3):
                    value = stiffness * normal[c] * n_turn
                    if m < mine:
                        value -= spring[c, a] * shares[m]
                    for e in range(3):
                        value += spring[c, e] * turn[e, d] * n_d
                    if slips:
                        value += mu * one.penalty * s[c] / length * normal[a] * shares[m]
                    change[c, d] = value
        weight, traction = packed.areas[point], friction.tractions[point]
        if one.master >= 0:
            own = packed.surfaces[packed.elements[anchor.element].surface].functions
            held = np.empty((3, 9 * own))
            for m in range(3 * own):
                part = there.axial[0, m // 3] * there.phi[0, m % 3]
                for c in range(3):
                    for a in range(3):
                        held[c, 3 * m + a] = part * spring[c, a]
            if hanging.anchor_element < 0:
                for c in range(3):
                    for d in range(9 * own):
                        change[c, 3 * mine + d] += held[c, d]
            else:
                first, width = aside[point_of], 9 * own
                for row in range(3 * nodes):
                    for d in range(width):
                        others[first + row * width + d] -= weight * shares[row // 3] * held[row % 3, d]
        first, width = begin[point_of], 3 * nodes
        for row in range(width):
            m, c = divmod(row, 3)
            by1 = by2 = 0.0
            if m >= mine:
                j, i = divmod(m - mine, 3)
                by1 = -foot.axial[0, j] * foot.phi[1, i] * traction[c]
                by2 = -foot.axial[1, j] * foot.phi[0, i] * traction[c]
            for d in range(width):
                values[first + row * width + d] -= weight * (shares[m] * change[c, d] + by1 * xi[0, d] + by2 * xi[1, d])
