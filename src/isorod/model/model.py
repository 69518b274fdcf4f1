"""Models: bodies, supports, loads and contact definitions, the input of every analysis."""

import warnings
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index, Numbers
from isorod.errors import Checked, InputError, expect
from isorod.model.body import Body
from isorod.model.history import Times, TimeTable
from isorod.model.load import Load, PointLoad, Pressure, SectionLoad, Spin
from isorod.model.mean import MeanSupport
from isorod.model.motion import SupportMotion
from isorod.model.numbering import number
from isorod.model.past import Past
from isorod.model.support import Support
from isorod.space.space import Space

if TYPE_CHECKING:
    from isorod.fenics.solid import Solid
    from isorod.model.contact import Contact
    from isorod.model.tie import Tie

# The analyses that take histories, and the message in others.
_TIMED = ("statics", "modal analysis")
_ONE_FACTOR = "one factor multiplies all that loads the model; ask for statics"

# Fields of a model that are sequences.
_PARTS = ("bodies", "solids", "supports", "loads", "contacts", "ties")


@dataclass(frozen=True, eq=False)
class Model(Checked):
    """Bodies, supports, loads, contacts, ties; degrees of freedom are numbered body by body, node by node, ``x, y, z``.

    Attributes
    ----------
    ties, solids
        Welded surfaces (`isorod.model.tie.Tie`), and finite element bodies beside the rods
        (`isorod.fenics.solid.Solid`), which have supports and loads of their own.
    times
        Times along the load path (`isorod.model.times.until`): histories are then functions of the load factor.
    held
        Degrees of freedom that supports hold.
    bound, support_of
        Degrees of freedom that supports hold or tie, and by which support.
    free
        Unknown of each degree of freedom, -1 if it is held; tied ones have the same.
    past
        Earlier states, which laws with memory depend on (`after`).

    Raises
    ------
    InputError
        If a support, a load or a contact names a body, a node, an element or a component that is not there, or two
        supports contradict each other.
    """

    bodies: Sequence[Body]
    supports: Sequence[Support | MeanSupport] = ()
    spin: Spin | None = None
    contacts: "Sequence[Contact]" = ()
    loads: Sequence[Load] = ()
    ties: "Sequence[Tie]" = ()
    solids: "Sequence[Solid]" = ()
    times: Times | None = field(default=None, repr=False)
    first_node: Index = field(init=False)
    held: Index = field(init=False)
    free: Index = field(init=False)
    bound: Index = field(init=False)
    support_of: Index = field(init=False)
    motions: tuple[SupportMotion, ...] = field(init=False)
    past: Sequence[Past] = field(init=False, default=())

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.bodies:
            raise InputError("model: got no bodies, need at least one")
        if self.spin is not None and self.solids:
            raise InputError("spin: finite element bodies know no centrifugal force; leave out the spin or the solids")
        for b, body in enumerate(self.bodies):
            if self.spin is not None and not body.densities.min() > 0.0:
                raise InputError(f"spin: body {b} has no density")
        for k, contact in enumerate(self.contacts):
            contact.check(k, [body.space for body in self.bodies], len(self.solids))
            self._warn_of_poor_pressures(k, contact)
        counts = [body.space.nodes for body in self.bodies]
        first_node = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        motions = []
        for k, support in enumerate(self.supports):
            space = self._space(f"support {k}", support)
            try:
                motions.append(support.motion(space, int(first_node[support.body])))
            except InputError as problem:
                raise InputError(f"support {k}: {problem}") from None
        numbering = number(motions, 3 * int(first_node[-1]))
        self._set(first_node=first_node, motions=tuple(motions), **numbering._asdict())
        for k, load in enumerate(self.loads):
            space = self._space(f"load {k}", load)
            if isinstance(load, PointLoad):
                around, along = load.spread(space)
                warnings.warn(
                    f"load {k}: a point force has no limit of displacement and stress under it: this space spreads it "
                    f"over about {around:.3g} round the section and {along:.3g} along",
                    stacklevel=3,
                )
            if isinstance(load, SectionLoad) and load.moment is not None and any(load.moment):
                self._refuse_held(k, load, np.array(load.moment))
        for k, one in self.means.items():
            others = [j for j, other in enumerate(self.supports) if j != k and other.body == one.body]
            if one.free and others:
                raise InputError(
                    f"support {k}: rigid motions alone are held where nothing else holds the rod, and support "
                    f"{others[0]} does; leave one of the two out"
                )
        for k, tie in enumerate(self.ties):
            tie.check(k, len(self.bodies), len(self.solids))
        if self.ties and self.contacts:
            # Loaded where there is contact.
            from isorod.model.contact import refuse_tied

            refuse_tied(self.contacts, self.ties, self.solids)

    def _warn_of_poor_pressures(self, index: int, contact: "Contact") -> None:
        """Warn of pressure spaces too coarse to resolve a contact patch."""
        poor = [b for b, _ in contact.sides if self.bodies[b].has_poor_pressures]
        if poor:
            warnings.warn(
                f"contact {index}: contact patch under-resolved: the mixed formulation's pressures are linear "
                f"across the section of body {poor[0]}; peak pressures up to three times too low, forces off by some "
                "per cent; use order 2 and at least 5 section points",
                stacklevel=4,
            )

    def __repr__(self) -> str:
        counts = {name: len(getattr(self, name)) for name in _PARTS}
        parts = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
        spin = "" if self.spin is None else ", spin"
        return f"Model({parts}{spin}; {self.dofs} degrees of freedom, {self.unknowns} unknowns)"

    def _space(self, what: str, one: Support | MeanSupport | Load) -> Space:
        """Return the space of the body that a support or a load names."""
        if not 0 <= one.body < len(self.bodies):
            raise InputError(f"{what}: body {one.body} is not one of the {len(self.bodies)} bodies")
        space, made_for = self.bodies[one.body].space, getattr(one, "space", None)
        if made_for is not None and not made_for.matches(space):
            raise InputError(f"{what}: made for another space than that of body {one.body}; take that body's")
        return space

    def _refuse_held(self, index: int, load: SectionLoad, moment: Array) -> None:
        """Raise `InputError` if supports hold all nodes of a moment's section, or the mean rotation that it acts on."""
        space = self.bodies[load.body].space
        try:
            nodes = load.trace(space).nodes[0]
        except InputError as problem:
            raise InputError(f"load {index}: {problem}") from None
        held = bool((self.free[3 * (self.first_node[load.body] + nodes)[:, None] + np.arange(3)] < 0).all())
        u = space.axis.breaks[-1] if load.u is None else load.u
        for one in self.means.values():
            if one.body == load.body and one.u == u and one.stiffness is None and not one.ring:
                rest = moment - one.axes.T @ (one.axes @ moment)
                held |= bool(np.linalg.norm(rest) < 1e-9 * np.linalg.norm(moment))
        if held:
            raise InputError(f"load {index}: the section is held: a moment on it does nothing; leave it out")

    def in_displacements(self) -> "Model":
        """Return the model without pressure unknowns (`Body.in_displacements`)."""
        return self._of([body.in_displacements() for body in self.bodies])

    def of_density(self, density: float) -> "Model":
        """Return the model with one density for all rods, where any mass matrix will do."""
        with warnings.catch_warnings():
            # The bodies themselves have given these warnings.
            warnings.simplefilter("ignore")
            return self._of([replace(body, density=density) for body in self.bodies])

    def in_motion(self, integrator: str) -> "Model":
        """Return the model for steps in time (`Body.in_motion`)."""
        bodies = []
        for b, body in enumerate(self.bodies):
            try:
                bodies.append(body.in_motion(integrator))
            except InputError as problem:
                raise InputError(f"body {b}: {problem}") from None
        return self._of(bodies)

    @cached_property
    def remembers(self) -> bool:
        """Whether a law has a memory."""
        return any(body.remembers for body in self.bodies)

    def after(self, past: Sequence[Past], settled: bool = False) -> "Model":
        """Return the model after states with displacements ``(dofs,)``; see `isorod.model.body.Body.after`."""
        if not self.remembers:
            return self
        own = [body.after([Past(f, self.nodal(x, b)) for f, x in past], settled) for b, body in enumerate(self.bodies)]
        (model := copy(self))._set(bodies=own, past=tuple(past))
        return model

    def _of(self, bodies: Sequence[Body]) -> "Model":
        same = all(one is other for one, other in zip(bodies, self.bodies, strict=True))
        return self if same else replace(self, bodies=bodies)

    def split_pressures(self, pressures: Array) -> list[Array | None]:
        """Return all pressure coefficients ``(p,)`` as each body's ``(layers, count)``, or None."""
        result: list[Array | None] = []
        first = 0
        for own in (body.pressures for body in self.bodies):
            result.append(None if own is None else pressures[first : first + own.size].reshape(-1, own.count))
            first += 0 if own is None else own.size
        return result

    def prescribed(self, factor: float) -> Array:
        """Return prescribed displacements at a load factor, shape ``(dofs,)``; zero on unknowns that are not tied.

        The displacement of a state is ``x[free] + prescribed(factor)``, the first part left out where ``free`` is -1.
        """
        return self._by_motion(lambda one: one.at(self.amplitude(one.clock.table, factor)))

    def amplitude(self, table: "TimeTable | Numbers | None", factor: float, step: float | None = None) -> float:
        """Return the amplitude at a load factor of what has a table, or none, or its increment in a step."""
        if self.times is None:
            return factor if step is None else step
        own = table if isinstance(table, TimeTable) else self.times.ramp
        return own.at(factor) if step is None else own.at(factor + step) - own.at(factor)

    def pace(self, table: "TimeTable | Numbers | None", factor: float) -> float:
        """Return the derivative of the amplitude by the load factor, after a load factor."""
        if self.times is None:
            return 1.0
        return (table if isinstance(table, TimeTable) else self.times.ramp).slope(factor)

    def when(self, factor: float, digits: str = ".6g") -> str:
        """Return a load factor, or the time there, in words."""
        return f"load factor {factor:{digits}}" if self.times is None else f"time {self.times.time(factor):{digits}}"

    def applied(self, factor: float, step: float | None = None) -> Array:
        """Return `external` at a load factor, or its increment in a step, shape ``(dofs,)``."""
        if self.times is None:
            return (factor if step is None else step) * self.external
        pairs = zip(self.loads, self._external_by_load, strict=True)
        return sum((self.amplitude(load.history, factor, step) * own for load, (_, own) in pairs), np.zeros(self.dofs))

    @property
    def moves(self) -> bool:
        """Whether supports move by time."""
        return any(motion.clock.moves for motion in self.motions) or any(one.clock.moves for one in self.means.values())

    def placed(self, time: float) -> Array:
        """Return prescribed displacements of a motion at a time, shape ``(dofs,)``."""
        return self._by_motion(lambda one: one.at(one.clock.at(time)))

    def rates(self, time: float, before: bool = False) -> Array:
        """Return prescribed velocities after a time, or ``before`` it, shape ``(dofs,)``."""
        return self._by_motion(lambda one: one.velocity(time, before))

    def accelerations(self, time: float) -> Array:
        """Return prescribed accelerations at a time, shape ``(dofs,)``."""
        return self._by_motion(lambda one: one.acceleration(time))

    def _by_motion(self, values: "Callable[[SupportMotion], Array]") -> Array:
        result = np.zeros(self.dofs)
        for motion in self.motions:
            result[motion.dofs] = values(motion)
        return result

    def loaded(self, begin: float, end: float) -> Array:
        """Return means over a time interval of nodal forces that depend on no state, shape ``(dofs,)``."""
        if all(load.history is None for load in self.loads):
            return self.external
        return np.asarray(sum(factor(begin, end) * forces for factor, forces in self._external_by_load))

    @cached_property
    def _external_by_load(self) -> "list[tuple[Callable[[float, float], float], Array]]":
        factors_and_forces: list[tuple[Callable[[float, float], float], Array]] = []
        for load in self.loads:
            space, result = self.bodies[load.body].space, np.zeros((self.dofs // 3, 3))
            first, last = self.first_node[load.body : load.body + 2]
            if load not in self.following:
                result[first:last] = load.nodal(space)
            elif isinstance(load, SectionLoad):
                result[first:last] = load.steady(space)
            factors_and_forces.append((load.factor, result.ravel()))
        return factors_and_forces

    @cached_property
    def driven(self) -> Array:
        """Derivatives of prescribed displacements at load factor 1 (`SupportMotion.driven`), shape ``(dofs,)``."""
        return self.drives(1.0)

    def drives(self, factor: float) -> Array:
        """Return the same at a load factor, shape ``(dofs,)``."""
        return self._by_motion(lambda one: one.driven(self.amplitude(one.clock.table, factor)))

    @cached_property
    def stages(self) -> list[float]:
        """Load factors at which the motion of a support or obstacle, or a table, has a kink, and 1."""
        if self.times is not None:
            return [float(place) for place in self.times.path[1:]]
        ends = {end for motion in self.motions for end in motion.during}
        ends |= {float(end) for one in self.contacts if one.motion is not None for end in one.motion.track[:, 0]}
        return sorted((ends | {1.0}) - {0.0})

    @cached_property
    def means(self) -> dict[int, MeanSupport]:
        """The supports of mean motions, by their numbers."""
        return {k: one.on(self.bodies[one.body]) for k, one in enumerate(self.supports) if isinstance(one, MeanSupport)}

    @property
    def coupled(self) -> bool:
        """Whether unknowns depend on each other, or on those of finite element bodies."""
        return bool(self.ties or self.solids or self.means)

    def refuse_hold(self, what: str) -> None:
        """Raise `InputError` for a support of rigid motions alone, which ``what`` cannot take."""
        for k, one in self.means.items():
            if one.free:
                raise InputError(f"support {k}: to hold rigid motions alone is for statics; in {what} leave it out")

    @cached_property
    def values(self) -> Array:
        """Displacements at load factor 1 of the degrees of freedom in ``held``."""
        return self.prescribed(1.0)[self.held]

    @cached_property
    def external(self) -> Array:
        """Nodal forces of the loads at load factor 1 that depend on no state, shape ``(dofs,)``."""
        if self.times is not None:
            return self.applied(1.0)
        return sum((forces for _, forces in self._external_by_load), np.zeros(self.dofs))

    @cached_property
    def following(self) -> list[Pressure | SectionLoad]:
        """Loads that depend on the state: follower pressures, and moments except on bodies of small strains."""
        return [
            load
            for load in self.loads
            if (isinstance(load, Pressure) and load.follows)
            or (isinstance(load, SectionLoad) and load.turns and not self.bodies[load.body].linear)
        ]

    @property
    def has_potential(self) -> bool:
        """Whether no load is a moment that depends on the state, whose tangent is not symmetric."""
        return not any(isinstance(load, SectionLoad) for load in self.following)

    @property
    def dofs(self) -> int:
        """Number of degrees of freedom, held ones included."""
        return self.free.size

    @cached_property
    def size(self) -> float:
        """The largest extent of a body along an axis, units of length."""
        positions = [body.space.positions[body.space.is_control_point] for body in self.bodies]
        return max(float(np.ptp(one, axis=0).max()) for one in positions)

    @property
    def unknowns(self) -> int:
        """Number of degrees of freedom that are not held, tied ones counted once."""
        return int(self.free.max(initial=-1)) + 1

    @property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a node is a control point (`Space.is_control_point`), shape ``(nodes,)``."""
        return np.concatenate([body.space.is_control_point for body in self.bodies])

    @cached_property
    def whole_nodes(self) -> bool:
        """Whether each node is completely free or held, and none is tied, so that matrices have blocks of 3."""
        free = np.count_nonzero((self.free >= 0).reshape(-1, 3), axis=1)
        return bool(((free == 0) | (free == 3)).all()) and self.bound.size == self.held.size

    def nodal(self, displacement: Array, body: int = 0) -> Array:
        """Return one body's part ``(nodes, 3)`` of a vector of all degrees of freedom."""
        return displacement.reshape(-1, 3)[self.first_node[body] : self.first_node[body + 1]]


def unmoved(model: Model, what: str, timed: bool = False) -> None:
    """Raise `InputError` for what is no model, or moves in time while ``what`` is not ``timed``."""
    expect("model", model, Model)
    laws = [(f"body {b}: temperature", law) for b, body in enumerate(model.bodies) for law in body.laws]
    several: list[tuple[str, object]] = [(f"support {k}", one) for k, one in enumerate(model.supports)]
    several += [(f"load {k}", one) for k, one in enumerate(model.loads)]
    for name, one in [*several, *laws, ("spin", model.spin)]:
        if getattr(one, "history", None) is not None and not timed:
            cure = f"there is no time in {what} without an end_time; give one" if what in _TIMED else _ONE_FACTOR
            raise InputError(f"{name}: history: {cure}, or leave it out")
    for name, one in several:
        if np.any(getattr(one, "spin", 0.0)):
            raise InputError(f"{name}: spin: supports spin in dynamics; in {what} the frame does, with [spin]")
    for b, body in enumerate(model.bodies):
        if any(body.velocity) or any(body.spin):
            raise InputError(f"body {b}: velocity: there is no motion in {what}; leave velocity and spin out")
