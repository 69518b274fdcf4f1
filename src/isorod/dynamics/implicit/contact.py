"""Contact at the mean of the states at both ends of an implicit step; loaded by models that have contacts."""

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.contact.operator import ContactOperator
from isorod.contact.placing_kernel import obstacle_loads, obstacle_work
from isorod.model.contact import refuse_in_motion
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.contact.packed import Friction


class MidpointContact(ContactOperator):
    """Contact of a step, as functions of the displacement increment.

    Attributes
    ----------
    start
        Displacement of the model at the start of the step, followed by that of facets, shape ``(dofs,)``.
    span
        Begin and end of the step.
    """

    def __init__(self, model: Model, comm: PETSc.Comm) -> None:
        refuse_in_motion(model.contacts)
        super().__init__(model, comm, in_motion=True)
        self.start = np.zeros(model.dofs + self.beyond.size)
        self.span = 0.0, 0.0

    def use_history(self, friction: "Friction") -> None:
        """Keep the history of friction in the given arrays."""
        if self.friction is not None:
            self.friction.history = friction.anchors

    def begin(self, time: float, step: float) -> None:
        """Place moving obstacles for the middle of a step."""
        self.span = time, time + step
        super().place(time + 0.5 * step)

    def place(self, factor: float) -> None:
        """Do nothing: `begin` places obstacles."""

    def work(self) -> float:
        """Return the work of moving obstacles in the step, with the last forces."""
        loads = np.zeros((self.packed.passes.size, 6))
        obstacle_loads(self.packed, self._friction, loads)
        return float(self.ranks.sums(np.empty(0), obstacle_work(self.packed, loads, *self.span))[1][0])

    def _positions(self, displacement: Array) -> Array:
        return super()._positions(self.start + 0.5 * displacement)

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, the derivatives of the forces by the increment (see `isorod.contact.operator`)."""
        super().tangent(displacement)
        self.values *= 0.5
        return self.values
