"""Points of contact in their order, and the cells in which surfaces tell them apart.

The points of a pass are a grid: elements, points along each, arcs round the section, points of each arc.  A cell is an
arc by the part of an element that one function along the axis has to itself: what varies faster the surface cannot
follow, and pressures that do make it no flatter.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.contact.packed import Packed

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.space.space import Space


def grids(packed: Packed, values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield what points have, ``(Q,)``, pass by pass: views ``(elements, along, arcs, across)``."""
    for one in packed.passes:
        surface = packed.surfaces[one["slave"]]
        shape = surface["elements"], one["along"], surface["around"], one["across"]
        first = one["first_point"]
        yield values[first : first + np.prod(shape)].reshape(shape)


def functions(space: "Space") -> int:
    """Return how many functions along the axis an element has to itself: as many as its knots stand there times."""
    inner = space.axis.multiplicities[1:-1]
    return round(float(inner.mean())) if inner.size else space.axis.degree


def spaces(model: "Model") -> list["Space"]:
    """Return the space of each side of all contacts, in the order of the passes."""
    return [model.bodies[body].space for contact in model.contacts for body, _ in contact.sides]


def _parts(space: "Space", along: int) -> tuple[Index, int]:
    """Return the part of an element that each of so many points along it is in, and how many parts there are."""
    parts = min(functions(space), along)
    return np.arange(along) * parts // along, parts


def numbers(model: "Model", packed: Packed) -> Index:
    """Return the number of the cell of each point, ``(Q,)``."""
    found, count = np.zeros(packed.areas.size, dtype=np.int64), 0
    for space, number in zip(spaces(model), grids(packed, found), strict=True):
        elements, along, arcs, _ = number.shape
        part, parts = _parts(space, along)
        places = (np.arange(elements)[:, None] * parts + part)[..., None] * arcs + np.arange(arcs)
        number[:] = count + places[..., None]
        count += elements * parts * arcs
    return found


def means(model: "Model", packed: Packed, values: Array) -> Array:
    """Return, at points under pressure, the mean of values over those of the cell; zero at others, ``(Q,)``."""
    found = np.zeros(packed.areas.size)
    touching = packed.states["pressure"] > 0.0
    grid = (grids(packed, one) for one in (values, packed.areas * touching, found))
    for space, value, area, mean in zip(spaces(model), *grid, strict=True):
        part, parts = _parts(space, value.shape[1])
        starts = np.searchsorted(part, np.arange(parts))
        loads, areas = (
            np.add.reduceat(one.sum(axis=3), starts, axis=1)[:, part, :, None] for one in (value * area, area)
        )
        mean[:] = np.where(area > 0.0, loads / np.where(areas > 0.0, areas, 1.0), 0.0)
    return found


def moved(old: Packed, values: Array, new: Packed) -> Array:
    """Return what points of other rules have that lie where these do, ``(Q,)``."""
    found = np.zeros(new.areas.size)
    for value, other in zip(grids(old, values), grids(new, found), strict=True):
        _, along, _, across = other.shape
        rows = np.arange(along) * value.shape[1] // along
        columns = np.arange(across) * value.shape[3] // across
        other[:] = value[:, rows][..., columns]
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
        arcs = packed.surfaces["arcs"][packed.passes["slave"][k], :n]
        t, x = (np.polynomial.legendre.leggauss(count)[0] for count in (along, across))
        middles, halves = 0.5 * (breaks[1:] + breaks[:-1])[here], 0.5 * np.diff(breaks)[here]
        u[k][:] = (middles[:, None] + halves[:, None] * t)[:, :, None, None]
        angle[k][:] = arcs[:, :1] + np.pi * arcs[:, 6:] * x
    return found
