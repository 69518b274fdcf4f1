"""The quadratic pencil ``K + i omega G - omega^2 M`` of a spinning body: its lowest eigenpairs by SLEPc, and a count.

With ``K`` definite it is hyperbolic: each ``omega`` is real, they come in pairs ``+- omega``, and by Sylvester's law of
inertia the number between zero and some value is that of negative eigenvalues of the Hermitian matrix there (Duffin, J.
Rational Mech. Anal. 4 (1955) 221-254; Tisseur & Meerbergen, SIAM Rev. 43 (2001) 235-286).  With ``K`` indefinite
Coriolis forces may stabilise, and each ``omega`` counts by the sign of ``x^* (2 omega M - i G) x``.
"""

from dataclasses import dataclass
from time import perf_counter
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_array, kron
from slepc4py import SLEPc

from isorod.arrays import Array
from isorod.errors import InputError, SolveError
from isorod.modal.pencil import BAD_RESIDUAL, Eigenpairs, Pencil, just_above
from isorod.options import defaults
from isorod.petsc.inertia import negative_eigenvalues
from isorod.petsc.library import pc_name
from isorod.petsc.rows import local_rows

# Change of an eigenvector in its last iteration above which a complex eigenvalue is not taken for flutter.
_KNOWN = 1e-4

# Inverse iterations that purify vectors.
_PURIFIED = 2

# Attempts, each for more eigenpairs, until the count agrees.
_ROUNDS = 3

# Relative size of a part of an eigenvalue that is rounding.
_ROUNDING = 1e-6


class _Pair(NamedTuple):
    """An eigenpair: ``omega^2``, real and imaginary part of its vector, its sign in the count, its fault if any."""

    square: float
    real: PETSc.Vec
    imaginary: PETSc.Vec
    sign: int
    wrong: str = ""


@dataclass
class Quadratic:
    """The pencil of a spinning body about its equilibrium.

    Attributes
    ----------
    pencil
        Stiffness and mass.
    coriolis
        The antisymmetric matrix ``G``.
    """

    pencil: Pencil
    coriolis: PETSc.Mat

    def solve(self, count: int) -> Eigenpairs:
        """Return the lowest eigenpairs, by the user's options.

        Raises
        ------
        SolveError
            If the eigensolver does not converge, the body flutters, residuals are large, or eigenvalues are missing.
        """
        unstable = self.pencil.count_below(0.0)
        # The linearisation is accurate for eigenvalues of about one.
        rough = self.pencil.solve(min(count, self.pencil.size), 0.0, count=False)
        scale = float(np.sqrt(np.abs(rough.eigenvalues).max()))
        asked, iterations = count + 1 + 2 * unstable, 0
        for _ in range(_ROUNDS):
            pairs, more, types = self._find(min(asked, self.pencil.size), scale)
            iterations += more
            if len(pairs) < count:
                raise SolveError(
                    f"modes: {len(pairs)} of {count} converged; raise -pep_max_it or -pep_ncv, or loosen -eps_tol"
                )
            wrong = next((pair.wrong for pair in pairs[:count] if pair.wrong), "")
            if wrong:
                raise SolveError(f"modes: {wrong}")
            last = pairs[count - 1].square
            counted = self._count(last)
            known = sum(pair.sign for pair in pairs if 0.0 < pair.square <= just_above(last))
            missing = counted - unstable - known
            if missing == 0:
                break
            asked += 2 * abs(missing) + 2
        if missing:
            raise SolveError(f"modes: {abs(missing)} eigenvalues up to {last:.6g} missed or spurious; raise -pep_ncv")
        below = sum(pair.square <= just_above(last) for pair in pairs)
        residuals = np.array([self._residual(pair, rough.eigenvalues) for pair in pairs[:count]])
        if not residuals.max() <= BAD_RESIDUAL:
            worst = int(np.argmax(residuals))
            raise SolveError(f"modes: the residual of mode {worst + 1} is {residuals[worst]:.2g}: -eps_tol is loose")
        kept = pairs[:count]
        for pair in kept:
            # Re(x exp(i omega t)) a quarter of a period later is minus the imaginary part.
            pair.imaginary.scale(-1.0)
        return rough._replace(
            eigenvalues=np.array([pair.square for pair in kept]),
            vectors=[pair.real for pair in kept],
            later=[pair.imaginary for pair in kept],
            residuals=residuals,
            below=below,
            iterations=rough.iterations + iterations,
            shift=0.0,
            solver=types,
            falling=unstable,
        )

    def _find(self, count: int, scale: float) -> tuple[list[_Pair], int, dict[str, str]]:
        """Solve once; return the converged pairs, ascending, restarts and types of solvers."""
        stiffness = self.pencil.stiffness
        if not np.diff(stiffness.getOwnershipRanges()).all():
            # SLEPc's basis becomes NaN.
            raise InputError("modes of a spin: a rank has no unknowns; start fewer ranks, or take more elements")
        pep = SLEPc.PEP().create(stiffness.getComm())
        pep.setOperators([stiffness, self.coriolis, self.pencil.mass])
        pep.setProblemType(SLEPc.PEP.ProblemType.GENERAL)
        # Eigenvalues come in conjugate pairs.
        pep.setDimensions(2 * count)
        pep.setTarget(0.0)
        pep.setWhichEigenpairs(SLEPc.PEP.Which.TARGET_MAGNITUDE)
        pep.setTolerances(PETSc.Options().getReal("eps_tol", 1e-10), 1000)
        pep.setScale(SLEPc.PEP.Scale.SCALAR, scale)
        pep.getST().setType(SLEPc.ST.Type.SINVERT)
        with defaults({"pep_type": "toar", "st_type": "sinvert", "st_ksp_type": "preonly", **self.pencil.factors}):
            pep.setFromOptions()
            # So that the stiffness is factorised.
            pep.setTarget(0.0)
            pep.getST().setShift(0.0)
            pep.solve()
        pairs = self._collect(pep)
        st = pep.getST()
        types = {"pep": pep.getType(), "st": st.getType(), "ksp": st.getKSP().getType()}
        types["pc"] = pc_name(st.getKSP().getPC())
        iterations = pep.getIterationNumber()
        pep.destroy()
        return pairs, iterations, types

    def _collect(self, pep: SLEPc.PEP) -> list[_Pair]:
        """Return one eigenpair of each conjugate pair, with ``x^* M x = 1``."""
        pairs = []
        image, solver = self.pencil.stiffness.createVecRight(), pep.getST().getKSP()
        for k in range(pep.getConverged()):
            real, imaginary = self.pencil.stiffness.createVecRight(), self.pencil.stiffness.createVecRight()
            value = complex(pep.getEigenpair(k, real, imaginary))
            for _ in range(_PURIFIED):
                value, change = self._purify(solver, value, real, imaginary)
            rate, swing = value.real, value.imag
            if abs(swing) > _ROUNDING * abs(value) and abs(rate) > _ROUNDING * abs(value):
                pairs.append(_Pair(abs(value) ** 2, real, imaginary, 0, _fault(value, change)))
                continue
            grows = abs(rate) > abs(swing)
            if (rate if grows else swing) < 0.0:
                real.destroy()
                imaginary.destroy()
                continue
            self.coriolis.mult(imaginary, image)
            # x^* (2 omega M - i G) x = 2 omega + 2 x_r^T G x_i.
            sign = 1 if swing + real.dot(image) > 0.0 else -1
            pairs.append(_Pair(-(rate**2) if grows else swing**2, real, imaginary, sign))
        image.destroy()
        return sorted(pairs, key=lambda pair: pair.square)

    def _purify(
        self, solver: PETSc.KSP, value: complex, real: PETSc.Vec, imaginary: PETSc.Vec
    ) -> tuple[complex, float]:
        """Replace a vector by ``-K^-1 (s G x + s^2 M x)``, ``x^* M x = 1``; return its ``s``, and its change.

        This removes high frequencies, which rounding adds; ``s`` is the nearest root of ``s^2 + s x^* G x + x^* K x``.
        """
        square = value * value
        twisted, heavy = (
            [matrix * vector for vector in (real, imaginary)] for matrix in (self.coriolis, self.pencil.mass)
        )
        forces = [self.pencil.stiffness.createVecRight() for _ in range(2)]
        for force, (own, other), sign in zip(forces, ((0, 1), (1, 0)), (-1.0, 1.0), strict=True):
            force.axpy(-value.real, twisted[own])
            force.axpy(-sign * value.imag, twisted[other])
            force.axpy(-square.real, heavy[own])
            force.axpy(-sign * square.imag, heavy[other])
        before = sum(part.dot(image) for part, image in zip((real, imaginary), heavy, strict=True))
        size = work = across = 0.0
        for part, force, image in zip((real, imaginary), forces, heavy, strict=True):
            solver.solve(force, part)
            across += part.dot(image)
            self.pencil.mass.mult(part, image)
            size += part.dot(image)
            work += part.dot(force)
        for part in (real, imaginary):
            part.scale(1.0 / np.sqrt(size))
        self.coriolis.mult(imaginary, heavy[0])
        roots = np.roots([1.0, 2j * real.dot(heavy[0]), work / size])
        for vector in (*twisted, *heavy, *forces):
            vector.destroy()
        change = np.sqrt(max(0.0, size - 2.0 * across + before) / before)
        return complex(roots[np.argmin(np.abs(roots - value))]), float(change)

    def _residual(self, pair: _Pair, scales: Array) -> float:
        """Return the residual of an oscillating pair; of a growing one that of ``K x + s G x + s^2 M x``."""
        size = np.sqrt(abs(pair.square))
        total = heavy = 0.0
        mass, image = self.pencil.stiffness.createVecRight(), self.pencil.stiffness.createVecRight()
        swings = pair.square > 0.0
        parts = ((pair.real, pair.imaginary, -size), (pair.imaginary, pair.real, size))
        for own, other, rate in parts:
            self.pencil.mass.mult(own, mass)
            heavy += mass.norm() ** 2
            self.pencil.stiffness.mult(own, image)
            image.axpy(-pair.square, mass)
            self.coriolis.mult(other if swings else own, mass)
            image.axpy(rate if swings else size, mass)
            total += image.norm() ** 2
        for vector in (mass, image):
            vector.destroy()
        return float(np.sqrt(total / heavy) / max(abs(pair.square), np.abs(scales).min()))

    def _count(self, square: float) -> int:
        """Return the number of negative eigenvalues of the Hermitian matrix just above a frequency, without pressures'.

        The real matrix, with real and imaginary part of each unknown side by side, has each of them twice.
        """
        start = perf_counter()
        if square <= 0.0:
            return self.pencil.count_below(0.0)
        matrix = self._hermitian(np.sqrt(just_above(square)))
        count = negative_eigenvalues(matrix) // 2 - self.pencil.pressures
        matrix.destroy()
        self.pencil.check_seconds += perf_counter() - start
        return count

    def _hermitian(self, omega: float) -> PETSc.Mat:
        """Return ``K - omega^2 M`` and ``omega G`` as one symmetric matrix of twice as many rows."""
        even, odd = (_whole_rows(one) for one in (self.pencil.shifted(omega**2), self.coriolis))
        whole = csr_array(kron(even, np.eye(2)) + kron(omega * odd, np.array([[0.0, -1.0], [1.0, 0.0]])))
        whole.sort_indices()
        rows, size = even.shape
        kind = PETSc.IntType
        matrix = PETSc.Mat().createAIJ(
            ((2 * rows, 2 * size), (2 * rows, 2 * size)),
            csr=(whole.indptr.astype(kind), whole.indices.astype(kind), whole.data),
            comm=self.coriolis.getComm(),
        )
        for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SYMMETRY_ETERNAL):
            matrix.setOption(option, True)
        matrix.setOption(PETSc.Mat.Option.SPD, False)
        return matrix


def _fault(value: complex, change: float) -> str:
    """Return the message for an eigenvalue neither real nor imaginary, by the last change of its vector."""
    swing, rate = abs(value.imag) / (2.0 * np.pi), abs(value.real)
    if change < _KNOWN:
        return f"flutter: the equilibrium is unstable, frequency {swing:.6g}, growth rate {rate:.3g}"
    return f"modes of frequency {swing:.6g} cannot be separated, as far beyond critical speeds; reduce the spin"


def _whole_rows(matrix: PETSc.Mat) -> csr_array:
    """Return this rank's rows of a matrix, over all of its columns."""
    local = local_rows(matrix)
    rows, first = matrix.getLocalSize()[0], matrix.getOwnershipRange()[0]
    shape = rows, matrix.getSize()[1]
    on_rank = csr_array((local.own.values, local.own.column + first, local.own.start), shape=shape)
    if not local.columns.size:
        return on_rank
    off_rank = local.others
    return on_rank + csr_array((off_rank.values, local.columns[off_rank.column], off_rank.start), shape=shape)
