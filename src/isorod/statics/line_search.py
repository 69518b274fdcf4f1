"""Length of a Newton step by the work of the out-of-balance force along it."""

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from isorod.statics.tuning import CONTROL


def step_length(work: Callable[[float], float], start: float) -> float:
    """Return the fraction of a step at whose end no work is left along it, roughly.

    Where points come into contact, or slip, the force is no smooth function of the state and full Newton steps go back
    and forth.  Its work along a step is continuous.  It falls from the start as long as the tangent is definite; where
    it has changed sign at the end, points that push back lie between.  The bracket closes by chords and, where
    these do not halve it, halving.

    Parameters
    ----------
    work
        ``work(fraction)`` is the work at a fraction of the step, which need not be finite.
    start
        That at none of it, where a descent direction makes it positive.
    """
    low, high, at_low, at_high = 0.0, 1.0, start, work(1.0)
    if not start > 0.0:
        # The tangent is not definite, and the step may be right all the same.
        while high > CONTROL.short and not np.isfinite(at_high):
            high *= 0.5
            at_high = work(high)
        return high
    if at_high >= -CONTROL.kept * start:
        return 1.0
    halve = not np.isfinite(at_high)
    for _ in range(CONTROL.evaluations):
        fraction = 0.5 * (low + high) if halve else low + (high - low) * at_low / (at_low - at_high)
        found = work(fraction)
        if abs(found) <= CONTROL.left * start:
            return fraction
        width = high - low
        if found > 0.0:
            low, at_low = fraction, found
        else:
            high, at_high = fraction, found
        # A chord of which one end is far off hardly moves the other.
        halve = not np.isfinite(at_high) or (not halve and high - low > 0.5 * width)
    return low


class LineSearch:
    """Lets SNES, with its basic line search, take steps of such a length (`step_length`).

    Parameters
    ----------
    snes, residual
        The solver, and what fills a vector with the out-of-balance force of a state.
    signs
        Of each unknown 1, or -1 where equilibrium is the functional's maximum by it, as by the pressures of the mixed
        formulation: what falls along a step to a saddle is the work with these signs, and the tangent with them is
        definite.  None: 1 everywhere.
    free
        Returns the fraction of the increment between two states on which bodies do not go through each other.

    Attributes
    ----------
    short
        How many steps were hardly any, since this was last set.
    fraction
        How much of the last step was taken.
    """

    def __init__(
        self,
        snes: PETSc.SNES,
        residual: Callable[[PETSc.Vec, PETSc.Vec], object],
        signs: PETSc.Vec | None,
        free: Callable[[PETSc.Vec, PETSc.Vec], float],
    ) -> None:
        self.short, self.fraction, self._free = 0, 1.0, free
        self._snes, self._residual, self._signs = snes, residual, signs
        snes.setLineSearchPreCheck(self._shorten)

    def _shorten(self, x: PETSc.Vec, y: PETSc.Vec) -> bool:
        """Scale the step ``y`` that is to be taken from ``x``; return whether that changes it."""
        start = self._snes.getFunction()[0]
        force, trial, direction = start.duplicate(), x.duplicate(), y.copy()
        if self._signs is not None:
            direction.pointwiseMult(direction, self._signs)

        def work(fraction: float) -> float:
            trial.waxpy(-fraction, y, x)
            self._residual(trial, force)
            return float(force.dot(direction))

        trial.waxpy(-1.0, y, x)
        free = self._free(x, trial)
        y.scale(free)
        direction.scale(free)
        fraction = step_length(work, float(start.dot(direction)))
        self.short += fraction < CONTROL.short
        self.fraction = fraction * free
        y.scale(fraction)
        for one in (force, trial, direction):
            one.destroy()
        return self.fraction < 1.0
