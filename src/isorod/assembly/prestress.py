"""Geometric stiffness of a stress: ``G_jl,km = int S_l,A R_j sigma_AB S_m,B R_k dV`` of each component.

With the stress by which a model at rest begins to bear its loads, and the load stiffness of pressures that follow, it
is what classical, linear buckling takes for the change of the tangent.  Displacements before buckling are left out:
where bodies turn, a tangent in fixed axes does not survive their first order.
"""

import numpy as np

from isorod.arrays import Array
from isorod.assembly.part import Part
from isorod.space.space import Table


def geometric_stiffness(part: Part, before: Array, after: Array, step: float) -> Array:
    """Return the matrices ``(E, l width, l width)`` of a part.

    Parameters
    ----------
    part
        The elements.
    before, after
        States of this rank, a short way ``step`` of the load factor before the state at rest and behind it.
    step
        That way.
    """
    ends = (part.laws.at(0.0).stress(part.gradients(one)) for one in (before, after))
    stress = np.subtract(*reversed(list(ends)))
    pressure = part.pressure(after) - part.pressure(before)
    if pressure.size:
        stress += pressure[..., None, None] * np.eye(3)
    # Of a stress at rest what is not symmetric is rounding.
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
