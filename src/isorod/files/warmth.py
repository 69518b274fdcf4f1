"""Temperatures and expansions of a rod in a scene file."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError
from isorod.files.data import rows_of
from isorod.files.document import Place, shown
from isorod.files.expression import formula
from isorod.files.values import Kind, value_of

if TYPE_CHECKING:
    from isorod.material.places import Places

# Distance by which a table may end before the rod, as a fraction of its length.
_ROUNDED = 1e-6

_WORDS = "a number, rows [length along the rod, temperature], or a formula of s, n, b, r, x, y, z"


class AlongRod(NamedTuple):
    """A temperature by the length along the centre line, straight between the points of a table."""

    lengths: Array
    values: Array

    def __call__(self, places: "Places") -> Array:
        """Return the temperature at places of a rod."""
        length = places.length
        first, last = float(self.lengths[0]), float(self.lengths[-1])
        rounded = _ROUNDED * (last - first)
        low, high = float(length.min(initial=first)), float(length.max(initial=last))
        if low < first - rounded or high > last + rounded:
            raise InputError(
                f"temperature: its table is from {first:g} to {last:g} along the rod, which has {low:g} to {high:g}"
            )
        return np.interp(length, self.lengths, self.values)


class Formula(NamedTuple):
    """A temperature by a formula of the places of a rod.

    ``s`` is the length along the centre line, ``n`` and ``b`` are distances from it along the section's normal and
    binormal, ``r`` the distance from it, ``x``, ``y`` and ``z`` coordinates.
    """

    text: str
    function: Callable[..., Any]

    def __call__(self, places: "Places") -> Array:
        """Return the temperature at places of a rod."""
        offset = places.offset
        across = [np.sum(offset * one, axis=-1) for one in (places.normal, places.binormal)]
        with np.errstate(all="ignore"):
            found = self.function(places.length, *across, np.hypot(*across), *np.moveaxis(places.position, -1, 0))
        return np.asarray(found, dtype=float)


def _temperature(place: Place, value: Any) -> Any:
    """Return a number, or a function of places."""
    if isinstance(value, str) and not value.lower().endswith(".csv"):
        import sympy as sp

        names = {name: sp.Symbol(name, real=True) for name in ("s", "n", "b", "r", "x", "y", "z")}
        with place.locating({"temperature": place}):
            found = formula(value, names, "temperature", "one of s, n, b, r, x, y, z")
        return Formula(value, sp.lambdify([*names.values()], found, "numpy"))
    if not isinstance(value, str | list):
        return value_of(place, value, float)
    table = rows_of(place, value)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise place.error("need two or more rows [length along the rod, temperature]")
    if not (np.diff(table[:, 0]) > 0.0).all():
        k = int(np.argmin(np.diff(table[:, 0])))
        raise place.error(f"lengths must rise, got {table[k, 0]:g} and {table[k + 1, 0]:g} behind it")
    return AlongRod(*table.T)


def _expansion(place: Place, value: Any) -> Any:
    """Return a number, or a list of such and of lists."""
    if not isinstance(value, list):
        return value_of(place, value, float)
    if not value:
        raise place.error(f"got {shown(value)}, need numbers")
    return [value_of(place / k, one, Numbers if isinstance(one, list) else float) for k, one in enumerate(value)]


TEMPERATURE = Kind(_temperature, _WORDS)
EXPANSION = Kind(_expansion, "a number; of several laws one, or one for each; along the axes of a law a list")
