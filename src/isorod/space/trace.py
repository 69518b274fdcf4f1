"""Traces of a rod's functions on its surface, and values at any points in space, for ties."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.geometry.disk import circle, harmonic_functions
from isorod.geometry.fitting import evaluate
from isorod.geometry.quadrature import Rule, circle_points
from isorod.space.space import Space

Mask = NDArray[np.bool_]

# Starts of the search for closest points: distance along the rod, in radii; most sections; points round a section.
_APART, _MOST_SECTIONS = 0.5, 40_000
_AROUND = 16

# Iterations of Newton's method for closest points, and its tolerance, relative to the axis or the disk.
_STEPS, _EXACT = 50, 1e-13

# Relative size below which the trace of a function, or a combination of traces, counts as zero.
_NEW = 1e-7

# The same on a part of the outline, such as one side of a rectangle, which is not exactly flat: combinations that are
# independent only because of that are 0.012 and less, others 0.12 and more.
_PART = 0.04

# Largest fractions of the touching area that touch elsewhere along part of the length, or no longer at a quarter of
# the distance.
_UNCLEAR = 0.2

# Fewer touching points round the section count as a line, as between parallel round bars.
_FEW = 5

# Most Gauss points in a slice of the disk or along an element.
_MOST_POINTS = 64

# Functions along the axis below this are zero up to round-off.
_ZERO = 1e-14

# Lengths along a rod that differ by less than this fraction of it are equal.
_ROUNDED = 1e-6


class Trace(NamedTuple):
    """Functions on a surface, at its quadrature points.

    Attributes
    ----------
    points, normals : (q, 3)
        In the undeformed state; normals point out of the body.
    weights : (q,)
        Areas.
    nodes, values : (q, m)
        Nodes whose functions do not vanish there, and their values.
    independent : (k,)
        Nodes whose traces are a basis of all traces.
    """

    points: Array
    normals: Array
    weights: Array
    nodes: Index
    values: Array
    independent: Index


class Rows(NamedTuple):
    """Functions of a body at points in space.

    They are extrapolated linearly from the closest point of the body, so that linear fields are exact, also across a
    gap.

    Attributes
    ----------
    nodes, values : (q, m)
        Nodes, and values of their functions.
    gap : (q,)
        Distance from the body, 0 within, units of length.
    """

    nodes: Index
    values: Array
    gap: Array


def end_trace(space: Space, which: str, finer: int = 1, own: bool = False) -> Trace:
    """Return the functions on the face at the ``"start"`` or ``"end"``.

    The points are those of a full rule with ``finer`` times as many in each direction, or with ``own`` those of the
    elements: nodal forces of constant stresses are then balanced on the face exactly.
    """
    layer = space.end(which) % space.layers
    u = space.axis.breaks[space.end(which)]
    rule = space.rule if own else _finer_rule(space.basis.full(space.axis.degree), finer)
    xi, area = space.section_rule(rule)
    position, jacobian = space.rod.grid(xi, [u])
    normal = np.cross(jacobian[0, :, :, 0], jacobian[0, :, :, 1]) * (1.0 if which == "end" else -1.0)
    size = np.linalg.norm(normal, axis=1)
    nodes = layer * space.layer_nodes + np.arange(space.layer_nodes)
    values = space.basis.functions(xi)[0]
    return Trace(position[0], normal / size[:, None], area * size, np.tile(nodes, (len(xi), 1)), values, nodes)


def section_trace(space: Space, u: float) -> Trace:
    """Return the functions on the cross-section at an axis parameter, by the elements' rule; normals point forwards.

    Raises
    ------
    InputError
        If there is no such section.
    """
    xi, area = space.section_rule(space.rule)
    position, jacobian = space.rod.grid(xi, [_on_axis(space, u)])
    normal = np.cross(jacobian[0, :, :, 0], jacobian[0, :, :, 1])
    size = np.linalg.norm(normal, axis=1)
    return Trace(position[0], normal / size[:, None], area * size, *_across(space, xi, u))


def ring_trace(space: Space, u: float) -> Trace:
    """Return the functions on the line round the outer surface at an axis parameter; weights are lengths.

    Raises
    ------
    InputError
        If there is no such section.
    """
    rule = space.basis.full(space.axis.degree)
    xi, angle = circle_points(space.points_around, rule.angular, space.rod.rings[-1], space.turn)
    position, jacobian = space.rod.grid(xi, [_on_axis(space, u)])
    around = jacobian[0, ..., 1] * xi[:, :1] - jacobian[0, ..., 0] * xi[:, 1:]
    normal = np.cross(around, jacobian[0, ..., 2])
    size = np.linalg.norm(normal, axis=1)
    weights = angle * np.linalg.norm(around, axis=1)
    return Trace(position[0], normal / size[:, None], weights, *_across(space, xi, u))


def _on_axis(space: Space, u: float) -> float:
    low, high = space.axis.breaks[[0, -1]]
    if not low <= u <= high:
        raise InputError(f"got u = {u:g}, need an axis parameter from {low:g} to {high:g}")
    return u


def _across(space: Space, xi: Array, u: float) -> tuple[Index, Array, Index]:
    """Return nodes ``(q, m)`` and values of functions at points of a section, and all nodes with functions there."""
    first, axial, _ = space.axis.local([u])
    acting = np.flatnonzero(np.abs(axial[0]) > _ZERO)
    layers = (first[0] + acting) % space.layers
    nodes = (layers[:, None] * space.layer_nodes + np.arange(space.layer_nodes)).ravel()
    values = np.einsum("j,qn->qjn", axial[0, acting], space.basis.functions(xi)[0]).reshape(len(xi), -1)
    return np.tile(nodes, (len(xi), 1)), values, nodes


def lateral_trace(
    space: Space,
    along: tuple[float, float] | None,
    surface: str,
    finer: int = 1,
    breaks: Array | None = None,
    kept: Mask | None = None,
) -> Trace:
    """Return the functions on the lateral surface (`isorod.model.tie.LateralSurface`).

    Parameters
    ----------
    finer
        As for `end_trace`.
    breaks
        Axis parameters where functions of another body are not smooth: integration is split there.
    kept
        Which of the points round the section to use (`touching`); by default all.
    """
    radius = space.rod.rings[0 if surface == "inner" else -1]
    if radius == 0.0:
        raise InputError("inner surface: the rod has no hole")
    chosen = elements_along(space, along)
    rule = _finer_rule(space.basis.full(space.axis.degree), finer)
    xi, angle = circle_points(space.points_around, rule.angular + 1, radius, space.turn)
    if kept is not None:
        xi, angle = xi[kept], angle[kept]
    element, u, length = _between(space, chosen, rule.axial, breaks)
    position, jacobian = space.rod.grid(xi, u.ravel())
    around = jacobian[..., 1] * xi[:, :1] - jacobian[..., 0] * xi[:, 1:]
    normal = np.cross(around, jacobian[..., 2]) * (1.0 if surface == "outer" else -1.0)
    size = np.linalg.norm(normal, axis=-1)
    across = space.basis.functions(xi)[0]
    # Higher-order functions of control points vanish there, and polynomials are dependent there.
    triangle, order = qr(across, mode="r", pivoting=True)
    pivots = np.abs(np.diag(triangle))
    basis = np.sort(order[: int(np.count_nonzero(pivots > (_NEW if kept is None else _PART) * pivots[0]))])
    acting = np.flatnonzero(np.abs(across).max(axis=0) > _NEW * np.abs(across).max())
    axial = space.axis.local(u.ravel())[1]
    layers = np.repeat(space.element_layers[element], u.shape[1], axis=0)
    values = np.einsum("tj,ql->tqjl", axial, across[:, acting])
    nodes = (layers[:, :, None] * space.layer_nodes + acting).reshape(len(axial), 1, -1)
    count = values.shape[0] * values.shape[1]
    independent = (np.unique(space.element_layers[chosen])[:, None] * space.layer_nodes + basis).ravel()
    return Trace(
        position.reshape(-1, 3),
        (normal / size[..., None]).reshape(-1, 3),
        (length.reshape(-1, 1) * angle * size).ravel(),
        np.broadcast_to(nodes, (len(axial), len(xi), nodes.shape[2])).reshape(count, -1),
        values.reshape(count, -1),
        independent,
    )


def touching(space: Space, trace: Trace, gap: Array, most: float, finer: int = 1) -> Mask:
    """Return which points round the section touch another body along the whole length (`lateral_trace`).

    Parameters
    ----------
    trace, gap
        Trace of the whole lateral surface, and distances of its points from the other body, ``(q,)``.
    most
        Distance up to which they touch.
    finer
        As for `end_trace`.

    Raises
    ------
    InputError
        If there are none, or they vary along the length or strongly with the distance.
    """
    around = _finer_rule(space.basis.full(space.axis.degree), finer).angular + 1
    apart, areas = (values.reshape(-1, space.points_around * around) for values in (gap, trace.weights))
    kept: Mask = apart.max(axis=0) <= most
    area = float(areas[:, kept].sum())
    if not area:
        raise InputError(f"the surfaces do not touch all along: they are up to {apart.max(axis=0).min():.3g} apart")
    if areas[apart <= most].sum() > (1.0 + _UNCLEAR) * area:
        raise InputError("the surfaces touch along part of their length only; give the interval (along)")
    near_area = areas[:, apart.max(axis=0) <= 0.25 * most].sum()
    if kept.sum() < _FEW or near_area < (1.0 - _UNCLEAR) * area:
        raise InputError("the surfaces touch along a line, not on an area; use another tie")
    return kept


def _finer_rule(rule: Rule, finer: int) -> Rule:
    """Return a rule with ``finer`` times as many points in each direction."""
    return Rule(*(min(finer * count, _MOST_POINTS) for count in (rule.radial, rule.angular, rule.axial)))


def _between(space: Space, chosen: Index, count: int, breaks: Array | None) -> tuple[Index, Array, Array]:
    """Return elements ``(i,)``, Gauss points and weights ``(i, count)`` of intervals between breaks of two bodies."""
    own_breaks = space.axis.breaks
    joints = own_breaks if breaks is None else np.unique(np.concatenate([own_breaks, breaks]))
    # Nearly coincident joints are merged.
    joints = joints[np.append(True, np.diff(joints) > _ROUNDED * (own_breaks[-1] - own_breaks[0]))]
    joints[-1] = own_breaks[-1]
    element = np.searchsorted(own_breaks, 0.5 * (joints[1:] + joints[:-1]), "right") - 1
    inside = np.isin(element, chosen)
    begin, size = joints[:-1][inside], np.diff(joints)[inside]
    x, w = np.polynomial.legendre.leggauss(count)
    return element[inside], begin[:, None] + size[:, None] * 0.5 * (x + 1.0), size[:, None] * 0.5 * w


def breaks_on(space: Space, other: Space) -> Array:
    """Return the axis parameters of a rod nearest to the joints of another's elements."""
    centers = other.rod.grid(np.zeros((1, 2)), other.axis.breaks)[0][:, 0]
    return _nearest(space, centers)[1]


def elements_along(space: Space, along: tuple[float, float] | None) -> Index:
    """Return the elements between two arc lengths, which must be joints where the space is C0."""
    everything = np.arange(space.axis.elements)
    if along is None:
        return everything
    length, axis = space.rod.arc_length, space.axis
    ends = length(axis.breaks)
    if along[0] < -_ROUNDED * length.total or along[1] > (1.0 + _ROUNDED) * length.total:
        raise InputError(
            f"lateral surface: along is from {along[0]:g} to {along[1]:g}, need lengths from 0 to the rod's "
            f"{length.total:.9g}"
        )
    for value in along:
        k = int(np.argmin(np.abs(ends - value)))
        inner = 0 < k < axis.elements
        if abs(ends[k] - value) > _ROUNDED * length.total or (inner and axis.multiplicities[k] < axis.degree):
            raise InputError(
                f"lateral surface: {value:g} along the rod is no joint of elements at which the space is C0; "
                f"give it the knot {np.interp(value, length.length, length.u):.9g} twice"
            )
    low, high = along
    middles = 0.5 * (ends[1:] + ends[:-1])
    return everything[(middles > low) & (middles < high)]


def rows_at(space: Space, points: Array) -> Rows:
    """Return the functions of a rod at points ``(q, 3)`` in or near it."""
    xi, u = _nearest(space, points)
    position, jacobian = _map(space, xi, u)
    rest = points - position
    step = np.linalg.solve(jacobian, rest[..., None])[..., 0]
    across, slopes = space.basis.functions(xi)
    first, axial, along = space.axis.local(u)
    grown = across + np.einsum("qld,qd->ql", slopes, step[:, :2])
    values = np.einsum("qj,ql->qjl", axial, grown) + np.einsum("qj,ql->qjl", along * step[:, 2:], across)
    layers = (first[:, None] + np.arange(space.axis.degree + 1)) % space.layers
    nodes = layers[:, :, None] * space.layer_nodes + np.arange(space.layer_nodes)
    return Rows(nodes.reshape(len(u), -1), values.reshape(len(u), -1), np.linalg.norm(rest, axis=1))


def _map(space: Space, xi: Array, u: Array) -> tuple[Array, Array]:
    """Return position ``(q, 3)`` and Jacobian ``(q, 3, 3)`` at pairs of disk points and axis parameters."""
    rod = space.rod
    values, gradients = harmonic_functions(rod.section_points, xi)
    section, slopes = evaluate(rod.axis, rod.control_points, u)
    jacobian = np.empty((len(u), 3, 3))
    jacobian[:, :, :2] = np.einsum("qid,qia->qad", gradients, section)
    jacobian[:, :, 2] = np.einsum("qi,qia->qa", values, slopes)
    return np.einsum("qi,qia->qa", values, section), jacobian


def _nearest(space: Space, points: Array) -> tuple[Array, Array]:
    """Return the disk points ``(q, 2)`` and axis parameters ``(q,)`` of approximate closest points of a rod.

    Within the rod they are exact; outside of it they are projections in the rod's own coordinates.
    """
    rod, axis = space.rod, space.rod.axis
    low, high = axis.breaks[[0, -1]]
    hole = rod.rings[0]
    sections = int(np.clip(rod.arc_length.total / (_APART * rod.radius), 4 * axis.elements, _MOST_SECTIONS))
    stations = np.linspace(low, high, sections + 1)
    radii = np.linspace(hole, 1.0, 3)
    disk = (radii[:, None, None] * circle(_AROUND)).reshape(-1, 2)
    start = np.unique(disk.round(12), axis=0)
    cloud = rod.grid(start, stations)[0].reshape(-1, 3)
    # Imported late: only models whose surfaces are tied need it.
    from scipy.spatial import cKDTree

    near = cKDTree(cloud).query(points)[1]
    xi, u = start[near % len(start)].copy(), stations[near // len(start)].copy()
    for _ in range(_STEPS):
        position, jacobian = _map(space, xi, u)
        step = np.linalg.solve(jacobian, (points - position)[..., None])[..., 0]
        after, along = xi + step[:, :2], u + step[:, 2]
        if rod.closed:
            along = low + np.mod(along - low, high - low)
        along = np.clip(along, low, high)
        radius = np.linalg.norm(after, axis=1)
        held = np.clip(radius, hole, 1.0)
        after *= np.divide(held, radius, out=np.ones_like(radius), where=radius > 0.0)[:, None]
        change = max(np.abs(after - xi).max(initial=0.0), np.abs(along - u).max(initial=0.0) / (high - low))
        xi, u = after, along
        if change < _EXACT:
            break
    return xi, u
