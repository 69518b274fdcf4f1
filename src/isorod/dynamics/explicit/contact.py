"""Contact in explicit steps: what the compiled steps take; loaded by models that have contacts."""

from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2
from isorod.contact import tables
from isorod.contact.packed import PACKED, Packed
from isorod.contact.passing import limits
from isorod.dynamics.explicit import end_faces
from isorod.dynamics.explicit.end_faces import FACES, Faces
from isorod.model.contact import refuse
from isorod.model.model import Model


class StepContact(NamedTuple):
    """All contacts of a model in motion.

    Attributes
    ----------
    packed, faces
        Contact of lateral surfaces, and of end faces.
    reference
        Coefficients of the undeformed bodies, numbered as the model's degrees of freedom, ``(dofs,)``.
    order
        Where each degree of freedom is in a state vector, ``(dofs,)``.
    positions, forces
        Work space, ``(nodes, 3)``.
    limits
        How deep points of each pass may be before they come out at the far side (`isorod.contact.passing`).
    """

    packed: Packed
    faces: Faces
    reference: Array
    order: NDArray[np.uint64]
    positions: Array
    forces: Array
    limits: Array


STEP_CONTACT = types.NamedTuple((PACKED, FACES, F1, types.Array(types.u8, 1, "C"), F2, F2, F1), StepContact)


def pack(model: Model, order: Index) -> StepContact:
    """Return the contacts of a model whose degrees of freedom are in this order in state vectors."""
    refuse(model.contacts, penetration=True, travel=True)
    reference = np.concatenate([body.space.positions for body in model.bodies])
    return StepContact(
        packed=tables.pack(model),
        faces=end_faces.pack(model),
        reference=reference.ravel(),
        order=order.astype(np.uint64),
        positions=np.empty_like(reference),
        forces=np.empty_like(reference),
        limits=np.repeat(limits(model), [len(contact.sides) for contact in model.contacts]),
    )
