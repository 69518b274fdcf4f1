"""Length of a Newton step by the work of the residual along it."""

from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from isorod.statics.tuning import CONTROL


def step_length(work: Callable[[float], float], start: float) -> float:
    """Return the fraction of a step at which the residual's work along it is about zero.

    Where points come into contact, or slip, the residual is not smooth and full Newton steps oscillate.  Its work along
    a step is continuous, and falls from the start while the tangent is definite; where it has changed sign at the end,
    points that push back lie between.  The bracket is closed by chords and, where these do not halve it, by halving.

    Parameters
    ----------
    work
        ``work(fraction)`` is the work at a fraction of the step, which need not be finite.
    start
        The work at zero, positive for a descent direction.
    """
    low, high, at_low, at_high = 0.0, 1.0, start, work(1.0)
    if not start > 0.0:
        # The tangent is not definite, but the step may be right.
        while high > CONTROL.short and not np.isfinite(at_high):
            high *= 0.5
            at_high = work(high)
        return high
    if at_high >= -CONTROL.kept * start:
        return 1.0
    halve = not np.isfinite(at_high)
    for _ in range(CONTROL.evaluations):
        fraction = 0.5 * (low + high) if halve else low + (high - low) * at_low / (at_low - at_high)
        at_fraction = work(fraction)
        if abs(at_fraction) <= CONTROL.left * start:
            return fraction
        width = high - low
        if at_fraction > 0.0:
            low, at_low = fraction, at_fraction
        else:
            high, at_high = fraction, at_fraction
        # A chord to a distant end hardly moves the other one.
        halve = not np.isfinite(at_high) or (not halve and high - low > 0.5 * width)
    return low


class LineSearch:
    """Shortens the steps of SNES with its basic line search to `step_length`.

    Parameters
    ----------
    snes, residual
        The solver, and a function that fills a vector with the residual of a state.
    signs
        1 for each unknown, or -1 where equilibrium is the functional's maximum by it, as by the pressures of the mixed
        formulation: with these signs the work falls along a step to the saddle, and the tangent is definite.  None: 1
        everywhere.
    free
        Returns the fraction of the increment between two states without bodies passing through each other.

    Attributes
    ----------
    short
        Number of very short steps since this was last set.
    fraction
        Fraction of the last step that was taken.
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
        """Scale the step ``y`` from ``x``; return whether that changes it."""
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
        for vector in (force, trial, direction):
            vector.destroy()
        return self.fraction < 1.0
