"""Contact in explicit steps: what the compiled steps take; loaded by models that have contacts."""

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
from isorod.contact.passing import limits
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
        Coefficients of the undeformed bodies, numbered as the model's degrees of freedom, ``(dofs,)``; those of facets
        of finite element bodies behind them, which move in implicit steps alone.
    order
        Where each degree of freedom is in a state vector, ``(dofs,)``; those of facets behind the others.
    positions, forces
        Work space of all nodes that contact knows (`isorod.contact.packed`), ``(., 3)``.
    limits
        How deep points of each pass may be before they come out at the far side (`isorod.contact.passing`).
    carries
        1 for the nodes whose functions add up to one, else 0: their forces make the resultant, ``(nodes,)``.
    shared
        The model's nodes that carry surfaces.
    mine
        Which nodes are this rank's, ``(nodes,)``.
    call, own, all
        What ranks tell each other: how (`isorod.dynamics.explicit.exchange_kernel.MassFactors`), three components of
        the shared nodes' displacements or forces and `NUMBERS` behind, of this rank and the sums.
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


# Numbers behind the forces: those of `isorod.dynamics.explicit.exchange_kernel`, then energy, force and area, and
# whether a point is too deep.
CONTACT_ENERGY, FORCE, AREA, TOO_DEEP, NUMBERS = 2, 3, 4, 5, 6

_STRUCTURES = (PACKED, FRICTION)
STEP_CONTACT = types.NamedTuple(
    (*_STRUCTURES, F1, U1, F2, F2, F1, F1, I1, types.Array(b1, 1, "C"), U1, F1, F1), StepContact
)


def pack(
    model: Model, order: Index, ranks: Ranks | None = None, points: Sequence[tuple[int, int]] | None = None
) -> StepContact:
    """Return the contacts of a model whose degrees of freedom are in this order in state vectors, shared by ranks.

    ``points`` are as for `isorod.contact.tables.pack`.
    """
    ranks = Ranks(model, order) if ranks is None else ranks
    refuse_in_motion(model.contacts)
    nodes, places = facets.nodes_of(model)
    reference = np.concatenate([*(body.space.positions for body in model.bodies), places])
    # The first rank has the forces on facets.
    mine = np.append(ranks.owned[::3], np.full(nodes.size, ranks.rank == 0))
    packed = dealt.Ranks(ranks.communicator).split(tables.pack(model, points, in_motion=True))
    control_points, lifts = packed.control_points, packed.lifts
    shared = [control_points[control_points < len(reference)]]
    shared += [one["first_node"] + np.arange(one["layers"] * one["functions"]) for one in lifts]
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
