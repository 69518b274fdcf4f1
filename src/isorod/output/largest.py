"""The largest value of a field over a rod, and where it is."""

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

# Radii of a ring of the section and angles that are looked at first, at least; both ends of a radius are among them.
_RADII, _ANGLES = 4, 32

# Elements whose largest values are looked at closer, how often, and at how many points in each direction.
_CLOSER, _TIMES, _PARTS = 4, 14, 5

# Other peaks of the grid that may be as large as the largest value, but for this share of it, and how many at most.
_ALIKE, _MANY = 0.02, 8

# What is added to the name of a largest value for those of all places that tie.
TIED = " of places that tie"

# Places tie whose values are as near to the largest: where these part beside, it has no derivative.
_TIED = 1e-5

# What is this close to a knot, or to where two rings meet, belongs to one side of it.
_SIDE = 1e-9


class Largest(NamedTuple):
    """The largest value, and where it is: axis parameter and disk point; number and place of a given one there."""

    value: float
    u: float
    xi: Array
    at: tuple[int, float] | None = None


class Peak(NamedTuple):
    """The largest value and its place in a record: ``u``, ``angle`` in degrees, ``radius``; values of all that tie."""

    value: float
    place: dict[str, float]
    tied: tuple[float, ...] = ()


class _Box(NamedTuple):
    """Where is looked closer: bounds of axis parameter and radius, the middle, and half the sizes of a box about it."""

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
    """Return the largest value of a field over a rod, over a section of it, or over a line along it; and what ties.

    Every element and ring is looked at on a grid, both of its sides included, and more and more closely round the
    largest values of the grid.  These places are a choice (`isorod.choices`): the derivative of a largest value is that
    of the value where it is.

    Parameters
    ----------
    space
        Of the rod.
    field
        Its values; minus infinity where it does not count.
    u, xi
        The section, or the line; the rod where neither is given.
    more
        Axis parameters that are looked at besides, as where the field begins to count.

    Returns
    -------
    list[Largest]
        The first is the largest; its value is minus infinity where nothing counts.  Beside an answer, at the same
        places, its value is not known.

    Raises
    ------
    InputError
        If a place at which the field begins to count is not there any more.
    """
    found = choices.chosen(lambda: _tied(_peaks(space, field, u, xi, np.asarray(more, dtype=float))))
    if not choices.near():
        return found
    if any(one.at is not None and one.at[0] >= len(more) for one in found):
        raise InputError("the place of the largest value is not there any more")
    # Where the field begins to count goes along with what it depends on, on its side of a knot.
    return [one if one.at is None else one._replace(u=one.u + more[one.at[0]] - one.at[1]) for one in found]


def peak(several: Sequence[Largest], value: Callable[[float, Array], float]) -> Peak:
    """Return as a record has it what is largest at the first of several places, of values there that may have signs."""
    first, values = several[0], tuple(value(one.u, one.xi) for one in several)
    angle = float(np.degrees(np.arctan2(*first.xi[::-1]))) % 360.0
    return Peak(values[0], {"u": first.u, "angle": angle, "radius": float(np.hypot(*first.xi))}, values)


def numbers(found: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what is measured with values in the place of peaks, or lists of them, and the places of these.

    Beside an answer ``NAME + TIED`` are the values of all places that tie, a row for each peak of a list.
    """
    result, places = dict(found), dict[str, Any]()
    for name, value in found.items():
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


def _tied(several: Sequence[Largest]) -> list[Largest]:
    """Return the largest and those that tie with it."""
    first = max(several, key=lambda one: one.value, default=Largest(-np.inf, np.nan, np.zeros(2)))
    least = first.value - _TIED * abs(first.value)
    return [first, *(one for one in several if one is not first and one.value >= least)]


def _peaks(
    space: Space,
    field: Field,
    u: float | None,
    xi: Sequence[float] | None,
    more: Array,
) -> list[Largest]:
    """Return the largest values of some elements, those of which they are largest, and others that are as large."""
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
            some = rows[first : first + at_once]
            values = field(some.ravel(), _disk(across)).reshape(*some.shape, len(across))
            for row, own in zip(some, values, strict=True):
                bounds = np.array([[row[0], row[-1]], [radii[0], radii[-1]]])
                half = np.array([np.ptp(row) / (2 * space.axis.degree + 1), *sizes])
                most, *alike = (
                    (float(own[t, q]), _Box(bounds, np.array([row[t], *across[q]]), half))
                    for t, q in _peaked(own, len(radii))
                )
                boxes.append(most)
                others += alike
    boxes.sort(key=lambda one: -one[0])
    least = boxes[0][0] * (1.0 - _ALIKE)
    others = [one for one in others if one[0] >= least > 0.0]
    several = [*boxes[:_CLOSER], *others[_some(others)]]
    found = [_closer(field, value, box) for value, box in several if value > -np.inf]
    # Those at a knot may be on either side of it.
    near = [np.flatnonzero(np.abs(more - one.u) <= 2.0 * _SIDE * np.ptp(space.axis.breaks)) for one in found]
    return [one._replace(at=(int(k[0]), more[k[0]]) if k.size else None) for one, k in zip(found, near, strict=True)]


def _peaked(own: Array, radii: int) -> list[tuple[int, int]]:
    """Return where the values of an element are largest, and where others are peaks nearly as large."""
    first = int(np.argmax(own))
    grid = own.reshape(len(own), radii, -1)
    peaks = grid >= maximum_filter(grid, size=3, mode=("nearest", "nearest", "wrap"))
    alike = np.flatnonzero(peaks & (grid >= (1.0 - _ALIKE) * grid.max()))
    alike = alike[alike != first]
    return [divmod(int(k), own.shape[1]) for k in (first, *alike[_some(alike)])]


def _some(several: Sized) -> slice:
    """Return which of several, if there are many, are looked at: from the first to the last."""
    return slice(None, None, -(-len(several) // _MANY) or None)


def _along(space: Space, u: float | None, more: Sequence[float] | Array) -> Array:
    """Return the axis parameters to begin with, a row an element."""
    if u is not None:
        return np.array([[u]])
    breaks = space.axis.breaks
    rows = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, 2 * space.axis.degree + 2)
    rows[:, -1] -= _SIDE * np.diff(breaks)
    # All rows are as long as the others.
    besides = np.broadcast_to(np.asarray(more, dtype=float), (len(rows), len(more)))
    inside = (besides > rows[:, :1]) & (besides < rows[:, -1:])
    return np.sort(np.concatenate([rows, np.where(inside, besides, rows[:, :1])], axis=1), axis=1)


def _closer(field: Field, value: float, box: _Box) -> Largest:
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
    """Return disk points of radii and angles, both ``(q, 2)``."""
    return polar[:, :1] * np.stack([np.cos(polar[:, 1]), np.sin(polar[:, 1])], axis=1)


def _polar(xi: Sequence[float]) -> list[float]:
    x, y = xi
    return [float(np.hypot(x, y)), float(np.arctan2(y, x))]
