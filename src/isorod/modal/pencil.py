"""Eigenpairs of the pencil K - lambda M by SLEPc."""

from collections.abc import Sequence
from time import perf_counter

import numpy as np
from petsc4py import PETSc
from slepc4py import SLEPc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.checks import hourglass, rigid_motions
from isorod.errors import SolveError
from isorod.options import defaults
from isorod.petsc.inertia import negative_eigenvalues

# What a user's option overrides.  Purification mends vectors where the mass is singular; here it is not, and it costs a
# tenth.
OPTIONS = {"eps_tol": 1e-10, "eps_purify": 0, "st_type": "sinvert", "st_ksp_type": "preonly"}

# Measured on the blade: below a tolerance of 1e-8 none of them gets (LOBPCG 1e-7), and LOBPCG breaks down with blocks
# of several modes, which converge at very different rates.
PRECONDITIONED_OPTIONS = {
    "eps_tol": 1e-8,
    "eps_max_it": 3000,
    "st_pc_type": "cholesky",
    "st_pc_factor_mat_solver_type": "mumps",
}


LOBPCG_OPTIONS = {"eps_tol": 1e-7, "eps_lobpcg_blocksize": 1, "st_ksp_type": "preonly"}

# Eigensolvers that take a preconditioner instead of a spectral transformation.
PRECONDITIONED = ("lobpcg", "rqcg", "gd", "jd")

# Options after which the eigensolver still wants no more of the mass than its products.
_HARMLESS = (
    *("eps_nev", "eps_ncv", "eps_mpd", "eps_tol", "eps_max_it", "eps_purify", "eps_krylovschur", "eps_conv"),
    *("eps_monitor", "eps_view", "eps_error", "st_ksp", "st_pc"),
)


# The Sturm count is taken this far (relative) above the last eigenvalue returned.
_ABOVE = 1e-6

# Rounds of deflation until no eigenvalue is missing, and the residual above which a mode is refused.
_ROUNDS = 12

# The shift of a free body lies this share of its first flexible eigenvalue below zero; far from it the modes would
# cluster.
_SHIFT = 0.1

# A typed shift that turns out to be an eigenvalue is moved by this share of it.  Near one, purified vectors of high
# modes lose digits.
_ASIDE = 1e-2


def _just_above(eigenvalue: float) -> float:
    return eigenvalue + _ABOVE * abs(eigenvalue)


class _Problem:
    """The pencil ``K - lambda M``."""

    def __init__(self, assembler: Assembler, lumped: bool, loose: Sequence[tuple[int, Array]]) -> None:
        self.assembler = assembler
        self.stiffness = assembler.matrix()
        self.lumped = lumped
        self._only_multiplies = not loose and _only_multiplies()
        self.mass = assembler.mass_operator(lumped) if self._only_multiplies else assembler.mass(lumped)
        self.loose = loose
        self.found: list[tuple[float, PETSc.Vec]] = []
        self.check_seconds = 0.0

    def _eps(self, count: int, shift: float) -> SLEPc.EPS:
        eps = SLEPc.EPS().create(self.assembler.comm)
        eps.setOperators(self.stiffness, self.mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setDimensions(min(count, self.assembler.model.unknowns))
        eps.setTarget(shift)
        return eps

    def first_flexible(self, rigid_modes: int) -> float:
        """Return a rough value of the first eigenvalue above the rigid modes of a free body."""
        diagonal = self.stiffness.getDiagonal().sum() / self.mass.getDiagonal().sum()
        guess = 1e-8 * diagonal
        for _ in range(8):
            eps = self._eps(rigid_modes + 2, -guess)
            eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
            eps.setTolerances(1e-4)
            st = eps.getST()
            st.setType(SLEPc.ST.Type.SINVERT)
            st.setShift(-guess)
            _direct(st.getKSP())
            eps.solve()
            if eps.getConverged() <= rigid_modes:
                break
            first = sorted(eps.getEigenvalue(k).real for k in range(eps.getConverged()))[rigid_modes]
            eps.destroy()
            # Too far below zero, the shift makes rigid and flexible modes look alike.
            if first > 0.01 * guess:
                return float(first)
            guess = max(10.0 * abs(first), 1e-3 * guess)
        body, motion = self.loose[0]
        how = rigid_motions.describe(self.assembler.model.bodies[body].space, motion)
        raise SolveError(
            f"modes: body {body} is free to {how}, as far as 1e-8 of its size tells, and no flexible mode was found to place the shift by; "
            "hold it, or give a shift (-st_shift)"
        )

    def solve(self, wanted: int, shift: float, aside: float = 0.0) -> tuple[SLEPc.EPS, int]:
        """Find the lowest ``wanted`` eigenvalues, as the user's options say; return the solver and the Sturm count.

        The shift in force is moved ``aside`` by this share of it.

        A Krylov space holds one vector of a multiple eigenvalue until rounding brings the others in.  Where the count
        of eigenvalues shows that some are missing, those found are deflated and the rest is solved for.
        """
        typed = PETSc.Options().getAll().get("eps_type", "krylovschur")
        unknowns = self.assembler.model.unknowns
        # One more than wanted, so that the last one seldom lacks its twin; another one more would cost ten modes a
        # restart.
        eps = self._eps(wanted + 1, shift)
        if typed in PRECONDITIONED:
            eps.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
            offered = PRECONDITIONED_OPTIONS | (LOBPCG_OPTIONS if typed == "lobpcg" else {})
            if PETSc.Options().getAll().get("st_pc_type", "cholesky") not in ("lu", "cholesky"):
                offered = {name: value for name, value in offered.items() if not name.startswith("st_pc_")}
        else:
            eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
            offered = OPTIONS | factorisation(self.assembler, "st_")
        eps.getST().setShift(shift)
        with defaults(offered):
            eps.setFromOptions()
            if PETSc.Options().hasName("eps_nev"):
                _, ncv, mpd = eps.getDimensions()
                eps.setDimensions(min(wanted + 1, unknowns), ncv, mpd)
            if aside:
                eps.getST().setShift((1.0 + aside) * eps.getST().getShift())
            if typed in PRECONDITIONED and self.loose:
                # These solvers find no end of a kernel: it is known, and taken out.
                self._take_rigid_motions()
                eps.setDeflationSpace([vector for _, vector in self.found])
            eps.solve()
        self._collect(eps)
        if len(self.found) < wanted:
            raise SolveError(
                f"modes: SLEPc found {len(self.found)} of {wanted} in {eps.getIterationNumber()} iterations (reason "
                f"{eps.getConvergedReason()}); raise -eps_max_it or -eps_ncv, or loosen -eps_tol"
            )
        for _ in range(_ROUNDS):
            last = self.found[wanted - 1][0]
            below = self.count_below(last)
            missing = below - sum(value <= _just_above(last) for value, _ in self.found)
            if missing == 0:
                return eps, below
            if missing < 0:
                raise SolveError(
                    f"modes: {below} eigenvalues lie at or below {last:.6g}, but {below - missing} were found: some are no modes; "
                    "tighten -eps_tol, take the default -eps_type, or stiffness differs more along the model than double "
                    f"precision bears{hourglass.hint(self.assembler.model)}"
                )
            before = len(self.found)
            eps.setDeflationSpace([vector for _, vector in self.found])
            # All three: SLEPc 3.22 keeps from the first solve what is not given, and it need not fit the new count.
            count = max(1, min(missing + 2, unknowns - before - 1))
            room = min(max(2 * count, count + 15), unknowns - before)
            eps.setDimensions(count, room, room)
            eps.solve()
            self._collect(eps)
            if len(self.found) == before:
                break
        raise SolveError(
            f"modes: {below} eigenvalues lie at or below {last:.6g}, but {below - missing} were found; raise -eps_ncv or shift "
            "elsewhere (-st_shift)"
        )

    def _take_rigid_motions(self) -> None:
        model = self.assembler.model
        taken: list[PETSc.Vec] = []
        for body, motion in self.loose:
            everywhere = np.zeros(model.dofs)
            model.nodal(everywhere, body)[:] = motion
            vector = self.assembler.state(everywhere)
            image = self.assembler.vector()
            for other in taken:
                self.mass.mult(other, image)
                vector.axpy(-vector.dot(image), other)
            self.mass.mult(vector, image)
            vector.scale(1.0 / np.sqrt(vector.dot(image)))
            taken.append(vector)
            self.stiffness.mult(vector, image)
            self.found.append((float(vector.dot(image)), vector))

    def _collect(self, eps: SLEPc.EPS) -> None:
        for k in range(eps.getConverged()):
            vector = self.stiffness.createVecRight()
            value = eps.getEigenpair(k, vector).real
            self.found.append((value, vector))
        self.found.sort(key=lambda pair: pair[0])

    def pairs(self, wanted: int, rigid_modes: int) -> tuple[Array, Array, Array]:
        """Return the lowest eigenvalues, their vectors on all degrees of freedom, and residuals."""
        lowest = self.found[:wanted]
        values = np.array([value for value, _ in lowest])
        kx, mx = self.stiffness.createVecs()
        low, high = mx.getOwnershipRange()
        unknowns = np.empty((wanted, mx.getSize()))
        stiff, heavy = np.empty((2, wanted, high - low))
        for k, (_, x) in enumerate(lowest):
            self.mass.mult(x, mx)
            self.stiffness.mult(x, kx)
            unknowns[k], stiff[k], heavy[k] = self.assembler.all_unknowns(x), kx.array_r, mx.array_r
        own = unknowns[:, low:high]
        gap = stiff - values[:, None] * heavy
        # Of each vector x^T M x, |K x - lambda M x|^2, |M x|^2.
        products = np.stack([np.einsum("ki,ki->k", *pair) for pair in ((own, heavy), (gap, gap), (heavy, heavy))])
        if self.assembler.comm.getSize() > 1:
            products = self.assembler.comm.tompi4py().allreduce(products)
        amount, gap, size = products
        residuals = np.sqrt(gap / size) / np.maximum(np.abs(values), abs(values[rigid_modes]))
        vectors = self.assembler.shapes(unknowns) / np.sqrt(amount)[:, None]
        # The first of the largest components is positive.
        large = np.abs(vectors) > 0.999 * np.abs(vectors).max(axis=1, keepdims=True)
        signs = np.sign(vectors[np.arange(wanted), large.argmax(axis=1)])
        return values, vectors * signs[:, None], residuals

    def count_below(self, eigenvalue: float) -> int:
        """Return the number of eigenvalues up to just above the given one, by Sylvester's law of inertia."""
        start = perf_counter()
        entries = self.assembler.mass(self.lumped) if self._only_multiplies else self.mass
        shifted = self.stiffness.copy()
        shifted.axpy(-_just_above(eigenvalue), entries, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        negative = negative_eigenvalues(shifted)
        shifted.destroy()
        if self._only_multiplies:
            entries.destroy()
        self.check_seconds += perf_counter() - start
        return negative


def _only_multiplies() -> bool:
    """Return whether the eigensolver takes the mass only to multiply with, as the default with a shift of zero does."""
    typed = (name for name in PETSc.Options().getAll() if name.startswith(("eps_", "st_")))
    return all(name.startswith(_HARMLESS) for name in typed)


def _direct(ksp: PETSc.KSP) -> None:
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.LU)
    pc.setFactorSolverType("mumps")
