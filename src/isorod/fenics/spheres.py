"""Which of many things may be near points: spheres about them, sorted by size, and SciPy's trees of the centres."""

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index


class Spheres:
    """Spheres about sets of points.

    Parameters
    ----------
    corners
        The points of each thing, shape ``(things, n, 3)``.
    margin
        Factor of the radii: 1 where the thing is in the hull of its points.
    """

    def __init__(self, corners: Array, margin: float) -> None:
        self.centers: Array = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
        self.radii: Array = margin * np.linalg.norm(corners - self.centers[:, None], axis=2).max(axis=1)
        self._tree = cKDTree(self.centers)
        # Within a class radii differ by a factor of two at most.
        sizes = np.frexp(self.radii)[1]
        self._classes = [np.flatnonzero(sizes == one) for one in np.unique(sizes)]
        self._trees = [cKDTree(self.centers[own]) for own in self._classes]

    def first(self, points: Array) -> Index:
        """Return for each point ``(q, 3)`` the thing whose centre is nearest."""
        return np.asarray(self._tree.query(points)[1], dtype=np.int64)

    def pairs(self, points: Array, reach: Array) -> tuple[Index, Index]:
        """Return pairs of a point and a thing that may be within ``reach`` ``(q,)`` of it."""
        found: list[tuple[Index, Index]] = []
        for own, tree in zip(self._classes, self._trees, strict=True):
            lists = tree.query_ball_point(points, reach + self.radii[own].max())
            counts = np.fromiter(map(len, lists), np.int64, len(lists))
            things = own[np.fromiter(chain.from_iterable(lists), np.int64, counts.sum())]
            of = np.repeat(np.arange(len(points)), counts)
            near = np.linalg.norm(points[of] - self.centers[things], axis=1) <= reach[of] + self.radii[things]
            found.append((of[near], things[near]))
        of, things = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return of, things
