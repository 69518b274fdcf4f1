"""Where points of rods are in the cells of their mesh: the Rods' parameters are functions of the cells too."""

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from meshes.mesh import Array, Index, gradients

# A point belongs to a cell if its reference position is inside but for this: the rim of a section is a polynomial.
_OUTSIDE = 0.05
_NEWTON_STEPS = 25
# Cells that are tried, those with the nearest middles first.
_TRIED = 32


def lagrange(order: int, nodes: Array, where: Array) -> Array:
    """Return values ``(m, nodes)`` of the brick's Lagrange functions of ``nodes`` ``(nodes, 3)`` at ``where``."""
    ticks = np.arange(order + 1.0) / order
    result = np.ones((len(where), len(nodes)))
    for a in range(3):
        for tick in ticks:
            own = np.abs(nodes[:, a] - tick) < 1e-6
            others = ticks[np.abs(ticks - tick) > 1e-6]
            factor = np.prod((where[:, a, None] - others) / (tick - others), axis=1)
            result[:, own] *= factor[:, None]
    return result


class Places:
    """The cells of one rod.

    Parameters
    ----------
    order, reference
        Of the cells, as in `meshes.mesh.Mesh`.
    parameters
        Of each cell's nodes, shape ``(cells, nodes per cell, 3)``.
    period
        How much ``u`` grows once round a closed rod; None if it has ends.
    """

    def __init__(self, order: int, reference: Array, parameters: Array, period: float | None) -> None:
        self.order, self.reference, self.parameters, self.period = order, reference, parameters, period
        u = parameters[:, :, 2]
        # Of the size of the disk's cells, so that near cells are near in all three parameters.
        across = np.ptp(parameters[:, :, :2], axis=1).mean()
        self._scale = np.array([1.0, 1.0, across / np.ptp(u, axis=1).mean()])
        self._tree = cKDTree(parameters.mean(axis=1) * self._scale)

    def find(self, points: Array) -> tuple[Index, Array]:
        """Return cell and reference position of points ``xi_1, xi_2, u``, shape ``(m, 3)``.

        Raises
        ------
        InputError
            If a point is in no cell.
        """
        cell, where, outside = self._search(points)
        if self.period is not None:
            later = self._search(points + np.array([0.0, 0.0, self.period]))
            better = later[2] < outside
            cell, outside = np.where(better, later[0], cell), np.where(better, later[2], outside)
            where = np.where(better[:, None], later[1], where)
        if (outside > _OUTSIDE).any():
            lost = points[int(np.argmax(outside))]
            raise InputError(f"mesh: no cell has the point xi ({lost[0]:.4g}, {lost[1]:.4g}), u {lost[2]:.4g}")
        return cell, where

    def _search(self, points: Array) -> tuple[Index, Array, Array]:
        """Return cells, reference positions, and how far outside of the cell these are."""
        count = min(_TRIED, len(self.parameters))
        _, tried = self._tree.query(points * self._scale, k=count)
        tried = tried.reshape(len(points), count)
        cell = tried[:, 0].astype(np.int64)
        best, outside = np.full((len(points), 3), 0.5), np.full(len(points), np.inf)
        for k in range(count):
            left = np.flatnonzero(outside > 1e-9)
            if not left.size:
                break
            where = self._invert(tried[left, k], points[left])
            excess = np.maximum(np.abs(where - 0.5) - 0.5, 0.0).max(axis=1)
            better = excess < outside[left]
            chosen = left[better]
            cell[chosen], best[chosen], outside[chosen] = tried[chosen, k], where[better], excess[better]
        return cell, best, outside

    def _invert(self, cells: Index, points: Array) -> Array:
        """Return reference positions at which the parameters are the points', one cell each, by Newton's method."""
        nodes = self.parameters[cells]
        where = np.full((len(points), 3), 0.5)
        for _ in range(_NEWTON_STEPS):
            values = lagrange(self.order, self.reference, where)
            slopes = gradients("hexahedron", self.order, self.reference, where)
            gap = points - np.einsum("mn,mna->ma", values, nodes)
            change = np.linalg.solve(np.einsum("mnb,mna->mab", slopes, nodes), gap[:, :, None])[:, :, 0]
            # Far outside it is not this cell.
            where = np.clip(where + change, -1.0, 2.0)
            if np.abs(change).max() < 1e-13:
                break
        return where
