"""Direct solver of banded systems, by LAPACK, as a PETSc preconditioner.

Numbered layer by layer, the matrix of a rod has all its entries in a band round its diagonal.  Within the band nearly
all are there, so that dense blocks of it can be factorised at once: several times as fast as PETSc's own factorisation,
row by row, and without the analysis that a solver for any sparsity begins with.

Options ``-pc_type python -pc_python_type isorod.petsc.banded.Banded`` name it; it is what isorod offers where it suits
(`isorod.assembly.factorisation.suits`).
"""

import atexit
import weakref
from typing import Any

import numpy as np
from numba import i8, void
from petsc4py import PETSc
from scipy.linalg import lapack

from isorod.arrays import Array
from isorod.compiled import F1, F2, STRICT, njit
from isorod.petsc.library import forget, set_singular
from isorod.petsc.matrix import P1, compressed_rows

NAME = f"{__name__}.Banded"

# Those that a preconditioner still has.
_ALIVE: "weakref.WeakSet[Banded]" = weakref.WeakSet()


class Banded:
    """Factors of a symmetric matrix: Cholesky's or, if it is not positive definite, LU's with row exchanges."""

    def __init__(self) -> None:
        self._band: Array | None = None
        self._pivots: Any = None
        self.handle = 0

    def create(self, pc: PETSc.PC) -> None:
        """Remember whose this is."""
        self.handle = pc.handle
        _ALIVE.add(self)

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise the matrix of a PETSc preconditioner; a singular one makes the solve fail."""
        _, matrix = pc.getOperators()
        start, column, values = compressed_rows(matrix)
        width = _bandwidth(start, column)
        lower = _lower_band(start, column, values, width)
        self._pivots = None
        self._band, info = lapack.dpbtrf(lower.T, lower=1, overwrite_ab=1)
        if info > 0:
            whole = _whole_band(_lower_band(start, column, values, width))
            self._band, self._pivots, info = lapack.dgbtrf(whole, width, width, overwrite_ab=1)
        set_singular(pc, info > 0)

    def apply(self, pc: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve for one right-hand side."""
        assert self._band is not None
        if self._pivots is None:
            found, _ = lapack.dpbtrs(self._band, right.array_r, lower=1)
        else:
            width = (self._band.shape[0] - 1) // 3
            found, _ = lapack.dgbtrs(self._band, width, width, right.array_r, self._pivots)
        solution.array_w[:] = found

    # The matrix is symmetric.
    applyTranspose = apply


@njit(i8(P1, P1), **STRICT)
def _bandwidth(start: Any, column: Any) -> int:
    """Return how far the entries of compressed rows reach from the diagonal to the left."""
    width = 0
    for i in range(start.size - 1):
        if start[i + 1] > start[i]:
            width = max(width, i - column[start[i]])
    return width


def _lower_band(start: Any, column: Any, values: Array, width: int) -> Array:
    """Return what `_fill_band` makes of a matrix."""
    result = np.zeros((start.size - 1, width + 1))
    _fill_band(start, column, values, result)
    return result


@njit(void(P1, P1, F1, F2), **STRICT)
def _fill_band(start: Any, column: Any, values: Array, result: Array) -> None:
    """Fill in the entries on and below the diagonal, shape ``(n, width + 1)``.

    Row ``j`` holds column ``j`` from the diagonal on.  The entries are read off above the diagonal, where those of a
    column are a row and lie side by side.
    """
    for j in range(start.size - 1):
        for k in range(start[j + 1] - 1, start[j] - 1, -1):
            i = column[k]
            if i < j:
                break
            result[j, i - j] = values[k]


def _whole_band(lower: Array) -> Array:
    """Return the band of the symmetric matrix as LAPACK's dgbtrf takes it, with room for row exchanges."""
    n, width = lower.shape[0], lower.shape[1] - 1
    result = np.zeros((3 * width + 1, n), order="F")
    result[2 * width :] = lower.T
    for d in range(1, width + 1):
        result[2 * width - d, d:] = lower[: n - d, d]
    return result


@atexit.register
def _leave() -> None:
    """Take away from PETSc, which ends after Python, what it could then no longer destroy."""
    for one in list(_ALIVE):
        forget(one.handle)
