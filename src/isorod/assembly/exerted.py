"""Reactions of supports of mean motions (`isorod.assembly.averages`)."""

from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.constraints import Constraints


def carried(constraints: Constraints, forces: Array, displacement: Array) -> dict[int, Array]:
    """Return forces and moments ``(k,)`` of each support of mean motions on the model, by its number.

    Parameters
    ----------
    forces
        Internal and inertial less external forces on all degrees of freedom.
    displacement
        Of all degrees of freedom.
    """
    # The generalised force is the work of a unit mean motion.
    held, first, result = constraints.offsets.T @ forces[constraints.slaves], 0, {}
    for k in constraints.held_means:
        count = len(constraints.means[k].rows)
        result[k] = held[first : first + count]
        first += count
    for k, one in constraints.means.items():
        if one.stiffness is not None:
            result[k] = -one.stiffness * one.moved(displacement)
    return result


def in_equilibrium(assembler: Assembler, x: PETSc.Vec, factor: float, acting: Array) -> dict[int, Array]:
    """Return `carried` for an equilibrium with nodal forces `acting`."""
    if not assembler.model.means:
        return {}
    assert assembler.coupling is not None
    return carried(assembler.coupling.constraints, acting, assembler.system_displacement(x, factor))
