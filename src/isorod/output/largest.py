"""The largest value of a field over a rod, and where it is."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.space.space import Space

# Values of a field at axis parameters ``(t,)`` and disk points ``(q, 2)``, shape ``(t, q)``.
Field = Callable[[Array, Array], Array]

# Points at which a field is evaluated at a time.
_CHUNK = 20_000

# Radii of a ring of the section and angles that are looked at first, at least; both ends of a radius are among them.
_RADII, _ANGLES = 4, 32

# Elements whose largest values are looked at closer, how often, and at how many points in each direction.
_CLOSER, _TIMES, _PARTS = 4, 14, 5

# What is this close to a knot, or to where two rings meet, belongs to one side of it.
_SIDE = 1e-9


class Largest(NamedTuple):
    """The largest value, and where it is: axis parameter, and disk point ``(2,)``."""

    value: float
    u: float
    xi: Array


class Peak(NamedTuple):
    """The largest stress, and its place in a record: ``u``, ``angle`` in degrees, ``radius``."""

    value: float
    place: dict[str, float]


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
) -> Largest:
    """Return the largest value of a field over a rod, over a section of it, or over a line along it.

    Every element and ring is looked at on a grid, both of its sides included, and more and more closely round the
    largest values of the grid.

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
    """
    angles = max(_ANGLES, 4 * space.points_around)
    rows = _along(space, u, more)
    boxes: list[tuple[float, _Box]] = []
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
                t, q = np.unravel_index(np.argmax(own), own.shape)
                bounds = np.array([[row[0], row[-1]], [radii[0], radii[-1]]])
                half = np.array([np.ptp(row) / (2 * space.axis.degree + 1), *sizes])
                boxes.append((float(own[t, q]), _Box(bounds, np.array([row[t], *across[q]]), half)))
    boxes.sort(key=lambda one: -one[0])
    found = [_closer(field, value, box) for value, box in boxes[:_CLOSER] if value > -np.inf]
    return max(found, key=lambda one: one.value, default=Largest(-np.inf, np.nan, np.zeros(2)))


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
