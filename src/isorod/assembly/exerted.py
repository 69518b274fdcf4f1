"""What supports of mean motions (`isorod.assembly.averages`) exert on a model."""

from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.constraints import Constraints


def carried(constraints: Constraints, forces: Array, displacement: Array) -> dict[int, Array]:
    """Return force and moment ``(k,)`` of each of the supports of mean motions on the model, by its number.

    Parameters
    ----------
    forces
        Internal and inertial less external forces on all degrees of freedom.
    displacement
        Of all degrees of freedom.
    """
    # So much work it takes to move what is held by one.
    held, first, found = constraints.offsets.T @ forces[constraints.slaves], 0, {}
    for k in constraints.held_means:
        count = len(constraints.means[k].rows)
        found[k] = held[first : first + count]
        first += count
    for k, one in constraints.means.items():
        if one.stiffness is not None:
            found[k] = -one.stiffness * one.moved(displacement)
    return found


def in_equilibrium(assembler: Assembler, x: PETSc.Vec, factor: float, acting: Array) -> dict[int, Array]:
    """Return what `carried` does of an equilibrium and what is `acting` in it."""
    if not assembler.model.means:
        return {}
    assert assembler.coupling is not None
    return carried(assembler.coupling.constraints, acting, assembler.system_displacement(x, factor))
