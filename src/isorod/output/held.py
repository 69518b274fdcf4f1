"""Distances along a rod to its supports: at the edges of supported faces stresses are singular."""

from collections.abc import Sequence
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from isorod.arrays import Array
from isorod.geometry.rod import Rod
from isorod.model.mean import MeanSupport
from isorod.model.model import Model

# Points of the centre line for each knot span with which its length is measured.
_STEPS = 20

# Cache of `_line`.
_LINES: WeakKeyDictionary[Rod, tuple[Array, Array, float]] = WeakKeyDictionary()


def width(model: Model, number: int) -> float:
    """Return the largest width of a body's sections."""
    return _line(model, number)[2]


def distance(model: Model, number: int, u: Array, more: Sequence[float] | Array = ()) -> Array:
    """Return distances along the centre line to the nearest supported face or patch, infinite where there is none.

    Parameters
    ----------
    model
        The model with its supports.
    number
        Number of the body.
    u
        Axis parameters, shape ``(n,)``.
    more
        Other axis parameters that count like supports.
    """
    line, lengths, _ = _line(model, number)
    length_at = np.interp(u, line, lengths)
    nearest = np.full(length_at.shape, np.inf)
    for low, high in [*_held(model, number), *((place, place) for place in more)]:
        start, end = np.interp([low, high], line, lengths)
        beyond = np.maximum(start - length_at, length_at - end)
        if model.bodies[number].space.rod.closed:
            beyond = np.minimum(beyond, np.maximum(start + lengths[-1] - length_at, length_at - end))
            beyond = np.minimum(beyond, np.maximum(start - length_at, length_at + lengths[-1] - end))
        nearest = np.minimum(nearest, np.maximum(beyond, 0.0))
    return nearest


def edges(model: Model, number: int, away: float) -> Array:
    """Return the axis parameters at which `distance` is ``away``."""
    line, _, _ = _line(model, number)
    gap = distance(model, number, line) - away
    # Without supports all distances are infinite.
    (k,) = np.nonzero(np.isfinite(gap[:-1]) & ((gap[:-1] < 0.0) != (gap[1:] < 0.0)))
    return np.asarray(line[k] + gap[k] / (gap[k] - gap[k + 1]) * (line[k + 1] - line[k]))


def _line(model: Model, number: int) -> tuple[Array, Array, float]:
    """Return axis parameters and the lengths of the centre line up to there, and the section's largest width."""
    rod = model.bodies[number].space.rod
    if rod not in _LINES:
        _LINES[rod] = _measure(rod)
    return _LINES[rod]


def _measure(rod: Rod) -> tuple[Array, Array, float]:
    breaks = rod.axis.breaks
    line = np.concatenate([np.linspace(a, b, _STEPS, endpoint=False) for a, b in pairwise(breaks)])
    line = np.append(line, breaks[-1])
    angle = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    ring = rod.grid(np.stack([np.cos(angle), np.sin(angle)], axis=1), line)[0]
    middle = ring.mean(axis=1)
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1)))
    return line, length, float(2.0 * np.linalg.norm(ring - middle[:, None], axis=2).max())


def _held(model: Model, number: int) -> list[tuple[float, float]]:
    """Return the ranges of axis parameters of a body's supports."""
    space = model.bodies[number].space
    degree, knots = space.axis.degree, space.axis.knots
    ranges = []
    for support in model.supports:
        if support.body != number or isinstance(support, MeanSupport) or not len(support.nodes):
            continue
        layers = np.unique(np.asarray(support.nodes) // space.layer_nodes)
        # Greville abscissae of the layers.
        middle = np.array([knots[k + 1 : k + 1 + degree].mean() for k in layers])
        ranges.append((float(middle.min()), float(middle.max())))
    return ranges
