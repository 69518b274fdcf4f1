"""The nearest points of cells, and of facets of theirs, to many points at once."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.fenics.boxes import Boxes
from isorod.fenics.cells import SLACK, Cells
from isorod.fenics.facets import Facets

# Points that are looked for at a time.
AT_ONCE = 20_000

# Share of its size by which a curved cell may reach beyond the box about its nodes.
_CURVED = 0.25


class Place(NamedTuple):
    """Points of cells.

    Attributes
    ----------
    cell
        This rank's number of the cell, shape ``(q,)``; -1 where there is none.
    X
        Reference points, shape ``(q, 3)``.
    distance
        Distance from the points asked for, shape ``(q,)``; infinite where there is none.
    """

    cell: Index
    X: Array
    distance: Array


class Nearest:
    """Some cells, and facets that points beyond them are projected on.

    Parameters
    ----------
    cells
        This rank's cells.
    some
        Those in which points are looked for.
    cell, face
        The cell of each facet, and which of its facets it is.
    """

    def __init__(self, cells: Cells, some: Index, cell: Index, face: Index) -> None:
        self._cells, self._some, self._cell, self._face = cells, some, cell, face
        # Within rounding, or where the nodes are not the hull.
        self._margin = cells.slack if cells.geometry.degree == 1 else _CURVED
        if len(some):
            self._boxes = self._around(cells.x[some])
        if len(cell):
            self._facets = Facets(cells, cell, face)
            self._facet_boxes = self._around(self._facets.samples)
            self._middles = cKDTree(self._facets.samples.mean(axis=1))

    def _around(self, x: Array) -> Boxes:
        """Return the boxes about things of which some points are given, shape ``(n, m, 3)``."""
        low, high = x.min(axis=1), x.max(axis=1)
        margin = self._margin * (high - low).max(axis=1, keepdims=True)
        return Boxes(low - margin, high + margin)

    def __call__(self, points: Array) -> Place:
        """Return the nearest place of each point ``(q, 3)``."""
        count = len(points)
        place = Place(np.full(count, -1, dtype=np.int64), np.zeros((count, 3)), np.full(count, np.inf))
        for k in range(0, count, AT_ONCE):
            own = np.arange(k, min(k + AT_ONCE, count))
            if len(self._some):
                self._look_within(points[own], own, place)
            own = own[place.cell[own] < 0]
            if len(self._cell) and len(own):
                self._project(points[own], own, place)
        return place

    def _look_within(self, points: Array, own: Index, place: Place) -> None:
        """Set the places of the points that are in a cell."""
        of, things = self._boxes.within(points, np.zeros(len(points)))
        cell = self._some[things]
        X = self._cells.pulled_back(cell, points[of])
        outside = self._cells.outside(X)
        within = np.flatnonzero(outside <= self._cells.slack)
        within = within[_first_of(of[within], outside[within])]
        to = own[of[within]]
        place.cell[to], place.X[to], place.distance[to] = cell[within], X[within], 0.0

    def _project(self, points: Array, own: Index, place: Place) -> None:
        """Set the places of points on facets."""
        first = np.asarray(self._middles.query(points)[1], dtype=np.int64)
        bound = self._facets.nearest(first, points)[1]
        of, things = self._facet_boxes.within(points, bound * (1.0 + SLACK))
        s, distance = self._facets.nearest(things, points[of])
        best = _first_of(of, distance)
        things = things[best]
        place.cell[own], place.distance[own] = self._cell[things], distance[best]
        place.X[own] = self._cells.on_faces(self._face[things], s[best])


def _first_of(of: Index, key: Array) -> Index:
    """Return of each number in ``of`` where it stands with the least key, in the order of numbers."""
    order = np.lexsort((key, of))
    first = np.ones(len(of), dtype=bool)
    first[1:] = np.diff(of[order]) > 0
    return np.asarray(order[first], dtype=np.int64)
