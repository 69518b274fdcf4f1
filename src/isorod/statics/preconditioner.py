"""Data of a model for preconditioners: rigid motions, and the unknowns of rods and solids."""

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.checks.rigid_motions import near_null_space
from isorod.petsc.matrix import orthonormalise
from isorod.tensors import motions_of

if TYPE_CHECKING:
    from isorod.assembly.coupling import Coupling

_MULTIGRID = ("gamg", "ml", "hypre")


def prepare(assembler: Assembler, matrix: PETSc.Mat, pc: PETSc.PC) -> None:
    """Give multigrid the rigid motions of a model, and ``fieldsplit`` its fields, ``rods`` and ``solids``.

    The field ``solids`` has their rigid motions for its own multigrid.
    """
    if pc.getType() in _MULTIGRID:
        matrix.setNearNullSpace(near_null_space(assembler))
    if pc.getType() == "fieldsplit" and assembler.coupling is not None:
        rods, solids = assembler.coupling.fields()
        solids.compose("nearnullspace", _rigid_motions(assembler, assembler.coupling, solids))
        pc.setFieldSplitIS(("rods", rods), ("solids", solids))


def _rigid_motions(assembler: Assembler, coupling: "Coupling", field: PETSc.IS) -> PETSc.NullSpace:
    """Return the rigid motions of all solids on their unknowns."""
    vectors, nothing = [], np.zeros(assembler.model.dofs)
    for k, solid in enumerate(assembler.model.solids):
        for motion in motions_of(solid.positions, np.ones(len(solid.positions), dtype=bool)).T:
            motions = [np.zeros(3 * len(other.positions)) for other in assembler.model.solids]
            motions[k] = motion
            everywhere = assembler.state(nothing, (), motions)
            part = everywhere.getSubVector(field)
            vectors.append(part.copy())
            everywhere.restoreSubVector(field, part)
    return PETSc.NullSpace().create(vectors=orthonormalise(vectors), comm=assembler.comm)
