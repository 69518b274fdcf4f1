"""Inertia of symmetric matrices by Sylvester's law from factors: a band's, LAPACK's or MUMPS'."""

import numpy as np
from petsc4py import PETSc
from scipy.linalg import lapack

from isorod.petsc.band import Factors
from isorod.petsc.band_kernel import Ordered
from isorod.petsc.banded import is_banded
from isorod.petsc.direct import WORK_SPACE
from isorod.petsc.rows import Compressed, local_rows
from isorod.petsc.shared_band import DistributedFactors

# Up to so many rows a dense factorisation takes less time than MUMPS' (measured on blades: 243 rows, 1.5 against 3.2
# ms; 486 rows, 5.3 against 7.5 ms).
_DENSE = 500
_BLOCK = 32

# Where a band's factors have more than so many times the matrix' entries, MUMPS is used.
_FILL = 2.0

_PREFIX = "sturm_"

# With this option, read at MUMPS' start, its factors of a symmetric matrix give the number of negative eigenvalues on
# any number of ranks.
COUNT_NEGATIVE = {"mat_mumps_icntl_13": 1}


def prepare(pc: PETSc.PC) -> None:
    """Let a MUMPS Cholesky factorisation, before it is set up, count negative eigenvalues."""
    pc.setFactorSetUpSolverType()
    # MUMPS knows the inertia only if its root node is not ScaLAPACK's and it looks for zero pivots.
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(13, 1)
    factor.setMumpsIcntl(24, 1)
    factor.setMumpsIcntl(14, WORK_SPACE)


def is_factored(pc: PETSc.PC) -> bool:
    """Return whether a preconditioner is a direct solver."""
    return is_banded(pc) or pc.getType() in (PETSc.PC.Type.LU, PETSc.PC.Type.CHOLESKY)


def of_factors(pc: PETSc.PC) -> int | None:
    """Return the number of negative eigenvalues from a direct solver's present factors; None if not known."""
    if is_banded(pc):
        negative: int | None = pc.getPythonContext().negative
        return negative
    if pc.getType() != PETSc.PC.Type.CHOLESKY or pc.getFactorSolverType() != "mumps":
        return None
    factor = pc.getFactorMatrix()
    # With ScaLAPACK at the root node it is not known (`COUNT_NEGATIVE`).
    known = factor.getComm().getSize() == 1 or factor.getMumpsIcntl(13) == 1
    return int(factor.getMumpsInfog(12)) if known else None


def count_negative(pc: PETSc.PC) -> int:
    """Return the number of negative eigenvalues of the matrix factorised by MUMPS or as a band."""
    if is_banded(pc):
        negative = pc.getPythonContext().negative
        return negative_eigenvalues(pc.getOperators()[1]) if negative is None else int(negative)
    return int(pc.getFactorMatrix().getInertia()[0])


def negative_eigenvalues(matrix: PETSc.Mat) -> int:
    """Return the number of negative eigenvalues of a symmetric matrix, options ``-sturm_...``.

    Without such options a banded matrix is factorised as a band, without keeping the factors.
    """
    factors = DistributedFactors()
    if not _typed() and factors.eliminate(matrix, keep=False, fill=_FILL):
        assert factors.negative is not None
        return factors.negative
    if matrix.getType() == "seqaij" and matrix.getSize()[0] <= _DENSE:
        return _negative_dense(matrix)
    pc = PETSc.PC().create(matrix.getComm())
    pc.setOptionsPrefix(_PREFIX)
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


def negative_of_rows(rows: Compressed) -> int | None:
    """Return `negative_eigenvalues` from all rows, on one rank; the upper triangle suffices.

    None where a band's factors cannot be used.
    """
    factors, size = Factors(), rows.start.size - 1
    if _typed() or not factors.factorise(Ordered(rows, 0, size), size, keep=False, fill=_FILL):
        return None
    return factors.negative


def _typed() -> bool:
    return any(name.startswith(_PREFIX) for name in PETSc.Options().getAll())


def _negative_dense(matrix: PETSc.Mat) -> int:
    """Return the number of negative eigenvalues, by Bunch's and Kaufman's factorisation."""
    start, column, values = local_rows(matrix).own
    n = start.size - 1
    dense = np.zeros((n, n))
    dense[np.repeat(np.arange(n), np.diff(start)), column] = values
    # The transpose has the upper triangle below the diagonal.
    factors, pivots, _ = lapack.dsytrf(dense.T, lower=1, lwork=_BLOCK * n, overwrite_a=1)
    single = pivots > 0
    # A block of two rows has an eigenvalue of either sign.
    return int(np.count_nonzero(factors.diagonal()[single] < 0.0) + np.count_nonzero(~single) // 2)
