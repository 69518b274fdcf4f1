"""Target curves, or measured ones: a table of points, each a scene with numbers of its own."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.design import parameters
from isorod.design.wanted import Vary
from isorod.errors import InputError


class Curve(NamedTuple):
    """A table of points: numbers that are set in each, and what was measured there, by name, ``(points,)``."""

    given: Mapping[str, Array]
    measured: Mapping[str, Array]

    def values(self, answers: Mapping[str, float]) -> dict[str, Array]:
        """Return what scenes of the points answer, by name, ``(points,)``."""
        return {
            name: np.array([answers[f"{k}.{name}"] for k in range(len(one))]) for name, one in self.measured.items()
        }

    def off(self, answers: Mapping[str, float]) -> Array:
        """Return by how much they are off, of each column as a share of its largest value, ``(columns * points,)``."""
        found = self.values(answers)
        return np.concatenate([(found[name] - one) / _size(one) for name, one in self.measured.items()])

    def slopes(self, rates: Mapping[str, Array]) -> Array:
        """Return the derivatives of that, ``(columns * points, numbers)``."""
        each = [rates[f"{k}.{name}"] / _size(one) for name, one in self.measured.items() for k in range(len(one))]
        return np.array(each)


def _size(column: Array) -> float:
    return float(np.abs(column).max()) or 1.0


def curve(rows: Mapping[str, Array], scene: Any, several: Sequence[Vary]) -> Curve:
    """Return the columns of a table, by whether they are numbers of the scene or measured; raises `InputError`."""
    known, varied = parameters.parameters(scene), [one.name for one in several]
    given = {name: column for name, column in rows.items() if name in known}
    answers = [name for name in scene.units if name not in known]
    taken = [name for name in given if name in varied]
    if taken:
        raise InputError(f"{taken[0]}: it cannot both vary and be given in the table")
    found = {name: column for name, column in rows.items() if name not in given}
    strange = next((name for name in found if name.partition("[")[0] not in answers), None)
    if strange is not None:
        raise InputError(
            f"column {strange!r} is no number of the scene, nor measured; there are: {', '.join([*answers, *known])}"
        )
    if not found:
        raise InputError(f"the table has no column of what is measured: {', '.join(answers)}")
    size = len(next(iter(found.values())))
    if size * len(found) < len(several):
        raise InputError(f"{size * len(found)} measured values for {len(several)} numbers; need at least as many")
    for name, column in rows.items():
        if not np.isfinite(column).all():
            raise InputError(f"column {name!r}: got a value that is no number")
    return Curve(given, found)


def scenes_of(scene: Any, table: Curve) -> dict[str, Any]:
    """Return a scene for each point."""
    size = len(next(iter(table.measured.values())))
    rows = [{name: float(column[k]) for name, column in table.given.items()} for k in range(size)]
    return {str(k): parameters.at(scene, row) if row else scene for k, row in enumerate(rows)}


def columns(table: Curve, several: Mapping[str, Mapping[str, Array]]) -> dict[str, Array]:
    """Return columns to be drawn: what is given first, or the number of the point, and over it each curve by its name.

    ``several`` has curves such as that of a design before and after, by what they are.
    """
    first = dict([*table.given.items()][:1]) or {"point": np.arange(len(next(iter(table.measured.values())))) + 1.0}
    return first | {f"{name}, {which}": one[name] for name in table.measured for which, one in several.items()}
