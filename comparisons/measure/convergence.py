"""Extrapolation of a quantity computed on three meshes, and orders of convergence of Newton's method."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from comparisons.measure.records import Record
from isorod.errors import SolveError


@dataclass(frozen=True)
class Limit:
    """Richardson's limit, the observed order, and how far the finest value is from the limit.

    Without one (`extrapolate`), the finest value, None, and how far it is from the one before.
    """

    value: float
    order: float | None
    distance: float


def richardson(sizes: Sequence[float], values: Sequence[float]) -> Limit:
    """Return the limit of ``f(h) = limit + c h^order`` through the three finest of the given pairs.

    Parameters
    ----------
    sizes
        Mesh sizes, decreasing.
    values
        The quantity on each.

    Raises
    ------
    SolveError
        If the values do not approach a limit monotonically, so that they have no order.
    """
    (a, b, c), (f, g, h) = sizes[-3:], values[-3:]
    if not a > b > c > 0.0:
        raise SolveError(f"extrapolation: mesh sizes {a:g}, {b:g}, {c:g} must decrease")
    ratio = (f - g) / (g - h) if g != h else np.inf

    def misfit(order: float) -> float:
        return float((a**order - b**order) / (b**order - c**order) - ratio)

    try:
        order = brentq(misfit, 0.05, 20.0)
    except ValueError:
        raise SolveError(f"extrapolation: {f:.8g}, {g:.8g}, {h:.8g} show no order of convergence") from None
    limit = h + (h - g) * c**order / (b**order - c**order)
    return Limit(float(limit), float(order), abs(float(h - limit)))


def extrapolate(sizes: Sequence[float], values: Sequence[float]) -> Limit:
    """Return `richardson`'s limit, or the finest value where there is none.

    There is none where the values do not approach one monotonically with first order at least.
    One value alone has distance zero.
    """
    try:
        limit = richardson(sizes, values)
    except (SolveError, ValueError):
        limit = None
    if limit is None or limit.order is None or limit.order < 1.0:
        return Limit(float(values[-1]), None, abs(float(values[-1] - values[-2])) if len(values) > 1 else 0.0)
    return limit


def limits(records: Sequence[Record], names: Iterable[str]) -> dict[str, list[Limit]]:
    """Return, by name, the extrapolated limit of each number of some quantities of records, one a mesh, fine last."""
    sizes = [1.0 / record["options"]["layers"] for record in records]
    columns = {name: [np.ravel(record[name]).tolist() for record in records] for name in names}
    return {name: [extrapolate(sizes, one) for one in zip(*each, strict=True)] for name, each in columns.items()}


def time_at(errors: Sequence[float], times: Sequence[float], target: float) -> tuple[float, str]:
    """Return the run time to an error, on the line between two meshes in logarithms of both.

    Meshes go from coarse to fine.  Where none is within the error it is the time of the finest, and ``"more than"``;
    where the coarsest is, that of the coarsest, and ``"at most"``.
    """
    logs, log_target = np.log(np.maximum(errors, 1e-16)), np.log(max(target, 1e-16))
    (within,) = np.nonzero(logs <= log_target)
    if not within.size:
        return float(times[-1]), "more than"
    k = int(within[0])
    if k == 0:
        return float(times[0]), "at most"
    fraction = (log_target - logs[k - 1]) / (logs[k] - logs[k - 1])
    return float(times[k - 1] * (times[k] / times[k - 1]) ** fraction), ""


def newton_orders(norms: Sequence[float]) -> list[float]:
    """Return the orders of convergence of Newton's method, from the norms of the residual, rounding left out."""
    values = np.array(norms)
    falls = np.diff(np.log(values[values > 1e-11 * values.max()]))
    return [float(after / before) for before, after in pairwise(falls)]
