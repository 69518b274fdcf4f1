"""The largest value of a field over a rod, and its place."""

from collections.abc import Callable, Mapping, Sequence, Sized
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter

from isorod import choices
from isorod.arrays import Array
from isorod.errors import InputError
from isorod.space.space import Space

# Values of a field at axis parameters ``(t,)`` and disk points ``(q, 2)``, shape ``(t, q)``.
Field = Callable[[Array, Array], Array]

# Points at which a field is evaluated at a time.
_CHUNK = 20_000

# Radial intervals of each ring and angles of the first grid, at least.
_RADII, _ANGLES = 4, 32

# Peaks that are refined, times that the interval is halved, and points in each direction.
_REFINED, _TIMES, _PARTS = 4, 14, 5

# Other peaks of the grid are refined too, if within this fraction of the largest value, at most so many.
_ALIKE, _MANY = 0.02, 8

# Added to the name of a largest value for the values at all tied places.
TIED = " of places that tie"

# Places are tied if their values are within this fraction of the largest, which has no derivative if theirs differ.
_TIED = 1e-5

# Distance from a knot, or from where two rings meet, of points that belong to one side of it.
_SIDE = 1e-9


class Largest(NamedTuple):
    """The largest value, its axis parameter and disk point, and index and value of an additional parameter there."""

    value: float
    u: float
    xi: Array
    at: tuple[int, float] | None = None


class Peak(NamedTuple):
    """The largest value, its place for a record (``u``, ``angle`` in degrees, ``radius``), and all tied values."""

    value: float
    place: dict[str, float]
    tied: tuple[float, ...] = ()


class _Box(NamedTuple):
    """A box that is refined: bounds of axis parameter and radius, its centre, and half its sizes."""

    bounds: Array
    middle: Array
    half: Array


def largest(
    space: Space,
    field: Field,
    u: float | None = None,
    xi: Sequence[float] | None = None,
    more: Sequence[float] | Array = (),
) -> list[Largest]:
    """Return the largest value of a field over a rod, a section of it, or a line along it, with tied values.

    Every element and ring is sampled on a grid that includes its boundaries, which is refined round the largest values.
    The places are choices (`isorod.choices`): the derivative of a largest value is that of the value at its place.

    Parameters
    ----------
    space
        Space of the rod.
    field
        The field; minus infinity where it does not count.
    u, xi
        The section, or the line; the rod where neither is given.
    more
        Additional axis parameters, such as those where the field begins to count.

    Returns
    -------
    list[Largest]
        The first is the largest; its value is minus infinity where nothing counts.  In neighbouring solutions the
        places are kept and values are not updated.

    Raises
    ------
    InputError
        If an additional parameter does not exist any more.
    """
    places = choices.chosen(lambda: _tied(_peaks(space, field, u, xi, np.asarray(more, dtype=float))))
    if not choices.near():
        return places
    if any(place.at is not None and place.at[0] >= len(more) for place in places):
        raise InputError("the place of the largest value is not there any more")
    # Places at additional parameters move with these, on the same side of a knot.
    return [
        place if place.at is None else place._replace(u=place.u + more[place.at[0]] - place.at[1]) for place in places
    ]


def peak(places: Sequence[Largest], value: Callable[[float, Array], float]) -> Peak:
    """Return the largest value, given by its first place, for a record; values may have signs."""
    first, values = places[0], tuple(value(place.u, place.xi) for place in places)
    angle = float(np.degrees(np.arctan2(*first.xi[::-1]))) % 360.0
    return Peak(values[0], {"u": first.u, "angle": angle, "radius": float(np.hypot(*first.xi))}, values)


def numbers(results: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return results with values instead of peaks, or of lists of peaks, and the places of these.

    In neighbouring solutions ``NAME + TIED`` has the values at all tied places, a row for each peak of a list.
    """
    result, places = dict(results), dict[str, Any]()
    for name, value in results.items():
        peaks = [one for one in (value if isinstance(value, list) else [value]) if isinstance(one, Peak)]
        if not peaks:
            continue
        values, where = [one.value for one in peaks], [one.place for one in peaks]
        result[name], places[name] = (values, where) if isinstance(value, list) else (value.value, value.place)
        width = max(len(one.tied) for one in peaks)
        if width > 1 and choices.near():
            rows = [one.tied + one.tied[-1:] * (width - len(one.tied)) for one in peaks]
            result[name + TIED] = rows if isinstance(value, list) else rows[0]
    return result, places


def _tied(peaks: Sequence[Largest]) -> list[Largest]:
    """Return the largest value and those tied with it."""
    first = max(peaks, key=lambda peak: peak.value, default=Largest(-np.inf, np.nan, np.zeros(2)))
    least = first.value - _TIED * abs(first.value)
    return [first, *(peak for peak in peaks if peak is not first and peak.value >= least)]


def _peaks(
    space: Space,
    field: Field,
    u: float | None,
    xi: Sequence[float] | None,
    more: Array,
) -> list[Largest]:
    """Return the refined peaks of the elements with the largest values, and others that are nearly as large."""
    angles = max(_ANGLES, 4 * space.points_around)
    rows = _along(space, u, more)
    boxes, others = list[tuple[float, _Box]](), list[tuple[float, _Box]]()
    for inner, outer in pairwise(space.rod.rings) if xi is None else [_polar(xi)[:1] * 2]:
        end = outer if xi is not None or outer == space.rod.rings[-1] else outer * (1.0 - _SIDE)
        radii = np.linspace(inner, end, _RADII + 1) if end > inner else np.array([end])
        turn = 2.0 * np.pi * np.arange(angles) / angles if xi is None else np.array([_polar(xi)[1]])
        across = np.stack([one.ravel() for one in np.meshgrid(radii, turn, indexing="ij")], axis=1)
        sizes = np.array([np.ptp(radii) / _RADII, 2.0 * np.pi / angles if xi is None else 0.0])
        at_once = max(1, _CHUNK // (len(across) * rows.shape[1]))
        for first in range(0, len(rows), at_once):
            chunk = rows[first : first + at_once]
            values = field(chunk.ravel(), _disk(across)).reshape(*chunk.shape, len(across))
            for row, element in zip(chunk, values, strict=True):
                bounds = np.array([[row[0], row[-1]], [radii[0], radii[-1]]])
                half = np.array([np.ptp(row) / (2 * space.axis.degree + 1), *sizes])
                highest, *alike = (
                    (float(element[t, q]), _Box(bounds, np.array([row[t], *across[q]]), half))
                    for t, q in _peaked(element, len(radii))
                )
                boxes.append(highest)
                others += alike
    boxes.sort(key=lambda one: -one[0])
    least = boxes[0][0] * (1.0 - _ALIKE)
    others = [one for one in others if one[0] >= least > 0.0]
    boxes_refined = [*boxes[:_REFINED], *others[_subset(others)]]
    refined = [_refine(field, value, box) for value, box in boxes_refined if value > -np.inf]
    # Places at a knot may be on either side of it.
    near = [np.flatnonzero(np.abs(more - one.u) <= 2.0 * _SIDE * np.ptp(space.axis.breaks)) for one in refined]
    return [one._replace(at=(int(k[0]), more[k[0]]) if k.size else None) for one, k in zip(refined, near, strict=True)]


def _peaked(values: Array, radii: int) -> list[tuple[int, int]]:
    """Return the indices of an element's largest value, and of other peaks nearly as large."""
    first = int(np.argmax(values))
    grid = values.reshape(len(values), radii, -1)
    peaks = grid >= maximum_filter(grid, size=3, mode=("nearest", "nearest", "wrap"))
    alike = np.flatnonzero(peaks & (grid >= (1.0 - _ALIKE) * grid.max()))
    alike = alike[alike != first]
    return [divmod(int(k), values.shape[1]) for k in (first, *alike[_subset(alike)])]


def _subset(several: Sized) -> slice:
    """Return a slice of a bounded number of evenly spaced items."""
    return slice(None, None, -(-len(several) // _MANY) or None)


def _along(space: Space, u: float | None, more: Sequence[float] | Array) -> Array:
    """Return the initial axis parameters, a row for each element."""
    if u is not None:
        return np.array([[u]])
    breaks = space.axis.breaks
    rows = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, 2 * space.axis.degree + 2)
    rows[:, -1] -= _SIDE * np.diff(breaks)
    # All rows have the same length.
    besides = np.broadcast_to(np.asarray(more, dtype=float), (len(rows), len(more)))
    inside = (besides > rows[:, :1]) & (besides < rows[:, -1:])
    return np.sort(np.concatenate([rows, np.where(inside, besides, rows[:, :1])], axis=1), axis=1)


def _refine(field: Field, value: float, box: _Box) -> Largest:
    """Return the largest value near the middle of a box."""
    middle, half = box.middle, box.half
    (low, high), (inner, outer) = box.bounds
    steps = np.linspace(-1.0, 1.0, _PARTS)
    for _ in range(_TIMES):
        t = np.unique(np.clip(middle[0] + half[0] * steps, low, high))
        radii = np.unique(np.clip(middle[1] + half[1] * steps, inner, outer))
        turn = np.unique(middle[2] + half[2] * steps)
        across = np.stack([one.ravel() for one in np.meshgrid(radii, turn, indexing="ij")], axis=1)
        values = field(t, _disk(across))
        k, q = np.unravel_index(np.argmax(values), values.shape)
        if values[k, q] > value:
            value, middle = float(values[k, q]), np.array([t[k], *across[q]])
        half = 0.5 * half
    return Largest(value, float(middle[0]), _disk(middle[None, 1:])[0])


def _disk(polar: Array) -> Array:
    """Return disk points from radii and angles, both ``(q, 2)``."""
    return polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=1)


def _polar(xi: Sequence[float]) -> list[float]:
    x, y = xi
    return [float(np.hypot(x, y)), float(np.arctan2(y, x))]
