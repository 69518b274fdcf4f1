"""Points of contact in their order, and the cells in which surfaces tell them apart.

The points of a pass are a grid: elements, points along each, arcs round the section, points of each arc.  A cell is an
arc by the part of an element that one function along the axis has to itself: what varies faster the surface cannot
follow, and pressures that do make it no flatter.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.packed import Packed

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.space.space import Space


def grids(packed: Packed, values: Array) -> Iterator[Array]:
    """Yield what points have, ``(Q,)``, pass by pass: views ``(elements, along, arcs, across)``."""
    for one in packed.passes:
        surface = packed.surfaces[one["slave"]]
        shape = surface["elements"], one["along"], surface["around"], one["across"]
        first = one["first_point"]
        yield values[first : first + np.prod(shape)].reshape(shape)


def functions(space: "Space") -> int:
    """Return how many functions along the axis an element adds."""
    return max(1, round((space.axis.count - 1) / space.axis.elements))


def spaces(model: "Model") -> list["Space"]:
    """Return the space of each side of all contacts, in the order of the passes."""
    return [model.bodies[body].space for contact in model.contacts for body, _ in contact.sides]


def means(model: "Model", packed: Packed, values: Array) -> list[Array]:
    """Return the means of what points have over the cells of each pass, ``(elements, parts, arcs)``."""
    found = []
    for space, value, area in zip(spaces(model), grids(packed, values), grids(packed, packed.areas), strict=True):
        starts = _starts(value.shape[1], functions(space))
        weights = np.add.reduceat(area.sum(axis=3), starts, axis=1)
        found.append(np.add.reduceat((value * area).sum(axis=3), starts, axis=1) / weights)
    return found


def spread(packed: Packed, cells: Sequence[Array]) -> Array:
    """Return what points have where all in a cell have the same, ``(Q,)``."""
    found = np.zeros(packed.areas.size)
    for cell, value in zip(cells, grids(packed, found), strict=True):
        along, parts = value.shape[1], cell.shape[1]
        value[:] = cell[:, np.arange(along) * parts // along, :, None]
    return found


def parameters(model: "Model", packed: Packed) -> Array:
    """Return axis parameter and angle of all points, ``(Q, 2)``."""
    found = np.empty((packed.areas.size, 2))
    chosen = [elements for contact in model.contacts for _, elements in contact.sides]
    u, angle = (list(grids(packed, found[:, k])) for k in range(2))
    for k, (space, elements) in enumerate(zip(spaces(model), chosen, strict=True)):
        breaks = space.axis.breaks
        here = np.arange(breaks.size - 1) if elements is None else np.unique(np.asarray(elements, dtype=np.int64))
        _, along, n, across = u[k].shape
        t, x = (np.polynomial.legendre.leggauss(count)[0] for count in (along, across))
        middles, halves = 0.5 * (breaks[1:] + breaks[:-1])[here], 0.5 * np.diff(breaks)[here]
        u[k][:] = (middles[:, None] + halves[:, None] * t)[:, :, None, None]
        angle[k][:] = space.turn + np.pi / n * (2.0 * np.arange(n)[:, None] + x)
    return found


def _starts(along: int, parts: int) -> Index:
    """Return the first of the points along an element that are in each of its parts."""
    return np.unique(np.arange(along) * min(parts, along) // along, return_index=True)[1]
