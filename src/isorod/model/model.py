"""What every analysis takes: bodies (a space with a material) and supports."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array, Index
from isorod.errors import InputError, representable
from isorod.material.along_rod import Laws
from isorod.material.law import LinearElastic, Material, NeoHookean
from isorod.model.load import Load
from isorod.model.numbering import Motion, number
from isorod.space.space import Space, Table

if TYPE_CHECKING:
    from isorod.contact.tables import Contact
    from isorod.space.pressure import Pressures


# How a body's equilibrium is stated.
FORMULATIONS = ("displacement", "mixed")

# Ratio of moduli from which a smooth joint is warned of: bars in series err by 4 % at 10, by 13 % at 100 (p = 3, four elements each).
_JUMP = 10.0


@dataclass(frozen=True, eq=False)
class Body:
    """A rod with its displacement space and material.

    Parameters
    ----------
    space
        The displacement space.
    material
        One law for the whole rod, or one for each element of the space, shape ``(elements,)``.
    density
        Mass per reference volume, one for the whole rod or one for each element of the space.
    formulation
        ``"displacement"``, or ``"mixed"``: displacement and pressure (`isorod.assembly.mixed`), which does not lock near incompressibility and
        takes a Poisson's ratio of 0.5; statics alone knows it.

    Raises
    ------
    InputError
        If the number of laws or densities is not that of the elements, a density is negative or not finite, or the formulation is not
        known or not one for the material.
    """

    space: Space
    material: Material | Sequence[Material]
    density: float | Sequence[float] = 0.0
    formulation: str = "displacement"

    def __post_init__(self) -> None:
        given = np.asarray(self.density, dtype=float)
        if given.shape not in ((), (self.space.axis.elements,)):
            raise InputError(
                f"density: got shape {given.shape}, need one or one for each of the {self.space.axis.elements} elements"
            )
        bad = ~(np.isfinite(given) & (given >= 0.0))
        if bad.any():
            raise InputError(f"density: got {given[bad].flat[0]:g}, need a finite mass per volume, not negative")
        if given.any():
            representable("density", float(given[given > 0.0].min()))
            representable("density", float(given.max()))
        if isinstance(self.material, Sequence) and len(self.material) != self.space.axis.elements:
            raise InputError(
                f"material: got {len(self.material)} laws for {self.space.axis.elements} elements, need one law or one an element"
            )

        if self.formulation not in FORMULATIONS:
            raise InputError(f"formulation: got {self.formulation!r}, need one of {', '.join(FORMULATIONS)}")
        for e, law in enumerate(self.laws):
            if self.formulation == "displacement" and not np.isfinite(getattr(law, "lame", 0.0)):
                raise InputError(f"material of element {e}: incompressible (nu = 0.5); that takes formulation 'mixed'")
        self._warn_of_smooth_joints()

    @cached_property
    def pressures(self) -> "Pressures | None":
        """The pressure space of the mixed formulation.

        Raises
        ------
        InputError
            If the space has none, or a law is not split for it or has ``nu <= 0``.
        """
        if self.formulation != "mixed":
            return None
        from isorod.space.pressure import Pressures

        for e, law in enumerate(self.laws):
            if not getattr(law, "nu", 0.0) > 0.0:
                raise InputError(f"material of element {e}: the mixed formulation needs an isotropic law with nu > 0")
        return Pressures(self.space)

    @cached_property
    def pressure_unit(self) -> float:
        """What the unknown pressures of the mixed formulation are counted in: the middle shear modulus, force/area."""
        return float(np.median([getattr(law, "mu", 1.0) for law in self.laws]))

    def _warn_of_smooth_joints(self) -> None:
        """Warn where stiffness jumps at a knot at which displacements are smooth: strains, which jump too, cannot follow."""
        if not isinstance(self.material, Sequence):
            return
        axis = self.space.axis
        moduli = np.array([getattr(law, "E", np.nan) for law in self.laws])
        jumps = np.exp(np.abs(np.diff(np.log(moduli)))) * (1.0 - 1e-9)
        times = np.searchsorted(axis.knots, axis.breaks[1:-1], "right") - np.searchsorted(axis.knots, axis.breaks[1:-1])
        smooth = (jumps > _JUMP) & (times < axis.degree)
        if smooth.any():
            k = int(np.argmax(np.where(smooth, jumps, 0.0)))
            warnings.warn(
                f"stiffness jumps by {jumps[k]:.3g} at u = {axis.breaks[k + 1]:.4g}, where displacements are smooth: errors of a tenth and "
                "more; take continuity 0, or a rod with that knot repeated (Rod.insert)",
                stacklevel=4,
            )

    @cached_property
    def densities(self) -> Array:
        """The mass per reference volume of each element, shape ``(elements,)``."""
        return np.broadcast_to(np.asarray(self.density, dtype=float), (self.space.axis.elements,))

    @cached_property
    def laws(self) -> tuple[Material, ...]:
        """The law of each element, shape ``(elements,)``."""
        if isinstance(self.material, Sequence):
            return tuple(self.material)
        return (self.material,) * self.space.axis.elements

    @cached_property
    def linear(self) -> bool:
        """Whether its stiffness is the same in all states."""
        return self.formulation == "displacement" and all(isinstance(law, LinearElastic) for law in self.laws)

    def laws_at(self, u: Array) -> Laws:
        """Return the laws at axis parameters, for deformation gradients of shape ``u.shape + (q, 3, 3)``.

        Parameters
        ----------
        u
            Shape ``(E,)`` or ``(E, t)``, each row within one element; at a knot the element above it is meant.
        """
        breaks = self.space.axis.breaks
        elements = np.searchsorted(breaks[1:-1], u.reshape(u.shape[0], -1)[:, 0], side="right")
        laws = Laws.of([self.laws[e] for e in elements])
        return laws.along(self._tangents(u)[..., None, :]) if laws.follow else laws

    def _tangents(self, u: Array) -> Array:
        return self.space.rod.tangents(u.ravel()).reshape(*u.shape, 3)

    def parameters(self) -> Array:
        """Return the constants of each element's law as `isorod.material.muscle.point_stress` takes them, shape ``(elements, 5)``.

        Raises
        ------
        InputError
            If a law is neither neo-Hookean nor muscle, or the formulation is mixed.
        """
        if self.formulation != "displacement":
            raise InputError(f"formulation {self.formulation!r} is for statics alone")
        for e, law in enumerate(self.laws):
            if not isinstance(law, NeoHookean):
                raise InputError(f"material of element {e}: got {type(law).__name__}, need NeoHookean or Muscle here")
        return np.array([law.parameters for law in self.laws if isinstance(law, NeoHookean)])

    def fibres(self, table: Table) -> Array:
        """Return the unit fibre directions at the quadrature points, shape ``(E, t, q, 3)``; zero where the law has none."""
        result = np.zeros((*table.weights.shape, 3))
        for law, first, last in self.laws_at(table.u).runs:
            result[first:last] = getattr(law, "fibre", 0.0)
        return result


@dataclass(frozen=True, eq=False)
class Support:
    """Prescribed displacements of nodes.

    Parameters
    ----------
    nodes
        Node numbers in the body's space, shape ``(m,)``.
    components
        Held components, letters of ``"xyz"``.
    displacement
        Displacement at load factor 1, shape ``(3,)`` or one a node ``(m, 3)``, units of length; components that are not held
        are not read.
    body
        Index of the body in the model.
    turn
        Rotation vector at load factor 1, radians, of any length; at factor ``f`` the nodes' displacement is
        ``f displacement + (R(f turn) - 1) arm`` with the exact rotation ``R``.
    arms
        Coefficients of the position from the centre of that rotation, shape ``(m, 3)``; zero where not given.
    tied
        Components, letters of ``"xyz"``, in which the nodes turn with the others but translate freely, as one: those that carry
        the rod (`Space.carries`) share one unknown.
    """

    nodes: Index
    components: str = "xyz"
    displacement: ArrayLike = (0.0, 0.0, 0.0)
    body: int = 0
    turn: ArrayLike = (0.0, 0.0, 0.0)
    arms: ArrayLike | None = None
    tied: str = ""

    @classmethod
    def end(
        cls,
        space: Space,
        which: str,
        components: str = "xyz",
        displacement: tuple[float, float, float] = (0.0, 0.0, 0.0),
        body: int = 0,
        turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
        center: tuple[float, float, float] | None = None,
        tied: str = "",
    ) -> "Support":
        """Return a support of the whole ``"start"`` or ``"end"`` face: every ``k`` is held, ``k = 0`` carries the displacement.

        With a ``turn`` (rotation vector, radians at load factor 1) the face moves as a rigid body: at factor ``f`` its point ``x``
        is displaced by ``R(f turn) (x - c) - (x - c) + f displacement``; the ``center`` ``c`` is the mean of the face's nodes where
        not given.  In the components ``tied`` the face turns too, but is free to translate as a whole; ``components`` are those
        held, so that ``components="x", tied="yz"`` holds one translation of a rigid face.
        """
        if space.rod.closed:
            raise InputError("support of an end: a closed rod has none")
        layers = {"start": 0, "end": space.layers - 1}
        if which not in layers:
            raise InputError(f"support: got end {which!r}, need 'start' or 'end'")
        nodes = layers[which] * space.layer_nodes + np.arange(space.layer_nodes)
        carries = space.carries[nodes, None]
        arms = None
        if np.any(turn):
            arms = space.positions[nodes]
            middle = arms[carries[:, 0]].mean(axis=0) if center is None else np.array(center, dtype=float)
            arms = arms - carries * middle
        return cls(nodes, components, carries * np.array(displacement, dtype=float), body, turn, arms, tied)


@dataclass(frozen=True)
class Spin:
    """A steady rotation of the frame in which displacements are measured: centrifugal force, growing with the load factor.

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
        if not np.isfinite([*self.velocity, *self.center]).all():
            raise InputError(f"spin: velocity {self.velocity}, center {self.center}: both must be finite")

    @property
    def field(self) -> Array:
        """Matrix ``|w|^2 1 - w w^T`` that takes the position from the center to the centrifugal acceleration."""
        w = np.array(self.velocity)
        return w @ w * np.eye(3) - np.outer(w, w)


@dataclass(frozen=True, eq=False)
class Model:
    """Bodies, supports, loads and contacts; degrees of freedom are numbered body by body, node by node, ``x, y, z``.

    Attributes
    ----------
    held
        Degrees of freedom that supports hold.
    bound, support_of
        Degrees of freedom that supports hold or tie, and by which support.
    free
        Unknown of each degree of freedom, -1 if it is held; tied ones share an unknown.

    Raises
    ------
    InputError
        If a support, a load or a contact names a body, a node, an element or a component that is not there, or two supports contradict each
        other.
    """

    bodies: Sequence[Body]
    supports: Sequence[Support] = ()
    spin: Spin | None = None
    contacts: "Sequence[Contact]" = ()
    loads: Sequence[Load] = ()
    first_node: Index = field(init=False)
    held: Index = field(init=False)
    free: Index = field(init=False)
    bound: Index = field(init=False)
    support_of: Index = field(init=False)
    motions: tuple[Motion, ...] = field(init=False)

    def __post_init__(self) -> None:
        for b, body in enumerate(self.bodies):
            if self.spin is not None and not body.densities.min() > 0.0:
                raise InputError(f"spin: body {b} has no density")
        for k, contact in enumerate(self.contacts):
            contact.check(k, self.bodies)
        counts = [body.space.nodes for body in self.bodies]
        first_node = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        motions = tuple(self._motion(support, k, first_node) for k, support in enumerate(self.supports))
        numbering = number(motions, 3 * int(first_node[-1]))
        for name, value in (("first_node", first_node), ("motions", motions), *numbering._asdict().items()):
            object.__setattr__(self, name, value)
        for k, load in enumerate(self.loads):
            if not 0 <= load.body < len(self.bodies):
                raise InputError(f"load {k}: body {load.body} is not one of the {len(self.bodies)} bodies")

    def _motion(self, support: Support, k: int, first_node: Index) -> Motion:
        if not 0 <= support.body < len(self.bodies):
            raise InputError(f"support {k}: body {support.body} is not one of the {len(self.bodies)} bodies")
        space = self.bodies[support.body].space
        nodes = np.asarray(support.nodes, dtype=np.int64)
        bad = (nodes < 0) | (nodes >= space.nodes)
        if bad.any():
            raise InputError(f"support {k}: node {nodes[np.argmax(bad)]} is not in body {support.body}")
        letters = support.components + support.tied
        if not letters or set(letters) - set("xyz"):
            raise InputError(f"support {k}: got components {letters!r}, need some of 'xyz'")
        if set(support.components) & set(support.tied):
            raise InputError(
                f"support {k}: components {support.components!r} held and {support.tied!r} tied, need one or the other"
            )
        columns = np.array(["xyz".index(letter) for letter in letters])
        tied = np.array([letter in support.tied for letter in letters]) & space.carries[nodes, None]
        given = np.asarray(support.displacement, dtype=float)
        if given.shape not in ((3,), (nodes.size, 3)):
            raise InputError(f"support {k}: got displacements of shape {given.shape}, need (3,) or ({nodes.size}, 3)")
        rates = np.broadcast_to(given, (nodes.size, 3))[:, columns]
        if not np.isfinite(rates).all():
            raise InputError(f"support {k}: displacement {rates[~np.isfinite(rates)][0]} is not finite")
        turn = np.asarray(support.turn, dtype=float)
        if turn.shape != (3,) or not np.isfinite(turn).all():
            raise InputError(f"support {k}: got turn {turn.tolist()}, need three finite components in radians")
        full = np.zeros((nodes.size, columns.size, 3))
        if support.arms is not None:
            arms = np.asarray(support.arms, dtype=float)
            if arms.shape != (nodes.size, 3) or not np.isfinite(arms).all():
                raise InputError(f"support {k}: got arms of shape {arms.shape}, need ({nodes.size}, 3) finite numbers")
            full += arms[:, None]
            if tied.any():
                full[tied] -= arms[np.argmax(space.carries[nodes])]
        dofs = 3 * (first_node[support.body] + nodes)[:, None] + columns
        return Motion(dofs.ravel(), np.where(tied, 0.0, rates).ravel(), full.reshape(-1, 3), turn, tied.ravel())

    def prescribed(self, factor: float) -> Array:
        """Return what supports add to the unknowns at a load factor, shape ``(dofs,)``.

        The displacement of a state is ``x[free] + prescribed(factor)``, the first part left out where ``free`` is -1.
        """
        result = np.zeros(3 * int(self.first_node[-1]))
        for motion in self.motions:
            result[motion.dofs] = motion.at(factor)
        return result

    @cached_property
    def values(self) -> Array:
        """Displacements at load factor 1 of the degrees of freedom in ``held``."""
        return self.prescribed(1.0)[self.held]

    @cached_property
    def external(self) -> Array:
        """Nodal forces of the loads at load factor 1, shape ``(dofs,)``."""
        result = np.zeros((int(self.first_node[-1]), 3))
        for load in self.loads:
            first, last = self.first_node[load.body : load.body + 2]
            result[first:last] += load.nodal(self.bodies[load.body].space)
        return result.ravel()

    @property
    def dofs(self) -> int:
        """Number of degrees of freedom, held ones included."""
        return self.free.size

    @cached_property
    def size(self) -> float:
        """The largest extent of a body along an axis, units of length."""
        places = [body.space.positions[body.space.carries] for body in self.bodies]
        return max(float(np.ptp(one, axis=0).max()) for one in places)

    @property
    def unknowns(self) -> int:
        """Number of degrees of freedom that are not held, tied ones counted once."""
        return int(self.free.max(initial=-1)) + 1

    @property
    def carries(self) -> NDArray[np.bool_]:
        """Whether a node moves with its rod (`Space.carries`), shape ``(nodes,)``."""
        return np.concatenate([body.space.carries for body in self.bodies])

    @cached_property
    def whole_nodes(self) -> bool:
        """True if each node is free or held as a whole, and none is tied, so that matrices have blocks of 3."""
        free = np.count_nonzero((self.free >= 0).reshape(-1, 3), axis=1)
        return bool(((free == 0) | (free == 3)).all()) and self.bound.size == self.held.size

    def nodal(self, displacement: Array, body: int = 0) -> Array:
        """Return one body's part ``(nodes, 3)`` of a vector of all degrees of freedom."""
        return displacement.reshape(-1, 3)[self.first_node[body] : self.first_node[body + 1]]
