"""Closest points of cells and of their facets for many points at once."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.fenics.boxes import Boxes
from isorod.fenics.cells import SLACK, Cells
from isorod.fenics.facets import Facets

# Points that are searched for at a time.
AT_ONCE = 20_000

# Distance by which a curved cell may extend beyond the box of its nodes, relative to its size.
_CURVED = 0.25


class Place(NamedTuple):
    """Closest points in cells.

    Attributes
    ----------
    cell
        This rank's number of the cell, shape ``(q,)``; -1 where there is none.
    X
        Reference points, shape ``(q, 3)``.
    distance
        Distance from the given points, shape ``(q,)``; infinite where there is none.
    """

    cell: Index
    X: Array
    distance: Array


class Nearest:
    """Search for closest points in some cells, or by projection on facets for points outside.

    Parameters
    ----------
    cells
        This rank's cells.
    some
        The cells that are searched.
    cell, face
        The cell of each facet, and its number among the facets of the cell.
    """

    def __init__(self, cells: Cells, some: Index, cell: Index, face: Index) -> None:
        self._cells, self._some, self._cell, self._face = cells, some, cell, face
        # Round-off, or the bulge of curved cells.
        self._margin = cells.slack if cells.geometry.degree == 1 else _CURVED
        if len(some):
            self._boxes = self._around(cells.x[some])
        if len(cell):
            self._facets = Facets(cells, cell, face)
            self._facet_boxes = self._around(self._facets.samples)
            self._middles = cKDTree(self._facets.samples.mean(axis=1))

    def _around(self, x: Array) -> Boxes:
        """Return the boxes of sets of points, shape ``(n, m, 3)``, with a margin."""
        low, high = x.min(axis=1), x.max(axis=1)
        margin = self._margin * (high - low).max(axis=1, keepdims=True)
        return Boxes(low - margin, high + margin)

    def __call__(self, points: Array) -> Place:
        """Return the closest points to points ``(q, 3)``."""
        count = len(points)
        place = Place(np.full(count, -1, dtype=np.int64), np.zeros((count, 3)), np.full(count, np.inf))
        for k in range(0, count, AT_ONCE):
            chunk = np.arange(k, min(k + AT_ONCE, count))
            if len(self._some):
                self._locate(points[chunk], chunk, place)
            chunk = chunk[place.cell[chunk] < 0]
            if len(self._cell) and len(chunk):
                self._project(points[chunk], chunk, place)
        return place

    def _locate(self, points: Array, numbers: Index, place: Place) -> None:
        """Set the places of points inside a cell."""
        point, candidates = self._boxes.within(points, np.zeros(len(points)))
        cell = self._some[candidates]
        X = self._cells.pulled_back(cell, points[point])
        outside = self._cells.outside(X)
        within = np.flatnonzero(outside <= self._cells.slack)
        within = within[_first_of(point[within], outside[within])]
        target = numbers[point[within]]
        place.cell[target], place.X[target], place.distance[target] = cell[within], X[within], 0.0

    def _project(self, points: Array, numbers: Index, place: Place) -> None:
        """Set the places of points on facets."""
        first = np.asarray(self._middles.query(points)[1], dtype=np.int64)
        bound = self._facets.nearest(first, points)[1]
        point, candidates = self._facet_boxes.within(points, bound * (1.0 + SLACK))
        s, distance = self._facets.nearest(candidates, points[point])
        best = _first_of(point, distance)
        candidates = candidates[best]
        place.cell[numbers], place.distance[numbers] = self._cell[candidates], distance[best]
        place.X[numbers] = self._cells.on_faces(self._face[candidates], s[best])


def _first_of(numbers: Index, key: Array) -> Index:
    """Return the index of the least key of each distinct number, in ascending order of the numbers."""
    order = np.lexsort((key, numbers))
    first = np.ones(len(numbers), dtype=bool)
    first[1:] = np.diff(numbers[order]) > 0
    return np.asarray(order[first], dtype=np.int64)
