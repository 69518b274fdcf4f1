"""Extrapolation of a quantity computed on three meshes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from isorod.errors import SolveError


@dataclass(frozen=True)
class Limit:
    """Richardson's limit, the observed order, and how far the finest value is from the limit."""

    value: float
    order: float
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
        If the values do not approach a limit monotonically, so that an order cannot be told.
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
