"""A scene's measures as numbers of both sides: finite elements' limits, and the error of each run."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from comparisons.measure.convergence import Limit, richardson
from comparisons.measure.records import Record
from isorod.arrays import Array
from isorod.errors import SolveError

FREQUENCIES = "frequencies"

# Orders of convergence beyond these are chance: displacements of degree 2 reach 4.
LOWEST_ORDER, HIGHEST_ORDER = 0.5, 6.0

# Largest relative difference of meshes of a quantity that is the same on all.
GIVEN = 1e-7


@dataclass(frozen=True)
class Converged:
    """A quantity by finite elements: each of its numbers extrapolated, where the meshes converge regularly.

    Attributes
    ----------
    name
        What it is.
    values
        Limits ``(n,)``; of numbers whose meshes show no order, those of the finest mesh.
    uncertainties
        How far the finest mesh is from the limit, or, without one, from the mesh before.
    orders
        Observed orders, None where there is none; below 1, as at edges of held faces, limits are those of first order.
    spread
        Largest relative difference of the meshes from the finest.
    """

    name: str
    values: list[float]
    uncertainties: list[float]
    orders: list[float | None]
    spread: float = 1.0

    @property
    def given(self) -> bool:
        """Whether all meshes agree: what follows from equilibrium does not depend on the discretisation."""
        return self.spread < GIVEN

    @property
    def uncertainty(self) -> float:
        """Uncertainty relative to the quantity: of frequencies the largest, of vectors that of the size."""
        return self._relative(np.array(self.uncertainties))

    @property
    def vanishes(self) -> bool:
        """Whether it is zero within its uncertainty."""
        return not np.linalg.norm(self.values) > np.linalg.norm(self.uncertainties)

    def error(self, values: Sequence[float]) -> float:
        """Return the relative error of other values of the quantity."""
        return self._relative(np.array(values) - self.values)

    def _relative(self, difference: Array) -> float:
        if self.name == FREQUENCIES:
            return float(np.max(np.abs(difference / self.values)))
        return float(np.linalg.norm(difference) / np.linalg.norm(self.values))


def values(record: Record, names: Sequence[str]) -> dict[str, list[float]]:
    """Return the quantities of a record, each as a list of numbers; frequencies without those of rigid modes."""
    result = {name: np.ravel(np.asarray(record[name], dtype=float)).tolist() for name in names}
    if FREQUENCIES in result:
        result[FREQUENCIES] = result[FREQUENCIES][record.get("rigid", 0) :]
    return result


def converged(sizes: Sequence[float], records: Sequence[Mapping[str, Sequence[float]]]) -> list[Converged]:
    """Return the limit of each quantity of `values` of meshes, given coarse to fine; ``sizes`` are those of cells."""
    result = []
    for name in records[0]:
        limits = [_limit(sizes, column) for column in zip(*(one[name] for one in records), strict=True)]
        result.append(
            Converged(
                name,
                [limit.value for limit in limits],
                [limit.distance for limit in limits],
                [limit.order for limit in limits],
                _spread([one[name] for one in records]),
            )
        )
    return result


def _spread(every: Sequence[Sequence[float]]) -> float:
    size = float(np.linalg.norm(every[-1]))
    return max(float(np.linalg.norm(np.subtract(one, every[-1]))) for one in every) / size if size else 1.0


def _limit(sizes: Sequence[float], column: Sequence[float]) -> Limit:
    """Return the extrapolated value; the finest where the order is too low or too high to be one."""
    try:
        limit = richardson(sizes, column)
    except (SolveError, ValueError):
        limit = Limit(0.0, None, 0.0)
    last = float(column[-1] - column[-2])
    if limit.order is None or not LOWEST_ORDER <= limit.order <= HIGHEST_ORDER:
        return Limit(float(column[-1]), None, abs(last))
    if limit.order >= 1.0:
        return limit
    # A lower order takes the limit far from all meshes, and may be that of coarse ones.
    step = last * sizes[-1] / (sizes[-2] - sizes[-1])
    return Limit(float(column[-1] + step), limit.order, abs(step))


def errors(reference: Sequence[Converged], values: Mapping[str, Any]) -> dict[str, float]:
    """Return the relative error of each quantity that does not vanish."""
    return {one.name: one.error(values[one.name]) for one in reference if not one.vanishes}
