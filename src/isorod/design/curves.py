"""Target or measured curves: tables of points, each a scene with its own values of some parameters."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.design import parameters
from isorod.design.constraints import Variable
from isorod.errors import InputError


class Curve(NamedTuple):
    """A table of points: parameters given at each, and results measured there, by name, ``(points,)``."""

    given: Mapping[str, Array]
    measured: Mapping[str, Array]

    def values(self, results: Mapping[str, float]) -> dict[str, Array]:
        """Return the computed results at the points, by name, ``(points,)``."""
        return {
            name: np.array([results[f"{k}.{name}"] for k in range(len(rows))]) for name, rows in self.measured.items()
        }

    def off(self, results: Mapping[str, float]) -> Array:
        """Return the residuals, relative to each measured column's largest value, ``(columns * points,)``."""
        computed = self.values(results)
        return np.concatenate([(computed[name] - column) / _size(column) for name, column in self.measured.items()])

    def slopes(self, rates: Mapping[str, Array]) -> Array:
        """Return the derivatives of the residuals, ``(columns * points, parameters)``."""
        rows = [rates[f"{k}.{name}"] / _size(col) for name, col in self.measured.items() for k in range(len(col))]
        return np.array(rows)


def _size(column: Array) -> float:
    return float(np.abs(column).max()) or 1.0


def curve(rows: Mapping[str, Array], scene: Any, variables: Sequence[Variable]) -> Curve:
    """Return the curve of a table's columns: parameters of the scene and results; raises `InputError`."""
    known, varied = parameters.parameters(scene), [one.name for one in variables]
    given = {name: column for name, column in rows.items() if name in known}
    results = [name for name in scene.units if name not in known]
    twice = [name for name in given if name in varied]
    if twice:
        raise InputError(f"{twice[0]}: it cannot both vary and be given in the table")
    measured = {name: column for name, column in rows.items() if name not in given}
    unknown = next((name for name in measured if name.partition("[")[0] not in results), None)
    if unknown is not None:
        raise InputError(
            f"column {unknown!r} is no parameter of the scene, nor measured; there are: {', '.join([*results, *known])}"
        )
    if not measured:
        raise InputError(f"the table has no column of what is measured: {', '.join(results)}")
    size = len(next(iter(measured.values())))
    if size * len(measured) < len(variables):
        raise InputError(f"{size * len(measured)} measured values for {len(variables)} numbers; need at least as many")
    for name, column in rows.items():
        if not np.isfinite(column).all():
            raise InputError(f"column {name!r}: got a value that is no number")
    return Curve(given, measured)


def scenes_of(scene: Any, table: Curve) -> dict[str, Any]:
    """Return a scene for each point."""
    size = len(next(iter(table.measured.values())))
    rows = [{name: float(column[k]) for name, column in table.given.items()} for k in range(size)]
    return {str(k): parameters.at(scene, row) if row else scene for k, row in enumerate(rows)}


def columns(table: Curve, several: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return columns to draw: the first given parameter, or else the point's number, and each curve by its name.

    ``several`` has curves by a label, such as those of a design before and after.
    """
    first = dict([*table.given.items()][:1]) or {"point": np.arange(len(next(iter(table.measured.values())))) + 1.0}
    return first | {f"{name}, {which}": curves[name] for name in table.measured for which, curves in several.items()}
