"""Supports of mean motions of a section, or of the line round it, which stay free to deform; and springs to ground.

The mean displacement of a section is ``int u dA / A`` and its mean rotation ``J^-1 int r x u dA``, where ``r`` is the
position from the section's centroid at rest and ``J = int (r.r 1 - r r^T) dA``.  Support forces are distributed over
the section like stresses of bending and of torsion of a round bar: a distributing coupling.  Where rings have different
laws, areas are weighted with Young's moduli, as stresses of bending and tension are.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array, Index, Numbers
from isorod.errors import InputError, finite
from isorod.geometry.quadrature import ring_of
from isorod.material.law import Material
from isorod.model.history import Clock, InTime, clock_of
from isorod.model.motion import SupportMotion
from isorod.space.space import Space
from isorod.space.trace import Trace, ring_trace, section_trace

if TYPE_CHECKING:
    from isorod.model.body import Body

# Relative tolerance by which a hinge's axis is a principal axis of the section.
_PRINCIPAL = 1e-6

MEANS = ("pin", "fork", "hinge", "fixed")


@dataclass(frozen=True, eq=False)
class MeanSupport(InTime):
    """A support of mean motions of a section.

    Attributes
    ----------
    u
        Axis parameter of the section.
    directions, axes
        Unit vectors ``(k, 3)`` along which its mean displacement is held, and ``(m, 3)`` about which its mean rotation.
    displacement
        Mean displacement at load factor 1 along the ``directions``, shape ``(3,)``, units of length.
    stiffness
        Stiffness of springs instead of the constraints, for each of ``directions`` and ``axes``: force per length, and
        moment per radian.
    body
        Index of the body in the model.
    ring
        Whether the means are those of the line round the section.
    free
        Whether it only removes the rigid motions of a body with balanced loads: its reactions must vanish.
    space
        The space of the parameter ``u``, to check that the body has the same.
    moduli
        Young's moduli of the section's rings, where they differ (`on`).
    """

    u: float
    directions: Array
    axes: Array
    displacement: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stiffness: Array | None = None
    body: int = 0
    ring: bool = False
    free: bool = False
    space: Space | None = field(default=None, repr=False)
    moduli: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        table = self.clock.table
        if table is None:
            return
        if not np.any(self.displacement):
            raise InputError("history: the support does not move; give it a displacement")
        if table.jumps or table.at(0.0) != 0.0:
            raise InputError("history: a mean motion starts at factor 0 and does not jump; let it begin with [0, 0]")

    @property
    def clock(self) -> Clock:
        """The factor of its motion by time."""
        return clock_of(self.history)

    @classmethod
    def section(
        cls,
        space: Space,
        u: float,
        mean: str = "pin",
        components: str = "xyz",
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        axis: tuple[float, float, float] | None = None,
        body: int = 0,
        history: Numbers | None = None,
    ) -> "MeanSupport":
        """Return a support of the mean motion of a cross-section, which stays free to deform.

        Parameters
        ----------
        u
            Axis parameter of the section.
        mean, axis
            What is held besides the mean displacement: with ``"pin"`` nothing, with ``"fork"`` the mean rotation about
            the normal of the section, with ``"hinge"`` that about all but its ``axis``, with ``"fixed"`` all of it.
        components
            Letters of ``"xyz"``: which of the mean displacement are held.
        displacement
            Of the mean at load factor 1, shape ``(3,)``, units of length.
        body
            Index of the body in the model.
        history
            In motions the factor by time of the displacement, rows of time and factor
            (`isorod.model.history.InTime`).

        Raises
        ------
        InputError
            If there is no such section, or an axis is none.
        """
        if mean not in MEANS:
            raise InputError(f"mean: got {mean!r}, need one of {', '.join(MEANS)}")
        if set(components) - set("xyz"):
            raise InputError(f"components: got {components!r}, need some of 'xyz'")
        if (mean == "hinge") != (axis is not None):
            raise InputError("axis: a hinge has one, and nothing else does")
        directions = np.eye(3)[[letter in components for letter in "xyz"]]
        axes = np.eye(3) if mean == "fixed" else np.zeros((0, 3))
        if mean == "fork":
            trace = section_trace(space, u)
            normal = trace.weights @ trace.normals
            axes = (normal / np.linalg.norm(normal))[None]
        if axis is not None:
            axes = _across(np.array(axis, dtype=float))
            arms = _arms(section_trace(space, u))[1]
            if np.abs(axes @ arms @ np.cross(*axes)).max() > _PRINCIPAL * np.abs(arms).max():
                raise InputError(
                    f"axis: {list(axis)} is none of the section's principal axes, about which alone it turns freely"
                )
        section_trace(space, u)
        if not len(directions) and not len(axes):
            raise InputError("components: got none, and no rotation is held; name some of 'xyz'")
        return cls(u, directions, axes, displacement, None, body, space=space, history=history)

    @classmethod
    def end(
        cls,
        space: Space,
        which: str,
        mean: str = "pin",
        components: str = "xyz",
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        axis: tuple[float, float, float] | None = None,
        body: int = 0,
        history: Numbers | None = None,
    ) -> "MeanSupport":
        """Return a support of the mean motion of the ``"start"`` or ``"end"`` face (`section`)."""
        u = float(space.axis.breaks[space.end(which)])
        return cls.section(space, u, mean, components, displacement, axis, body, history)

    @classmethod
    def bearing(cls, space: Space, u: float, body: int = 0) -> "MeanSupport":
        """Return a bearing: it holds the mean displacement of the ring round a section across the centre line.

        The ring slides along the line's tangent at rest, and rotates freely.

        Parameters
        ----------
        u
            Axis parameter of the ring.
        body
            Index of the body in the model.

        Raises
        ------
        InputError
            If there is no such section.
        """
        section_trace(space, u)
        along = space.rod.grid(np.zeros((1, 2)), [u])[1][0, 0, :, 2]
        return cls(u, _across(along), np.zeros((0, 3)), body=body, ring=True, space=space)

    @classmethod
    def spring(
        cls,
        space: Space,
        at: str | float,
        stiffness: tuple[float, float, float] = (0.0, 0.0, 0.0),
        rotational: tuple[float, float, float] = (0.0, 0.0, 0.0),
        body: int = 0,
    ) -> "MeanSupport":
        """Return springs from a section's mean displacement and rotation to the ground, without force at rest.

        Rotations count as small: a section that turns by ``a`` has the moment ``rotational sin(a) cos(a)``, half a
        percent less than ``rotational a`` at 5 degrees, of which statics warns.

        Parameters
        ----------
        at
            ``"start"``, ``"end"``, or the axis parameter of the section.
        stiffness
            Along x, y and z, force per length, not negative.
        rotational
            About x, y and z, moment per radian, not negative.
        body
            Index of the body in the model.

        Raises
        ------
        InputError
            If there is no such section, a stiffness is negative or all are zero.
        """
        u = float(space.axis.breaks[space.end(at)]) if isinstance(at, str) else at
        section_trace(space, u)
        whole = np.append(stiffness, rotational)
        if not (np.isfinite(whole).all() and (whole >= 0.0).all() and whole.any()):
            raise InputError(
                f"stiffness: got {(*stiffness, *rotational)}, need numbers, none negative and not all zero"
            )
        directions, axes = (np.eye(3)[np.array(one) > 0.0] for one in (stiffness, rotational))
        return cls(u, directions, axes, stiffness=whole[whole > 0.0], body=body, space=space)

    @classmethod
    def rigid(cls, space: Space, body: int = 0) -> "MeanSupport":
        """Return a support that removes a rod's rigid motions only (3-2-1), for loads in balance.

        It holds the mean motion of one section; equilibria with reactions there are refused.
        """
        return cls(float(space.axis.breaks[0]), np.eye(3), np.eye(3), body=body, free=True, space=space)

    @property
    def turn(self) -> Array:
        """Rotation vector at load factor 1: it does not turn."""
        return np.zeros(3)

    def motion(self, space: Space, first_node: int) -> SupportMotion:
        """Return its motion of single degrees of freedom: none."""
        nothing = np.empty(0, dtype=np.int64)
        return SupportMotion(nothing, np.zeros((2, 0)), np.zeros((0, 3)), self.turn, nothing.astype(bool))

    @property
    def values(self) -> Array:
        """Prescribed mean motions at load factor 1, shape ``(k + m,)``."""
        return np.append(self.directions @ np.array(self.displacement), np.zeros(len(self.axes)))

    def on(self, body: "Body") -> "MeanSupport":
        """Return the support on a body, with Young's moduli of its rings if they differ."""
        axis, rings = body.space.axis, len(body.space.rod.rings) - 1
        first = rings * int(np.searchsorted(axis.breaks[1:-1], self.u, side="right"))
        moduli = tuple(map(_stiffness, body.laws[first : first + rings]))
        alike = self.ring or max(moduli) <= min(moduli) * (1.0 + 1e-9)
        return replace(self, moduli=() if alike else moduli)

    def trace(self, space: Space) -> Trace:
        """Return the functions of a space on the section, or on the line round it, weighted with rings' moduli."""
        if self.ring:
            return ring_trace(space, self.u)
        trace = section_trace(space, self.u)
        if not self.moduli:
            return trace
        xi, _ = space.section_rule(space.rule)
        return trace._replace(weights=trace.weights * np.array(self.moduli)[ring_of(space.rod.rings, xi)])

    def middle(self, space: Space) -> tuple[Index, Array]:
        """Return nodes, and their weights in the position of the section's centroid ``(n,)``."""
        trace = self.trace(space)
        return trace.nodes[0], trace.weights @ trace.values / trace.weights.sum()

    def rows(self, space: Space) -> tuple[Index, Array]:
        """Return nodes ``(n,)`` and the mean motions' coefficients in their displacements, shape ``(k + m, n, 3)``.

        The dual quantities are forces along the ``directions``, and moments about the ``axes``.
        """
        return self.rows_on(self.trace(space))

    def rows_on(self, trace: Trace) -> tuple[Index, Array]:
        """Return `rows` of other functions on the points of the trace, the same nodes at each."""
        shifts = np.broadcast_to(
            self.directions[:, None] / trace.weights.sum(), (len(self.directions), len(trace.points), 3)
        )
        arms, inverse = _arms(trace)
        turns = np.cross((self.axes @ inverse)[:, None], arms)
        moved = trace.weights[:, None] * np.concatenate([shifts, turns])
        return trace.nodes[0], np.einsum("qn,kqa->kna", trace.values, moved)

    def turned(self, space: Space, nodal: Array) -> Array:
        """Return the section's rotation about each of the ``axes``, radians ``(m,)``, up to half a turn.

        ``nodal`` ``(nodes, 3)`` are the displacements of the space's nodes.
        """
        return turns_about(*self.moved(space, nodal), self.axes)

    def moved(self, space: Space, nodal: Array) -> tuple[Array, Array, Array]:
        """Return positions from the section's centroid, at rest and now, ``(q, 3)``, and their weights ``(q,)``."""
        trace = self.trace(space)
        arms, weights = _arms(trace)[0], trace.weights
        now = arms + trace.values @ nodal[trace.nodes[0]]
        return arms, now - weights @ now / weights.sum(), weights

    def radius(self, space: Space) -> float:
        """Return the radius of gyration of the section, units of length."""
        trace = section_trace(space, self.u)
        return float(np.sqrt(trace.weights @ np.sum(_arms(trace)[0] ** 2, axis=1) / trace.weights.sum()))


def _stiffness(law: Material) -> float:
    """Return Young's modulus of an isotropic law at rest, of others that of their linearised isotropic moduli."""
    shear, lame = law.shear_modulus, law.lame
    return 3.0 * shear if lame == np.inf else shear * (3.0 * lame + 2.0 * shear) / (lame + shear)


def turns_about(arms: Array, now: Array, weights: Array, axes: Array) -> Array:
    """Return the mean rotation, radians ``(m,)``, up to half a turn, of points ``(q, 3)`` about axes ``(m, 3)``."""
    sines = axes @ (weights @ np.cross(arms, now))
    both = weights @ np.einsum("qa,qa->q", arms, now)
    cosines = both - np.einsum("ma,mb,ab->m", axes, axes, (weights[:, None] * arms).T @ now)
    return np.asarray(np.arctan2(sines, cosines))


def _arms(trace: Trace) -> tuple[Array, Array]:
    """Return positions from a section's centroid ``(q, 3)``, and ``J^-1``."""
    arms = trace.points - trace.weights @ trace.points / trace.weights.sum()
    spread = (trace.weights[:, None] * arms).T @ arms
    return arms, np.linalg.inv(spread.trace() * np.eye(3) - spread)


def _across(axis: Array) -> Array:
    """Return two unit vectors ``(2, 3)`` across an axis."""
    finite("axis", axis, "finite components")
    size = np.linalg.norm(axis)
    if not size > 0.0:
        raise InputError("axis: got no direction, need a vector that is not zero")
    first = np.eye(3)[np.argmin(np.abs(axis))]
    first = first - (first @ axis) * axis / size**2
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis / size, first)])
