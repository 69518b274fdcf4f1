"""Contact at the mean of the states at both ends of an implicit step; loaded by models that have contacts."""

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.contact.operator import ContactOperator
from isorod.contact.result import doubts
from isorod.model.contact import refuse_in_motion
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.contact.packed import Friction


class MidpointContact(ContactOperator):
    """Contact of a step, as functions of the change of the displacement.

    Attributes
    ----------
    start
        Displacement at the start of the step, that of facets behind that of the model, shape ``(dofs,)``.
    """

    long_steps = False

    def __init__(self, model: Model, comm: PETSc.Comm) -> None:
        refuse_in_motion(model.contacts)
        super().__init__(model, comm)
        self.start = np.zeros(model.dofs + self.beyond.size)

    def share(self, friction: "Friction") -> None:
        """Keep the history of friction there."""
        if self.friction is not None:
            self.friction.history = friction.anchors

    def _positions(self, displacement: Array) -> Array:
        return super()._positions(self.start + 0.5 * displacement)

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, the derivatives of the forces by the change (see `isorod.contact.operator`)."""
        super().tangent(displacement)
        self.values *= 0.5
        return self.values


def doubts_of_facets(model: Model, comm: PETSc.Comm, displacement: Array) -> list[str]:
    """Return what is not to be trusted where rods press on facets, in a state of a motion; collective.

    Parameters
    ----------
    model, comm
        The model, over a communicator.
    displacement
        What contact takes, shape ``(dofs + b,)``.
    """
    return doubts(model, ContactOperator(model, comm).results(displacement, check=True), facets=True)
