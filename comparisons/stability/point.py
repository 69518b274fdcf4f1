"""Sweeps and their points: a value, PETSc options, what came out, and the one-line failure where nothing did."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from isorod.errors import InputError, SolveError


def measure(sweep: str, value: float | str, solve: Callable[[], Mapping[str, Any]], **more: Any) -> dict[str, Any]:
    """Return the record of a point.

    Parameters
    ----------
    sweep, value
        Name of the swept number, and the number.
    solve
        Computes the point and returns what was found: ``error`` (relative, against the reference) and whatever else the
        case reports. An `InputError` or `SolveError` becomes ``failure``, its one line; anything else is a defect and
        passes through.
    more
        What is known beforehand: ``reference`` (words), ``tolerance`` (the largest error at which the point holds),
        ``series`` (name of the curve where a sweep has several).
    """
    start = perf_counter()
    try:
        # What overflows is refused by the solvers; numpy need not say it too.
        with np.errstate(all="ignore"):
            found = dict(solve())
    except (InputError, SolveError) as problem:
        found = {"failure": str(problem)}
    return {"sweep": sweep, "value": value, **more, **found, "seconds": perf_counter() - start}


class Sweep(NamedTuple):
    """A swept number: its name, what results are compared with, and the largest error at which a point holds."""

    name: str
    reference: str
    tolerance: float

    def point(self, value: float, solve: Callable[[], Mapping[str, Any]], **more: Any) -> dict[str, Any]:
        """Return the record of a point (`measure`)."""
        return measure(self.name, value, solve, reference=self.reference, tolerance=self.tolerance, **more)

    def over(
        self, values: Iterable[float], solve: Callable[..., Mapping[str, Any]], *given: Any, **more: Any
    ) -> Iterator[dict[str, Any]]:
        """Yield the records of ``solve(value, *given)`` at each value."""
        for value in values:
            yield self.point(value, partial(solve, value, *given), **more)


@contextmanager
def petsc(values: Mapping[str, Any]) -> Iterator[None]:
    """Set PETSc options as a user would type them, within."""
    from petsc4py import PETSc

    options = PETSc.Options()
    for name, value in values.items():
        options[name] = value
    try:
        yield
    finally:
        for name in values:
            options.delValue(name)


def holds(record: Mapping[str, Any]) -> bool:
    """Return whether a point has a result, within its tolerance if it has one."""
    return "failure" not in record and bool(record["error"] <= record.get("tolerance", np.inf))


def reach(records: list[dict[str, Any]]) -> float | None:
    """Return the last value up to which all points of a sweep hold, in the order of the records.

    None if the first does not.
    """
    last = None
    for record in records:
        if not holds(record):
            break
        last = record["value"]
    return last


def reached(curves: Mapping[str, list[dict[str, Any]]], form: str, single: str = "") -> str:
    """Return in words up to which value each series holds; ``single`` stands for an empty name."""
    words = []
    for series, curve in curves.items():
        last = reach(curve)
        words.append(f"{series or single} {'nowhere' if last is None else f'up to {last:{form}}'}")
    return ", ".join(words)


def sweeps(records: list[dict[str, Any]]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Return the points by sweep and series, in the order of the records."""
    found: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for record in records:
        found.setdefault(record["sweep"], {}).setdefault(record.get("series", ""), []).append(record)
    return found
