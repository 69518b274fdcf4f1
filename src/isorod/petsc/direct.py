"""Linear solves by factors of a matrix."""

from collections.abc import Mapping, Sequence

import numpy as np
from petsc4py import PETSc

from isorod.errors import SolveError
from isorod.options import defaults

# Work space of MUMPS beyond its estimate, per cent.  On several ranks the need varies from run to run: with the default
# 20 one in three factorisations of the same matrix of 2,000 unknowns failed (INFOG(1) = -9).
WORK_SPACE = 200

# Relative tolerance of iterative solvers: Newton's method needs fewer digits.
_LEFT = 1e-8


def direct(matrix: PETSc.Mat, options: Mapping[str, object], prefix: str = "") -> PETSc.KSP:
    """Return a solver that factorises a matrix, unless options with its prefix choose another.

    Parameters
    ----------
    matrix
        The matrix; its factors are made at the first solve.
    options
        Those of the preconditioner, with the prefix (`isorod.assembly.factorisation`).
    """
    ksp = PETSc.KSP().create(matrix.getComm())
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    with defaults({f"{prefix}ksp_type": "preonly", **options}):
        ksp.setFromOptions()
    return ksp


def room(comm: PETSc.Comm, prefix: str = "") -> dict[str, object]:
    """Return the option that gives MUMPS enough work space on several ranks, which it reads at its start."""
    return {f"{prefix}mat_mumps_icntl_14": WORK_SPACE} if comm.getSize() > 1 else {}


def refined(ksp: PETSc.KSP, forces: Sequence[PETSc.Vec]) -> list[PETSc.Vec]:
    """Return the solutions of several right-hand sides, with one step of iterative refinement.

    The factors are read from memory once for all of them.

    Raises
    ------
    SolveError
        If iterations do not converge.
    """
    if not forces:
        return []
    matrix, _ = ksp.getOperators()
    right = PETSc.Mat().createDense((forces[0].getSizes(), len(forces)), comm=ksp.getComm())
    right.setUp()
    right.getDenseArray()[:] = np.stack([one.array_r for one in forces], axis=1)
    right.assemble()
    solutions = _solved(ksp, right)
    left = matrix.matMult(solutions)
    left.aypx(-1.0, right)
    corrections = _solved(ksp, left)
    solutions.axpy(1.0, corrections)
    result = [force.duplicate() for force in forces]
    for one, column in zip(result, solutions.getDenseArray().T, strict=True):
        one.array_w[:] = column
    for mat in (right, solutions, corrections, left):
        mat.destroy()
    return result


def _solved(ksp: PETSc.KSP, right: PETSc.Mat) -> PETSc.Mat:
    """Return the solutions of the columns of a dense matrix."""
    solutions = right.duplicate()
    if ksp.getType() == "preonly":
        ksp.getPC().matApply(right, solutions)
        return solutions
    ksp.setTolerances(rtol=min(ksp.getTolerances()[0], _LEFT))
    force, solution = right.createVecLeft(), right.createVecLeft()
    for one, column in zip(right.getDenseArray().T, solutions.getDenseArray().T, strict=True):
        force.array_w[:] = one
        ksp.solve(force, solution)
        if ksp.getConvergedReason() < 0:
            raise SolveError(f"the linear solver failed (KSP reason {ksp.getConvergedReason()}); leave out -ksp_type")
        column[:] = solution.array_r
    return solutions
