"""Where points are in the cells of a mesh: by positions of its nodes, or by parameters, functions of the cells too."""

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from meshes.mesh import Array, CellShape, Index, gradients, tetrahedral

# A point belongs to a cell if its reference position is inside but for this: the rim of a section is a polynomial; that
# of a coarse tetrahedron may be straight.
_OUTSIDE = {"hexahedron": 0.05, "tetrahedron": 0.6}
_INSIDE = 1e-9
_NEWTON_STEPS = 12
# Determinants that are less, of tangents of size 1, are zero.
_FLAT = 1e-12
_FAR = 1.0
# Cells that are tried, those with the nearest middles first.
_TRIED = 32


def lagrange(order: int, nodes: Array, where: Array) -> Array:
    """Return values ``(m, nodes)`` of Lagrange functions of ``nodes`` ``(nodes, 3)`` of a cell at ``where``."""
    if len(nodes) < (order + 1) ** 3:
        return tetrahedral(order, nodes, where)
    ticks = np.arange(order + 1.0) / order
    result = np.ones((len(where), len(nodes)))
    for a in range(3):
        for tick in ticks:
            own = np.abs(nodes[:, a] - tick) < 1e-6
            others = ticks[np.abs(ticks - tick) > 1e-6]
            factor = np.prod((where[:, a, None] - others) / (tick - others), axis=1)
            result[:, own] *= factor[:, None]
    return result


def _outside(shape: CellShape, where: Array) -> Array:
    """Return how far reference positions ``(m, 3)`` are outside of the cell, shape ``(m,)``."""
    if shape == "hexahedron":
        return np.asarray(np.maximum(np.abs(where - 0.5) - 0.5, 0.0).max(axis=1))
    return np.maximum(np.maximum(-where.min(axis=1), where.sum(axis=1) - 1.0), 0.0)


class Places:
    """Some cells, in which points are looked for.

    Parameters
    ----------
    shape, order, reference
        Of the cells, as in `meshes.mesh.Mesh`.
    parameters
        Of each cell's nodes, or their positions, shape ``(cells, nodes per cell, 3)``.
    period
        How much ``u`` grows once round a closed rod; None if it has ends.
    """

    def __init__(
        self, shape: CellShape, order: int, reference: Array, parameters: Array, period: float | None = None
    ) -> None:
        self.shape, self.order, self.reference, self.parameters, self.period = (
            shape,
            order,
            reference,
            parameters,
            period,
        )
        self._middle = reference.mean(axis=0)
        u = parameters[:, :, 2]
        # Of the size of the disk's cells, so that near cells are near in all three parameters.
        across = np.ptp(parameters[:, :, :2], axis=1).mean()
        self._scale = np.array([1.0, 1.0, across / np.ptp(u, axis=1).mean()])
        self._tree = cKDTree(parameters.mean(axis=1) * self._scale)

    def find(self, points: Array) -> tuple[Index, Array]:
        """Return cell and reference position of points, by what nodes are given by, shape ``(m, 3)``.

        Raises
        ------
        InputError
            If a point is in no cell.
        """
        cell, where, outside = self._search(points)
        lost = np.flatnonzero(outside > _INSIDE)
        if self.period is not None and lost.size:
            found = self._search(points[lost] + np.array([0.0, 0.0, self.period]))
            better = found[2] < outside[lost]
            for own, other in zip((cell, where, outside), found, strict=True):
                own[lost[better]] = other[better]
        if (outside > _OUTSIDE[self.shape]).any():
            x, y, u = points[int(np.argmax(outside))]
            said = f"xi ({x:.4g}, {y:.4g}), u {u:.4g}" if self.shape == "hexahedron" else f"({x:.4g}, {y:.4g}, {u:.4g})"
            raise InputError(f"mesh: no cell has the point {said}")
        return cell, where

    def _search(self, points: Array) -> tuple[Index, Array, Array]:
        """Return cells, reference positions, and how far outside of the cell these are."""
        count = min(_TRIED, len(self.parameters))
        _, tried = self._tree.query(points * self._scale, k=count)
        tried = tried.reshape(len(points), count)
        cell = tried[:, 0].astype(np.int64)
        best, outside = np.tile(self._middle, (len(points), 1)), np.full(len(points), np.inf)
        for k in range(count):
            left = np.flatnonzero(outside > _INSIDE)
            if not left.size:
                break
            where = self._invert(tried[left, k], points[left])
            excess = _outside(self.shape, where)
            better = excess < outside[left]
            chosen = left[better]
            cell[chosen], best[chosen], outside[chosen] = tried[chosen, k], where[better], excess[better]
        return cell, best, outside

    def _invert(self, cells: Index, points: Array) -> Array:
        """Return reference positions at which nodes' values are the points', one cell each, by Newton's method."""
        where = np.tile(self._middle, (len(points), 1))
        left = np.arange(len(points))
        for step in range(_NEWTON_STEPS):
            nodes, here = self.parameters[cells[left]], where[left]
            values = lagrange(self.order, self.reference, here)
            slopes = gradients(self.shape, self.order, self.reference, here)
            gap = points[left] - np.einsum("mn,mna->ma", values, nodes)
            tangents = np.einsum("mnb,mna->mab", slopes, nodes)
            # A curved cell may be flat outside of itself; there the point is not in it.
            flat = np.abs(np.linalg.det(tangents)) <= _FLAT * np.abs(tangents).max(axis=(1, 2)) ** 3
            where[left[flat]] = -_FAR
            left, here, gap, tangents = (one[~flat] for one in (left, here, gap, tangents))
            change = np.linalg.solve(tangents, gap[:, :, None])[:, :, 0]
            where[left] = np.clip(here + change, -_FAR, 1.0 + _FAR)
            going = (np.abs(change) > 1e-13).any(axis=1)
            if step > 1:
                # Far outside it is not this cell.
                going &= (np.abs(where[left] - 0.5) < 0.5 + _FAR).all(axis=1)
            left = left[going]
            if not left.size:
                break
        return where
