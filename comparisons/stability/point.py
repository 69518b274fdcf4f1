"""Sweeps and their points: a value, PETSc options, and the results or the one-line failure."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from isorod.errors import InputError, SolveError


class Sweep(NamedTuple):
    """A swept number: its name, the reference of results, and the largest error at which a point holds."""

    name: str
    reference: str
    tolerance: float

    def point(self, value: float, solve: Callable[[], Mapping[str, Any]], **more: Any) -> dict[str, Any]:
        """Return the record of a point.

        Parameters
        ----------
        value
            The swept number.
        solve
            Computes the point and returns its results: ``error`` (relative, against the reference) and whatever else
            the case reports. An `InputError` or `SolveError` becomes ``failure``, its one line; anything else is a
            defect and passes through.
        more
            What is known beforehand, such as ``series``, the name of the curve where a sweep has several.
        """
        start = perf_counter()
        try:
            # What overflows is refused by the solvers; numpy need not warn too.
            with np.errstate(all="ignore"):
                result = dict(solve())
        except (InputError, SolveError) as problem:
            result = {"failure": str(problem)}
        known = {"sweep": self.name, "value": value, "reference": self.reference, "tolerance": self.tolerance}
        return known | more | result | {"seconds": perf_counter() - start}

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


def limits(records: list[dict[str, Any]]) -> list[str]:
    """Return how far each series of each sweep holds, in words, a line a sweep."""
    lines = []
    for sweep, curves in sweeps(records).items():
        words = []
        for series, curve in curves.items():
            last, refused = reach(curve), sum("failure" in record for record in curve)
            errors = [record["error"] for record in curve if "error" in record]
            facts = [f"largest error {max(errors):.2g}"] if errors else []
            facts += [f"{refused} refused"] if refused else []
            words.append(f"{series or 'holds'} {'nowhere' if last is None else f'up to {last:g}'} ({', '.join(facts)})")
        tolerance = next(iter(curves.values()))[0]["tolerance"]
        lines.append(f"{sweep}, error within {tolerance:g}: {'; '.join(words)}.")
    return lines


def sweeps(records: list[dict[str, Any]]) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Return the points by sweep and series, in the order of the records."""
    records_by_sweep: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for record in records:
        records_by_sweep.setdefault(record["sweep"], {}).setdefault(record.get("series", ""), []).append(record)
    return records_by_sweep
