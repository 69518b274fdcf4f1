"""How far places along a rod are from where supports hold it: at the edges of held faces stresses have no limit."""

from collections.abc import Sequence
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from isorod.arrays import Array
from isorod.geometry.rod import Rod
from isorod.model.mean import MeanSupport
from isorod.model.model import Model

# Points of the centre line between knots that its length is measured with.
_STEPS = 20

# What `_line` returns of rods that there are.
_LINES: WeakKeyDictionary[Rod, tuple[Array, Array, float]] = WeakKeyDictionary()


def width(model: Model, number: int) -> float:
    """Return how wide the section of a body is where it is widest."""
    return _line(model, number)[2]


def distance(model: Model, number: int, u: Array, more: Sequence[float] | Array = ()) -> Array:
    """Return lengths along the centre line to the nearest held face or patch, infinite where there is none.

    Parameters
    ----------
    model
        Whose supports hold.
    number
        Of the body.
    u
        Axis parameters, shape ``(n,)``.
    more
        Other places that count as held ones do.
    """
    line, length, _ = _line(model, number)
    place = np.interp(u, line, length)
    found = np.full(place.shape, np.inf)
    for low, high in [*_held(model, number), *((one, one) for one in more)]:
        first, last = np.interp([low, high], line, length)
        beyond = np.maximum(first - place, place - last)
        if model.bodies[number].space.rod.closed:
            beyond = np.minimum(beyond, np.maximum(first + length[-1] - place, place - last))
            beyond = np.minimum(beyond, np.maximum(first - place, place + length[-1] - last))
        found = np.minimum(found, np.maximum(beyond, 0.0))
    return found


def edges(model: Model, number: int, away: float) -> Array:
    """Return the axis parameters at which `distance` is a given length."""
    line, _, _ = _line(model, number)
    gap = distance(model, number, line) - away
    # Where nothing is held all of them are infinite.
    (k,) = np.nonzero(np.isfinite(gap[:-1]) & ((gap[:-1] < 0.0) != (gap[1:] < 0.0)))
    return np.asarray(line[k] + gap[k] / (gap[k] - gap[k + 1]) * (line[k + 1] - line[k]))


def _line(model: Model, number: int) -> tuple[Array, Array, float]:
    """Return axis parameters and the lengths of the centre line up to there, and the section's largest width."""
    rod = model.bodies[number].space.rod
    if rod not in _LINES:
        _LINES[rod] = _look_along(rod)
    return _LINES[rod]


def _look_along(rod: Rod) -> tuple[Array, Array, float]:
    breaks = rod.axis.breaks
    line = np.concatenate([np.linspace(a, b, _STEPS, endpoint=False) for a, b in pairwise(breaks)])
    line = np.append(line, breaks[-1])
    angle = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    ring = rod.grid(np.stack([np.cos(angle), np.sin(angle)], axis=1), line)[0]
    middle = ring.mean(axis=1)
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1)))
    return line, length, float(2.0 * np.linalg.norm(ring - middle[:, None], axis=2).max())


def _held(model: Model, number: int) -> list[tuple[float, float]]:
    """Return where along a body its supports are, from and to which axis parameter."""
    space = model.bodies[number].space
    degree, knots = space.axis.degree, space.axis.knots
    found = []
    for one in model.supports:
        if one.body != number or isinstance(one, MeanSupport) or not len(one.nodes):
            continue
        layers = np.unique(np.asarray(one.nodes) // space.layer_nodes)
        # Where functions of these layers are largest.
        middle = np.array([knots[k + 1 : k + 1 + degree].mean() for k in layers])
        found.append((float(middle.min()), float(middle.max())))
    return found
