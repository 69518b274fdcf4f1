"""The load steps on the way to an equilibrium, and what is kept of them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks.reactions import Carried, carried
from isorod.errors import whole_number
from isorod.model.past import Past

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult

# Outputs this near to a kink of a table are at it.
_SAME = 1e-9


class Step(NamedTuple):
    """Where a load step ended.

    Its load factor, the forces of the supports on the model ``(supports, 3)``, the sum of the normal forces of
    obstacles that move, the supports' moments, and force and moment of the obstacle of each contact
    (`isorod.contact.operator.ContactOperator.obstacle_loads`).  Without friction, and where supports hold all bodies,
    multipliers are added at the full load alone, and what is before it is as the penalty says; over time they are in
    each step.  Displacement, pressures and solids, as of an `isorod.statics.Equilibrium`, are there where they are
    to be kept.
    """

    factor: float
    reactions: Array
    push: float = 0.0
    moments: Array = np.empty((0, 3))
    displacement: Array | None = None
    pressures: Sequence[Array | None] = ()
    obstacles: Array = np.empty((0, 6))
    solids: Sequence[Array] = ()


class Turn(NamedTuple):
    """An equilibrium where a table goes on otherwise: its load factor, stored energy, and what an answer has of it."""

    factor: float
    energy: float
    displacement: Array
    pressures: Sequence[Array | None]
    solids: Sequence[Array]
    carried: Carried
    contacts: "Sequence[ContactResult]"


class Path:
    """The load steps taken.

    Parameters
    ----------
    assembler
        Of the model.
    keep
        Keep the state of each step, or of those that end at outputs, if there are any, or at kinks of tables.
    outputs
        How many there are, at load factors, or times, evenly spaced.

    Attributes
    ----------
    outputs
        Their load factors.
    most
        Over time the largest force, or moment over the model's size, of a support so far.
    past
        Equilibria that laws with memory have gone on from.
    largest
        The equilibrium of the most stored energy among those at kinks of tables so far.
    """

    def __init__(self, assembler: Assembler, keep: bool, outputs: int | None = None) -> None:
        self._assembler, self._keep = assembler, keep or outputs is not None
        self._times = assembler.model.times
        count = 0 if outputs is None else whole_number("outputs", outputs, 1, 1_000_000)
        self.outputs = [(k + 1) / count for k in range(count)]
        self._kept = set(self.outputs)
        if self._times is not None:
            places = [self._times.place(self._times.end * share) for share in self.outputs]
            stages = np.array(assembler.model.stages)
            near = stages[np.abs(np.subtract.outer(places, stages)).argmin(axis=1)] if places else stages[:0]
            self.outputs = np.where(np.abs(near - places) <= _SAME, near, places).tolist()
            self._kept = {*self.outputs, *assembler.model.stages}
        self.steps, self.past = list[Step](), list[Past]()
        self.most = 0.0
        self.largest: Turn | None = None

    def left(self, x: PETSc.Vec, factor: float) -> None:
        """Let laws with memory go on from an equilibrium, once: the step from there may be tried again."""
        if self._assembler.model.remembers and factor > (self.past[-1].factor if self.past else 0.0):
            self.past.append(Past(factor, self._assembler.displacement(x, factor).copy()))
            self._assembler.advance(x, factor)

    def reached(self, x: PETSc.Vec, factor: float) -> None:
        """Note where a step has ended; without contact and times, where nobody asks, the load factor alone."""
        assembler = self._assembler
        step = Step(factor, np.empty((0, 3)))
        keep = self._keep and (not self.outputs or factor in self._kept)
        if keep or assembler.contact is not None or self._times is not None:
            own = carried(assembler, x, factor)
            step = Step(factor, own.reactions, moments=own.moments)
            if assembler.contact is not None:
                loads = assembler.contact.obstacle_loads()
                step = step._replace(push=assembler.contact.push(), obstacles=loads)
            if self._times is not None:
                size = assembler.model.size
                self.most = max(self.most, np.abs(own.reactions).max(), np.abs(own.moments).max() / size)
                self._compare(x, factor, own)
        if keep:
            state = assembler.displacement(x, factor).copy(), assembler.pressures(x)
            step = step._replace(displacement=state[0], pressures=state[1], solids=assembler.solids(x, factor))
        self.steps.append(step)

    def _compare(self, x: PETSc.Vec, factor: float, own: Carried) -> None:
        """Keep a state at a kink of tables if it stores more than those before."""
        assembler = self._assembler
        if factor == 1.0 or factor not in assembler.model.stages:
            return
        energy = assembler.energy(x, factor)
        if self.largest is not None and not energy > self.largest.energy:
            return
        contacts: Sequence[ContactResult] = ()
        if assembler.contact is not None:
            undo = assembler.contact.keep()
            contacts = assembler.contact.results(assembler.touching(x, factor), check=True)
            undo()
        state = assembler.displacement(x, factor).copy(), assembler.pressures(x), assembler.solids(x, factor)
        self.largest = Turn(factor, energy, *state, own, contacts)
