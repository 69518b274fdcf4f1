"""Inertia of symmetric matrices."""

from petsc4py import PETSc


def negative_eigenvalues(matrix: PETSc.Mat) -> int:
    """Return the number of negative eigenvalues of a symmetric matrix (Sylvester's law of inertia), by MUMPS; options ``-sturm_...``."""
    pc = PETSc.PC().create(matrix.getComm())
    pc.setOptionsPrefix("sturm_")
    try:
        pc.setOperators(matrix)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        # MUMPS knows the inertia only if its root node is not ScaLAPACK's and it looks for zero pivots.
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(13, 1)
        factor.setMumpsIcntl(24, 1)
        pc.setFromOptions()
        pc.setUp()
        negative, _, _ = factor.getInertia()
        return int(negative)
    finally:
        pc.destroy()
