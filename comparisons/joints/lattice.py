"""Meshes of a ring with a round hole for dolfinx, of bricks or of tetrahedra, straight or curved."""

from collections.abc import Callable
from typing import Any, NamedTuple

import dolfinx
import numpy as np
from mpi4py import MPI
from numpy.typing import NDArray

from isorod.fenics import compat

Array = NDArray[np.float64]
# Six tetrahedra of a brick, round its diagonal: corners by their coordinates 0 or 1.
_PATHS = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))


class Ring(NamedTuple):
    """A mesh of a ring, and where its surface is.

    Attributes
    ----------
    mesh
        The mesh.
    hole, outside
        Facets of the hole and of the outer surface.
    ends
        Facets of both plane ends.
    """

    mesh: Any
    hole: NDArray[np.int32]
    outside: NDArray[np.int32]
    ends: NDArray[np.int32]


def circle(radius: float) -> Callable[[Array], Array]:
    """Return an outer surface, a circle: positions ``(n, 2)`` by angle."""
    return lambda angle: radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def square(half: float) -> Callable[[Array], Array]:
    """Return an outer surface, a square of that half side."""

    def outline(angle: Array) -> Array:
        unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return half * unit / np.abs(unit).max(axis=-1, keepdims=True)

    return outline


def ring(
    inner: float,
    outer: Callable[[Array], Array],
    length: float,
    cells: tuple[int, int, int],
    shape: str = "hexahedron",
    order: int = 1,
) -> Ring:
    """Return the mesh of a ring from a hole of radius ``inner`` to an outline, along ``z`` from 0 to ``length``.

    Parameters
    ----------
    cells
        Bricks in radius, angle and length; each is six tetrahedra if that is ``shape``.
    order
        Degree of the geometry, 1 or 2.
    """
    radial, around, along = cells
    count = [order * radial + 1, order * around, order * along + 1]
    fraction = np.linspace(0.0, 1.0, count[0])
    angle = 2.0 * np.pi * np.arange(count[1]) / count[1]
    hole = circle(inner)(angle)
    section = hole + fraction[:, None, None] * (outer(angle) - hole)
    points = np.zeros((*count, 3))
    points[..., :2] = section[:, :, None]
    points[..., 2] = np.linspace(0.0, length, count[2])
    number = np.arange(points.size // 3).reshape(count)

    grid = np.indices((radial, around, along)).reshape(3, -1).T * order
    local = compat.reference_nodes(shape, order)
    if shape == "hexahedron":
        parts = [np.rint(order * local).astype(int)]
    else:
        parts = []
        for path in _PATHS:
            corners = np.cumsum([np.zeros(3), *np.eye(3)[list(path)]], axis=0)
            nodes = (1.0 - local.sum(axis=1))[:, None] * corners[0] + local @ corners[1:]
            parts.append(np.rint(order * nodes).astype(int))
    all_cells = []
    for part in parts:
        i, j, k = (grid[:, None] + part).transpose(2, 0, 1)
        all_cells.append(number[i, j % count[1], k])
    mesh = compat.create_mesh(
        MPI.COMM_WORLD, np.concatenate(all_cells).astype(np.int64), points.reshape(-1, 3), shape, order
    )
    mesh.topology.create_connectivity(2, 3)

    def on(marker: Callable[[Array], Any]) -> NDArray[np.int32]:
        return np.asarray(dolfinx.mesh.locate_entities_boundary(mesh, 2, marker), dtype=np.int32)

    near = 1e-9 * length
    ends = np.union1d(on(lambda x: x[2] < near), on(lambda x: x[2] > length - near))
    inside = on(lambda x: np.hypot(x[0], x[1]) < inner * (1.0 + 1e-9))
    outside = np.setdiff1d(on(lambda x: np.ones(x.shape[1], dtype=bool)), np.concatenate([ends, inside]))
    return Ring(mesh, inside, outside.astype(np.int32), ends.astype(np.int32))
