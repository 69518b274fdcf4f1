"""Contact between the lateral surfaces of rods, outer and inner ones, and of rods with rigid obstacles.

The penalty energy ``1/2 eps g^2`` per reference area, ``g`` the gap from a point of one surface (the slave) to the
closest point of the other (the master), is integrated over both surfaces in turn with half the weight each, so that
neither is preferred (Lu, CMAME 200 (2011) 726-741, on the paper's surface).  Forces are its exact derivative.

Of several masters the nearest to a point counts.  A point whose closest point lies on the open end of its master, or on
the border of its named elements, is not in contact: it is beyond the surface.

The energy has a continuous gradient, and a Hessian that jumps where points come and go and where projections cross
joints of arcs.  Newton's method converges quadratically once the active set is constant; a load step in which it does
not become constant runs out of iterations and is cut (see `isorod.statics`).
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact import facets
from isorod.contact.cells import functions
from isorod.contact.defaults import deepest, penalty, points_of, radii
from isorod.contact.facets import Facets
from isorod.contact.packed import (
    CYLINDER,
    ELEMENT,
    FUNCTIONS,
    LIFT,
    MESH,
    NEAR,
    NODE,
    NOWHERE,
    PASS,
    PLANE,
    SPHERE,
    STATE,
    SURFACE,
    Packed,
    Table,
)
from isorod.contact.traces import Trace, section_functions, trace
from isorod.contact.tree import tree
from isorod.geometry.axis import Axis
from isorod.geometry.disk import MAX_COUNT
from isorod.model.contact import Contact, Cylinder, Plane, Sphere
from isorod.model.triangle_mesh import TriangleMesh

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.space.space import Space

# Distance of the sections at which searches start, in radii, and the most of them on an element.
_RUNG, _MOST = 0.4, 256

_KINDS = {Plane: PLANE, Cylinder: CYLINDER, Sphere: SPHERE, TriangleMesh: MESH}


class _Tables:
    """Rows of the tables of `Packed` as they are collected; ``size`` is the number of nodes so far."""

    def __init__(self, size: int) -> None:
        self.surfaces: list[Any] = []
        self.elements: list[Any] = []
        self.passes: list[Any] = []
        self.control_points: list[Index] = []
        self.around: list[Array] = []
        self.along_rows: list[Array] = []
        self.fractions: list[Array] = []
        self.rungs: list[Array] = []
        self.corners: list[Array] = []
        self.normals: list[Array] = []
        self.nodes: list[Table] = []
        self.areas: list[Array] = []
        self.lifts: dict[tuple[int, float], Any] = {}
        self.matrices: list[Array] = []
        self.tracks: list[Array] = []
        self.size = size

    def surface(
        self, body: int, space: "Space", first_node: int, own: Trace, chosen: Sequence[int], sought: bool
    ) -> None:
        """Add a surface, the slave of the next pass.

        Parameters
        ----------
        body, space, first_node, own
            The rod's number, its space, the first of its nodes in the model, and its inner or outer surface.
        chosen
            Elements of its axis.
        sought
            Whether bodies, not only obstacles, touch it.
        """
        axis, arc_of, arcs = space.axis, own.arc_of, own.arcs
        n, stride = len(arcs), space.layer_nodes
        if own.lift is not None:
            first_node, stride = self._lifted(body, space, first_node, own), n
        first = len(self.elements)
        rows = {e: first + k for k, e in enumerate(chosen)}
        along = space.rod.arc_length(axis.breaks)
        period = along[-1] if space.rod.closed else np.inf
        counts = axis.degree + 1, first, len(rows), sought, len(arc_of), functions(space), own.dimension
        padded = np.pad(arc_of, (0, MAX_COUNT - len(arc_of))), np.pad(arcs, ((0, MAX_COUNT - n), (0, 0)))
        self.surfaces.append((body, n, *counts, own.turn, period, deepest(space, own.sense < 0.0), *padded))
        for e in chosen:
            layers = np.zeros(FUNCTIONS, dtype=np.int64)
            layers[: axis.degree + 1] = first_node + space.element_layers[e] * stride
            self.control_points.append((layers[: axis.degree + 1, None] + np.arange(n)).ravel())
            beside = [(e + step) % axis.elements if space.rod.closed else e + step for step in (-1, 1)]
            neighbours = [rows.get(other, -1) for other in beside]
            sizes = (along[e], along[e + 1], own.radius * radii(space, [e])[1])
            rungs, reach = _rungs(space, e, sizes)
            ladder = (reach, len(self.rungs), len(rungs), axis.breaks[e : e + 2])
            self.rungs.extend(rungs)
            self.elements.append((len(self.surfaces) - 1, layers, _polynomials(axis, e), neighbours, *sizes, *ladder))

    def _lifted(self, body: int, space: "Space", first_node: int, own: Trace) -> int:
        """Add the control points of a surface whose space has none there, and return the first of them."""
        assert own.lift is not None
        key, shape = (body, own.sense), (space.layers, *own.lift.shape)
        if key not in self.lifts:
            first_value = sum(matrix.size for matrix in self.matrices)
            self.matrices.append(own.lift.ravel())
            self.lifts[key] = self.size, first_node, *shape, first_value
            self.size += shape[0] * shape[1]
        return int(self.lifts[key][0])

    def slave(self, rule: "_Rule", masters: tuple[int, int], contact: Contact, force: float, fraction: float) -> None:
        """Add the pass in which the last surface is the slave.

        Parameters
        ----------
        rule
            Its points.
        masters
            First of the other surfaces and their number, or an obstacle's kind and 0.
        contact, force
            The contact's definition and penalty.
        fraction
            Weight of this pass in the energy.
        """
        first_point = sum(areas.size for areas in self.areas)
        starts = (first_point, rule.across, rule.along, len(self.around), len(self.along_rows))
        self.passes.append((len(self.surfaces) - 1, *masters, *starts, force, *self._obstacle(contact)))
        self._points(rule.around, rule.axial, np.tile(rule.fractions, len(rule.areas)), fraction * rule.areas)

    def _points(self, around: Array, along: Iterable[Array], fractions: Array, areas: Array) -> None:
        """Add the points of a pass."""
        self.around.extend(around)
        self.along_rows.extend(along)
        self.fractions.append(fractions)
        self.areas.append(areas.ravel())

    def facets(self, own: Facets, first_node: int, masters: tuple[int, int], contact: Contact, force: float) -> None:
        """Add facets of a finite element body, and the pass in which they are the slave (`slave`)."""
        (count, points), size = own.areas.shape, own.nodes.shape[1]
        first_point, first = sum(areas.size for areas in self.areas), len(self.elements)
        arcs = np.zeros((MAX_COUNT, 7))
        arcs[0, 6] = 1.0
        counts = 1, size, first, count, True, 1, 1, 1
        self.surfaces.append((own.body, *counts, 0.0, np.inf, 0.0, np.zeros(MAX_COUNT, dtype=np.int64), arcs))
        nodes = np.pad(first_node + own.nodes, ((0, 0), (0, FUNCTIONS - size)))
        for e, layers in enumerate(nodes):
            # The rungs are the nodes.
            ladder = (0.0, len(self.rungs) + e * size, size, (e, e + 1))
            nothing = np.zeros((FUNCTIONS, FUNCTIONS)), (-1, -1), 0.0, 0.0, np.inf
            self.elements.append((len(self.surfaces) - 1, layers, *nothing, *ladder))
        self.rungs.extend(np.tile(np.eye(size, FUNCTIONS), (count, 1)))
        self.control_points.append(first_node + np.unique(own.nodes))
        starts = (first_point, 1, points, len(self.around), len(self.along_rows))
        self.passes.append((len(self.surfaces) - 1, *masters, *starts, force, *self._obstacle(contact)))
        along = np.pad(own.values.reshape(-1, size), ((0, 0), (0, FUNCTIONS - size)))
        self._points(np.array([[0.0, 1.0, 0.0]]), along, np.zeros(len(along)), own.areas)

    def _obstacle(self, contact: Contact) -> tuple[Any, ...]:
        """Return the fields of a pass for a rigid obstacle, from its point on, and add its track."""
        point, direction, radius = _at_rest(contact)
        motion, first = contact.motion, sum(map(len, self.tracks))
        if motion is None:
            return point, direction, radius, np.eye(3), point, point, direction, point, np.zeros(3), first, 0
        self.tracks.append(motion.track)
        middle = motion.middle
        own = middle, point, direction, middle, motion.direction
        return point, direction, radius, np.eye(3), *own, first, len(motion.track)

    def obstacle(self, contact: Contact) -> tuple[int, int]:
        """Add the tables of a contact's obstacle; return its kind and the first of its boxes, if it has any."""
        obstacle, first = contact.obstacle, sum(nodes.size for nodes in self.nodes)
        if isinstance(obstacle, TriangleMesh):
            order, nodes = tree(obstacle.corners)
            nodes["first"] += np.where(nodes["count"] > 0, sum(map(len, self.corners)), first)
            self.corners.append(obstacle.corners[order])
            self.normals.append(obstacle.normals()[order])
            self.nodes.append(nodes)
            return MESH, first
        return _KINDS[type(obstacle)], 0


class _Rule:
    """Gauss points on the surface of some elements of a rod.

    Attributes
    ----------
    across, along
        Number of points round an arc, and along an element.
    around, axial
        Rows of `Packed.around` and `Packed.along`.
    fractions
        Positions of the points along an element, 0 to 1, ``(along,)``.
    areas
        Reference areas, ``(elements, along, n across)``.
    """

    def __init__(self, space: "Space", own: Trace, chosen: Sequence[int], points: tuple[int, int]) -> None:
        self.across, self.along = points
        t, v = np.polynomial.legendre.leggauss(self.along)
        self.fractions = 0.5 * (1.0 + t)
        self.around, theta, w = section_functions(own, self.across)
        circle = own.circle(theta)
        axial: list[Array] = []
        areas = []
        for e in chosen:
            middle, half = _span(space.axis, e)
            u = middle + half * t
            values = np.zeros((self.along, FUNCTIONS))
            values[:, : space.axis.degree + 1] = space.axis.local(u)[1]
            axial.extend(values)
            _, jacobian = space.rod.grid(circle, u)
            around = jacobian[..., 1] * circle[:, :1] - jacobian[..., 0] * circle[:, 1:]
            area = np.linalg.norm(np.cross(around, jacobian[..., 2]), axis=-1)
            areas.append(area * w * (half * v)[:, None])
        self.axial = axial
        self.areas = np.array(areas)


def _rungs(space: "Space", e: int, sizes: tuple[float, float, float]) -> tuple[Array, float]:
    """Return the axis functions at sections evenly along an element, and the largest distance from the nearest of them.

    Rods are stretched and bent: the distance is twice that of the undeformed rod.

    Parameters
    ----------
    space, e
        The rod's space, and the element.
    sizes
        Arc length at both ends of the element, and its radius.
    """
    begin, end, radius = sizes
    count = int(np.clip(np.ceil((end - begin) / (_RUNG * radius)), 1, _MOST))
    middle, half = _span(space.axis, e)
    u = np.clip(middle + half * np.linspace(-1.0, 1.0, 2 * count + 1), *space.axis.breaks[e : e + 2])
    values = np.zeros((count, FUNCTIONS))
    values[:, : space.axis.degree + 1] = space.axis.local(u[1::2])[1]
    centers = space.rod.grid(np.zeros((1, 2)), u)[0][:, 0]
    return values, 2.0 * float(np.linalg.norm(np.diff(centers, axis=0), axis=1).max())


def _at_rest(contact: Contact) -> tuple[Array, Array, float]:
    """Return point, unit direction and radius of a rigid obstacle; zeros where the partner is a body or a mesh."""
    other = contact.obstacle
    if other is None or isinstance(other, TriangleMesh):
        return np.zeros(3), np.zeros(3), 0.0
    if isinstance(other, Sphere):
        return np.array(other.center, dtype=float), np.zeros(3), other.radius
    point, direction = np.array(other.point, dtype=float), other.normal if isinstance(other, Plane) else other.axis
    unit = np.array(direction, dtype=float) / np.linalg.norm(direction)
    return point, unit, other.radius if isinstance(other, Cylinder) else 0.0


def _span(axis: Axis, e: int) -> tuple[float, float]:
    """Return middle and half length of an element in ``u``."""
    low, high = axis.breaks[e : e + 2]
    return 0.5 * (low + high), 0.5 * (high - low)


def _polynomials(axis: Axis, e: int) -> Array:
    """Return the weighted functions of an element in powers of ``s`` in [-1, 1], shape ``(l, l)``."""
    p = axis.degree
    # Chebyshev points: interpolation is exact and well conditioned.
    s = np.cos(np.pi * (np.arange(p + 1) + 0.5) / (p + 1))
    middle, half = _span(axis, e)
    flat = Axis(p, axis.knots, np.ones(axis.count))
    first, values, _ = flat.local(middle + half * s)
    weighted = values * axis.weights[first[0] : first[0] + p + 1]
    result = np.zeros((FUNCTIONS, FUNCTIONS))
    result[: p + 1, : p + 1] = np.linalg.solve(np.vander(s, increasing=True), weighted).T
    return result


def pack(model: "Model", points: Sequence[tuple[int, int]] | None = None, in_motion: bool = False) -> Packed:
    """Return all contacts of a model as tables for the compiled loops.

    ``points`` are those of each pass, `points_of` by default.  Nodes of facets
    (`isorod.contact.facets.nodes_of`) come after those of the rods.
    """
    first_node, known = int(model.first_node[-1]), facets.nodes_of(model)[0]
    tables, rules = _Tables(first_node + known.size), iter(points_of(model) if points is None else points)
    for contact in model.contacts:
        first, groups = len(tables.surfaces), contact.groups
        sizes = [len(bodies) for bodies in groups]
        masters = [(first, sizes[0])]
        if contact.obstacle is not None:
            masters = [tables.obstacle(contact)]
        elif len(groups) == 2:
            masters = [(first + sizes[0], sizes[1]), (first, sizes[0])]
        force = penalty(model, contact, in_motion)
        fraction = 0.5 if contact.obstacle is None else 1.0
        for number, (body, elements) in enumerate(contact.sides):
            space = model.bodies[body].space
            chosen = range(space.axis.elements) if elements is None else sorted({int(e) for e in elements})
            own = trace(space, contact.is_inner(body))
            tables.surface(body, space, int(model.first_node[body]), own, chosen, contact.obstacle is None)
            if contact.facets is None:
                rule = _Rule(space, own, chosen, next(rules))
                tables.slave(rule, masters[int(number >= sizes[0])], contact, force, fraction)
        if contact.facets is not None:
            tables.facets(
                facets.facets(model, contact, max(next(rules)), known), first_node, masters[0], contact, force
            )
    areas = np.concatenate([np.empty(0), *tables.areas])
    rows = np.array(tables.elements, ELEMENT)
    margin = 0.5 * float(rows["radius"].min(initial=np.inf))
    return Packed(
        surfaces=np.array(tables.surfaces, SURFACE),
        elements=rows,
        passes=np.array(tables.passes, PASS),
        around=np.array(tables.around).reshape(-1, 3),
        along=np.array(tables.along_rows).reshape(-1, FUNCTIONS),
        rungs=np.array(tables.rungs).reshape(-1, FUNCTIONS),
        fractions=np.concatenate([np.empty(0), *tables.fractions]),
        areas=areas,
        corners=np.concatenate([np.empty((0, 3, 3)), *tables.corners]),
        normals=np.concatenate([np.empty((0, 7, 3)), *tables.normals]),
        nodes=np.concatenate([np.empty(0, NODE), *tables.nodes]),
        lifts=np.array([*tables.lifts.values()], LIFT),
        matrices=np.concatenate([np.empty(0), *tables.matrices]),
        tracks=np.concatenate([np.empty((0, 5)), *tables.tracks]),
        control_points=np.unique(np.concatenate([np.empty(0, dtype=np.int64), *tables.control_points])),
        multipliers=np.zeros(areas.size),
        states=np.zeros(areas.size, STATE),
        points=np.zeros((areas.size, 3)),
        starts=np.full(areas.size, NOWHERE),
        before=np.zeros((tables.size, 3)),
        travel=np.zeros(1),
        clear=np.full(areas.size, -np.inf),
        boxes=np.zeros((rows.size, 2, 3)),
        rings=np.zeros((len(tables.rungs), 4)),
        near=np.zeros((rows.size, NEAR), dtype=np.int64),
        counts=np.zeros(rows.size, dtype=np.int64),
        listed=np.array([margin, -np.inf]),
        own=np.ones(areas.size, dtype=bool),
    )
