"""Harmonic and random vibrations in scene files: frequencies, damping, the loads that swing."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.files import values
from isorod.files.data import rows_of
from isorod.files.document import Place, shown
from isorod.files.form import Form, Name, call
from isorod.files.measures import Component, component_of

if TYPE_CHECKING:
    from isorod.harmonic import Damping, Span
    from isorod.harmonic.response import Response

_SPAN = Form("isorod.harmonic.frequencies:Span", keys={"first": "from", "last": "to"})
_DAMPING = Form("isorod.harmonic.damping:Damping")


def _frequencies(place: Place, value: Any) -> "Span | Array":
    if isinstance(value, dict):
        found: Span = call(place, _SPAN, value).make()
        return found
    return np.asarray(values.value_of(place, value if isinstance(value, list) else [value], Numbers), dtype=float)


def _damping(place: Place, value: Any) -> "Damping":
    found: Damping = call(place, _DAMPING, place.table(value)).make()
    return found


def _loads(place: Place, value: Any) -> list[Name]:
    several = value if isinstance(value, list) else [value]
    if not all(isinstance(one, str) for one in several):
        raise place.error(f"got {shown(value)}, need {LOADS.words}")
    return [Name(place, one) for one in several]


def _psd(place: Place, value: Any) -> Array:
    rows = rows_of(place, value)
    if rows.ndim != 2 or rows.shape[1] != 2:
        raise place.error(f"got {shown(value)}, need {PSD.words}")
    return rows


PSD = values.Kind(_psd, "rows [frequency, value] in a list, or the name of a file beside this one")
FREQUENCIES = values.Kind(_frequencies, "numbers in a list, or a table: from, to, count, log")
DAMPING = values.Kind(_damping, "a table: ratio, rayleigh = [alpha, beta], structural")
LOADS = values.Kind(_loads, "the names of loads in a list")


def settled(arguments: dict[str, Any], loads: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an analysis with the numbers of loads in the place of their names."""
    if "loads" not in arguments:
        return arguments
    numbers = {name: k for k, name in enumerate(loads)}
    return arguments | {"loads": [one.among(numbers) for one in arguments["loads"]]}


def acceleration(
    solution: "Response",
    rod: int,
    u: float | None = None,
    xi: tuple[float, float] | None = None,
    component: Component | None = None,
) -> Any:
    """Return the acceleration of a point of a rod, that of shaken supports included, or one component of it.

    Parameters
    ----------
    rod
        Whose point it is.
    u
        Axis parameter of the point; that of the end face where not given.
    xi
        Its point of the unit disk; where not given the centre, of a hollow rod the mean of its hole.
    component
        ``"x"``, ``"y"`` or ``"z"``; all three where not given.
    """
    return component_of(solution.acceleration(rod, "end" if u is None else u, xi), component)
