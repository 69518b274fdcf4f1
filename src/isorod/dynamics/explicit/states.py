"""States of laws with memory at the quadrature points: in blocks of points, or body by body for all ranks."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.dynamics.explicit.ranks import Ranks
from isorod.geometry.quadrature import ring_of
from isorod.material.points import POINTS
from isorod.model.model import Model


class _RingPoints(NamedTuple):
    """Points of a range of elements in one ring: their numbers, and their place and shape in blocks of points.

    ``begin`` and ``whole`` are the start and shape ``(E, t, q, m)`` of the body's states, ``first`` and ``last`` its
    range of elements.
    """

    points: Index | slice
    blocks: slice
    shape: tuple[int, ...]
    begin: int
    whole: tuple[int, ...]
    first: int
    last: int


def of(model: Model, ranks: Ranks, blocks: Array) -> Array:
    """Return the states of all points from blocks (`Mesh.fibres`), zero at points of other ranks."""
    all_states = np.zeros(_size(model))
    for ring in _ring_points(model, ranks):
        values = blocks[ring.blocks].reshape(ring.shape).swapaxes(2, 3)
        rows = values.reshape(*values.shape[:3], -1)
        own_body = all_states[ring.begin :][: int(np.prod(ring.whole))].reshape(ring.whole)
        part = own_body[ring.first : ring.last]
        part[:, :, ring.points] = np.moveaxis(rows, 2, -1)[:, :, : part[:, :, ring.points].shape[2]]
    return all_states


def give(model: Model, ranks: Ranks, all_states: Array, blocks: Array) -> None:
    """Fill in blocks with the states of all points."""
    for ring in _ring_points(model, ranks):
        own_body = all_states[ring.begin :][: int(np.prod(ring.whole))].reshape(ring.whole)
        part = np.moveaxis(own_body[ring.first : ring.last][:, :, ring.points], -1, 2)
        rows = np.zeros((*part.shape[:3], ring.shape[2] * POINTS))
        rows[..., : part.shape[3]] = part
        blocks[ring.blocks] = rows.reshape(*part.shape[:3], -1, POINTS).swapaxes(2, 3).ravel()


def by_bodies(model: Model, all_states: Array) -> list[Array]:
    """Return the states of all points body by body, ``(E, t, q, m)`` each, ``m`` 0 without memory."""
    shapes = _shapes(model)
    parts = np.split(all_states, np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def _shapes(model: Model) -> list[tuple[int, ...]]:
    """Return the shape ``(E, t, q, m)`` of the states of each body; ``m`` is 0 without memory."""
    shapes = []
    for body in model.bodies:
        points = body.space.tabulate(0, 1).weights.shape[1:]
        shapes.append((body.space.axis.elements, *points, body.width if body.remembers else 0))
    return shapes


def _size(model: Model) -> int:
    return sum(int(np.prod(shape)) for shape in _shapes(model)) if model.remembers else 0


def _ring_points(model: Model, ranks: Ranks) -> Iterator[_RingPoints]:
    """Yield the points of this rank's elements in the order of `isorod.dynamics.explicit.mesh.pack`."""
    if not model.remembers:
        return
    shapes, place = _shapes(model), 0
    begins = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    for elements in ranks.element_ranges:
        body, table = elements.body, elements.body.space.tabulate(elements.first, elements.last)
        inside = ring_of(body.space.rod.rings, table.xi)
        rings = len(body.space.rod.rings) - 1
        for ring in range(rings):
            own = np.flatnonzero(inside == ring) if rings > 1 else slice(None)
            blocks = -(-int(inside[own].size) // POINTS)
            shape = (table.elements, table.weights.shape[1], blocks, body.width, POINTS)
            span = slice(place, place + int(np.prod(shape)))
            place = span.stop
            if body.remembers:
                b = elements.which
                yield _RingPoints(own, span, shape, int(begins[b]), shapes[b], elements.first, elements.last)
