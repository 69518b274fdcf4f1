"""Contact in the arrays of compiled explicit steps; loaded by models that have contacts."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import b1, types
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, I1, U1
from isorod.contact import facets, friction, tables
from isorod.contact import ranks as dealt
from isorod.contact.packed import FRICTION, PACKED, Friction, Packed
from isorod.contact.tunnelling import limits
from isorod.dynamics.explicit.ranks import Ranks
from isorod.model.contact import refuse_in_motion
from isorod.model.model import Model


class StepContact(NamedTuple):
    """All contacts of a model in motion.

    Attributes
    ----------
    packed, friction
        Contact of lateral surfaces, and its friction.
    reference
        Coefficients of the undeformed bodies, numbered as the model's degrees of freedom, ``(dofs,)``, followed by
        those of facets of finite element bodies, which move in implicit steps alone.
    order
        Place of each degree of freedom in a state vector, ``(dofs,)``, followed by those of facets.
    positions, forces
        Work space of all nodes of contact (`isorod.contact.packed`), ``(., 3)``.
    limits
        Largest penetration of each pass before points come out at the far side (`isorod.contact.tunnelling`).
    carries
        1 for control points, else 0: the resultant is the sum of their forces, ``(nodes,)``.
    shared
        The model's nodes of contact surfaces, exchanged between ranks.
    mine
        Whether this rank owns a node, ``(nodes,)``.
    call, own, all
        Exchange between ranks: the call (`isorod.dynamics.explicit.exchange_kernel.MassFactors`), three components of
        the ``shared`` nodes' displacements or forces followed by `NUMBERS`, of this rank and the sums.
    """

    packed: Packed
    friction: Friction
    reference: Array
    order: NDArray[np.uint64]
    positions: Array
    forces: Array
    limits: Array
    carries: Array
    shared: Index
    mine: NDArray[np.bool_]
    call: NDArray[np.uint64]
    own: Array
    all: Array


# Numbers that follow the forces: those of `isorod.dynamics.explicit.exchange_kernel`, then energy, force and area, and
# whether a penetration is too large.
CONTACT_ENERGY, FORCE, AREA, TOO_DEEP, NUMBERS = 2, 3, 4, 5, 6

_STRUCTURES = (PACKED, FRICTION)
STEP_CONTACT = types.NamedTuple(
    (*_STRUCTURES, F1, U1, F2, F2, F1, F1, I1, types.Array(b1, 1, "C"), U1, F1, F1), StepContact
)


def pack(
    model: Model, order: Index, ranks: Ranks | None = None, points: Sequence[tuple[int, int]] | None = None
) -> StepContact:
    """Return the contacts of a model, split over ranks, with degrees of freedom in this order in state vectors.

    ``points`` are as for `isorod.contact.tables.pack`.
    """
    ranks = Ranks(model, order) if ranks is None else ranks
    refuse_in_motion(model.contacts)
    nodes, places = facets.nodes_of(model)
    reference = np.concatenate([*(body.space.positions for body in model.bodies), places])
    # The first rank owns the facets.
    mine = np.append(ranks.owned[::3], np.full(nodes.size, ranks.rank == 0))
    packed = dealt.Ranks(ranks.communicator).split(tables.pack(model, points, in_motion=True))
    control_points, lifts = packed.control_points, packed.lifts
    shared = [control_points[control_points < len(reference)]]
    shared += [each["first_node"] + np.arange(each["layers"] * each["functions"]) for each in lifts]
    known = np.unique(np.concatenate(shared))
    size = 3 * known.size + NUMBERS
    return StepContact(
        packed=packed,
        friction=friction.pack(model, packed),
        reference=reference.ravel(),
        order=np.append(order, order.size + np.arange(3 * nodes.size)).astype(np.uint64),
        positions=np.empty_like(packed.before),
        forces=np.empty_like(packed.before),
        limits=np.repeat(limits(model), [contact.passes for contact in model.contacts]),
        carries=model.is_control_point.astype(float),
        shared=known,
        mine=mine,
        call=ranks.call(),
        own=np.zeros(size),
        all=np.zeros(size),
    )
