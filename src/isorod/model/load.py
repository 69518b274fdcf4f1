"""Loads, proportional to the load factor: dead loads, and pressure that may follow the surface."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from isorod.arrays import Array
from isorod.errors import Checked, InputError, finite
from isorod.geometry.quadrature import axis_points, circle_points
from isorod.space.space import Space


class Load(Protocol):
    """What a model asks of a load."""

    @property
    def body(self) -> int:
        """Index of the body in the model."""

    def nodal(self, space: Space) -> Array:
        """Return the consistent nodal forces at load factor 1, shape ``(nodes, 3)``."""


@dataclass(frozen=True)
class SectionLoad(Checked):
    """A force spread uniformly over a cross-section: ``t = force / A`` on the section's reference area ``A``.

    Its nodal forces are ``f_jl = R_j(u) (force / A) int S_l dA``; the potential is
    ``-force . (mean displacement of the section)``.

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
        The space in whose parameter ``u`` is, if it is to be checked that the body has the same.
    """

    force: tuple[float, float, float]
    u: float | None = None
    body: int = 0
    space: Space | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        finite("section load: force", self.force, "finite components")

    @classmethod
    def end(cls, space: Space, which: str, force: tuple[float, float, float], body: int = 0) -> "SectionLoad":
        """Return a load on the whole ``"start"`` or ``"end"`` face."""
        return cls(force, float(space.axis.breaks[space.end(which)]), body, space)

    def nodal(self, space: Space) -> Array:
        """Return the nodal forces, shape ``(nodes, 3)``."""
        low, high = space.axis.breaks[[0, -1]]
        u = high if self.u is None else self.u
        if not low <= u <= high:
            raise InputError(f"section load: got u = {u}, need an axis parameter from {low:g} to {high:g}")
        xi, area = space.section_rule(space.rule)
        _, jacobian = space.rod.grid(xi, [u])
        area = area * np.linalg.norm(np.cross(jacobian[0, :, :, 0], jacobian[0, :, :, 1]), axis=1)
        share = area @ space.basis.functions(xi)[0] / area.sum()
        first, values, _ = space.axis.local([u])
        layers = (first[0] + np.arange(values.shape[1])) % space.layers
        result = np.zeros((space.layers, space.layer_nodes, 3))
        result[layers] = values[0][:, None, None] * share[:, None] * np.array(self.force)
        return result.reshape(-1, 3)


@dataclass(frozen=True)
class Pressure(Checked):
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
        Whether normal and area are those of the moving surface, as of a fluid's pressure; if not, the force on each
        piece of the surface stays as it is, which where displacements are small is the same.

    Raises
    ------
    InputError
        If the pressure is not finite or the surface none; and, from ``points``, if the body's rod has no hole.
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

        The weights, by angle and axis parameter, are times the pressure, with the sign of its force along
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
        shares = np.einsum("etj,qn,etqa->ejna", axial, space.basis.functions(xi)[0], force, optimize=True)
        nodes = space.element_nodes.ravel()
        return np.stack([np.bincount(nodes, shares[..., a].ravel(), space.nodes) for a in range(3)], axis=1)


@dataclass(frozen=True)
class BodyForce(Checked):
    """A uniform force per reference volume, such as weight ``density * gravity``: ``f_jl = density int S_l R_j dV``.

    Parameters
    ----------
    density
        Force per reference volume at load factor 1, shape ``(3,)``.
    body
        Index of the body in the model.
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
class Spin(Checked):
    """A steady rotation of the frame in which displacements are measured: centrifugal force, by the load factor.

    Parameters
    ----------
    velocity
        Angular velocity vector, radians per time, at load factor 1 (at factor ``f``, ``sqrt(f)`` times as fast).
    center
        A point on the axis of rotation.
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
