"""Rows of shape functions at points, and quadrature on facets, of bodies distributed over ranks."""

from typing import Any, NamedTuple

import basix
import numpy as np
from mpi4py import MPI

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.cells import Cells, tabulated
from isorod.fenics.nearest import AT_ONCE, Nearest
from isorod.tensors import inverse


class Rows(NamedTuple):
    """Shape functions at points, by linear extrapolation from the nearest point of the body.

    They reproduce linear fields, including rigid motions, also across a gap.

    Attributes
    ----------
    nodes
        Global numbers of nodes, shape ``(q, m)``.
    values
        The shape functions, shape ``(q, m)``.
    gap
        Distance from the body, 0 inside, shape ``(q,)``; with given facets from these, 0 inside their cells.
    """

    nodes: Index
    values: Array
    gap: Array


class Trace(NamedTuple):
    """Quadrature points on a surface of the body.

    Attributes
    ----------
    points, normals
        Positions and outward unit normals at rest, shape ``(q, 3)``.
    weights
        Area weight of each, shape ``(q,)``.
    nodes
        Global numbers of the nodes whose shape functions do not vanish on the facet, shape ``(q, m)``.
    values
        These shape functions, shape ``(q, m)``.
    each
        Number of points on a facet, which are consecutive.
    """

    points: Array
    normals: Array
    weights: Array
    nodes: Index
    values: Array
    each: int


class Surface:
    """The surface of a body, and closest points on it."""

    def __init__(self, space: Any) -> None:
        self._space, self._comm = space, space.mesh.comm
        self._cells = Cells(space)
        self._exterior = compat.exterior_facets(space.mesh)

    def rows(self, points: Array, facets: Index | None) -> Rows:
        """Return `Rows` at points that are equal on all ranks."""
        cell, face = self._places(facets)
        some = np.arange(len(self._cells.x)) if facets is None else np.unique(cell)
        place = Nearest(self._cells, some, cell, face)(points)
        # The nearest rank evaluates, the first of several.
        gap, least = place.distance, np.empty_like(place.distance)
        self._comm.Allreduce(gap, least, op=MPI.MIN)
        rank = np.where(gap <= least, self._comm.rank, self._comm.size).astype(np.int64)
        first = np.empty_like(rank)
        self._comm.Allreduce(rank, first, op=MPI.MIN)
        assigned = np.flatnonzero((first == self._comm.rank) & (place.cell >= 0))
        count = self._cells.nodes.shape[1]
        nodes, values = np.zeros((len(points), count), dtype=np.int64), np.zeros((len(points), count))
        nodes[assigned] = self._cells.nodes[place.cell[assigned]]
        for k in range(0, len(assigned), AT_ONCE):
            chunk = assigned[k : k + AT_ONCE]
            values[chunk] = self._cells.extrapolated(place.cell[chunk], place.X[chunk], points[chunk])
        self._comm.Allreduce(MPI.IN_PLACE, nodes, op=MPI.SUM)
        self._comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
        return Rows(nodes, values, least)

    def trace(self, facets: Index | None, pieces: int | None = None) -> Trace:
        """Return the `Trace` of exterior facets."""
        cells = self._cells
        cell, face = self._places(facets)
        kind = basix.CellType.triangle if cells.simplex else basix.CellType.quadrilateral
        degree = 2 * cells.element.degree + 2 * cells.geometry.degree
        s, w = basix.make_quadrature(kind, degree if pieces is None else 2)[:2]
        if pieces is not None:
            s, w = _subdivided(s, w, pieces, cells.simplex)
        parts = []
        layout = self._space.dofmap.dof_layout
        normals = basix.cell.facet_outward_normals(cells.element.cell_type)
        for f in range(len(cells.faces)):
            with_facet = cell[face == f]
            closure = np.asarray(layout.entity_closure_dofs(2, f), dtype=np.int64)
            X = cells.on_faces(np.full(len(s), f), s)
            values = tabulated(cells.element, 0, X)[0][:, closure]
            repeated, X = np.repeat(with_facet, len(s)), np.tile(X, (len(with_facet), 1))
            x, J = cells.at(repeated, X)
            # Nanson's formula.
            corner = cells.corners[cells.faces[f]]
            area = np.cross(J @ (corner[1] - corner[0]), J @ (corner[2] - corner[0]))
            size = np.linalg.norm(area, axis=1)
            outward = np.einsum("kba,b->ka", inverse(J)[0], normals[f])
            area *= np.sign(np.einsum("ka,ka->k", area, outward))[:, None] / size[:, None]
            nodes = np.repeat(cells.nodes[with_facet][:, closure], len(s), axis=0)
            parts.append((x, area, np.tile(w, len(with_facet)) * size, nodes, np.tile(values, (len(with_facet), 1))))
        local = [np.concatenate(part) for part in zip(*parts, strict=True)]
        gathered = [np.concatenate(part) for part in zip(*self._comm.allgather(local), strict=True)]
        return Trace(gathered[0], gathered[1], gathered[2], gathered[3], gathered[4], len(s))

    def _own(self, facets: Index) -> Index:
        """Return the given facets that are this rank's own."""
        mesh = self._space.mesh
        index_map = mesh.topology.index_map(2)
        known = index_map.size_local + index_map.num_ghosts
        given = np.unique(np.asarray(facets))
        outside = given[~np.isin(given, np.arange(known))]
        own = given[given < index_map.size_local].astype(np.int64)
        inner = np.setdiff1d(own, self._exterior)
        total, wrong, none = self._comm.allreduce(np.array([len(own), len(inner), len(outside)]), op=MPI.SUM)
        if none:
            which = f"{outside[0]:g}, need whole numbers from 0 to {known - 1}" if len(outside) else "another's number"
            raise InputError(f"facets of the solid: got {which}")
        if total == 0:
            raise InputError("facets of the solid: there is none on any rank; name facets of its surface")
        if wrong:
            raise InputError(
                f"facets of the solid: {wrong} of {total} are inside of the mesh, need those of its surface"
            )
        return own

    def _places(self, facets: Index | None) -> tuple[Index, Index]:
        """Return the cells of facets, all exterior ones if None, and their numbers among the facets of the cell."""
        own = self._exterior if facets is None else self._own(facets)
        return compat.facets_in_cells(self._space.mesh, own, len(self._cells.faces))


def _subdivided(s: Array, w: Array, count: int, simplex: bool) -> tuple[Array, Array]:
    """Return a rule on the reference triangle or square with each side subdivided equally."""
    corner = np.stack(np.meshgrid(*2 * [np.arange(count)], indexing="ij"), axis=-1).reshape(-1, 2)
    points = corner[:, None] + s
    if simplex:
        # The second triangle of each square.
        turned = corner[:, None] + 1.0 - s
        points = np.concatenate([points[corner.sum(axis=1) < count], turned[corner.sum(axis=1) < count - 1]])
    return points.reshape(-1, 2) / count, np.tile(w, len(points)) / count**2
