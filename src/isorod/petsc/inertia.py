"""Inertia of symmetric matrices: signs of eigenvalues, by MUMPS and Sylvester's law."""

from petsc4py import PETSc


def prepare(pc: PETSc.PC) -> None:
    """Let a MUMPS Cholesky factorisation, before it is set up, count negative eigenvalues."""
    pc.setFactorSetUpSolverType()
    # MUMPS knows the inertia only if its root node is not ScaLAPACK's and it looks for zero pivots.
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(13, 1)
    factor.setMumpsIcntl(24, 1)
    # Room beyond its estimate, in per cent: on several ranks 20 can fall short by a little.
    factor.setMumpsIcntl(14, 50)


def count_negative(pc: PETSc.PC) -> int:
    """Return the number of negative eigenvalues of what was factorised."""
    return int(pc.getFactorMatrix().getInertia()[0])


def negative_eigenvalues(matrix: PETSc.Mat) -> int:
    """Return the number of negative eigenvalues of a symmetric matrix; options ``-sturm_...``."""
    pc = PETSc.PC().create(matrix.getComm())
    pc.setOptionsPrefix("sturm_")
    try:
        pc.setOperators(matrix)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        prepare(pc)
        pc.setFromOptions()
        pc.setUp()
        return count_negative(pc)
    finally:
        pc.destroy()
