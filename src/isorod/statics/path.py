"""The load steps of an equilibrium, and their recorded results."""

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

# Outputs this close to a kink of a table are moved to it.
_SAME = 1e-9


class Step(NamedTuple):
    """The end of a load step.

    Its load factor, the forces of the supports on the model ``(supports, 3)``, the sum of the normal forces of moving
    obstacles, the supports' moments, and force and moment of the obstacle of each contact
    (`isorod.contact.operator.ContactOperator.obstacle_loads`).  Without friction, and where supports hold all bodies,
    multipliers are updated at the full load alone, and steps before it are by the penalty method; over time they are
    updated in each step.  Displacement, pressures and solids, as of an `isorod.statics.Equilibrium`, are given where
    states are kept.
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
    """An equilibrium at a kink of a table: its load factor, stored energy, and results."""

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
        Assembler of the model.
    keep
        Keep the state of each step or, if there are outputs, of those at outputs and kinks of tables.
    outputs
        Number of outputs, evenly spaced in load factor or time.

    Attributes
    ----------
    outputs
        Load factors of the outputs.
    most
        Over time the largest force, or moment over the model's size, of a support so far.
    past
        Equilibria at the starts of steps, for laws with memory.
    largest
        The equilibrium of largest stored energy at kinks of tables so far.
    """

    def __init__(self, assembler: Assembler, keep: bool, outputs: int | None = None) -> None:
        self._assembler, self._keep = assembler, keep or outputs is not None
        self._times = assembler.model.times
        count = 0 if outputs is None else whole_number("outputs", outputs, 1, 1_000_000)
        self.outputs = [(k + 1) / count for k in range(count)]
        self._kept = set(self.outputs)
        if self._times is not None:
            places = [self._times.place(self._times.end * fraction) for fraction in self.outputs]
            stages = np.array(assembler.model.stages)
            near = stages[np.abs(np.subtract.outer(places, stages)).argmin(axis=1)] if places else stages[:0]
            self.outputs = np.where(np.abs(near - places) <= _SAME, near, places).tolist()
            self._kept = {*self.outputs, *assembler.model.stages}
        self.steps, self.past = list[Step](), list[Past]()
        self.most = 0.0
        self.largest: Turn | None = None

    def left(self, x: PETSc.Vec, factor: float) -> None:
        """Let laws with memory accept the equilibrium at the start of a step, once: the step may be repeated."""
        if self._assembler.model.remembers and factor > (self.past[-1].factor if self.past else 0.0):
            self.past.append(Past(factor, self._assembler.displacement(x, factor).copy()))
            self._assembler.advance(x, factor)

    def reached(self, x: PETSc.Vec, factor: float) -> None:
        """Record the end of a step; without contact and times only the load factor, unless states are kept."""
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
        """Keep a state at a kink of a table if it stores more energy than those before."""
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
