"""The pencil ``K - lambda M``: its lowest eigenpairs by SLEPc, and the count that proves none is missing."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from isorod.arrays import Array
from isorod.errors import SolveError
from isorod.modal import eigensolvers
from isorod.options import defaults
from isorod.petsc import banded
from isorod.petsc.inertia import negative_eigenvalues, negative_of_rows
from isorod.petsc.library import pc_name
from isorod.petsc.matrix import absolute_product, add_componentwise, has_whole_rows, orthonormalise
from isorod.petsc.products import products
from isorod.petsc.shifted import upper_rows

# The Sturm count is taken this far (relative) above the last eigenvalue returned.
_ABOVE = 1e-6

# Rounds of deflation until no eigenvalue is missing, and the residual above which a mode is refused.
_ROUNDS = 12
BAD_RESIDUAL = 1e-5

# Residuals of long rods are rounding of the stiffness times a mode, ``eps |K| |x|``, allowed with a margin of ten.  The
# error of the eigenvalue is at most ``eps |x|^T |K| |x|``; this fraction of the eigenvalue is allowed.
_MARGIN, _LOST = 10.0, 2e-4

# Dimensions of a Krylov space beyond those asked for, where the mass is singular: with 1 it seldom converges (5 of 20
# small bars), with 2 in 63 restarts, with 4 in 16.
SPARE = 5

# The shift of a free body lies this fraction of its first flexible eigenvalue below zero; farther off the modes would
# cluster.
_SHIFT = 0.1

# A typed shift that turns out to be an eigenvalue is moved by this fraction of it.  Near one, purified vectors of high
# modes lose digits.
_ASIDE = 1e-2


class Eigenpairs(NamedTuple):
    """The lowest eigenpairs, ascending.

    Attributes
    ----------
    eigenvalues : (m,)
    vectors
        Of the unknowns, ``m`` of them, ``x^T M x = 1``.
    residuals : (m,)
        ``|K x - lambda M x| / (|lambda| |M x|)``; for rigid modes with the first flexible ``lambda``.
    below
        Number of eigenvalues up to just above the last one, or None if not counted.
    iterations
        Of the eigensolver in all rounds.
    tolerance, shift
        Of the eigensolver, and of its spectral transformation.
    solver, options
        Types of EPS, ST, KSP and PC, and all PETSc options in force.
    later, falling
        Of a spinning body, ``y`` of its motions ``x cos(omega t) + y sin(omega t)``, ``x`` in ``vectors``, and the
        number of negative eigenvalues of the stiffness.
    """

    eigenvalues: Array
    vectors: list[PETSc.Vec]
    residuals: Array
    below: int | None
    iterations: int
    tolerance: float
    shift: float
    solver: dict[str, str]
    options: dict[str, str]
    later: Sequence[PETSc.Vec] = ()
    falling: int = 0


@dataclass(eq=False)
class Pencil:
    """A symmetric stiffness ``K``, positive definite or with rigid motions, and a mass ``M``.

    Some unknowns may be pressures, multipliers without mass: ``[[A, B], [B^T, -C]]`` with a semidefinite ``C`` and a
    ``B`` of full rank, ``M`` on the others alone.  Each adds a negative eigenvalue to ``K - tau M`` (Sylvester), and
    one or, where ``C`` is zero, two infinite ones to the pencil; ``M`` is a semi-inner product, and an eigenvector's
    pressures follow from its displacements.

    Attributes
    ----------
    stiffness
        Symmetric matrix; only its upper triangle may be stored.
    mass
        Symmetric matrix to multiply with; where there is a shift, with entries at places where the stiffness has some.
    rigid
        Number of rigid motions.
    pressures
        Number of pressures.
    factors
        Options, named ``st_...``, of the factorisation that suits the stiffness, and others that replace the defaults
        of `isorod.modal.eigensolvers`; the user's override them.  Eigensolvers without a spectral transformation
        ignore them.
    motions
        Returns the rigid motions on the unknowns, if known: those eigensolvers do not converge on a kernel.
    entries
        Returns the mass as a new matrix with entries, where `mass` only multiplies.
    structure
        Relation of the nonzero pattern of the mass to that of the stiffness.
    floor, check_seconds
        Residuals of smaller eigenvalues are relative to this one; wall time of Sturm counts so far.
    report
        Called at each restart with a function that returns a line of progress, if it is not None.
    """

    stiffness: PETSc.Mat
    mass: PETSc.Mat
    rigid: int = 0
    pressures: int = 0
    factors: Mapping[str, object] = field(default_factory=dict)
    motions: Callable[[], Iterable[PETSc.Vec]] = tuple
    entries: Callable[[], PETSc.Mat] | None = None
    structure: Any = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
    floor: float = 0.0
    check_seconds: float = field(default=0.0, init=False)
    report: Callable[[Callable[[], str]], None] | None = field(default=None, init=False)

    @property
    def finite(self) -> int:
        """Number of eigenvalues that are finite for any ``C`` of pressures."""
        return int(self.stiffness.getSize()[0]) - 2 * self.pressures

    @property
    def size(self) -> int:
        """Number of eigenvalues that can be asked for."""
        return self.finite - (SPARE if self.pressures else 0)

    def _eps(self, count: int, shift: float) -> SLEPc.EPS:
        """Return a new eigensolver for some eigenpairs near a shift."""
        eps = SLEPc.EPS().create(self.stiffness.getComm())
        eps.setOperators(self.stiffness, self.mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        count = min(count, self.size)
        # In a Krylov space larger than the number of finite eigenvalues, rounding makes spurious ones.
        narrow = self.pressures > 0 and max(2 * count, count + 15) >= self.finite
        eps.setDimensions(count, self.finite if narrow else None)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        eps.setTarget(shift)
        eps.getST().setShift(shift)
        eps.getST().setMatStructure(self.structure)
        if self.report is not None:
            eps.setMonitor(lambda eps, k, converged, *_: self._report(f"restart {k}, {converged} of {count} found"))
        return eps

    def shift(self) -> float | None:
        """Return the shift to solve with: zero, or below it if there are rigid motions, whose eigenvalue is zero.

        None if no flexible mode converged from which to choose it.
        """
        if not self.rigid or PETSc.Options().hasName("st_shift"):
            return 0.0
        first = self._first_flexible()
        return None if first is None else -_SHIFT * first

    def _first_flexible(self) -> float | None:
        """Return a rough value of the first eigenvalue above the rigid modes of a free body, None if not converged."""
        inertia = self.mass.getDiagonal().array_r
        sums = float(self.stiffness.getDiagonal().array_r[inertia > 0.0].sum()), float(inertia.sum())
        stiffness, mass = (self.stiffness.getComm().tompi4py().allreduce(one) for one in sums)
        guess = 1e-8 * stiffness / mass
        for _ in range(8):
            eps = self._eps(self.rigid + 2, -guess)
            eps.setTolerances(1e-4)
            eps.getST().setType(SLEPc.ST.Type.SINVERT)
            ksp = eps.getST().getKSP()
            ksp.setType(PETSc.KSP.Type.PREONLY)
            pc = ksp.getPC()
            if self.factors.get("st_pc_python_type") == banded.NAME:
                pc.setType(PETSc.PC.Type.PYTHON)
                pc.setPythonType(banded.NAME)
            else:
                pc.setType(PETSc.PC.Type.CHOLESKY)
                pc.setFactorSolverType("mumps")
            eigensolvers.solve(eps)
            values = sorted(eps.getEigenvalue(k).real for k in range(eps.getConverged()))
            eps.destroy()
            if len(values) <= self.rigid:
                return None
            first = float(values[self.rigid])
            # With a shift too far below zero, rigid and flexible modes cannot be distinguished.
            if first > 0.01 * guess:
                return first
            guess = max(10.0 * abs(first), 1e-3 * guess)
        return None

    def solve(self, number: int, shift: float, count: bool = True) -> Eigenpairs:
        """Return the lowest eigenpairs, rigid modes included, by the user's options.

        Parameters
        ----------
        number
            Number of eigenpairs, at most `size`.
        shift
            Of the spectral transformation, see `shift`.
        count
            Count the eigenvalues up to just above the last one, by Sylvester's law of inertia, and solve for those that
            are missing.

        Raises
        ------
        SolveError
            If the eigensolver does not converge, residuals are large, or eigenvalues are missing or spurious.
        InputError
            If an eigensolver is typed that needs a definite mass, and there are pressures.
        """
        self._report("assembled")
        pairs = self._find(number, shift, count)
        limit = max(BAD_RESIDUAL, 100.0 * pairs.tolerance)
        if not self._excess(pairs, limit)[1] <= limit:
            # The last copy of a multiple eigenvalue, which rounding brings in, may pass the test of convergence early.
            # Purification corrects its vector; it costs a tenth, so the first round goes without.
            pairs = self._find(number, shift, count, purify=1)
        if not self._excess(pairs, limit)[1] <= limit and PETSc.Options().hasName("st_shift"):
            # What was factorised is singular if the shift is an eigenvalue.
            first = float(pairs.eigenvalues[min(self.rigid, number - 1)])
            pairs = self._find(number, shift, count, aside=_ASIDE * (pairs.shift or -abs(first)))
        worst, excess = self._excess(pairs, limit)
        if not excess <= limit:
            raise SolveError(
                f"modes: the residual of mode {worst + 1} is {pairs.residuals[worst]:.2g}: -eps_tol is loose, or "
                "the stiffness contrast along the model is too large for double precision"
            )
        return pairs

    def _excess(self, pairs: Eigenpairs, limit: float) -> tuple[int, float]:
        """Return the number and size of the largest residual, without those at round-off level."""
        residuals = np.where(np.isfinite(pairs.residuals), pairs.residuals, np.inf)
        if residuals.max() > limit and has_whole_rows(self.stiffness):
            comm, image = self.stiffness.getComm().tompi4py(), self.stiffness.createVecRight()
            for k in np.flatnonzero(residuals > limit):
                x, values = pairs.vectors[k], np.abs(pairs.eigenvalues[[k, self.rigid]])
                self.mass.mult(x, image)
                sizes = np.abs(x.array_r)
                noise = absolute_product(self.stiffness, sizes)
                noise *= 0.5 * np.finfo(float).eps / max(values.max(), self.floor)
                lost, left = comm.allreduce(float(sizes @ noise)), np.sqrt(comm.allreduce(float(noise @ noise)))
                if lost <= _LOST and residuals[k] <= _MARGIN * left / image.norm():
                    residuals[k] = 0.0
            image.destroy()
        worst = int(np.argmax(residuals))
        return worst, float(residuals[worst])

    def _report(self, message: str) -> None:
        """Report progress."""
        if self.report is not None:
            self.report(lambda: f"modes: {self.size:,} unknowns, {message}")

    def _find(self, number: int, shift: float, count: bool, *, purify: int = 0, aside: float = 0.0) -> Eigenpairs:
        """Solve once, with the shift in force moved by ``aside``."""
        # One more than asked for, so that the last one seldom lacks its double; yet one more would cost ten modes a
        # restart.
        eps = self._eps(number + 1, shift)
        kind = eigensolvers.typed(self.pressures > 0)
        if kind in eigensolvers.PRECONDITIONED:
            eps.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
        pairs: list[tuple[float, PETSc.Vec]] = []
        # With pressures the mass does not see their rounding errors.
        with defaults(eigensolvers.offered(kind, {"eps_purify": purify or int(self.pressures > 0), **self.factors})):
            eps.setFromOptions()
            if PETSc.Options().hasName("eps_nev"):
                _, *spaces = eps.getDimensions()
                eps.setDimensions(min(number + 1, self.size), *spaces)
            if aside:
                eps.getST().setShift(eps.getST().getShift() + aside)
            if kind in eigensolvers.PRECONDITIONED and self.rigid:
                pairs = self._rigid_pairs()
                eps.setDeflationSpace([vector for _, vector in pairs])
            eigensolvers.solve(eps)
            options = dict(PETSc.Options().getAll())
        self._collect(eps, pairs)
        iterations = eps.getIterationNumber()
        if len(pairs) < number:
            raise SolveError(
                f"modes: SLEPc found {len(pairs)} of {number} in {iterations} iterations (reason "
                f"{eps.getConvergedReason()}); raise -eps_max_it or -eps_ncv, or loosen -eps_tol"
            )
        below = None
        if count:
            below, more = self._complete(eps, pairs, number)
            iterations += more
        st, ksp = eps.getST(), eps.getST().getKSP()
        types = {"eps": eps.getType(), "st": st.getType(), "ksp": ksp.getType(), "pc": pc_name(ksp.getPC())}
        (tolerance, _), placed = eps.getTolerances(), st.getShift()
        eps.destroy()
        return Eigenpairs(*self._normalised(pairs, number), below, iterations, tolerance, placed, types, options)

    def _rigid_pairs(self) -> list[tuple[float, PETSc.Vec]]:
        """Return the Rayleigh quotients of the known rigid motions, and vectors with ``x^T M x = 1``."""
        image = self.stiffness.createVecRight()
        pairs = []
        for vector in orthonormalise(self.motions(), self.mass):
            self.stiffness.mult(vector, image)
            pairs.append((float(vector.dot(image)), vector))
        image.destroy()
        return pairs

    def _collect(self, eps: SLEPc.EPS, pairs: list[tuple[float, PETSc.Vec]]) -> None:
        """Add the converged eigenpairs of an eigensolver; keep them ascending."""
        for k in range(eps.getConverged()):
            vector = self.stiffness.createVecRight()
            pairs.append((eps.getEigenpair(k, vector).real, vector))
        pairs.sort(key=lambda pair: pair[0])

    def _complete(self, eps: SLEPc.EPS, pairs: list[tuple[float, PETSc.Vec]], number: int) -> tuple[int, int]:
        """Add eigenpairs until none of the lowest ones is missing; return the Sturm count and the iterations.

        A Krylov space holds one vector of a multiple eigenvalue until rounding brings the others in.  If the count
        shows that some are missing, the converged ones are deflated and the rest is solved for.
        """
        iterations = 0
        for _ in range(_ROUNDS):
            last = pairs[number - 1][0]
            below = self.count_below(last)
            missing = below - sum(value <= just_above(last) for value, _ in pairs)
            if missing == 0:
                return below, iterations
            problem = f"modes: {below} eigenvalues lie at or below {last:.6g}, but {below - missing} converged"
            if missing < 0:
                raise SolveError(
                    f"{problem}: some are spurious; tighten -eps_tol, use the default -eps_type, or the stiffness "
                    "contrast along the model is too large for double precision"
                )
            before = len(pairs)
            if before >= self.finite:
                break
            eps.setDeflationSpace([vector for _, vector in pairs])
            # All three: SLEPc 3.22 keeps those not given from the first solve, which need not fit the new count.
            count = max(1, min(missing + 2, self.finite - before - 1))
            room = max(count + 1, min(max(2 * count, count + 15), self.finite - before))
            eps.setDimensions(count, room, room)
            eigensolvers.solve(eps)
            iterations += eps.getIterationNumber()
            self._collect(eps, pairs)
            if len(pairs) == before:
                break
        raise SolveError(f"{problem}; raise -eps_ncv or shift elsewhere (-st_shift)")

    def _normalised(self, pairs: list[tuple[float, PETSc.Vec]], number: int) -> tuple[Array, list[PETSc.Vec], Array]:
        """Return eigenvalues, vectors and residuals of the lowest pairs; destroy the other vectors."""
        values = np.array([value for value, _ in pairs[:number]])
        scales = np.maximum(np.abs(values), max(abs(values[self.rigid]), self.floor))
        kx, mx = self.stiffness.createVecRight(), self.stiffness.createVecRight()
        residuals = np.empty(number)
        images = products(self.stiffness, [x for _, x in pairs[:number]])
        for k, (value, x) in enumerate(pairs[:number]):
            kx.array_w[:] = images[k]
            self.mass.mult(x, mx)
            kx.axpy(-value, mx)
            residuals[k] = kx.norm() / (scales[k] * mx.norm())
            x.scale(1.0 / np.sqrt(x.dot(mx)))
        for vector in (kx, mx, *(x for _, x in pairs[number:])):
            vector.destroy()
        return values, [x for _, x in pairs[:number]], residuals

    def count_below(self, eigenvalue: float) -> int:
        """Return the number of eigenvalues up to just above the given one, by Sylvester's law of inertia."""
        start = perf_counter()
        shift = just_above(eigenvalue)
        rows = upper_rows(self.stiffness, shift, self.mass)
        negative = None if rows is None else negative_of_rows(rows)
        if negative is None:
            negative = self._count_below(shift)
        self.check_seconds += perf_counter() - start
        return negative - self.pressures

    def shifted(self, shift: float) -> PETSc.Mat:
        """Return the stiffness minus ``shift`` times the mass."""
        shifted = self.stiffness.copy()
        if not add_componentwise(shifted, -shift, self.mass):
            mass = self.mass if self.entries is None else self.entries()
            shifted.axpy(-shift, mass, self.structure)
            if mass is not self.mass:
                mass.destroy()
        return shifted

    def _count_below(self, shift: float) -> int:
        """Return the number of eigenvalues below a shift, of matrices of any type."""
        shifted = self.shifted(shift)
        shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        shifted.setOption(PETSc.Mat.Option.SPD, False)
        negative = negative_eigenvalues(shifted)
        shifted.destroy()
        return negative


def just_above(eigenvalue: float) -> float:
    """Return the shift of the count of eigenvalues up to and including one."""
    return eigenvalue + _ABOVE * abs(eigenvalue)
