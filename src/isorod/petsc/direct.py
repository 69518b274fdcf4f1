"""Linear solves by factors of a matrix."""

from collections.abc import Mapping

from petsc4py import PETSc

from isorod.options import defaults


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
