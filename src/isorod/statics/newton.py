"""SNES on an assembler, at one load factor after the other."""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import SPARSE, _is_mixed, factorisation
from isorod.checks import hourglass, rigid_motions
from isorod.errors import SolveError
from isorod.options import defaults
from isorod.statics.convergence import Balance, squeezed

# Preconditioners that ask for the rigid motions.
MULTIGRID = ("gamg", "ml", "hypre")

# Share of a load step by which the residual is differentiated where supports turn.
_DELTA = 1e-6

# What a user's option overrides.
OPTIONS = {"snes_linesearch_type": "basic", "snes_rtol": 1e-9, "snes_max_it": 15, "ksp_type": "preonly"}


class _Diverged(Exception):
    """A load step did not converge."""


class _Past(NamedTuple):
    """The equilibrium before the last: how much lower its load factor was, its state, and the path's slope there."""

    step: float
    x: PETSc.Vec
    rate: PETSc.Vec


class _Newton:
    """SNES on an assembler, at one load factor after the other."""

    def __init__(self, assembler: Assembler) -> None:
        self.assembler = assembler
        self.x = assembler.vector()
        self.trial = assembler.vector()
        self.force = assembler.vector()
        self.change = assembler.vector()
        self.matrix = assembler.matrix()
        self.factor = 0.0
        self.balance = Balance(assembler)
        self._history: _Past | None = None
        self._rate = self.change
        self.iterations = 0
        self.linear_iterations = 0
        self.norms: list[float] = []
        self._stage = PETSc.Log.Stage("solve")
        with defaults(OPTIONS | factorisation(assembler)) as typed:
            self.snes = PETSc.SNES().create(assembler.comm)
            self.snes.setFunction(self._residual, assembler.vector())
            self.snes.setJacobian(self._tangent, self.matrix)
            self.snes.setMonitor(lambda snes, k, norm: self.norms.append(norm))
            self.snes.setFromOptions()
            if self.snes.getKSP().getPC().getType() in MULTIGRID:
                self.matrix.setNearNullSpace(rigid_motions.near_null_space(assembler))
            self._own_tolerance = "snes_atol" not in typed
            self._may_reuse = self._own_tolerance and not PETSc.Options().hasName("snes_test_jacobian")
            if self._own_tolerance:
                self.snes.setConvergenceTest(self.balance.test)

    def destroy(self) -> None:
        """Give back matrix, factors and work vectors, which SNES and this object, each holding the other, would keep for long."""
        for one in (self.snes, self.matrix, self.trial, self.force, self.change):
            one.destroy()

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self.assembler.residual(x, self.factor, out)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        # The last tangent, with its factors, may be good enough for the last iteration.
        own = self._may_reuse and snes.handle == self.snes.handle and P.handle == self.matrix.handle
        if not (own and len(self.norms) > 1 and self.balance.reuses_tangent(self.norms[-2], self.norms[-1], snes)):
            self.assembler.tangent(x, self.factor, P)
        if J.handle != P.handle:
            J.assemble()

    def advance(self, factor: float, target: float) -> int:
        """Go from the equilibrium at ``factor`` to the one at ``target``; return the number of linear solves."""
        self._stage.push()
        try:
            return self._advance(factor, target)
        finally:
            self._stage.pop()

    def _advance(self, factor: float, target: float) -> int:
        assembler, snes = self.assembler, self.snes
        assembler.extrapolate()
        matrices = assembler.tangent(self.x, factor, self.matrix, keep=True)
        # A cubic predictor takes the path's slope, the first step the whole way of supports that turn.
        share = 1.0 if self._history is None else _DELTA
        assembler.load_forces(self.x, factor, matrices, share * (target - factor), self.force)
        self.force.scale(1.0 / share)
        del matrices
        scale = self.force.norm()
        ksp = snes.getKSP()
        ksp.setOperators(self.matrix)
        ksp.solve(self.force, self.change)
        self.iterations += 1
        self.linear_iterations += ksp.getIterationNumber()
        if ksp.getConvergedReason() < 0 or not np.isfinite(self.change.norm()):
            advice = {"ksp_type": "preonly", **(SPARSE if _is_mixed(assembler.model) else {"pc_type": "lu"})}
            raise SolveError(
                f"the linear solver failed at load factor {factor:.6g} (KSP reason {ksp.getConvergedReason()}): a free rigid "
                f"motion is not held, or the preconditioner does not fit (try {' '.join(f'-{k} {v}' for k, v in advice.items())})"
            )
        self.trial.waxpy(-1.0, self.change, self.x)
        if self._bend(target - factor):
            # The extrapolated stress belongs to a straight step.
            assembler.extrapolate()
        self.factor = target
        before = assembler.jacobians(self.x, factor)
        self._refuse_squeezed(before)
        self.norms = [scale]
        if self._own_tolerance:
            self.balance.update(self.matrix, scale)
        snes.solve(None, self.trial)
        its = snes.getIterationNumber()
        self.iterations += its
        self.linear_iterations += snes.getLinearSolveIterations()
        if snes.getConvergedReason() < 0:
            det, body, element, u = assembler.smallest_jacobian(self.trial, target)
            at = f"element {element} of body {body}, axis position u = {u:.4g}: det F = {det:.3g}"
            why = "an element inverts" if not det > 0.0 else f"SNES diverged (reason {snes.getConvergedReason()})"
            if snes.getConvergedReason() == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                why = f"the linear solver does not converge (KSP reason {ksp.getConvergedReason()})"
            raise _Diverged(f"{why} however small the load step; worst place: {at}{hourglass.hint(assembler.model)}")
        self._refuse_squeezed(before)
        self._history = _Past(target - factor, self.x.copy(), self._rate)
        self.trial.copy(self.x)
        return its + 1

    def _bend(self, step: float) -> bool:
        """Make the predictor follow the curve of the path, by the cubic through the last two equilibria with their tangents."""
        self._rate = self.change.copy()
        self._rate.scale(-1.0 / step if step else 0.0)
        if self._history is None or not step or self.assembler.contact is not None:
            return False
        length, past, slope = self._history
        gap = past - self.x
        gap.axpy(length, self._rate)
        turn = slope - self._rate
        turn.scale(length)
        share = step / length
        # x + v t + a t^2 + b t^3 with the values and slopes of both ends.
        gap.scale(3.0 * share**2 + 2.0 * share**3)
        gap.axpy(share**2 + share**3, turn)
        if not gap.norm() <= self.change.norm():
            return False
        self.trial.axpy(1.0, gap)
        return True

    def _refuse_squeezed(self, before: list[Array]) -> None:
        problem = squeezed(self.assembler, before, self.trial, self.factor)
        if problem is not None:
            raise _Diverged(problem)
