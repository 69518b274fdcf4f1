"""Direct solver of banded systems, by LAPACK, as a PETSc preconditioner, on any number of ranks.

Numbered layer by layer, the matrix of a rod has all its entries in a band round its diagonal.  Within the band nearly
all are there, so that dense blocks of it can be factorised at once: several times as fast as PETSc's own factorisation,
row by row, and without the analysis phase of a general sparse solver.

Options ``-pc_type python -pc_python_type isorod.petsc.banded.Banded`` select it; it is isorod's default where it suits
(`isorod.assembly.factorisation.suits`).
"""

import atexit
import weakref

from petsc4py import PETSc

from isorod.petsc.library import forget, set_singular
from isorod.petsc.shared_band import DistributedFactors

NAME = f"{__name__}.Banded"

# Instances that a preconditioner still uses.
_ALIVE: "weakref.WeakSet[Banded]" = weakref.WeakSet()


class Banded:
    """Factors of a symmetric matrix: those of `isorod.petsc.band` or, where these are refused, LU with row exchanges.

    LU is on one rank alone: it takes three times the memory there, and from several ranks the whole matrix is gathered.
    """

    def __init__(self) -> None:
        self._factors = DistributedFactors()
        self.handle = 0

    def create(self, pc: PETSc.PC) -> None:
        """Keep the handle of the preconditioner."""
        self.handle = pc.handle
        _ALIVE.add(self)

    @property
    def negative(self) -> int | None:
        """Number of negative eigenvalues of the factorised matrix; None where rows were exchanged."""
        return self._factors.negative

    def setUp(self, pc: PETSc.PC) -> None:
        """Factorise the matrix of a PETSc preconditioner; a singular one makes the solve fail."""
        _, matrix = pc.getOperators()
        set_singular(pc, not self._factors.factorise(matrix))

    def apply(self, pc: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve for one right-hand side."""
        solution.array_w[:] = self._factors.solve(right.array_r)
        if self._factors.negative:
            # Iterative refinement: without row exchanges, factors of an indefinite matrix lose digits.
            _, matrix = pc.getOperators()
            residual = right.duplicate()
            matrix.mult(solution, residual)
            residual.aypx(-1.0, right)
            solution.array_w[:] += self._factors.solve(residual.array_r)
            residual.destroy()

    def matApply(self, pc: PETSc.PC, right: PETSc.Mat, solution: PETSc.Mat) -> None:
        """Solve for several right-hand sides, the columns of a dense matrix."""
        values = solution.getDenseArray()
        values[:] = self._factors.solve(right.getDenseArray())
        if self._factors.negative:
            _, matrix = pc.getOperators()
            residual = matrix.matMult(solution)
            values += self._factors.solve(right.getDenseArray() - residual.getDenseArray())
            residual.destroy()

    # The matrix is symmetric.
    applyTranspose = apply


def is_banded(pc: PETSc.PC) -> bool:
    """Return whether a preconditioner is `Banded`."""
    return pc.getType() == "python" and isinstance(pc.getPythonContext(), Banded)


@atexit.register
def _leave() -> None:
    """Detach the instances from PETSc, which ends after Python and could then not destroy them."""
    for one in list(_ALIVE):
        forget(one.handle)
