"""Continuation in a load from rest to full load, in steps in which Newton's method converges."""

from collections.abc import Callable

from comparisons.fem.statics import Newton
from isorod.errors import SolveError

# A step is halved at most this many times, and doubled after one that took no more than so many linear solves.
HALVINGS = 6
_EASY = 6


def lead(
    newton: Newton,
    load: Callable[[float], None],
    full: float,
    first: float,
    name: str,
    halvings: int = HALVINGS,
    begin: float = 0.0,
    reached: Callable[[float], None] | None = None,
) -> dict[str, int]:
    """Continue from one load, usually from rest, to another; the size of the first step is given.

    Each step starts from the last two equilibria, extrapolated.  A step that fails is halved, one that was easy doubles
    the next.

    Parameters
    ----------
    newton
        Left at the equilibrium under the full load.
    load
        Sets the load.
    full, first
        All of it, and that of the first step.
    name
        Of the load, for errors.
    begin
        The load at which the state is.
    reached
        Called at each equilibrium, of which the path then is made: no step is larger than the first.

    Returns
    -------
    Numbers of ``steps``, of ``cuts`` and of ``newton_iterations`` and ``linear_iterations``, those in vain too.

    Raises
    ------
    SolveError
        If it fails however small the step.
    """
    done, size = begin, first
    counts = {"steps": 0, "cuts": 0, "newton_iterations": 0, "linear_iterations": 0}
    last, slope, guess = newton.x.copy(), newton.x.duplicate(), newton.x.duplicate()
    slope.set(0.0)
    while done < full * (1.0 - 1e-12):
        target = full if done + size > full * (1.0 - 1e-12) else done + size
        load(target)
        newton.norms.clear()
        guess.waxpy(target - done, slope, last)
        try:
            newton.solve(guess)
        except SolveError as problem:
            size *= 0.5
            counts["cuts"] += 1
            if size < first * 0.5**halvings:
                raise SolveError(f"{name} {target:.4g}: {problem}") from None
        else:
            slope.waxpy(-1.0, last, newton.x)
            slope.scale(1.0 / (target - done))
            newton.x.copy(last)
            done = target
            counts["steps"] += 1
            if newton.snes.getIterationNumber() <= _EASY:
                size *= 2.0
            if reached is not None:
                reached(done)
                size = min(size, first)
        counts["newton_iterations"] += newton.snes.getIterationNumber()
        counts["linear_iterations"] += newton.snes.getLinearSolveIterations()
    for vector in (last, slope, guess):
        vector.destroy()
    return counts
