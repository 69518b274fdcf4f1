"""SNES on an assembler, for one load step after the other."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import SPARSE, factorisation, is_mixed, unscaled
from isorod.checks import hourglass
from isorod.errors import SolveError
from isorod.options import defaults
from isorod.petsc.direct import room
from isorod.petsc.inertia import COUNT_NEGATIVE
from isorod.petsc.matrix import forget_factors
from isorod.petsc.snes import create_snes
from isorod.statics.contact_policy import ContactPolicy
from isorod.statics.convergence import Convergence, worst_place
from isorod.statics.line_search import LineSearch
from isorod.statics.preconditioner import prepare
from isorod.statics.predictor import Ahead, Before
from isorod.statics.proximal import FEW, NEARLY
from isorod.statics.steps import Diverged, Steps

if TYPE_CHECKING:
    from isorod.statics.proximal import Proximal

# Fraction of a load step over which the residual is differenced for the path's slope.
DELTA = 1e-6

# Defaults, which a user's options override.
OPTIONS = {"snes_linesearch_type": "basic", "snes_rtol": 1e-9, "snes_max_it": 15, "ksp_type": "preonly"}

# More iterations with contact, where steps are shortened (`isorod.statics.line_search`), and with friction.
TOUCHING, RUBBING = {"snes_max_it": 20}, {"snes_max_it": 40}

# Number of steps of nearly no length after which a solution stops while lower penalties can be tried.
_STUCK = 3

# While contact settles, the elements' part of the tangent is kept as long as each iteration leaves less than this
# fraction of the residual.
_LAGS = 0.2

# With contact, the path counts as smooth after a step of at most so many linear solves.
_SMOOTH = 8


class Newton:
    """SNES on an assembler, for one load step after the other.

    Attributes
    ----------
    x
        The last equilibrium.
    iterations, linear_iterations
        Linear solves so far, and their iterations.
    norms
        Norms of the residual in the last step: before the predictor, then at each iteration.
    stabilisation
        Artificial stiffness of bodies held by contact alone, or None.
    policy
        Updates of penalties, multipliers and points of contact; None without contact.
    steps
        Limits of load steps.
    cuts
        Number of load steps cut so far.
    report
        Called in each iteration with a function that returns the progress as text.
    guess
        Initial guess of the next load step in place of its predictor, or None.
    left
        Called with state and load factor at the start of each step, also of a repeated one.
    history, solves
        The equilibrium before the last, or None, and linear solves of the last step.
    """

    def __init__(self, assembler: Assembler, loose: Sequence[tuple[int, Array]] = ()) -> None:
        self.assembler = assembler
        self.x = assembler.vector()
        self.iterations = 0
        self.linear_iterations = 0
        self.norms: list[float] = []
        self.cuts = 0
        self.report: Callable[[Callable[[], str]], None] = lambda line: None
        self.guess: PETSc.Vec | None = None
        self.left: Callable[[PETSc.Vec, float], None] = lambda x, factor: None
        self._trial = assembler.vector()
        self._force = assembler.vector()
        self._change = assembler.vector()
        self._matrix = assembler.matrix()
        self._factor = 0.0
        self.solves = 0
        self._filled = self._fresh = self._settles = False
        self._convergence = Convergence(assembler)
        self.history: Before | None = None
        self._ahead: Ahead | None = None
        self.steps = Steps(assembler)
        self.stabilisation: Proximal | None = None
        self.policy: ContactPolicy | None = None
        if assembler.contact is not None:
            self.policy = ContactPolicy(self, assembler.contact)
        self._stage = PETSc.Log.Stage("solve")
        typed = PETSc.Options()
        self._own_tolerance = not typed.hasName("snes_atol")
        self._may_reuse = self._own_tolerance and not typed.hasName("snes_test_jacobian")
        contact = assembler.contact
        own = {} if contact is None else TOUCHING if contact.friction is None else RUBBING
        self.snes = create_snes(
            assembler.vector(),
            self._matrix,
            self._residual,
            self._tangent,
            self._test,
            OPTIONS | own | factorisation(assembler),
        )
        self._line_search: LineSearch | None = None
        if own and not typed.hasName("snes_linesearch_type"):
            self.steps.watched = True
            self._line_search = LineSearch(self.snes, self._residual, self._signs(), self._free)
        self.snes.setMonitor(self._monitor)
        prepare(assembler, self._matrix, self.snes.getKSP().getPC())
        if loose:
            from isorod.statics import stabilisation

            assembler.tangent(self.x, 0.0, self._matrix)
            self.stabilisation = stabilisation.Stabilisation(assembler, self._matrix, loose)
            # Bodies that are not held yet may pass through others in one step.
            self.steps.careful = self.steps.watched

    def _signs(self) -> PETSc.Vec | None:
        """Return 1 for each unknown that is a displacement and -1 for pressures, None without these."""
        if not is_mixed(self.assembler.model):
            return None
        signs = self.assembler.state(np.full(self.assembler.model.dofs, 2.0))
        signs.shift(-1.0)
        return signs

    def destroy(self) -> None:
        """Give back matrix, factors and work vectors.

        SNES and the line search hold references to this object, which would keep them for long.
        """
        self._line_search = self.policy = None
        for item in (self.snes, self._matrix, self._trial, self._force, self._change):
            item.destroy()

    def _monitor(self, snes: PETSc.SNES, iteration: int, norm: float) -> None:
        self.norms.append(norm)
        self.report(lambda: self._line(iteration, norm))

    def _line(self, iteration: int, norm: float) -> str:
        """Return the progress as text."""
        contact = self.assembler.contact
        touching = "" if contact is None else f", {contact.touching:,} points in contact"
        cuts = f", {self.cuts} steps cut" if self.cuts else ""
        reached = self.assembler.model.when(self._factor, ".4g")
        return f"{reached}, iteration {iteration}, residual force {norm:.2g}{touching}{cuts}"

    def _test(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> PETSc.SNES.ConvergedReason:
        """Return SNES's reason to stop; among them are very short steps, while lower penalties can be tried."""
        search, policy = self._line_search, self.policy
        if search is not None and search.short >= _STUCK and policy is not None and policy.may_soften:
            return PETSc.SNES.ConvergedReason.DIVERGED_LINE_SEARCH
        state, change, force = norms
        if search is not None and search.fraction < 1.0:
            # The correction is that of the full step.
            change = change / search.fraction if search.fraction > 0.0 else np.inf
        return self._convergence.test(snes, iteration, (state, change, force))

    def _residual(self, x: PETSc.Vec, out: PETSc.Vec) -> None:
        carried = self._convergence.carried_force = self.assembler.residual(x, self._factor, out)
        if self.stabilisation is not None:
            self.stabilisation.add_forces(x, out, carried)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Mat) -> None:
        # The last tangent, with its factors, may be good enough for the last iteration.
        own = self._may_reuse and snes.handle == self.snes.handle and out.handle == self._matrix.handle
        fresh, self._fresh = self._fresh, False
        if own and fresh:
            return
        if not (own and len(self.norms) > 1 and self._convergence.reuses_tangent(self.norms[-2], self.norms[-1], snes)):
            converges = len(self.norms) < 2 or self.norms[-1] < _LAGS * self.norms[-2]
            self._fill(x, self._factor, out, own and self._settles and converges)

    def _fill(self, x: PETSc.Vec, factor: float, out: PETSc.Mat, lags: bool = False) -> None:
        """Fill ``out`` with the tangent; if ``lags``, its elements' part may be that of an earlier iteration."""
        self.assembler.tangent(x, factor, out, lags)
        forget_factors(out, self.snes.getKSP())
        if self.stabilisation is not None:
            self.stabilisation.add_stiffness(out)

    def advance(self, factor: float, target: float) -> int:
        """Go from the equilibrium at ``factor`` to the one at ``target``; return the number of linear solves.

        Raises
        ------
        Diverged
            If SNES diverges, an element loses most of its volume, a rotating support turns a body too far, or bodies in
            contact pass through each other; the state is then the one before.
        SolveError
            If the linear solver fails.
        """
        self._stage.push()
        # With stabilisation there is no other equilibrium near.
        self._convergence.guarded = self.stabilisation is None
        try:
            before = self.assembler.jacobians(self.x, factor)
            with defaults(COUNT_NEGATIVE | room(self.assembler.comm) | unscaled(self.assembler)):
                # At constant load factor only contact has changed.
                self._settles = self.assembler.contact is not None and target == factor
                scale, rate = self._predict(factor, target - factor)
                self._factor = target
                fraction = self.steps.free(self.x, self._trial, factor, target)
                self._trial.axpby(1.0 - fraction, fraction, self.x)
                self.steps.refuse_squeezed(before, self._trial, target)
                solves = self._correct(scale)
            self.steps.refuse_squeezed(before, self._trial, target)
            self.steps.refuse(self.x, factor, self._trial, target)
        finally:
            self._stage.pop()
        self.solves = solves
        # At constant load factor contact has changed, and with it the path.
        self.history = Before(target - factor, self.x.copy(), rate) if target > factor else None
        self._trial.copy(self.x)
        return solves

    def begin(self, displacement: Array) -> bool:
        """Look for the equilibrium at the full load near a displacement ``(dofs,)``; return whether there is one.

        If not, the state is that of rest.
        """
        near = self.assembler.state(displacement)
        near.copy(self.x)
        near.destroy()
        converged = self.assembler.smallest_jacobian(self.x, 1.0)[0] > 0.0
        if converged:
            if self.stabilisation is not None:
                self.stabilisation.begin(self.x)
            try:
                self.advance(1.0, 1.0)
            except Diverged:
                converged = False
        if converged and self.steps.turning.watches:
            converged = self.steps.turning.follows(self.assembler.displacement(self.x, 1.0))
        if not converged:
            self.x.zeroEntries()
            if self.stabilisation is not None:
                self.stabilisation.begin(self.x)
        return converged

    def forget_path(self) -> None:
        """Begin a new path: the next predictor is linear."""
        self.history = None

    def resistance(self, direction: PETSc.Vec) -> PETSc.Vec:
        """Return the change of the residual over a short increment from the last equilibrium."""
        change = direction.duplicate()
        self._residual(self.x + direction, change)
        change.axpy(-1.0, self.snes.getFunction()[0])
        return change

    def own_tangent(self) -> PETSc.Mat:
        """Return the tangent at the last equilibrium, with the stress there."""
        self.assembler.extrapolate()
        self._fill(self.x, self._factor, self._matrix)
        return self._matrix

    def settle(self) -> "Proximal | None":
        """Reduce the stabilisation to zero at the full load, and return it (`Proximal.vanish`)."""
        if self.stabilisation is not None:
            self.stabilisation.vanish(self.again, self.x)
        return self.stabilisation

    @contextmanager
    def let_go(self, factor: float) -> Iterator[None]:
        """Reduce the stabilisation nearly to zero to evaluate the state at a load factor; then restore all.

        Raises
        ------
        SolveError
            If contact does not hold the bodies there.
        """
        held, contact = self.stabilisation, self.assembler.contact
        assert held is not None and contact is not None
        start, path, undo = self.x.copy(), (self.history, self.solves), (contact.keep(), held.keep())
        try:
            held.vanish(lambda: self.again(factor), self.x, NEARLY, FEW)
            yield
        finally:
            start.copy(self.x)
            self.history, self.solves = path
            for back in undo:
                back()

    def again(self, factor: float = 1.0) -> bool:
        """Iterate to equilibrium at the same load factor again; return whether that converges."""
        try:
            self.advance(factor, factor)
        except Diverged:
            return False
        return True

    def _predict(self, factor: float, step: float) -> tuple[float | None, PETSc.Vec]:
        """Set the trial state of a step; return the norm of its load increment, if any, and the path's slope."""
        assembler = self.assembler
        if self.history is None:
            self.left(self.x, factor)
        assembler.extrapolate()
        if not step and self._filled:
            # Only contact has changed, which Newton's iterations take into account.
            self.x.copy(self._trial)
            return self._convergence.carried_force, assembler.vector()
        self._filled = True
        self._fill(self.x, factor, self._matrix)
        if not step:
            self._fresh = True
            self.x.copy(self._trial)
            return None, assembler.vector()
        force, rate = self._slope(factor, step)
        # The tangent is that of continued flow: once the laws have accepted the state, it is that of unloading.
        self.left(self.x, factor)
        self._trial.waxpy(step, rate, self.x)
        if self._bend(rate, step):
            # The extrapolated stress is that of a linear predictor.
            assembler.extrapolate()
        if assembler.contact is not None and step:
            assembler.contact.predict(assembler.touching(self._trial, factor + step))
        if self.guess is not None:
            self.guess.copy(self._trial)
            self.guess = None
        return force, rate

    def _slope(self, factor: float, step: float) -> tuple[float, PETSc.Vec]:
        """Return the norm of a step's load increment, and the path's slope at its start."""
        ahead = self._ahead
        if ahead is None or ahead.factor != factor:
            # A cubic predictor needs the path's slope; the first step takes the secant of rotating supports.
            fraction = 1.0 if self.history is None else DELTA
            self.assembler.load_forces(self.x, factor, fraction * step, self._force)
            self._force.scale(1.0 / fraction)
            self._solve_linear(factor)
            rate = self._change.copy()
            rate.scale(-1.0 / step)
            ahead = Ahead(factor, rate, self._force.norm() / step)
            self._ahead = None if self.history is None else ahead
        return ahead.force * step, ahead.rate

    def _solve_linear(self, factor: float) -> None:
        """Set the change of state by the force."""
        ksp = self.snes.getKSP()
        ksp.setOperators(self._matrix)
        ksp.solve(self._force, self._change)
        self.iterations += 1
        self.linear_iterations += ksp.getIterationNumber()
        if ksp.getConvergedReason() < 0 or not np.isfinite(self._change.norm()):
            direct = SPARSE if is_mixed(self.assembler.model) else {"pc_type": "lu"}
            advice = " ".join(f"-{name} {value}" for name, value in {"ksp_type": "preonly", **direct}.items())
            raise SolveError(
                f"the linear solver failed at {self.assembler.model.when(factor)} "
                f"(KSP reason {ksp.getConvergedReason()}): a rigid-body "
                f"mode is unconstrained, or the preconditioner is unsuitable (try {advice})"
                f"{hourglass.hint(self.assembler.model)}"
            )

    def _bend(self, rate: PETSc.Vec, step: float) -> bool:
        """Make the predictor cubic, if the path is smooth; return whether it is."""
        if self.history is None or (self.assembler.contact is not None and self.solves > _SMOOTH):
            return False
        gap = self.history.bend(self.x, rate, step)
        bends = bool(gap.norm() <= step * rate.norm())
        self._trial.axpy(float(bends), gap)
        return bends

    def _correct(self, scale: float | None) -> int:
        """Iterate the trial state to equilibrium; return the number of linear solves, the predictor's included."""
        snes = self.snes
        self.norms = [] if scale is None else [scale]
        if self._line_search is not None:
            self._line_search.short = 0
        if self._own_tolerance:
            self._convergence.update(self._matrix, scale)
        snes.solve(None, self._trial)
        iterations = snes.getIterationNumber()
        self.iterations += iterations
        self.linear_iterations += snes.getLinearSolveIterations()
        reason = snes.getConvergedReason()
        if reason < 0:
            why = f"SNES diverged (reason {reason})"
            if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                why = f"the linear solver does not converge (KSP reason {snes.getKSP().getConvergedReason()})"
                # MUMPS does not recover from a failure.
                snes.getKSP().getPC().reset()
            raise Diverged(worst_place(self.assembler, self._trial, self._factor, why))
        return int(iterations) + 1

    def _free(self, x: PETSc.Vec, end: PETSc.Vec) -> float:
        return self.steps.free(x, end, self._factor, self._factor)
