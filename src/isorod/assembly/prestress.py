"""Geometric stiffness of a stress: ``G_jl,km = int S_l,A R_j sigma_AB S_m,B R_k dV`` of each component.

With the linear stress of the loads at rest, and the load stiffness of follower pressures, it is the change of the
tangent in classical, linear buckling.  Displacements before buckling are neglected: with rotating bodies, their first
order in a tangent in fixed axes would be wrong.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array
from isorod.assembly.part import Part
from isorod.assembly.pattern import Pattern, add
from isorod.space.space import Table

if TYPE_CHECKING:
    from isorod.assembly.follower import FollowerLoads


def entries(
    parts: Sequence[Part], pattern: Pattern, states: Sequence[Array], step: float, pressing: "Sequence[FollowerLoads]"
) -> Array:
    """Return the entries of a pattern.

    Parameters
    ----------
    parts
        The elements of this rank.
    pattern
        That of the tangent.
    states
        States of this rank at load factors ``-step``, 0 and ``step``.
    step
        A small load factor.
    pressing
        Follower loads on each part, if there are any.
    """
    before, rest, after = states
    result = np.zeros(pattern.total)
    for k, (part, blocks) in enumerate(zip(parts, pattern.blocks, strict=True)):
        add(_of_part(part, before, after, step), blocks, result)
        if pressing:
            followed = part.padded_matrices(pressing[k].stiffness(part.nodal(rest)))
            add(-followed.reshape(*part.dofs.shape, -1), blocks, result)
    return result


def _of_part(part: Part, before: Array, after: Array, step: float) -> Array:
    """Return the geometric stiffness of a part's elements, ``(E, l width, l width)``."""
    # Thermal strains grow with the load factor, too.
    ends = (part.laws.at(f).stress(part.gradients(one)) for f, one in ((-step, before), (step, after)))
    stress = np.subtract(*reversed(list(ends)))
    pressure = part.pressure(after) - part.pressure(before)
    if pressure.size:
        stress += pressure[..., None, None] * np.eye(3)
    # The unsymmetric part of a stress at rest is rounding.
    stress = (stress + np.swapaxes(stress, -1, -2)) / (4.0 * step)
    scalar = np.stack([_scalar(part.table, stress, e) for e in range(part.table.elements)])
    size = 3 * scalar.shape[1]
    whole = np.einsum("eij,ab->eiajb", scalar, np.eye(3)).reshape(-1, size, size)
    return part.padded_matrices(whole).reshape(*part.dofs.shape, -1)


def _scalar(table: Table, stress: Array, element: int) -> Array:
    """Return the matrix ``(l n, l n)`` of one component of an element."""
    inverse, weights = table.inverse[element], table.weights[element]
    across = np.einsum("qdn,tqda->tqna", table.section[:, :2], inverse[:, :, :2])
    along = np.einsum("qn,tqa->tqna", table.section[:, 2], inverse[:, :, 2])
    gradients = np.einsum("tj,tqna->tqajn", table.axial[element], across)
    gradients += np.einsum("tj,tqna->tqajn", table.slopes[element], along)
    pulled = np.einsum("tqab,tqbjn->tqajn", weights[..., None, None] * stress[element], gradients)
    functions = gradients.shape[3] * gradients.shape[4]
    return np.asarray(gradients.reshape(-1, functions).T @ pulled.reshape(-1, functions))
