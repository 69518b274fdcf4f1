"""SNES on the equations of one implicit step."""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.factorisation import factorisation
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.options import defaults
from isorod.petsc.direct import room
from isorod.petsc.matrix import forget_factors
from isorod.petsc.snes import create_snes

# Defaults, which a user's options override.
OPTIONS = {
    "snes_linesearch_type": "bt",
    "snes_linesearch_max_it": 10,
    "snes_rtol": 1e-10,
    "snes_max_it": 25,
    "ksp_type": "preonly",
}

# After so many iterations the residual must be less than this fraction of the first; otherwise half the step is better
# than more iterations.
_LOOKED, _LESS = 8, 0.9

# Where Newton's iterations no longer reduce the residual by this factor, this multiple of its rounding is accepted.
_STALLED = 0.3

_NOISE = 10.0


class Newton:
    """SNES on the balance of a step.

    Attributes
    ----------
    iterations
        Newton iterations so far.
    """

    def __init__(self, assembler: StepAssembler) -> None:
        self.assembler = assembler
        self.iterations = 0
        self.matrix = assembler.matrix()
        self.x = assembler.vector()
        self._factor = 0.0
        self._first = self._last = np.inf
        self.snes = create_snes(
            assembler.vector(),
            self.matrix,
            lambda x, out: assembler.residual(x, self._factor, out),
            self._tangent,
            self._test,
            OPTIONS | factorisation(assembler),
        )

    def destroy(self) -> None:
        """Release matrix, factors and state, which the circular reference of SNES and this object would keep."""
        for item in (self.snes, self.matrix, self.x):
            item.destroy()

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Mat) -> None:
        self.assembler.tangent(x, self._factor, out)
        forget_factors(out, self.snes.getKSP())

    def imbalance(self, guess: Array, factor: float) -> float:
        """Return the norm of the residual for a guess of the displacement increment."""
        force = self.assembler.vector()
        self.assembler.residual(self.assembler.guess(guess), factor, force)
        norm = float(force.norm())
        return norm if np.isfinite(norm) else np.inf

    def solve(self, guess: Array, factor: float) -> Array | None:
        """Return the displacement increment (all degrees of freedom) from a guess; None where SNES diverges."""
        self._factor = factor
        self._last = np.inf
        self.assembler.guess(guess).copy(self.x)
        with defaults(room(self.assembler.comm)):
            self.snes.solve(None, self.x)
        self.iterations += self.snes.getIterationNumber()
        if self.snes.getConvergedReason() < 0 and not self._accurate():
            return None
        return self.assembler.change(self.x) + self.assembler.moved

    def _accurate(self) -> bool:
        # At round-off level the line search fails.
        return self._last <= _NOISE * self.assembler.rounding

    def _test(self, snes: PETSc.SNES, iteration: int, norms: tuple[float, float, float]) -> PETSc.SNES.ConvergedReason:
        """Return SNES's reason to stop: a residual small beside the acting forces, or stalled at their rounding."""
        reasons = PETSc.SNES.ConvergedReason
        force = norms[2]
        if not np.isfinite(force):
            return reasons.DIVERGED_FNORM_NAN
        if iteration == 0:
            self._first = force
        stalled = iteration > 0 and force > _STALLED * self._last
        self._last = force
        if force <= snes.getTolerances()[0] * self.assembler.amount:
            return reasons.CONVERGED_FNORM_RELATIVE
        if stalled and force <= _NOISE * self.assembler.rounding:
            return reasons.CONVERGED_FNORM_ABS
        if iteration == _LOOKED and force > _LESS * self._first:
            return reasons.DIVERGED_MAX_IT
        return reasons.CONVERGED_ITERATING
