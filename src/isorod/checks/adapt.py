"""The coarsest of the spaces tried whose result is estimated to be within a tolerance.

Each step estimates the error across the section and along the axis (`isorod.checks.estimate`), and refines what makes
more than its half of the tolerance: a degree more across the section (or an order, then twice the control points), a
degree more along the axis, then twice the elements.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from isorod.checks.finer import DIRECTIONS, more_along
from isorod.errors import InputError, SolveError
from isorod.geometry.disk import MAX_COUNT
from isorod.geometry.rod import Rod
from isorod.memory import SHORT
from isorod.model.model import Model
from isorod.space import choice
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE
from isorod.space.space import Space

# Results are not converged to less than this.
SMALLEST = 1e-10
# Refinements tried before giving up, and unknowns beyond which no space is tried.
MAX_STEPS = 24
MAX_UNKNOWNS = 400_000

# Polyharmonic order from which points round the section tell more than another order.
_ORDER = 2


class Solution(Protocol):
    """What is asked of a solution."""

    @property
    def model(self) -> Model:
        """What was solved."""

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of its error, or of that in one of `isorod.checks.finer.DIRECTIONS`."""

    def errors(self, *directions: str) -> "tuple[float | None, float | None]":
        """Return that, and an estimate of the error of stresses."""


Found = TypeVar("Found", bound=Solution)


@dataclass(frozen=True)
class Step:
    """Spaces that were tried: what was changed since the last ones, in the first body refined, and the error left."""

    changed: dict[str, Any]
    error: float


class Reached(NamedTuple, Generic[Found]):
    """A solution, its spaces, the steps to it, and in words why it is not within the tolerance, empty if it is."""

    solution: Found
    spaces: Sequence[Space]
    steps: Sequence[Step]
    short: str = ""


def reach(
    solve: Callable[[Sequence[Space]], Found], spaces: Sequence[Space], tolerance: float, stresses: bool = False
) -> Reached[Found]:
    """Return the first solution whose estimated relative error is within the tolerance, else the best there was.

    Parameters
    ----------
    solve
        Builds a model on spaces, one a body, and solves it.
    spaces
        To start with.
    tolerance
        Relative error, between 1e-10 and 1.
    stresses
        Whether the error of stresses counts too.

    Raises
    ------
    InputError
        If the tolerance is out of range, or the solution has no estimate (supports within the rod).
    SolveError
        If the first solution is not found.
    """
    check(tolerance)
    changed: dict[str, Any] = {}
    steps: list[Step] = []
    kept: list[tuple[Found, Sequence[Space]]] = []
    while True:
        try:
            solution = solve(spaces)
            across, along = (_error(solution, direction, stresses) for direction in DIRECTIONS)
            if across is None or along is None:
                raise InputError("tolerance: no error estimate is available for this result")
        except (InputError, SolveError, MemoryError) as problem:
            if not steps:
                raise
            return _best(kept, steps, tolerance, f"; the refined model fails: {str(problem) or SHORT}")
        steps.append(Step(changed, across + along))
        # All but the best would be memory for nothing.
        if steps[-1].error <= min(one.error for one in steps):
            kept = [(solution, spaces)]
        if steps[-1].error <= tolerance:
            return Reached(solution, spaces, steps)
        changes = _changes(spaces, across >= 0.5 * tolerance, along >= 0.5 * tolerance)
        changed = next((one for one in changes if one), {})
        if len(steps) > MAX_STEPS or not changed or solution.model.unknowns > MAX_UNKNOWNS:
            return _best(kept, steps, tolerance)
        spaces = [refined(*one) for one in zip(spaces, changes, strict=True)]


def _best(
    kept: Sequence[tuple[Found, Sequence[Space]]], steps: Sequence[Step], tolerance: float, why: str = ""
) -> Reached[Found]:
    """Return what came nearest to a tolerance that is not reached."""
    k = min(range(len(steps)), key=lambda k: (steps[k].error, -k))
    return Reached(*kept[0], steps[: k + 1], short(tolerance, steps[k].error, len(steps) - 1, why))


def short(tolerance: float, error: float, refinements: int, why: str = "") -> str:
    """Return in words that a tolerance is not reached, and how near a result is."""
    return f"tolerance {tolerance:g} not reached: estimated error {error:.2g} after {refinements} refinements{why}"


def _error(solution: Solution, direction: str, stresses: bool) -> float | None:
    if not stresses:
        return solution.estimate(direction)
    return max((one for one in solution.errors(direction) if one is not None), default=None)


def check(tolerance: float) -> None:
    """Raise `InputError` for a tolerance out of range."""
    if not SMALLEST <= tolerance < 1.0:
        raise InputError(f"tolerance: got {tolerance:g}, need a relative error between 0 and 1, not below {SMALLEST:g}")


def section(rod: Rod, tolerance: float) -> dict[str, int]:
    """Return section functions that miss as much as the tolerance lets them, to start with."""
    check(tolerance)
    # A frequency goes with the root of a stiffness.
    return choice.section(rod, min(1.5 * tolerance, 0.1))


def refined(space: Space, changed: dict[str, Any]) -> Space:
    """Return a space with other numbers, and the rule that goes with them unless one was given that follows."""
    follows = space.quadrature in ("auto", "full")
    made = replace(space, quadrature=space.quadrature if follows else "auto", **changed)
    return made if follows else replace(made, quadrature=str(choice.rule(made)))


def _changes(spaces: Sequence[Space], across: bool, along: bool) -> list[dict[str, Any]]:
    """Return what to refine each space by, along the axis too where no more can be done across.

    Those of the lowest degree are refined first.
    """
    wide = min(space.section_degree or 0 for space in spaces)
    found = [_across(one) if across and (one.section_degree or 0) == wide else {} for one in spaces]
    if along or not any(found):
        least = min(space.axis.degree for space in spaces)
        found = [
            changed | (more_along(one) if one.axis.degree == least else {})
            for changed, one in zip(found, spaces, strict=True)
        ]
    return found


def _across(space: Space) -> dict[str, Any]:
    if space.section_degree is not None:
        return {"section_degree": space.section_degree + 1} if space.section_degree < MAX_SECTION_DEGREE else {}
    if space.order is not None and space.order < _ORDER:
        return {"order": space.order + 1}
    return {"section_points": 2 * space.points_around} if 2 * space.points_around <= MAX_COUNT else {}
