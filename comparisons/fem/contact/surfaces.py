"""Frictionless penalty contact between two surfaces of a mesh, in two passes of half weight each.

Energy ``sum 1/2 penalty gap^2 dA`` over the points of either surface that are inside the other one, ``dA`` on the
reference surface: the same continuous problem as `isorod.contact`.  Everything is numbered as in `meshes.mesh.Mesh`;
nothing here knows dolfinx.
"""

from typing import Any, TypeVar

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from comparisons.fem.contact import closest_kernel, pressing_kernel
from comparisons.fem.contact.closest_kernel import Closest, Facet, Points, Surface
from comparisons.fem.contact.facets import facet_of, gauss, nodal
from comparisons.fem.contact.pressing_kernel import Pressing
from isorod.errors import InputError
from meshes.mesh import Array, Index, Mesh

Table = TypeVar("Table", Points, Closest)


class _Side:
    """The points of one surface against the facets of the other; ``closest`` keeps the last projections."""

    def __init__(self, points: Points, facets: Index, like: Facet) -> None:
        self.points, self.surface = points, Surface(np.ascontiguousarray(facets), _neighbours(facets), like)
        count = len(points.weights)
        self._keep(np.arange(count), np.zeros(count, dtype=np.int64))

    def _keep(self, near: Index, facet: Index) -> None:
        """Of all points keep those near the facets, and make room for their projections."""
        count = len(near)
        self.near = near
        self.kept = _take(self.points, near)
        self.closest = Closest(np.empty((count, 3)), facet, np.empty((count, 2)), np.empty(count))

    def search(self, nodes: Array, reach: float) -> None:
        """Keep the points within ``reach`` of the facets, starting from the facets with the nearest centres."""
        x = np.empty((len(self.points.weights), 3))
        closest_kernel.place(nodes, self.points, x)
        corners = nodes[self.surface.facets]
        centres = corners.mean(axis=1)
        # A facet bulges no farther from its centre than twice as far as its nodes are.
        size = 2.0 * np.sqrt(((corners - centres[:, None]) ** 2).sum(axis=2).max())
        distance, facet = cKDTree(centres).query(x, distance_upper_bound=reach + size)
        (near,) = np.nonzero(np.isfinite(distance))
        self._keep(near, facet[near].astype(np.int64))
        self.update(nodes)
        close = self.closest.gap < reach
        self._keep(near[close], self.closest.facet[close])

    def update(self, nodes: Array) -> None:
        """Find the closest points of those near, from where they were."""
        closest_kernel.place(nodes, self.kept, self.closest.x)
        closest_kernel.closest(nodes, self.surface, self.closest)

    def stiffness(self, nodes: Array, penalty: float) -> tuple[Index, Array]:
        """Return the unknowns ``(m, 3 n)`` of each point in contact and its second derivative ``(m, 3 n, 3 n)``."""
        (active,) = np.nonzero(self.closest.gap < 0.0)
        points, closest = _take(self.kept, active), _take(self.closest, active)
        n = points.supports.shape[1] + self.surface.facets.shape[1]
        numbers = np.empty((len(active), n), dtype=np.int64)
        blocks = np.empty((len(active), 3 * n, 3 * n))
        pressing_kernel.stiffness(nodes, points, self.surface, closest, penalty, numbers, blocks)
        return (3 * numbers[:, :, None] + np.arange(3)).reshape(len(active), 3 * n), blocks


def _take(tables: Table, which: Index) -> Table:
    """Return some rows of each of the arrays."""
    rows: Any = (one[which] for one in tables)
    return type(tables)(*rows)


class Contact:
    """Penalty contact between two named faces of a mesh.

    Parameters
    ----------
    mesh
        Its faces' nodes carry the displacement too: the element is isoparametric.
    first, second
        Names of faces.
    penalty
        Force per volume: pressure over penetration.
    parts
        Each facet is cut in ``parts^2`` of equal shape, each with a rule exact to twice the order: contact that begins
        inside a facet needs more points than its functions do.  0: the nodes, as usual in explicit dynamics; order 1
        only.
    reach
        Points farther apart than this are not checked until the surfaces have moved half of it; units of length.
    """

    def __init__(self, mesh: Mesh, first: str, second: str, penalty: float, parts: int = 1, reach: float = 0.1) -> None:
        if not (np.isfinite(penalty) and penalty > 0.0):
            raise InputError(f"penalty: got {penalty:g}, need a positive force per volume")
        if parts == 0 and mesh.order != 1:
            raise InputError(f"contact at nodes: got facets of order {mesh.order}, need order 1")
        self.penalty, self.reach = penalty, reach
        like = facet_of(mesh)
        faces = [mesh.faces[first], mesh.faces[second]]
        points = [gauss(mesh, like, face, parts) if parts else nodal(mesh, like, face) for face in faces]
        # Each pass has half of the energy.
        one, other = (some._replace(weights=0.5 * some.weights) for some in points)
        self.sides = (_Side(one, faces[1], like), _Side(other, faces[0], like))
        self._nodes: Index = np.unique(np.concatenate([face.ravel() for face in faces]))
        self._searched: Array | None = None

    def area(self, side: int) -> float:
        """Return the reference area of a surface."""
        return 2.0 * float(self.sides[side].points.weights.sum())

    def _find(self, nodes: Array) -> None:
        here = nodes[self._nodes]
        if self._searched is None or ((here - self._searched) ** 2).sum(axis=1).max() > (0.5 * self.reach) ** 2:
            for side in self.sides:
                side.search(nodes, self.reach)
            self._searched = here
        for side in self.sides:
            side.update(nodes)

    def add_forces(self, nodes: Array, out: Array) -> Pressing:
        """Add the gradient of the energy to ``out``.

        Both arrays of shape ``(nodes, 3)``, ``nodes`` the present positions.
        """
        self._find(nodes)
        first, second = (
            Pressing(*pressing_kernel.add_forces(nodes, side.kept, side.surface, side.closest, self.penalty, out))
            for side in self.sides
        )
        return Pressing(
            first.energy + second.energy,
            first.normal_force + second.normal_force,
            first.area + second.area,
            first.force - second.force,
            min(first.gap, second.gap, self.reach),
        )

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the second derivative of the energy, rows and columns ``3 node + component``; entries repeat."""
        self._find(nodes)
        rows, columns, values = [], [], []
        for side in self.sides:
            unknowns, blocks = side.stiffness(nodes, self.penalty)
            rows.append(np.broadcast_to(unknowns[:, :, None], blocks.shape).ravel())
            columns.append(np.broadcast_to(unknowns[:, None, :], blocks.shape).ravel())
            values.append(blocks.ravel())
        size = 3 * len(nodes)
        where = (np.concatenate(rows), np.concatenate(columns))
        return sparse.coo_array((np.concatenate(values), where), shape=(size, size))


def _neighbours(facets: Index) -> Index:
    """Return for each facet those that share a node with it, shape ``(facets, most)``, filled up with -1."""
    count, n = facets.shape
    touch = sparse.csr_array((np.ones(facets.size), (np.repeat(np.arange(count), n), facets.ravel())))
    pairs = (touch @ touch.T).tocoo()
    other = pairs.row != pairs.col
    row, column = pairs.row[other], pairs.col[other]
    order = np.argsort(row, kind="stable")
    row, column = row[order], column[order]
    first = np.searchsorted(row, np.arange(count + 1))
    table = np.full((count, int(np.diff(first).max(initial=1))), -1, dtype=np.int64)
    table[row, np.arange(row.size) - first[row]] = column
    return table
