"""Loads, proportional to the load factor: dead loads, moments, and pressure, which may be a follower load."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, finite
from isorod.geometry.quadrature import axis_points, circle_points
from isorod.model.body import Body
from isorod.model.history import InTime, TimeTable
from isorod.space.space import Space
from isorod.space.trace import Trace, section_trace

# Gauss points along an element for a line load, over the number of its functions: ds/du of a curved line is no
# polynomial.
_ALONG = 2


class Load(Protocol):
    """Interface of loads."""

    @property
    def body(self) -> int:
        """Index of the body in the model."""

    @property
    def history(self) -> "TimeTable | Numbers | None":
        """The factor by time (`isorod.model.history.InTime`)."""

    def factor(self, begin: float, end: float) -> float:
        """Return the mean of that over a time interval, or its value at one time."""

    def nodal(self, space: Space) -> Array:
        """Return the consistent nodal forces at load factor 1, shape ``(nodes, 3)``."""


@dataclass(frozen=True)
class SectionLoad(InTime):
    """Force and moment spread over a cross-section: ``t = force / A + w x r``, of reference areas.

    ``r`` is the position from the section's centroid and ``J w = moment``, ``J = int (r.r 1 - r r^T) dA``: a
    distributing coupling, which leaves the section free to deform, with the stresses of bending and of torsion of a
    round bar.  The force is a dead load with the potential ``-force . (mean displacement)``.  The moment, too, is a
    vector fixed in space: ``r`` is the present position, so that its power is ``moment . w`` with the mean angular
    velocity ``J^-1 int r x v dA``.  A moment has a potential only while the section rotates about one axis.  On bodies
    with laws of small strains only, ``r`` is the position at rest.

    Parameters
    ----------
    force
        Total force at load factor 1, shape ``(3,)``.
    u
        Axis parameter of the section: 0 is the start face, 1 (the default) the end face of a rod whose axis runs from 0
        to 1.
    body
        Index of the body in the model.
    space
        The space of the parameter ``u``, to check that the body has the same.
    moment
        Total moment at load factor 1 about the centroid of the section, force times length, shape ``(3,)``.
    history
        The factor by time, rows of time and factor (`isorod.model.history.InTime`).

    Raises
    ------
    InputError
        If there is neither force nor moment, or a number is not finite.
    """

    force: tuple[float, float, float] | None = None
    u: float | None = None
    body: int = 0
    space: Space | None = field(default=None, repr=False, compare=False)
    moment: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.force is None and self.moment is None:
            raise InputError("section load: got neither force nor moment, need one of them, or both")
        for name in ("force", "moment"):
            given = getattr(self, name)
            finite(f"section load: {name}", () if given is None else given, "finite components")

    @classmethod
    def end(
        cls,
        space: Space,
        which: str,
        force: tuple[float, float, float] | None = None,
        body: int = 0,
        moment: tuple[float, float, float] | None = None,
        history: Numbers | None = None,
    ) -> "SectionLoad":
        """Return a load on the whole ``"start"`` or ``"end"`` face.

        Parameters
        ----------
        space
            The body's space.
        which
            ``"start"`` or ``"end"``.
        force
            Total force at load factor 1, shape ``(3,)``, spread evenly.
        body
            Index of the body in the model.
        moment
            Total moment at load factor 1 about the centroid of the face, force times length, shape ``(3,)``: fixed in
            space however the face rotates, distributed like stresses of bending and torsion (`SectionLoad`).
        history
            The factor by time, rows of time and factor (`isorod.model.history.InTime`).

        Raises
        ------
        InputError
            If there is neither, or the rod has no such end.
        """
        return cls(force, float(space.axis.breaks[space.end(which)]), body, space, moment, history=history)

    @property
    def turns(self) -> bool:
        """Whether it has a moment."""
        return self.moment is not None and any(self.moment)

    def trace(self, space: Space) -> Trace:
        """Return the functions on the section."""
        try:
            return section_trace(space, float(space.axis.breaks[-1] if self.u is None else self.u))
        except InputError as problem:
            raise InputError(f"section load: {problem}") from None

    def steady(self, space: Space) -> Array:
        """Return the nodal forces of the force alone, shape ``(nodes, 3)``."""
        trace = self.trace(space)
        result = np.zeros((space.nodes, 3))
        if self.force is not None:
            weights = trace.weights @ trace.values / trace.weights.sum()
            result[trace.nodes[0]] = weights[:, None] * np.array(self.force)
        return result

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces where the section is at rest, shape ``(nodes, 3)``."""
        result = self.steady(space)
        if self.moment is not None:
            trace = self.trace(space)
            arms = trace.points - trace.weights @ trace.points / trace.weights.sum()
            spread = (trace.weights[:, None] * arms).T @ arms
            turn = np.linalg.solve(spread.trace() * np.eye(3) - spread, self.moment)
            result[trace.nodes[0]] += trace.values.T @ (trace.weights[:, None] * np.cross(turn, arms))
        return result


@dataclass(frozen=True)
class Pressure(InTime):
    """A uniform pressure on the lateral surface, along its normal: ``f_jl = -p int S_l R_j n dA``.

    Parameters
    ----------
    pressure
        Force per area at load factor 1; positive where it pushes the surface into the body.
    surface
        ``"outer"``, or ``"inner"``: that of the hole of a rod that has one (`isorod.geometry.rod.Rod.rings`).
    body
        Index of the body in the model.
    follows
        Whether it is a follower load, with normal and area of the moving surface, like a fluid's pressure; if not, it
        is a dead load, with those at rest.  For small displacements both are the same.
    history
        The factor by time, rows of time and factor (`isorod.model.history.InTime`).

    Raises
    ------
    InputError
        If the pressure is not finite or there is no such surface; and, from ``points``, if the body's rod has no hole.
    """

    pressure: float
    surface: str = "outer"
    body: int = 0
    follows: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("pressure", self.pressure, "a finite force per area")
        if self.surface not in ("outer", "inner"):
            raise InputError(f"pressure: got surface {self.surface!r}, need 'outer' or 'inner'")

    def points(self, space: Space) -> tuple[Array, Array, Array]:
        """Return the surface's disk points ``(q, 2)`` and axis parameters ``(E, t)``, and weights ``(E, t, q)``.

        The weights, by angle and axis parameter, include the pressure, with the sign of its force along
        ``dx/dtheta x dx/du``, which points away from the centre line.
        """
        radius = space.rod.rings[0 if self.surface == "inner" else -1]
        if radius == 0.0:
            raise InputError("pressure on the inner surface: the rod has no hole; see Rod.with_rings")
        rule = space.basis.full(space.axis.degree)
        xi, angle = circle_points(space.points_around, rule.angular, radius, space.turn)
        u, length = axis_points(space.axis, rule.axial)
        force = -self.pressure if self.surface == "outer" else self.pressure
        return xi, u, force * length[:, :, None] * angle

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces on the surface where it is at rest, shape ``(nodes, 3)``."""
        xi, u, weights = self.points(space)
        _, jacobian = space.rod.grid(xi, u.ravel())
        # d xi / d theta is xi turned by a right angle.
        around = jacobian[..., 1] * xi[:, :1] - jacobian[..., 0] * xi[:, 1:]
        force = weights[..., None] * np.cross(around, jacobian[..., 2]).reshape(*weights.shape, 3)
        axial = space.axis.local(u.ravel())[1].reshape(*u.shape, -1)
        forces = np.einsum("etj,qn,etqa->ejna", axial, space.basis.functions(xi)[0], force, optimize=True)
        nodes = space.element_nodes.ravel()
        return np.stack([np.bincount(nodes, forces[..., a].ravel(), space.nodes) for a in range(3)], axis=1)


@dataclass(frozen=True)
class BodyForce(InTime):
    """A uniform force per reference volume, such as weight ``density * gravity``: ``f_jl = density int S_l R_j dV``.

    Parameters
    ----------
    density
        Force per reference volume at load factor 1, shape ``(3,)``.
    body
        Index of the body in the model.
    history
        The factor by time, rows of time and factor (`isorod.model.history.InTime`).
    """

    density: tuple[float, float, float]
    body: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("body force: density", self.density, "finite components")

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces, shape ``(nodes, 3)``."""
        table = space.tabulate(0, space.axis.elements)
        volumes = np.einsum("etj,etq,qn->ejn", table.axial, table.weights, table.section[:, 2])
        total = np.bincount(space.element_nodes.ravel(), volumes.ravel(), space.nodes)
        return total[:, None] * np.array(self.density)


@dataclass(frozen=True)
class LineLoad(InTime):
    """A force per length of the centre line at rest, uniform over each section: ``f_jl = q int R_j dA / A ds``.

    Parameters
    ----------
    per_length
        Force per length at load factor 1, shape ``(3,)``.
    body
        Index of the body in the model.
    history
        The factor by time, rows of time and factor (`isorod.model.history.InTime`).
    """

    per_length: tuple[float, float, float]
    body: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("line load: per_length", self.per_length, "finite components")

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces, shape ``(nodes, 3)``."""
        rod, axis = space.rod, space.axis
        u, weights = axis_points(axis, _ALONG * (axis.degree + 1))
        xi, area = space.section_rule(space.rule)
        _, jacobian = rod.grid(xi, u.ravel())
        areas = area * np.linalg.norm(np.cross(jacobian[..., 0], jacobian[..., 1]), axis=-1)
        means = areas @ space.basis.functions(xi)[0] / areas.sum(axis=1)[:, None]
        speed = np.linalg.norm(rod.grid(np.zeros((1, 2)), u.ravel())[1][:, 0, :, 2], axis=-1).reshape(u.shape)
        axial = axis.local(u.ravel())[1].reshape(*u.shape, -1)
        lengths = np.einsum("et,etj,etn->ejn", weights * speed, axial, means.reshape(*u.shape, -1), optimize=True)
        total = np.bincount(space.element_nodes.ravel(), lengths.ravel(), space.nodes)
        return total[:, None] * np.array(self.per_length)


@dataclass(frozen=True)
class PointLoad(InTime):
    """A force at a point of the lateral surface: ``f_jl = R_j S_l force`` with the functions there.

    The space spreads it over about the arc between control points and an element; under a point force displacement and
    stress diverge as the space is refined.

    Parameters
    ----------
    u
        Axis parameter.
    force
        At load factor 1, shape ``(3,)``.
    angle
        Round the section, degrees of the disk.
    surface
        ``"outer"``, or ``"inner"``: that of the hole of a rod that has one.
    body
        Index of the body in the model.
    history
        The factor by time, rows of time and factor (`isorod.model.history.InTime`).
    """

    u: float
    force: tuple[float, float, float]
    angle: float = 0.0
    surface: str = "outer"
    body: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("point load: force", (self.angle, *self.force), "finite components")
        if self.surface not in ("outer", "inner"):
            raise InputError(f"point load: got surface {self.surface!r}, need 'outer' or 'inner'")

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces, shape ``(nodes, 3)``."""
        radius = space.rod.rings[0 if self.surface == "inner" else -1]
        low, high = space.axis.breaks[[0, -1]]
        if radius == 0.0:
            raise InputError("point load: surface: the rod has no hole")
        if not low <= self.u <= high:
            raise InputError(f"point load: got u = {self.u:g}, need an axis parameter from {low:g} to {high:g}")
        theta = np.radians(self.angle)
        across = space.basis.functions(radius * np.array([[np.cos(theta), np.sin(theta)]]))[0][0]
        first, axial, _ = space.axis.local([self.u])
        layers = (first[0] + np.arange(axial.shape[1])) % space.layers
        result = np.zeros((space.layers, space.layer_nodes, 3))
        result[layers] = np.einsum("j,n,a->jna", axial[0], across, np.array(self.force))
        return result.reshape(-1, 3)

    def spread(self, space: Space) -> tuple[float, float]:
        """Return approximate lengths round the section and along the line over which a space spreads it."""
        rod, breaks = space.rod, space.axis.breaks
        length = rod.arc_length(breaks)
        element = int(np.clip(np.searchsorted(breaks, self.u, "right") - 1, 0, len(breaks) - 2))
        return 2.0 * np.pi * rod.radius / space.points_around, float(length[element + 1] - length[element])


@dataclass(frozen=True)
class Weight(InTime):
    """The weight of a body: its densities, by place if it has several, times an acceleration.

    Parameters
    ----------
    acceleration
        At load factor 1, shape ``(3,)``.
    of
        The body.
    body
        Its index in the model.
    history
        The factor by time, rows of time and factor (`isorod.model.history.InTime`).
    """

    acceleration: tuple[float, float, float]
    of: Body = field(repr=False, compare=False)
    body: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("gravity: acceleration", self.acceleration, "finite components")
        if not self.of.densities.min() > 0.0:
            raise InputError(f"gravity: body {self.body} has no density")

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces, shape ``(nodes, 3)``."""
        return self.of.masses(space)[:, None] * np.array(self.acceleration)


@dataclass(frozen=True)
class Spin(InTime):
    """A steady rotation of the frame in which displacements are measured: centrifugal force, by the load factor.

    Parameters
    ----------
    velocity
        Angular velocity vector, radians per time, at load factor 1 (at factor ``f``, ``sqrt(f)`` times as fast).
    center
        A point on the axis of rotation.
    history
        In statics the factor by time, of the centrifugal force (`isorod.model.history.InTime`).
    """

    velocity: tuple[float, float, float]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("spin: velocity", self.velocity)
        finite("spin: center", self.center)

    @property
    def field(self) -> Array:
        """Matrix ``|w|^2 1 - w w^T`` that takes the position from the center to the centrifugal acceleration."""
        w = np.array(self.velocity)
        return w @ w * np.eye(3) - np.outer(w, w)
