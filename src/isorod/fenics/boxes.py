"""Axis-aligned boxes near points: a tree of boxes, traversed level by level for all points at once."""

import numpy as np

from isorod.arrays import Array, Index

# Bits of the grid coordinates by which the centres of boxes are sorted.
_BITS = 20


class Boxes:
    """Axis-aligned boxes in a binary tree.

    Parameters
    ----------
    low, high
        Corners, shape ``(n, 3)``.
    """

    def __init__(self, low: Array, high: Array) -> None:
        self._order = _morton_order(0.5 * (low + high))
        corners = np.stack([low[self._order].T, high[self._order].T])
        # The leaves first, then boxes about pairs of the level before; empty boxes make the numbers even.
        self._levels = [corners]
        while self._levels[-1].shape[2] > 1:
            below = self._levels[-1]
            if below.shape[2] % 2:
                empty = np.broadcast_to([[[np.inf]], [[-np.inf]]], (2, 3, 1))
                below = self._levels[-1] = np.concatenate([below, empty], axis=2)
            pairs = below.reshape(2, 3, -1, 2)
            self._levels.append(np.stack([pairs[0].min(axis=2), pairs[1].max(axis=2)]))

    def within(self, points: Array, reach: Array) -> tuple[Index, Index]:
        """Return the pairs of a point ``(q, 3)`` and a box that is within ``reach`` ``(q,)`` of it."""
        point, box = np.arange(len(points)), np.zeros(len(points), dtype=np.int64)
        x, square = np.ascontiguousarray(points.T), np.square(reach)
        for k, (low, high) in enumerate(reversed(self._levels)):
            if k > 0:
                point, box = np.repeat(point, 2), (2 * box[:, None] + np.arange(2)).ravel()
            away = np.zeros(len(point))
            for a in range(3):
                coordinate = x[a][point]
                away += np.square(np.maximum(np.maximum(low[a][box] - coordinate, coordinate - high[a][box]), 0.0))
            near = away <= square[point]
            point, box = point[near], box[near]
        return point, self._order[box]


def _morton_order(middles: Array) -> Index:
    """Return the order of points ``(n, 3)`` along a Z-order curve (Morton 1966)."""
    least = middles.min(axis=0)
    size = float((middles - least).max()) or 1.0
    steps = ((middles - least) * ((2**_BITS - 1) / size)).astype(np.int64)
    code = np.zeros(len(middles), dtype=np.int64)
    for bit in range(_BITS):
        for a in range(3):
            code |= ((steps[:, a] >> bit) & 1) << (3 * bit + a)
    return np.argsort(code, kind="stable")
