"""Adaptive refinement of spaces until the estimated error of the result is within a tolerance.

Each step estimates the error across the section and along the axis (`isorod.checks.estimate`), and refines the
directions that contribute more than half of the tolerance: a degree more across the section (or an order, then twice
the control points), a degree more along the axis, then twice the elements.
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

# Smallest tolerance.
SMALLEST = 1e-10
# Refinements tried before giving up, and unknowns beyond which no space is tried.
MAX_STEPS = 24
MAX_UNKNOWNS = 400_000

# Polyharmonic order from which more points round the section reduce the error more than a higher order.
_ORDER = 2


class Solution(Protocol):
    """What refinement needs of a solution."""

    @property
    def model(self) -> Model:
        """The model that was solved."""

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of its error, or of its error in some of `isorod.checks.finer.DIRECTIONS`."""

    def errors(self, *directions: str) -> "tuple[float | None, float | None]":
        """Return `estimate`, and an estimate of the error of stresses."""


Solved = TypeVar("Solved", bound=Solution)


@dataclass(frozen=True)
class Step:
    """A refinement: the change of the first body's space that was refined, and the estimated error."""

    changed: dict[str, Any]
    error: float


class Reached(NamedTuple, Generic[Solved]):
    """A solution, its spaces, the refinements, and why it is not within the tolerance, empty if it is."""

    solution: Solved
    spaces: Sequence[Space]
    steps: Sequence[Step]
    short: str = ""


def reach(
    solve: Callable[[Sequence[Space]], Solved], spaces: Sequence[Space], tolerance: float, stresses: bool = False
) -> Reached[Solved]:
    """Return the first solution whose estimated relative error is within the tolerance, else the best one.

    Parameters
    ----------
    solve
        Builds a model on spaces, one for each body, and solves it.
    spaces
        Initial spaces.
    tolerance
        Relative error, between 1e-10 and 1.
    stresses
        Whether the error of stresses counts too.

    Raises
    ------
    InputError
        If the tolerance is out of range, or the solution has no estimate (supports within the rod).
    SolveError
        If the first solve fails.
    """
    check(tolerance)
    changed: dict[str, Any] = {}
    steps: list[Step] = []
    kept: list[tuple[Solved, Sequence[Space]]] = []
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
        # Only the best is kept, to save memory.
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
    kept: Sequence[tuple[Solved, Sequence[Space]]], steps: Sequence[Step], tolerance: float, why: str = ""
) -> Reached[Solved]:
    """Return the solution with the smallest error where none is within the tolerance."""
    k = min(range(len(steps)), key=lambda k: (steps[k].error, -k))
    return Reached(*kept[0], steps[: k + 1], short(tolerance, steps[k].error, len(steps) - 1, why))


def short(tolerance: float, error: float, refinements: int, why: str = "") -> str:
    """Return the message that a tolerance is not reached, with the estimated error."""
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
    """Return initial section functions whose error is about the tolerance."""
    check(tolerance)
    # A frequency goes with the root of a stiffness.
    return choice.section(rod, min(1.5 * tolerance, 0.1))


def refined(space: Space, changed: dict[str, Any]) -> Space:
    """Return a space with changes, and a quadrature rule that suits them; ``auto`` and ``full`` adapt by themselves."""
    follows = space.quadrature in ("auto", "full")
    made = replace(space, quadrature=space.quadrature if follows else "auto", **changed)
    return made if follows else replace(made, quadrature=str(choice.rule(made)))


def _changes(spaces: Sequence[Space], across: bool, along: bool) -> list[dict[str, Any]]:
    """Return the refinement of each space, along the axis too where none across is left.

    Spaces of the lowest degree are refined first.
    """
    lowest = min(space.section_degree or 0 for space in spaces)
    changes = [_across(space) if across and (space.section_degree or 0) == lowest else {} for space in spaces]
    if along or not any(changes):
        least = min(space.axis.degree for space in spaces)
        changes = [
            changed | (more_along(space) if space.axis.degree == least else {})
            for changed, space in zip(changes, spaces, strict=True)
        ]
    return changes


def _across(space: Space) -> dict[str, Any]:
    if space.section_degree is not None:
        return {"section_degree": space.section_degree + 1} if space.section_degree < MAX_SECTION_DEGREE else {}
    if space.order is not None and space.order < _ORDER:
        return {"order": space.order + 1}
    return {"section_points": 2 * space.points_around} if 2 * space.points_around <= MAX_COUNT else {}
