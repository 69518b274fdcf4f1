"""The load steps on the way to an equilibrium, and what is kept of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks.reactions import carried
from isorod.errors import whole_number


class Step(NamedTuple):
    """Where a load step ended.

    Its load factor, the forces of the supports on the model ``(supports, 3)``, the sum of the normal forces of
    obstacles that move, the supports' moments, and force and moment of the obstacle of each contact
    (`isorod.contact.operator.ContactOperator.obstacle_loads`).  Without friction, and where supports hold all bodies,
    multipliers are added at the full load alone, and what is before it is as the penalty says.  Displacement and
    pressures, as those of an `isorod.statics.Equilibrium`, are there where they are to be kept.
    """

    factor: float
    reactions: Array
    push: float = 0.0
    moments: Array = np.empty((0, 3))
    displacement: Array | None = None
    pressures: Sequence[Array | None] = ()
    obstacles: Array = np.empty((0, 6))


class Path:
    """The load steps taken.

    Parameters
    ----------
    assembler
        Of the model.
    keep
        Keep the state of each step, or of those that end at outputs, if there are any.
    outputs
        How many there are, at load factors evenly spaced.

    Attributes
    ----------
    outputs
        Their load factors.
    """

    def __init__(self, assembler: Assembler, keep: bool, outputs: int | None = None) -> None:
        self._assembler, self._keep = assembler, keep or outputs is not None
        count = 0 if outputs is None else whole_number("outputs", outputs, 1, 1_000_000)
        self.outputs = [(k + 1) / count for k in range(count)]
        self.steps = list[Step]()

    def reached(self, x: PETSc.Vec, factor: float) -> None:
        """Note where a step has ended; without contact, where nobody asks, the load factor alone."""
        assembler = self._assembler
        step = Step(factor, np.empty((0, 3)))
        keep = self._keep and (not self.outputs or factor in self.outputs)
        if keep or assembler.contact is not None:
            own = carried(assembler, x, factor)
            step = Step(factor, own.reactions, moments=own.moments)
            if assembler.contact is not None:
                loads = assembler.contact.obstacle_loads()
                step = step._replace(push=assembler.contact.push(), obstacles=loads)
        if keep:
            state = assembler.displacement(x, factor).copy(), assembler.pressures(x)
            step = step._replace(displacement=state[0], pressures=state[1])
        self.steps.append(step)
