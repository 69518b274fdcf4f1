"""Contact for the assembler: forces and exact tangent on the degrees of freedom of a model.

Each rank has all tables and computes its own points (`isorod.contact.ranks`).  Forces, energies and results are sums
over all ranks, the same on each; entries of the tangent are each rank's own.
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

# Penetration allowed by default, relative to the smallest radius: multipliers are updated while it is exceeded.
_DEEPEST = 1e-3

# Change of the load factor for differences of forces where obstacles move.
_DELTA = 1e-6


class ContactOperator:
    """Forces and tangent of all contacts of a model; closest points are searched anew at each call, without history.

    Friction has history (`accept`).  Degrees of freedom are those of the model, then three for each node of facets of
    finite element bodies that rods touch.

    Attributes
    ----------
    model
        The model with these contacts.
    packed
        Tables of the compiled loops (`isorod.contact.packed`).
    points
        Points round an arc and along an element, of each pass of the contacts.
    beyond
        Numbers of the degrees of freedom of facets among those of rods and finite element bodies.
    friction
        Friction of the contacts, or None.
    ahead
        Predicted displacement at the end of the step (`foresee`), ``(dofs,)``.
    stiffness
        Ratio of default penalties, those that the user did not set, to their first values.
    values, rows, columns
        The last tangent: entries, to be summed over all ranks, and their rows and columns.
    version
        Number of the pattern of this rank's entries (`isorod.contact.blocks`).
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
        """Tables for compiled loops, of no points where there is no friction."""
        return self._frictionless if self.friction is None else self.friction.tables

    def _nodes_of(self, patch: Row) -> tuple[Index, Index]:
        nodes = np.empty(NODES, dtype=np.int64)
        forced, count = patch_nodes(self.packed, patch, nodes)
        return nodes[:forced], nodes[:count]

    def place(self, factor: float) -> None:
        """Place obstacles that move as at a load factor, for all later calls."""
        if self._moving.any():
            place_obstacles(self.packed, factor)

    def _positions(self, displacement: Array) -> Array:
        """Return positions of the model's nodes, then of control points of surfaces that have their own."""
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
            energy = self._pressures(self.packed, positions, forces)
            if self.friction is not None and np.isfinite(energy):
                energy += self.friction.add_forces(positions, forces)
            lower(self.packed, forces)
            forces, (energy,) = self.ranks.sums(forces[: self._nodes], energy)
        return forces.ravel(), float(energy)

    def _pressures(self, packed: Packed, positions: Array, forces: Array) -> float:
        """Add the forces of this rank's points, return their energy, and gather the states of all points."""
        energy = add_forces(packed, positions, forces)[0]
        self.ranks.gather(packed, packed.states)
        return energy

    def accept(self, displacement: Array) -> float:
        """Start the next step at a displacement ``(dofs,)``; return the energy that friction has dissipated."""
        if self.friction is None:
            return 0.0
        self.forces(displacement)
        positions = self._positions(displacement)
        # In load steps points may slide far as they come into contact: friction needs their former positions.
        self.friction.before = None if self._in_motion else positions
        return self.friction.accept(positions)

    def foresee(self, displacement: Array) -> None:
        """Set the predicted end of a step that has begun: points are taken to come into contact on the path to it."""
        self.ahead = displacement
        if self.friction is not None:
            self.friction.foresee(self._positions(displacement))

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, minus the derivatives of the forces at ``rows`` and ``columns``.

        Without friction they are the second derivatives of the energy.  Nodes of two sides (three control points by the
        layers of an element) that touch are coupled.  Where a new patch is not in the pattern, the pattern is rebuilt
        from the patches of this call and the last one, and ``version`` changes.
        """
        packed, positions = self.packed, self._positions(displacement)
        # Where the forces were computed just before, at the same positions, closest points are known.
        if not np.array_equal(packed.before[packed.control_points], positions[packed.control_points]):
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
        """Transform the tangent to the model's own nodes."""
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
        local = np.bincount(self.rows, self.values * move[self.columns], move.size).astype(np.float64, copy=False)
        return self.ranks.sums(local)[0]

    def carried_along(self, displacement: Array, factor: float, step: float) -> Array:
        """Return the change of the forces ``(dofs,)``, linearised, as obstacles move by ``step`` from a factor."""
        if not self._moving.any():
            return np.zeros_like(displacement)
        forces = []
        # Points that come into contact between the two do not count in the derivative.
        for ahead in (_DELTA, 0.0):
            self.place(factor + ahead)
            forces.append(self.forces(displacement)[0])
        return step / _DELTA * (forces[0] - forces[1])

    @property
    def touching(self) -> int:
        """Number of active points of the last forces."""
        return int((self.packed.states["pressure"] > 0.0).sum())

    def push(self) -> float:
        """Return the sum of normal forces of all obstacles that move, of the last forces: the driving force."""
        firsts, loads = self.packed.passes["first_point"], self.packed.areas * self.packed.states["pressure"]
        each = np.add.reduceat(loads, firsts)
        return float(each[self._moving].sum())

    def obstacle_loads(self) -> Array:
        """Return force and moment of the obstacle of each contact, of the last forces, ``(contacts, 6)``.

        Moments are about its centre of rotation, or its point.
        """
        return loads_of(self.model, self.packed, self._friction, self.ranks)

    def results(self, displacement: Array, check: bool = False) -> list[ContactResult]:
        """Return the result of each contact at a displacement ``(dofs,)``; ``check``: with the error of points."""
        others = self._with_more_points(displacement) if check else ()
        uneven = self._unevenness(displacement) if check else ()
        self.packed.look_everywhere()
        self.forces(displacement)
        self.ranks.gather(self.packed, self.packed.points, self.packed.starts)
        if self.friction is not None:
            self.ranks.gather(self.packed, self._friction.tractions, self._friction.slipping)
        return measure(self.model, self.packed, self._friction, others, uneven)

    def _unevenness(self, displacement: Array) -> list[tuple[float, float]]:
        """Return distances of flat facets under pressure from curved ones, and of their points from rods at rest."""
        if not self.beyond.size:
            return []
        from isorod.contact.flatness import unevenness

        result, states = [], []
        for moved in (displacement, np.zeros_like(displacement)):
            self.packed.look_everywhere()
            self.forces(moved)
            states.append(self.packed.states.copy())
        for contact, _, chosen in of_contacts(self.model, self.packed):
            pressed = states[0]["pressure"][chosen] > 0.0
            if contact.facets is None or not pressed.any():
                result.append((0.0, np.inf))
                continue
            # Points that are far away have no gap.
            apart = np.nan_to_num(np.abs(states[1]["gap"][chosen][pressed]), nan=np.inf)
            sizes = unevenness(self.model, contact)
            result.append((float(np.repeat(sizes, pressed.size // sizes.size)[pressed].max()), float(apart.max())))
        return result

    def _with_more_points(self, displacement: Array) -> list[tuple[float, float] | None]:
        """Return force and largest pressure of each contact with 1.5 times as many points, None if at the limit."""
        finer = [tuple(min(MAX_POINTS, count + (count + 1) // 2) for count in pair) for pair in self.points]
        packed = self._packed([(pair[0], pair[1]) for pair in finer])
        positions = self._positions(displacement)
        self._pressures(packed, positions, np.zeros_like(positions))
        result: list[tuple[float, float] | None] = []
        for _, passes, chosen in of_contacts(self.model, packed):
            pressure = packed.states["pressure"][chosen]
            same = all(finer[k] == self.points[k] for k in passes)
            result.append(None if same else (float(packed.areas[chosen] @ pressure), float(pressure.max(initial=0.0))))
        return result

    def _fresh(self) -> Packed:
        """Return tables without history."""
        return self.ranks.split(pack(self.model, self.points, self._in_motion))

    def _packed(self, points: list[tuple[int, int]]) -> Packed:
        """Return tables with other points, with the present multipliers and penalties."""
        packed = self.ranks.split(pack(self.model, points))
        for name in ("penalty", *PLACED):
            packed.passes[name] = self.packed.passes[name]
        packed.multipliers[:] = cells.moved(self.packed, self.packed.multipliers, packed)
        return packed

    def look(self, points: list[tuple[int, int]]) -> None:
        """Set the points round an arc and along an element of each pass, without history."""
        if points != self.points:
            self.points = points
            self._take(self._fresh())

    def see_better(self, displacement: Array, between: bool, chosen: Collection[int] | None = None) -> bool:
        """Increase points that the user did not set, if too few are across a patch; return whether there are more.

        With ``between``, also where nothing touches but might between points.  Contacts are those ``chosen``, or all.
        """
        self.forces(displacement)
        if not self.packed.states["pressure"].any():
            # Gaps of points that do not touch have not been computed.
            np.minimum(self.packed.clear, self.packed.travel[0], out=self.packed.clear)
            self.forces(displacement)
        # The width of a patch on facets follows from the elements that they touch.
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
        """Continue with other points, with multipliers, penalties and friction of the former ones."""
        self.points = points
        self._take(self._packed(points))

    def settled(self) -> Settled:
        """Return points, multipliers and penalties at the end of a solution."""
        return Settled(self.points, self.packed.multipliers.copy(), self.packed.passes["penalty"].copy())

    def keep(self) -> Callable[[], None]:
        """Return a function that resets points, multipliers, penalties and friction to their present state."""
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
        """Continue with other points."""
        self.packed = packed
        if self.friction is not None:
            self.friction.take(packed)

    def excess(self, displacement: Array) -> list[tuple[float, str]]:
        """Return, of each contact whose penetration is limited, its ratio to the limit, and a message with both."""
        self.forces(displacement)
        result = []
        for k, (contact, _, points) in enumerate(of_contacts(self.model, self.packed)):
            limit, states = self._limit(contact), self.packed.states[points]
            if np.isfinite(limit):
                depth = max(0.0, -float(states["gap"][states["pressure"] > 0.0].min(initial=0.0)))
                result.append((depth / limit, f"contact {k}: penetration {depth:.3g}, need {limit:.3g} at most,"))
        return result

    def augment(self, displacement: Array, in_cells: bool) -> None:
        """Make pressures the multipliers of contacts whose penetration is limited, or add to these by cells."""
        self.forces(displacement)
        pressure = self.packed.states["pressure"]
        if in_cells:
            # The first multipliers are the pressures; what is added to them is constant within a cell.
            former = np.where(pressure > 0.0, self.packed.multipliers, 0.0)
            if former.any():
                pressure = np.maximum(0.0, former + cells.means(self.packed, pressure - former))
        for contact, _, points in of_contacts(self.model, self.packed):
            if np.isfinite(self._limit(contact)):
                self.packed.multipliers[points] = pressure[points]

    def stiffen(self, times: float) -> None:
        """Raise penalties that the user did not set."""
        for contact, passes, _ in of_contacts(self.model, self.packed):
            if contact.penalty is None:
                self.packed.passes["penalty"][passes.start : passes.stop] *= times
        self.stiffness *= times

    @property
    def has_defaults(self) -> bool:
        """Whether the user did not set the penalty of a contact."""
        return any(contact.penalty is None for contact in self.model.contacts)

    def _limit(self, contact: Contact) -> float:
        """Return the largest allowed penetration of a contact."""
        if contact.penetration is not None:
            return contact.penetration
        return np.inf if contact.penalty is not None else _DEEPEST * smallest_radius(self.model, contact)
