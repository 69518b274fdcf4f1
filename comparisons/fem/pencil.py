"""The eigenproblem ``K x = lambda M x`` of a finite element model, in PETSc and SLEPc alone."""

from time import perf_counter
from typing import Any

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from isorod.errors import SolveError
from isorod.petsc.inertia import negative_eigenvalues
from meshes.mesh import Array

# Eigensolvers that take a preconditioner instead of a spectral transformation.
PRECONDITIONED = ("lobpcg", "rqcg", "gd", "jd")

# The inertia is taken this far (relative) above the last eigenvalue returned.
_ABOVE = 1e-6

# Rounds of deflation until no eigenvalue is missing.
_ROUNDS = 12


class Pencil:
    """Stiffness ``K``, positive definite or with rigid motions, and mass ``M``, at least semidefinite.

    Parameters
    ----------
    stiffness
        Symmetric matrix; only its upper triangle may be stored.
    mass
        A matrix to multiply with; of the stiffness's type and sparsity if there is a shift.
    """

    def __init__(self, stiffness: PETSc.Mat, mass: PETSc.Mat) -> None:
        self.stiffness, self.mass = stiffness, mass
        self.comm = stiffness.getComm()
        self.found: list[tuple[float, PETSc.Vec]] = []
        self.iterations = 0
        self.checking = 0.0

    def _eps(self, count: int, shift: float) -> SLEPc.EPS:
        eps = SLEPc.EPS().create(self.comm)
        eps.setOperators(self.stiffness, self.mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setDimensions(min(count, self.stiffness.getSize()[0]))
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(shift)
        eps.getST().setShift(shift)
        eps.getST().setMatStructure(PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        return eps

    def first_flexible(self, rigid: int) -> float:
        """Return a rough value of the first eigenvalue above the rigid modes of a free body."""
        guess = 1e-8 * self.stiffness.getDiagonal().sum() / self.mass.getDiagonal().sum()
        for _ in range(8):
            eps = self._eps(rigid + 2, -guess)
            eps.setTolerances(1e-4)
            eps.getST().setType(SLEPc.ST.Type.SINVERT)
            ksp = eps.getST().getKSP()
            ksp.setType(PETSc.KSP.Type.PREONLY)
            ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
            ksp.getPC().setFactorSolverType("mumps")
            eps.solve()
            values = sorted(eps.getEigenvalue(k).real for k in range(eps.getConverged()))
            eps.destroy()
            if len(values) <= rigid:
                break
            # Too far below zero, the shift makes rigid and flexible modes look alike.
            if values[rigid] > 0.01 * guess:
                return float(values[rigid])
            guess = max(10.0 * abs(values[rigid]), 1e-3 * guess)
        raise SolveError("modes of a free body: no flexible mode was found to place the shift by; give one (-st_shift)")

    def solve(self, wanted: int, shift: float, count_mass: PETSc.Mat | None) -> int | None:
        """Find the lowest ``wanted`` eigenvalues, as the options say.

        Returns the number of eigenvalues up to just above the last one, by Sylvester's law of inertia; those it shows
        to be missing are solved for with the others deflated.  ``count_mass`` is the mass with the type and sparsity of
        the stiffness; without it nothing is counted and None returned.
        """
        # One more than wanted, so that the last one seldom lacks its twin.
        eps = self._eps(wanted + 1, shift)
        if PETSc.Options().getString("eps_type", "krylovschur") in PRECONDITIONED:
            eps.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
        eps.setFromOptions()
        eps.solve()
        self._collect(eps)
        if len(self.found) < wanted:
            raise SolveError(
                f"modes: SLEPc found {len(self.found)} of {wanted} in {eps.getIterationNumber()} iterations (reason "
                f"{eps.getConvergedReason()}); raise -eps_max_it or -eps_ncv, or loosen -eps_tol"
            )
        below = self._complete(eps, wanted, count_mass) if count_mass is not None else None
        eps.destroy()
        return below

    def _complete(self, eps: SLEPc.EPS, wanted: int, count_mass: PETSc.Mat) -> int:
        for _ in range(_ROUNDS):
            last = self.found[wanted - 1][0]
            below = self._count_below(last, count_mass)
            missing = below - sum(value <= _just_above(last) for value, _ in self.found)
            if missing == 0:
                return below
            if missing < 0:
                raise SolveError(f"modes: found {below - missing} up to {last:.6g}, but the inertia counts {below}")
            before = len(self.found)
            eps.setDeflationSpace([vector for _, vector in self.found])
            eps.setDimensions(min(missing + 2, self.stiffness.getSize()[0] - before))
            eps.solve()
            self._collect(eps)
            if len(self.found) == before:
                break
        raise SolveError(
            f"modes: {below} eigenvalues lie at or below {last:.6g}, but {below - missing} were found; raise -eps_ncv or shift "
            "elsewhere (-st_shift)"
        )

    def _collect(self, eps: SLEPc.EPS) -> None:
        self.iterations += eps.getIterationNumber()
        for k in range(eps.getConverged()):
            vector = self.stiffness.createVecRight()
            self.found.append((eps.getEigenpair(k, vector).real, vector))
        self.found.sort(key=lambda pair: pair[0])

    def pairs(self, wanted: int, rigid: int) -> tuple[Array, Array, list[PETSc.Vec]]:
        """Return the lowest eigenvalues, their residuals, and their vectors, ``x^T M x = 1``."""
        lowest = self.found[:wanted]
        values = np.array([value for value, _ in lowest])
        scale = abs(values[rigid])
        kx, mx = self.stiffness.createVecRight(), self.stiffness.createVecRight()
        residuals = []
        for value, x in lowest:
            self.stiffness.mult(x, kx)
            self.mass.mult(x, mx)
            norm, size = mx.norm(), float(np.sqrt(x.dot(mx)))
            kx.axpy(-value, mx)
            residuals.append(kx.norm() / (max(abs(value), scale) * norm))
            x.scale(1.0 / size)
        for vector in (kx, mx, *(x for _, x in self.found[wanted:])):
            vector.destroy()
        return values, np.array(residuals), [x for _, x in lowest]

    def _count_below(self, eigenvalue: float, mass: PETSc.Mat) -> int:
        start = perf_counter()
        shifted = self.stiffness.copy()
        shifted.axpy(-_just_above(eigenvalue), mass, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        shifted.setOption(PETSc.Mat.Option.SPD, False)
        negative = negative_eigenvalues(shifted)
        shifted.destroy()
        self.checking += perf_counter() - start
        return negative


def _just_above(eigenvalue: float) -> float:
    return eigenvalue + _ABOVE * abs(eigenvalue)


def symmetric(matrix: PETSc.Mat, definite: bool) -> PETSc.Mat:
    """Tell PETSc that a matrix is symmetric, and whether it is positive definite."""
    option: Any = PETSc.Mat.Option
    matrix.setOption(option.SYMMETRIC, True)
    matrix.setOption(option.SYMMETRY_ETERNAL, True)
    if definite:
        matrix.setOption(option.SPD, True)
    return matrix
