"""What laws with memory know of the quadrature points: in blocks of points, and body by body, whatever the ranks."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.dynamics.explicit.ranks import Ranks
from isorod.geometry.quadrature import ring_of
from isorod.material.points import POINTS
from isorod.model.model import Model


class _Share(NamedTuple):
    """Elements of one ring: their points there, where these begin in blocks of points, and where all of the body's.

    ``whole`` is the shape ``(E, t, q, m)`` of what is known of the body, ``first`` and ``last`` are its elements.
    """

    points: Index | slice
    blocks: slice
    shape: tuple[int, ...]
    begin: int
    whole: tuple[int, ...]
    first: int
    last: int


def of(model: Model, ranks: Ranks, blocks: Array) -> Array:
    """Return what this rank knows of all points, zero of those of others, from blocks (`Mesh.fibres`)."""
    known = np.zeros(_size(model))
    for share in _shares(model, ranks):
        own = blocks[share.blocks].reshape(share.shape).swapaxes(2, 3)
        rows = own.reshape(*own.shape[:3], -1)
        whole = known[share.begin :][: int(np.prod(share.whole))].reshape(share.whole)
        part = whole[share.first : share.last]
        part[:, :, share.points] = np.moveaxis(rows, 2, -1)[:, :, : part[:, :, share.points].shape[2]]
    return known


def give(model: Model, ranks: Ranks, known: Array, blocks: Array) -> None:
    """Fill in blocks with what is known of all points."""
    for share in _shares(model, ranks):
        whole = known[share.begin :][: int(np.prod(share.whole))].reshape(share.whole)
        part = np.moveaxis(whole[share.first : share.last][:, :, share.points], -1, 2)
        rows = np.zeros((*part.shape[:3], share.shape[2] * POINTS))
        rows[..., : part.shape[3]] = part
        blocks[share.blocks] = rows.reshape(*part.shape[:3], -1, POINTS).swapaxes(2, 3).ravel()


def by_bodies(model: Model, known: Array) -> list[Array]:
    """Return what is known of all points body by body, ``(E, t, q, m)`` each, ``m`` 0 without memory."""
    shapes = _shapes(model)
    parts = np.split(known, np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1])
    return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]


def _shapes(model: Model) -> list[tuple[int, ...]]:
    """Return the shape ``(E, t, q, m)`` of what laws of each body with memory know; ``m`` is 0 of others."""
    found = []
    for body in model.bodies:
        points = body.space.tabulate(0, 1).weights.shape[1:]
        found.append((body.space.axis.elements, *points, body.width if body.remembers else 0))
    return found


def _size(model: Model) -> int:
    return sum(int(np.prod(shape)) for shape in _shapes(model)) if model.remembers else 0


def _shares(model: Model, ranks: Ranks) -> Iterator[_Share]:
    """Yield where the points of this rank's elements are, as `isorod.dynamics.explicit.mesh.pack` lays them out."""
    if not model.remembers:
        return
    shapes, place = _shapes(model), 0
    begins = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    for share in ranks.shares:
        body, table = share.body, share.body.space.tabulate(share.first, share.last)
        inside = ring_of(body.space.rod.rings, table.xi)
        rings = len(body.space.rod.rings) - 1
        for ring in range(rings):
            own = np.flatnonzero(inside == ring) if rings > 1 else slice(None)
            blocks = -(-int(inside[own].size) // POINTS)
            shape = (table.elements, table.weights.shape[1], blocks, body.width, POINTS)
            span = slice(place, place + int(np.prod(shape)))
            place = span.stop
            if body.remembers:
                yield _Share(own, span, shape, int(begins[share.which]), shapes[share.which], share.first, share.last)
