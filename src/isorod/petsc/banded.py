"""Direct solver of banded systems, by LAPACK, as a PETSc preconditioner, on any number of ranks.

Numbered layer by layer, the matrix of a rod has all its entries in a band round its diagonal.  Within the band nearly
all are there, so that dense blocks of it can be factorised at once: several times as fast as PETSc's own factorisation,
row by row, and without the analysis that a solver for any sparsity begins with.

Options ``-pc_type python -pc_python_type isorod.petsc.banded.Banded`` name it; it is what isorod offers where it suits
(`isorod.assembly.factorisation.suits`).
"""

import atexit
import weakref

from petsc4py import PETSc

from isorod.petsc.library import forget, set_singular
from isorod.petsc.shared_band import SharedFactors

NAME = f"{__name__}.Banded"

# Those that a preconditioner still has.
_ALIVE: "weakref.WeakSet[Banded]" = weakref.WeakSet()


class Banded:
    """Factors of a symmetric matrix: those of `isorod.petsc.band` or, where these are refused, LU with row exchanges.

    On one rank alone LU's are made: there they take three times the memory, gathered from several ranks all of it.
    """

    def __init__(self) -> None:
        self._factors = SharedFactors()
        self.handle = 0

    def create(self, pc: PETSc.PC) -> None:
        """Remember whose this is."""
        self.handle = pc.handle
        _ALIVE.add(self)

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of what was factorised; None where rows were exchanged."""
        return self._factors.negative

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise the matrix of a PETSc preconditioner; a singular one makes the solve fail."""
        _, matrix = pc.getOperators()
        set_singular(pc, not self._factors.factorise(matrix))

    def apply(self, pc: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve for one right-hand side."""
        solution.array_w[:] = self._factors.solve(right.array_r)
        if self._factors.negative:
            # Without row exchanges, factors of an indefinite matrix lose digits; the residual brings them back.
            _, matrix = pc.getOperators()
            residual = right.duplicate()
            matrix.mult(solution, residual)
            residual.aypx(-1.0, right)
            solution.array_w[:] += self._factors.solve(residual.array_r)
            residual.destroy()

    def matApply(self, pc: PETSc.PC, right: PETSc.Mat, solution: PETSc.Mat) -> None:
        """Solve for several right-hand sides, the columns of a dense matrix."""
        found = solution.getDenseArray()
        found[:] = self._factors.solve(right.getDenseArray())
        if self._factors.negative:
            _, matrix = pc.getOperators()
            residual = matrix.matMult(solution)
            found += self._factors.solve(right.getDenseArray() - residual.getDenseArray())
            residual.destroy()

    # The matrix is symmetric.
    applyTranspose = apply


def is_banded(pc: PETSc.PC) -> bool:
    """Return whether a preconditioner is such factors."""
    return pc.getType() == "python" and isinstance(pc.getPythonContext(), Banded)


@atexit.register
def _leave() -> None:
    """Take away from PETSc, which ends after Python, what it could then no longer destroy."""
    for one in list(_ALIVE):
        forget(one.handle)
