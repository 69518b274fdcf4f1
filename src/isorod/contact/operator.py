"""Contact as the assembler sees it: forces and exact tangent on the degrees of freedom of a model.

Of several ranks each has all tables and looks at its share of the points (`isorod.contact.ranks`); forces, energies and
what is told are sums over all, and the same on each, entries of the tangent each rank's own.
"""

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.contact import cells, quality
from isorod.contact.blocks import Blocks
from isorod.contact.defaults import points_of, smallest_radius
from isorod.contact.facets import nodes_of
from isorod.contact.force_kernel import add_forces
from isorod.contact.lift_kernel import lift, lower
from isorod.contact.packed import PLACED, Friction, Packed, Row, Settled
from isorod.contact.placing_kernel import place_obstacles
from isorod.contact.ranks import Ranks
from isorod.contact.result import ContactResult, loads_of, measure, of_contacts
from isorod.contact.tables import pack
from isorod.contact.tangent_kernel import NODES, PATCH, add_blocks, find_patches, patch_nodes
from isorod.model.contact import MAX_POINTS, Contact
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.contact.friction import FrictionOperator
    from isorod.contact.lifts import Lifts

# Penetration up to which multipliers are added by default, relative to the smallest radius.
_DEEPEST = 1e-3

# Change of the load factor by which forces are differentiated where obstacles move.
_DELTA = 1e-6


class ContactOperator:
    """Forces and tangent of all contacts of a model; closest points are sought anew at each call, without history.

    Friction has one (`accept`).  Degrees of freedom are those of the model, and behind them three of each node of
    facets of finite element bodies that rods touch.

    Attributes
    ----------
    model
        Whose contacts these are.
    packed
        What the compiled loops take and leave (`isorod.contact.packed`).
    points
        Points round an arc and along an element, of each pass of the contacts.
    beyond
        Which degrees of freedom of rods and finite element bodies together those of facets are.
    friction
        Friction of the contacts that have some, or None.
    ahead
        Where the step leads, as far as is known (`foresee`), ``(dofs,)``.
    stiffness
        Share of their defaults that penalties have which nobody gave.
    values, rows, columns
        The last tangent: entries, those of all ranks add up, and their places.
    version
        A number of the pattern of this rank's entries (`isorod.contact.blocks`).
    """

    def __init__(self, model: Model, comm: PETSc.Comm | None = None, in_motion: bool = False) -> None:
        self.ranks = Ranks(comm)
        self.model = model
        self._in_motion = in_motion
        self.points = points_of(model)
        self.packed = self._fresh()
        self._stage = PETSc.Log.Stage("contact")
        nodes, places = nodes_of(model)
        self.beyond: Index = (3 * nodes[:, None] + np.arange(3)).ravel()
        reference = np.concatenate([*(body.space.positions for body in model.bodies), places])
        self._nodes = len(reference)
        self._base = np.pad(reference, ((0, len(self.packed.before) - self._nodes), (0, 0)))
        self._moving = self.packed.passes["tracks"] > 0
        self._blocks = Blocks(PATCH)
        self.rows, self.columns, self.version = self._blocks.rows, self._blocks.columns, self._blocks.version
        self.values = np.empty(0)
        self._lifts: Lifts | None = None
        self.ahead: Array = np.empty(0)
        self.stiffness = 1.0
        self._frictionless = Friction.of(np.zeros(self.packed.passes.size), 0)
        self.friction: FrictionOperator | None = None
        if any(contact.friction for contact in model.contacts):
            from isorod.contact import friction

            self.friction = friction.FrictionOperator(model, self.packed, self.ranks)

    @property
    def _friction(self) -> Friction:
        """What compiled loops take, of no point where there is no friction."""
        return self._frictionless if self.friction is None else self.friction.tables

    def _nodes_of(self, patch: Row) -> tuple[Index, Index]:
        nodes = np.empty(NODES, dtype=np.int64)
        forced, count = patch_nodes(self.packed, patch, nodes)
        return nodes[:forced], nodes[:count]

    def place(self, factor: float) -> None:
        """Put obstacles that move where they are at a load factor; all that follows is there."""
        if self._moving.any():
            place_obstacles(self.packed, factor)

    def _positions(self, displacement: Array) -> Array:
        """Return positions of the model's nodes, and behind these of control points of surfaces that have others."""
        positions = self._base.copy()
        positions[: self._nodes] += displacement.reshape(-1, 3)
        lift(self.packed, positions)
        return positions

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces of contact on all degrees of freedom ``(dofs,)``, and its energy."""
        self.packed.forget()
        return self._add_forces(self._positions(displacement))

    def _add_forces(self, positions: Array) -> tuple[Array, float]:
        forces = np.zeros_like(self._base)
        with self._stage:
            energy = self._find(self.packed, positions, forces)
            if self.friction is not None and np.isfinite(energy):
                energy += self.friction.add_forces(positions, forces)
            lower(self.packed, forces)
            forces, (energy,) = self.ranks.sums(forces[: self._nodes], energy)
        return forces.ravel(), float(energy)

    def _find(self, packed: Packed, positions: Array, forces: Array) -> float:
        """Add the forces of this rank's points, and return their energy; the outcome of all is known then."""
        energy = add_forces(packed, positions, forces)[0]
        self.ranks.gather(packed, packed.states)
        return energy

    def accept(self, displacement: Array) -> float:
        """Let the next step begin at a displacement ``(dofs,)``; return the energy that friction has dissipated."""
        if self.friction is None:
            return 0.0
        self.forces(displacement)
        positions = self._positions(displacement)
        # In load steps points may slide far as they come into contact: then friction asks where they were.
        self.friction.before = None if self._in_motion else positions
        return self.friction.accept(positions)

    def foresee(self, displacement: Array) -> None:
        """Say where a step that has begun leads, as far as is known: what comes into contact does so on that way."""
        self.ahead = displacement
        if self.friction is not None:
            self.friction.foresee(self._positions(displacement))

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, minus the derivatives of the forces at ``rows`` and ``columns``.

        Without friction they are the second derivatives of the energy.  Nodes of two sides (three control points by the
        layers of an element) that touch couple with each other.  Where a patch comes that is not in the pattern, the
        pattern is made anew of the patches of this call and the last one, and ``version`` is another.
        """
        packed, positions = self.packed, self._positions(displacement)
        # Where the forces were asked for just before, nothing has moved since: closest points are known.
        if not np.array_equal(packed.before[packed.carriers], positions[packed.carriers]):
            packed.forget()
        self._add_forces(positions)
        active = np.flatnonzero(packed.own & (packed.states["pressure"] > 0.0))
        patches = np.empty(active.size, PATCH)
        patches["number"] = packed.passes_of(active)
        find_patches(packed, self._friction, active, patches)
        begin = self._blocks.begin(patches, self._nodes_of)
        self.rows, self.columns, self.version = self._blocks.rows, self._blocks.columns, self._blocks.version
        blocks = np.zeros(self._blocks.room)
        with self._stage:
            add_blocks(packed, self._friction, positions, active, patches, begin, blocks)
            self.values = self._blocks.merge(blocks)
            if packed.lifts.size and self.rows.size:
                self._lower_tangent()
        return self.values

    def _lower_tangent(self) -> None:
        """Make the tangent one of the model's own nodes."""
        if self._lifts is None:
            from isorod.contact.lifts import Lifts

            self._lifts = Lifts(self.packed, self._nodes)
        self.values = self._lifts.lower(self.rows, self.columns, self.values, self.version)
        self.rows, self.columns = self._lifts.rows, self._lifts.columns

    @property
    def of_rods(self) -> NDArray[np.bool_] | slice:
        """Which entries of the last tangent are between degrees of freedom of the model."""
        if not self.beyond.size:
            return slice(None)
        return np.maximum(self.rows, self.columns) < self.model.dofs

    def product(self, move: Array) -> Array:
        """Return the last tangent times a vector of all degrees of freedom."""
        own = np.bincount(self.rows, self.values * move[self.columns], move.size).astype(np.float64, copy=False)
        return self.ranks.sums(own)[0]

    def carried_along(self, displacement: Array, factor: float, step: float) -> Array:
        """Return the change of the forces ``(dofs,)``, linearised, when obstacles move on by ``step`` at a factor."""
        if not self._moving.any():
            return np.zeros_like(displacement)
        forces = []
        # Points that come into contact on the way are none of the derivative.
        for ahead in (_DELTA, 0.0):
            self.place(factor + ahead)
            forces.append(self.forces(displacement)[0])
        return step / _DELTA * (forces[0] - forces[1])

    @property
    def touching(self) -> int:
        """Number of points that press, as the last forces left them."""
        return int((self.packed.states["pressure"] > 0.0).sum())

    def push(self) -> float:
        """Return the normal forces of all obstacles that move, as the last forces left them: what drives a model."""
        firsts, loads = self.packed.passes["first_point"], self.packed.areas * self.packed.states["pressure"]
        each = np.add.reduceat(loads, firsts)
        return float(each[self._moving].sum())

    def obstacle_loads(self) -> Array:
        """Return force and moment of the obstacle of each contact, as the last forces left them, ``(contacts, 6)``.

        Moments are about the point that it turns about, or its own.
        """
        return loads_of(self.model, self.packed, self._friction, self.ranks)

    def results(self, displacement: Array, check: bool = False) -> list[ContactResult]:
        """Return the outcome of each contact at a displacement ``(dofs,)``; ``check``: with the error of points."""
        others = self._otherwise(displacement) if check else ()
        uneven = self._unevenness(displacement) if check else ()
        self.packed.look_everywhere()
        self.forces(displacement)
        self.ranks.gather(self.packed, self.packed.points, self.packed.starts)
        if self.friction is not None:
            self.ranks.gather(self.packed, self._friction.tractions, self._friction.slipping)
        return measure(self.model, self.packed, self._friction, others, uneven)

    def _unevenness(self, displacement: Array) -> list[tuple[float, float]]:
        """Return how far flat facets under pressure are from curved ones, and how far points were from rods at rest."""
        if not self.beyond.size:
            return []
        from isorod.contact.flatness import unevenness

        found, states = [], []
        for moved in (displacement, np.zeros_like(displacement)):
            self.packed.look_everywhere()
            self.forces(moved)
            states.append(self.packed.states.copy())
        for contact, _, chosen in of_contacts(self.model, self.packed):
            pressed = states[0]["pressure"][chosen] > 0.0
            if contact.facets is None or not pressed.any():
                found.append((0.0, np.inf))
                continue
            # Far ones have no gap.
            apart = np.nan_to_num(np.abs(states[1]["gap"][chosen][pressed]), nan=np.inf)
            sizes = unevenness(self.model, contact)
            found.append((float(np.repeat(sizes, pressed.size // sizes.size)[pressed].max()), float(apart.max())))
        return found

    def _otherwise(self, displacement: Array) -> list[tuple[float, float] | None]:
        """Return force and largest pressure of each contact as half as many points again see them, if they can."""
        finer = [tuple(min(MAX_POINTS, count + (count + 1) // 2) for count in pair) for pair in self.points]
        packed = self._packed([(pair[0], pair[1]) for pair in finer])
        positions = self._positions(displacement)
        self._find(packed, positions, np.zeros_like(positions))
        found: list[tuple[float, float] | None] = []
        for _, passes, chosen in of_contacts(self.model, packed):
            pressure = packed.states["pressure"][chosen]
            same = all(finer[k] == self.points[k] for k in passes)
            found.append(None if same else (float(packed.areas[chosen] @ pressure), float(pressure.max(initial=0.0))))
        return found

    def _fresh(self) -> Packed:
        """Return tables without history."""
        return self.ranks.split(pack(self.model, self.points, self._in_motion))

    def _packed(self, points: list[tuple[int, int]]) -> Packed:
        """Return tables with other points, with the multipliers and penalties of now."""
        packed = self.ranks.split(pack(self.model, points))
        for name in ("penalty", *PLACED):
            packed.passes[name] = self.packed.passes[name]
        packed.multipliers[:] = cells.moved(self.packed, self.packed.multipliers, packed)
        return packed

    def look(self, points: list[tuple[int, int]]) -> None:
        """Take points round an arc and along an element of each pass, without history."""
        if points != self.points:
            self.points = points
            self._take(self._fresh())

    def see_better(self, displacement: Array, between: bool, chosen: Collection[int] | None = None) -> bool:
        """Take more points, where nobody gave them, if too few are across a patch; return whether there are more.

        Where nothing touches but might ``between`` points, more are taken too, if that is asked for.  Contacts are
        those ``chosen``, or all.
        """
        self.forces(displacement)
        if not self.packed.states["pressure"].any():
            # How near what does not touch is has not been looked at.
            np.minimum(self.packed.clear, self.packed.travel[0], out=self.packed.clear)
            self.forces(displacement)
        # What facets touch tells how wide a patch is.
        self.ranks.gather(self.packed, self.packed.starts)
        points = list(self.points)
        for number, (contact, passes, _) in enumerate(of_contacts(self.model, self.packed)):
            if contact.points is None and (chosen is None or number in chosen):
                for k, pair in quality.more(self.packed, passes, self.points, between).items():
                    points[k] = pair
        if points == self.points:
            return False
        self.take(points)
        return True

    def take(self, points: list[tuple[int, int]]) -> None:
        """Go on with other points, with multipliers, penalties and friction of those before."""
        self.points = points
        self._take(self._packed(points))

    def settled(self) -> Settled:
        """Return what a solution leaves of points, multipliers and penalties."""
        return Settled(self.points, self.packed.multipliers.copy(), self.packed.passes["penalty"].copy())

    def keep(self) -> Callable[[], None]:
        """Return what takes points, multipliers, penalties and friction back to what they are now."""
        packed, points, stiffness, friction = self.packed, self.points, self.stiffness, self.friction
        multipliers, penalties = packed.multipliers.copy(), packed.passes["penalty"].copy()
        undo = None if friction is None else friction.keep()

        def back() -> None:
            self.packed, self.points, self.stiffness = packed, points, stiffness
            packed.multipliers[:], packed.passes["penalty"][:] = multipliers, penalties
            packed.forget()
            if undo is not None:
                undo()

        return back

    def _take(self, packed: Packed) -> None:
        """Go on with other points."""
        self.packed = packed
        if self.friction is not None:
            self.friction.take(packed)

    def excess(self, displacement: Array) -> list[tuple[float, str]]:
        """Return, of each contact whose penetration is limited, that over the limit, and both in words."""
        self.forces(displacement)
        found = []
        for k, (contact, _, points) in enumerate(of_contacts(self.model, self.packed)):
            limit, states = self._limit(contact), self.packed.states[points]
            if np.isfinite(limit):
                depth = max(0.0, -float(states["gap"][states["pressure"] > 0.0].min(initial=0.0)))
                found.append((depth / limit, f"contact {k}: penetration {depth:.3g}, need {limit:.3g} at most,"))
        return found

    def augment(self, displacement: Array, in_cells: bool) -> None:
        """Make pressures the multipliers of contacts whose penetration is limited, or add to these by cells."""
        self.forces(displacement)
        pressure = self.packed.states["pressure"]
        if in_cells:
            # The first ones are as they come; what is added to them has no shape within a cell.
            former = np.where(pressure > 0.0, self.packed.multipliers, 0.0)
            if former.any():
                pressure = np.maximum(0.0, former + cells.means(self.packed, pressure - former))
        for contact, _, points in of_contacts(self.model, self.packed):
            if np.isfinite(self._limit(contact)):
                self.packed.multipliers[points] = pressure[points]

    def stiffen(self, times: float) -> None:
        """Raise penalties that nobody gave."""
        for contact, passes, _ in of_contacts(self.model, self.packed):
            if contact.penalty is None:
                self.packed.passes["penalty"][passes.start : passes.stop] *= times
        self.stiffness *= times

    @property
    def has_defaults(self) -> bool:
        """Whether a contact has a penalty that nobody typed."""
        return any(contact.penalty is None for contact in self.model.contacts)

    def _limit(self, contact: Contact) -> float:
        """Return how deep a point of a contact may be."""
        if contact.penetration is not None:
            return contact.penetration
        return np.inf if contact.penalty is not None else _DEEPEST * smallest_radius(self.model, contact)
