"""Linear solves by factors of a matrix."""

from collections.abc import Mapping

from petsc4py import PETSc

from isorod.options import defaults

# Work space of MUMPS beyond its estimate, per cent.  On several ranks what it takes depends on which of them is first:
# with its own 20 one in three factorisations of the same matrix of 2,000 unknowns failed (INFOG(1) = -9).
WORK_SPACE = 200


def direct(matrix: PETSc.Mat, options: Mapping[str, object], prefix: str = "") -> PETSc.KSP:
    """Return a solver that factorises a matrix, unless options that begin with its prefix say otherwise.

    Parameters
    ----------
    matrix
        The matrix; its factors are made at the first solve.
    options
        Those of the preconditioner, as `isorod.assembly.factorisation` has them, with the prefix.
    """
    ksp = PETSc.KSP().create(matrix.getComm())
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    with defaults({f"{prefix}ksp_type": "preonly", **options}):
        ksp.setFromOptions()
    return ksp


def room(comm: PETSc.Comm, prefix: str = "") -> dict[str, object]:
    """Return the option that gives MUMPS work space enough on several ranks, which it reads when it begins."""
    return {f"{prefix}mat_mumps_icntl_14": WORK_SPACE} if comm.getSize() > 1 else {}
