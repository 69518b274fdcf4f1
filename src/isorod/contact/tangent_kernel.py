"""Compiled: minus the derivatives of the contact forces by the nodes.

A slave point ``x`` has the traction ``T = p n + t``, per reference area, ``t`` that of friction.  With ``D`` the
derivative of ``x - y`` by the nodes at a fixed point ``y`` of the master, its forces are ``D^T T``, and their
derivatives ``D^T dT + (D_a dxi_a)^T T``, ``xi`` the parameters of the projection.  With ``t_a = D^T y_a``,
``b_a = D_a^T n``, ``k_ab = n . y_ab`` and ``H = a - g k`` (P. Wriggers, Computational Contact Mechanics (2006),
chapter 4) these follow by ``dxi = H^-1 (t - g b)``, the normal by ``dn = -y_a a^-1 (k dxi - b)``, and ``dp = -eps n^T
D``.  On an edge ``s`` is held, and the normal is ``(x - y) / g``.  Without friction the sum is symmetric, the second
derivatives of the energy.
"""

import numpy as np
from numba import b1, f8, from_dtype, i8, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, I1, STRICT, njit
from isorod.contact.force_kernel import place_of, project, stretch_of
from isorod.contact.packed import FRICTION, FUNCTIONS, MESH, PACKED, PASS_ROW, PLANE, Friction, Packed, Row, Table
from isorod.contact.search_kernel import site
from isorod.contact.surface_kernel import PROJECTION, Projection, arc_of, dot, new_projection

# A point couples at most this many nodes: three control points round each of three sections.
NODES = 9 * FUNCTIONS

# A patch of contact: pass, element and arc of the slave, of the master (-1 where it is rigid), and of the anchor of
# friction where that is elsewhere on a master, else -1.
PATCH = np.dtype(
    [
        *((name, np.int64) for name in ("number", "element", "arc", "master_element", "master_arc")),
        *((name, np.int64) for name in ("anchor_element", "anchor_arc")),
    ]
)
_PATCH_ROW = from_dtype(PATCH)
_PATCHES = types.Array(_PATCH_ROW, 1, "C")


@njit(b1(FRICTION, i8, i8), **STRICT)
def _hangs(friction: Friction, number: int, point: int) -> bool:
    """Return whether a point of a pass has an anchor."""
    return friction.coefficients[number] > 0.0 and friction.anchors[point].element >= 0


@njit(i8(PACKED, i8, f8), **STRICT)
def _arc_on(packed: Packed, element: int, theta: float) -> int:
    """Return the arc of an angle on the surface of an element."""
    return arc_of(packed.surfaces[packed.elements[element].surface], theta)


@njit(void(PACKED, FRICTION, I1, _PATCHES), **STRICT)
def find_patches(packed: Packed, friction: Friction, active: Index, patches: Table) -> None:
    """Fill ``patches``, whose passes are set, with those of active slave points."""
    for m in range(active.size):
        point, patch = active[m], patches[m]
        pass_ = packed.passes[patch.number]
        at = site(pass_, packed.surfaces[pass_.slave], point)
        patch.element, patch.arc = at.element, at.arc
        patch.master_element = patch.master_arc = patch.anchor_element = patch.anchor_arc = -1
        if pass_.master < 0:
            continue
        start = packed.starts[point]
        patch.master_element, patch.master_arc = start.element, _arc_on(packed, start.element, start.theta)
        if _hangs(friction, patch.number, point):
            anchor = friction.anchors[point]
            arc = _arc_on(packed, anchor.element, anchor.theta)
            if anchor.element != patch.master_element or arc != patch.master_arc:
                patch.anchor_element, patch.anchor_arc = anchor.element, arc


@njit(i8(PACKED, i8, i8, I1), **STRICT)
def _add_nodes(packed: Packed, element: int, arc: int, nodes: Index) -> int:
    """Fill ``nodes`` with the control points round an arc by the layers of an element, if any; return how many."""
    if element < 0:
        return 0
    layers = packed.elements[element].layers
    own = packed.surfaces[packed.elements[element].surface]
    for j in range(own.functions):
        for c in range(3):
            nodes[3 * j + c] = layers[j] + (arc + c - 1) % own.around
    return 3 * own.functions


@njit(types.UniTuple(i8, 2)(PACKED, _PATCH_ROW, I1), **STRICT)
def patch_nodes(packed: Packed, patch: Row, nodes: Index) -> tuple[int, int]:
    """Fill ``nodes`` with those of slave, master and anchor; return how many get forces (the first two), and all."""
    count = _add_nodes(packed, patch.element, patch.arc, nodes)
    count += _add_nodes(packed, patch.master_element, patch.master_arc, nodes[count:])
    return count, count + _add_nodes(packed, patch.anchor_element, patch.anchor_arc, nodes[count:])


@njit(void(PASS_ROW, PROJECTION, f8, F2), **STRICT)
def _bend(pass_: Row, projection: Projection, gap: float, bend: Array) -> None:
    """Fill the derivatives of an obstacle's normal by the point ``(3, 3)``."""
    bend[:] = 0.0
    if pass_.master == PLANE or (pass_.master == MESH and gap == 0.0):
        return
    y, normal, axis = projection.y, projection.normal, pass_.direction
    for c in range(3):
        for a in range(3):
            if pass_.master == MESH:
                bend[c, a] = (y[1, c] * y[1, a] + y[2, c] * y[2, a]) / gap
            else:
                # A sphere has no axis: zeros.
                fixed = (1.0 if c == a else 0.0) - normal[c] * normal[a] - axis[c] * axis[a]
                bend[c, a] = fixed / (gap + pass_.radius)


@njit(void(PROJECTION, f8, b1, i8, F1, F2, F2), **STRICT)
def _vary(projection: Projection, gap: float, edge: bool, mine: int, functions: Array, xi: Array, turn: Array) -> None:
    """Fill variations by the nodes: of a projection's parameters ``xi`` ``(2, dofs)``, and of its normal ``(3, dofs)``.

    ``functions`` is ``D``; the first ``mine`` are those of the slave's nodes.
    """
    y, normal, phi, axial = projection.y, projection.normal, projection.phi, projection.axial
    a11, a12, a22 = dot(y[1], y[1]), dot(y[1], y[2]), dot(y[2], y[2])
    k11, k12, k22 = dot(normal, y[3]), dot(normal, y[4]), dot(normal, y[5])
    h11, h12, h22 = a11 - gap * k11, a12 - gap * k12, a22 - gap * k22
    h, metric = h11 * h22 - h12 * h12, a11 * a22 - a12 * a12
    for m in range(functions.size):
        slope1 = slope2 = 0.0
        if m >= mine:
            j, i = divmod(m - mine, 3)
            slope1, slope2 = -axial[0, j] * phi[1, i], -axial[1, j] * phi[0, i]
        for a in range(3):
            d = 3 * m + a
            beside1, beside2 = slope1 * normal[a], slope2 * normal[a]
            right1 = functions[m] * y[1, a] - gap * beside1
            right2 = functions[m] * y[2, a] - gap * beside2
            if edge:
                xi[0, d], xi[1, d] = right1 / h11, 0.0
                tilt1 = k11 * xi[0, d] - beside1
                rate = functions[m] / gap if gap != 0.0 else 0.0
                for c in range(3):
                    fixed = (1.0 if c == a else 0.0) - normal[c] * normal[a] - y[1, c] * y[1, a] / a11
                    turn[c, d] = rate * fixed - y[1, c] * tilt1 / a11
                continue
            xi[0, d] = (h22 * right1 - h12 * right2) / h
            xi[1, d] = (h11 * right2 - h12 * right1) / h
            tilt1 = k11 * xi[0, d] + k12 * xi[1, d] - beside1
            tilt2 = k12 * xi[0, d] + k22 * xi[1, d] - beside2
            for c in range(3):
                turn[c, d] = -(y[1, c] * (a22 * tilt1 - a12 * tilt2) + y[2, c] * (a11 * tilt2 - a12 * tilt1)) / metric


@njit(void(PACKED, FRICTION, F2, _PATCH_ROW, i8, PROJECTION, F1, F2, F2), **STRICT)
def _add_friction(
    packed: Packed,
    friction: Friction,
    positions: Array,
    patch: Row,
    point: int,
    projection: Projection,
    functions: Array,
    turn: Array,
    change: Array,
) -> None:
    """Add the variation of the traction of friction to ``change`` ``(3, dofs)``; other arguments as in `add_blocks`."""
    there, s, spring = new_projection(), np.empty(3), np.empty((3, 3))
    anchor, pass_, mu = friction.anchors[point], packed.passes[patch.number], friction.coefficients[patch.number]
    mine, normal, slips = 3 * packed.surfaces[pass_.slave].functions, projection.normal, friction.slipping[point]
    place_of(packed, pass_, anchor, positions, there)
    length = stretch_of(packed, point, projection, there, s)
    n_d = 0.0
    for c in range(3):
        n_d += normal[c] * (packed.points[point, c] - there.y[0, c])
    # Traction per stretch; where the point slips, stretch along the traction changes nothing.
    stiffness = mu * packed.states[point].pressure / length if slips else pass_.penalty
    for c in range(3):
        for a in range(3):
            spring[c, a] = stiffness * ((1.0 if c == a else 0.0) - normal[c] * normal[a])
            if slips:
                spring[c, a] -= stiffness * s[c] * s[a] / length**2
    for m in range(functions.size):
        for a in range(3):
            d = 3 * m + a
            n_turn = 0.0
            for c in range(3):
                n_turn += turn[c, d] * (packed.points[point, c] - there.y[0, c])
            for c in range(3):
                value = stiffness * normal[c] * n_turn
                if m < mine:
                    value -= spring[c, a] * functions[m]
                for e in range(3):
                    value += spring[c, e] * turn[e, d] * n_d
                if slips:
                    value += mu * pass_.penalty * s[c] / length * normal[a] * functions[m]
                change[c, d] += value
    if pass_.master < 0:
        return
    first = mine if patch.anchor_element < 0 else functions.size
    for m in range(3 * packed.surfaces[packed.elements[anchor.element].surface].functions):
        part = there.axial[0, m // 3] * there.phi[0, m % 3]
        for c in range(3):
            for a in range(3):
                change[c, 3 * (first + m) + a] += part * spring[c, a]


@njit(void(PACKED, FRICTION, F2, I1, _PATCHES, I1, F1), **STRICT)
def add_blocks(
    packed: Packed,
    friction: Friction,
    positions: Array,
    active: Index,
    patches: Table,
    begin: Index,
    values: Array,
) -> None:
    """Add minus the derivatives of the contact forces to dense blocks.

    Parameters
    ----------
    packed, friction
        As the last forces left them.
    positions
        Those of the last forces, ``(nodes, 3)``.
    active, patches, begin
        Slave points under pressure, their patches, and where in ``values`` their blocks begin, all ``(m,)``.
    values
        Blocks of the degrees of freedom of a patch's nodes (see `patch_nodes`), one after the other; added to.
    """
    projection, bend, traction = new_projection(), np.empty((3, 3)), np.empty(3)
    nodes = np.empty(NODES, dtype=np.int64)
    for point_of in range(active.size):
        point, patch = active[point_of], patches[point_of]
        pass_, state, weight = packed.passes[patch.number], packed.states[point], packed.areas[point]
        slave = packed.surfaces[pass_.slave]
        count, columns = patch_nodes(packed, patch, nodes)
        mine, size, width = 3 * slave.functions, 3 * count, 3 * columns
        gap = project(packed, pass_, point, positions, projection)
        at, functions = site(pass_, slave, point), np.empty(count)
        for m in range(mine):
            functions[m] = packed.along[at.along, m // 3] * packed.around[at.around, m % 3]
        for m in range(mine, count):
            j, i = divmod(m - mine, 3)
            functions[m] = -projection.axial[0, j] * projection.phi[0, i]
        xi, turn, change = np.zeros((2, size)), np.empty((3, size)), np.zeros((3, width))
        if pass_.master >= 0:
            _vary(projection, gap, state.edge, mine, functions, xi, turn)
        else:
            _bend(pass_, projection, gap, bend)
            for d in range(size):
                for c in range(3):
                    turn[c, d] = functions[d // 3] * bend[c, d % 3]
        normal = projection.normal
        for c in range(3):
            traction[c] = state.pressure * normal[c]
            for d in range(size):
                change[c, d] = (
                    state.pressure * turn[c, d] - pass_.penalty * normal[c] * normal[d % 3] * functions[d // 3]
                )
        if _hangs(friction, patch.number, point):
            _add_friction(packed, friction, positions, patch, point, projection, functions, turn, change)
            for c in range(3):
                traction[c] += friction.tractions[point, c]
        for row in range(size):
            m, c = divmod(row, 3)
            first, factor = begin[point_of] + row * width, weight * functions[m]
            if m < mine:
                for d in range(width):
                    values[first + d] -= factor * change[c, d]
                continue
            j, i = divmod(m - mine, 3)
            by1 = weight * projection.axial[0, j] * projection.phi[1, i] * traction[c]
            by2 = weight * projection.axial[1, j] * projection.phi[0, i] * traction[c]
            for d in range(size):
                values[first + d] += by1 * xi[0, d] + by2 * xi[1, d] - factor * change[c, d]
            for d in range(size, width):
                values[first + d] -= factor * change[c, d]
