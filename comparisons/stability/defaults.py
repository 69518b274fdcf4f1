"""The points of other cases once more with nothing chosen by hand: right, told of, refused, or wrong in silence.

Where a case makes a space, a body or a spring of its own choice it gets one without any; the finest spaces are its
references and stay.  A point is told of where its result's own estimate is a third of its error or more, or a
warning was given.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from comparisons.measure.records import Record
from comparisons.stability import contrast, incompressible, large, point, sections, slender
from isorod import modal, statics
from isorod.command.solving import LARGE
from isorod.geometry.rod import Rod
from isorod.model import Body
from isorod.scenes.spring import Spring
from isorod.space import Space

NAME = "defaults"
TITLE = "nothing chosen by hand"
COLUMNS = {"estimate": "estimated", "outcome": "outcome", "warned": "warning", "space": "space"}

CASES = (incompressible, slender, large, contrast, sections)
# Supports of single points round the section, a mixed body of given degree, and geometry alone: nothing to choose.
LEFT_OUT = (
    incompressible.PINCHED,
    incompressible.TWISTED.name,
    sections.DEPTH.name,
    sections.OFFSET.name,
    sections.TWIST.name,
)
TOLERANCE = 5e-3
OUTCOMES = ("right", "told of", "refused", "wrong in silence")

# Degree from which a space is a reference; of so many elements one less, across.
_FINE, _MANY = 5, 16


class Bare:
    """In the place of `Space` in a case: no choice but the rod's, unless the space is a reference."""

    @staticmethod
    def paper(rod: Rod, elements: int | None = None, degree: int | None = None, **given: Any) -> Space:
        """Return the space of a rod."""
        if (degree or 0) >= _FINE or ((elements or 0) >= _MANY and given.get("section_degree", 0) >= _FINE - 1):
            return Space.paper(rod, elements, degree, **given)
        return Space(rod)


def LIMITS(records: list[Record]) -> list[str]:
    """Return how many points came out how."""
    counts = {name: sum(record["outcome"] == name for record in records) for name in OUTCOMES}
    told = ", ".join(f"{count} {name}" for name, count in counts.items())
    return [
        f"{len(records)} points, within {100 * TOLERANCE:g} %: {told}. A result is told of where its own estimate is a "
        f"third of its error or more; above {100 * LARGE:g} % that is a warning.",
        f"Left out, as nothing is chosen there: {'; '.join(LEFT_OUT)}; steps in time; solver options.",
    ]


def run(level: str) -> Iterator[dict[str, Any]]:
    """Yield the points."""
    for case in CASES:
        with _bare(case):
            yield from (record for record in case.run(level) if record)


def outcome(record: Mapping[str, Any]) -> str:
    """Return how a point came out."""
    if "failure" in record:
        return "refused"
    if record["error"] <= TOLERANCE:
        return "right"
    told = "warned" in record or 3.0 * (record.get("estimate") or 0.0) >= record["error"]
    return "told of" if told else "wrong in silence"


@contextmanager
def _bare(case: Any) -> Iterator[None]:
    """Let a case make no choice, and measure each point of its sweeps once."""
    known: set[tuple[str, Any]] = set()
    estimates: list[float | None] = []
    spaces: list[str] = []
    plain = point.measure

    def measure(sweep: str, value: Any, solve: Callable[[], Mapping[str, Any]], **more: Any) -> dict[str, Any] | None:
        if (sweep, value) in known or sweep in LEFT_OUT:
            return None
        known.add((sweep, value))
        estimates.clear()
        spaces.clear()
        more |= {"series": NAME, "tolerance": TOLERANCE}
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = plain(f"{case.NAME}: {sweep}", value, solve, **more)
        if said:
            found.setdefault("warned", str(said[0].message))
        if spaces:
            found |= {"estimate": max((one or 0.0 for one in estimates), default=0.0), "space": spaces[0]}
        return found | {"outcome": outcome(found)}

    def estimating(solve: Callable[..., Any]) -> Callable[..., Any]:
        def solved(model: Any, *given: Any, **more: Any) -> Any:
            solution = solve(model, *given, **more)
            space = model.bodies[0].space
            if {"elements", "degree"} <= set(space.chosen):
                estimates.append(solution.estimate())
                spaces.append(str(space))
            return solution

        return solved

    def body(space: Space, *given: Any, formulation: str | None = None) -> Body:
        return Body(space, *given)

    def spring(E: float, nu: float, **given: Any) -> Spring:
        return Spring(E=E, nu=nu)

    with ExitStack() as stack:
        stack.enter_context(patch.object(point, "measure", measure))
        for name, value in {"Space": Bare, "Body": body}.items():
            stack.enter_context(patch.object(case, name, value))
        for analysis in (statics, modal):
            stack.enter_context(patch.object(analysis, "solve", estimating(analysis.solve)))
        if case is incompressible:
            spring.E, spring.pull = Spring.E, Spring.pull  # type: ignore[attr-defined]
            stack.enter_context(patch.object(case, "Spring", spring))
        if case is sections:
            from comparisons.stability import rods

            stack.enter_context(patch.object(rods, "Body", body))
        yield
