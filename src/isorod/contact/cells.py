"""Points of contact in their order, and the cells that surfaces can resolve.

The points of a pass are a grid: elements, points along each, arcs round the section, points of each arc.  A cell is
the area per function round the section (an arc where these are of control points) and along the axis: the surface
cannot follow anything that varies faster, and pressures that do so do not flatten it.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.contact.packed import Packed, Row, Table

if TYPE_CHECKING:
    from isorod.space.space import Space


def grids(packed: Packed, values: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """Yield values of points ``(Q,)`` pass by pass: views ``(elements, along, arcs, across)``."""
    for pass_ in packed.passes:
        surface = packed.surfaces[pass_["slave"]]
        shape = surface["elements"], pass_["along"], surface["around"], pass_["across"]
        first = pass_["first_point"]
        yield values[first : first + np.prod(shape)].reshape(shape)


def functions(space: "Space") -> int:
    """Return the number of functions along the axis per element: the mean multiplicity of its inner knots."""
    inner = space.axis.multiplicities[1:-1]
    return round(float(inner.mean())) if inner.size else space.axis.degree


def numbers(packed: Packed) -> Index:
    """Return the number of the cell of each point, ``(Q,)``."""
    result, count = np.zeros(packed.areas.size, dtype=np.int64), 0
    for slave, number in zip(packed.passes["slave"], grids(packed, result), strict=True):
        elements, along, arcs, _ = number.shape
        parts, around = min(int(packed.surfaces["cells"][slave]), along), int(packed.surfaces["cells_round"][slave])
        rows = np.arange(elements)[:, None] * parts + np.arange(along) * parts // along
        number[:] = count + rows[..., None, None] * around + (np.arange(arcs) * around // arcs)[:, None]
        count += elements * parts * around
    return result


def means(packed: Packed, values: Array) -> Array:
    """Return, at points under pressure, the mean of values over those of the cell; zero at others, ``(Q,)``."""
    number, areas = numbers(packed), packed.areas * (packed.states["pressure"] > 0.0)
    loads, sizes = (np.bincount(number, one, packed.areas.size) for one in (areas * values, areas))
    return np.where(areas > 0.0, (loads / np.where(sizes > 0.0, sizes, 1.0))[number], 0.0)


def moved(old: Packed, values: Array, new: Packed) -> Array:
    """Return values transferred from points of one rule to those of another at the same place, ``(Q,)``."""
    # Imported late: motions do not need it.
    from scipy.spatial import cKDTree

    result = np.zeros(new.areas.size)
    for k, (value, other) in enumerate(zip(grids(old, values), grids(new, result), strict=True)):
        _, along, _, across = other.shape
        if is_facets(new.surfaces[new.passes["slave"][k]]):
            places = [_on_facets(one, k) for one in (old, new)]
            other.ravel()[:] = value.ravel()[cKDTree(places[0]).query(places[1])[1]]
            continue
        rows = np.arange(along) * value.shape[1] // along
        columns = np.arange(across) * value.shape[3] // across
        other[:] = value[:, rows][..., columns]
    return result


def is_facets(surface: Row) -> bool:
    """Whether a surface is one of a finite element body."""
    return bool(surface["around"] == 1)


def _on_facets(packed: Packed, k: int) -> Array:
    """Return coordinates of points of a pass: their facets, well apart, and shape functions there, ``(q, 1 + l)``."""
    pass_, values = packed.passes[k], packed.along[packed.passes[k]["first_along"] :]
    count = int(packed.surfaces[pass_["slave"]]["elements"]) * int(pass_["along"])
    return np.column_stack([10.0 * (np.arange(count) // pass_["along"]), values[:count]])


def sense(surfaces: Table) -> Array:
    """Return the sense of angles round surfaces: -1 where backwards (`isorod.contact.traces`), else 1."""
    return np.where(surfaces["deep"] > 0.0, -1.0, 1.0)


def parameters(packed: Packed) -> Array:
    """Return axis parameter and angle of all points, ``(Q, 2)``."""
    result = np.empty((packed.areas.size, 2))
    for pass_, u, angle in zip(packed.passes, *(grids(packed, column) for column in result.T), strict=True):
        surface = packed.surfaces[pass_["slave"]]
        _, along, arcs, across = u.shape
        low, high = packed.elements["u"][surface["first_element"] :][: surface["elements"], :, None].swapaxes(0, 1)
        u[:] = (low + (high - low) * packed.fractions[pass_["first_along"] :][:along])[..., None, None]
        x = np.polynomial.legendre.leggauss(across)[0]
        angle[:] = sense(surface) * (surface["arcs"][:arcs, :1] + np.pi * surface["arcs"][:arcs, 6:] * x)

    return result
