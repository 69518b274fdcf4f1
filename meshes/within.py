"""Where points are in the cells of a mesh: by positions of its nodes, or by the parameters of a rod."""

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.mesh import Array, CellShape, Index, gradients, tetrahedral

# A point belongs to a cell if its reference position is inside but for this: the rim of a section is a polynomial; that
# of a coarse tetrahedron may be straight.
_OUTSIDE = {"hexahedron": 0.05, "tetrahedron": 0.6}
# How far the rim of a section may be from the cells', as a fraction of half of its height.
_OFF = 0.2
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
    nodes
        Positions of each cell's nodes, shape ``(cells, nodes per cell, 3)``.
    """

    def __init__(self, shape: CellShape, order: int, reference: Array, nodes: Array) -> None:
        self.shape, self.order, self.reference, self.nodes = shape, order, reference, nodes
        self._middle = reference.mean(axis=0)
        self._tree = cKDTree(nodes.mean(axis=1))

    def find(self, points: Array) -> tuple[Index, Array]:
        """Return cell and reference position of points, shape ``(m, 3)``.

        Raises
        ------
        InputError
            If a point is in no cell.
        """
        cell, where, outside = self.search(points)
        if (outside > _OUTSIDE[self.shape]).any():
            x, y, z = points[int(np.argmax(outside))]
            raise InputError(f"mesh: no cell has the point ({x:.4g}, {y:.4g}, {z:.4g})")
        return cell, where

    def search(self, points: Array) -> tuple[Index, Array, Array]:
        """Return cells, reference positions, and how far outside of the cell these are."""
        count = min(_TRIED, len(self.nodes))
        _, tried = self._tree.query(points, k=count)
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
            nodes, here = self.nodes[cells[left]], where[left]
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
            left, change = left[going], change[going]
            if not left.size:
                break
        # Where Newton's method goes to and fro, by more than rounding, the point is in another cell.
        where[left[(np.abs(change) > _INSIDE).any(axis=1)]] = -_FAR
        return where


class Layers:
    """Bricks of a rod, the same quadrilaterals in layer after layer, in which points are looked for by its parameters.

    The place of a point in its section is searched in space: between nodes a cell is nearer to the rod there than by
    parameters, which are uneven round flat outlines.

    Parameters
    ----------
    rod
        The rod.
    order, reference
        Of the cells, as in `meshes.mesh.Mesh`.
    parameters
        ``xi_1, xi_2, u`` of each cell's nodes, layer by layer (`meshes.bricks.tensored`), shape ``(cells, nodes per
        cell, 3)``; ``u`` of a closed rod grows on beyond its end.
    """

    def __init__(self, rod: Rod, order: int, reference: Array, parameters: Array) -> None:
        self._rod = rod
        first = parameters[:, 0, 2]
        self._count = int(np.count_nonzero(first == first[0]))
        self._ends = np.append(first[:: self._count], parameters[-1, :, 2].max())
        # A section in the middle of a layer, where no kink can be.
        self._u = float(self._ends[self._ends.size // 2 - 1 :][:2].mean())
        nodes = parameters[: self._count]
        flat = rod.grid(nodes[..., :2].reshape(-1, 2), [self._u])[0][0]
        self._origin = flat.mean(axis=0)
        self._directions = np.linalg.svd(flat - self._origin, full_matrices=False)[2][:2]
        thick = np.ptp(flat @ self._directions[1])
        height = np.tile(thick * reference[:, 2], len(nodes))
        plane = np.column_stack([(flat - self._origin) @ self._directions.T, height]).reshape(nodes.shape)
        self._section = Places("hexahedron", order, reference, plane)
        self._half = 0.5 * thick

    def find(self, points: Array) -> tuple[Index, Array]:
        """Return cell and reference position of points ``xi_1, xi_2, u``, shape ``(m, 3)``.

        Raises
        ------
        InputError
            If a point is in no cell.
        """
        xi, which = np.unique(points[:, :2], axis=0, return_inverse=True)
        flat = (self._rod.grid(xi, [self._u])[0][0] - self._origin) @ self._directions.T
        there = np.column_stack([flat, np.full(len(flat), self._half)])
        quad, where, _ = self._section.search(there)
        # Corners of a grid in a smooth outline are flat, and just outside of them is far in the cell's own terms.
        where = np.clip(where, 0.0, 1.0)
        functions = lagrange(self._section.order, self._section.reference, where)
        gap = np.linalg.norm(np.einsum("mn,mna->ma", functions, self._section.nodes[quad]) - there, axis=1)
        if gap.max() > _OFF * self._half:
            x, y = xi[int(np.argmax(gap))]
            raise InputError(f"mesh: no cell has the point xi ({x:.4g}, {y:.4g})")
        low, high = self._ends[[0, -1]]
        u = points[:, 2]
        if self._rod.closed:
            u = low + np.mod(u - low, high - low)
        layer = np.clip(np.searchsorted(self._ends, u, side="right") - 1, 0, self._ends.size - 2)
        which = which.ravel()
        found = where[which]
        found[:, 2] = (u - self._ends[layer]) / (self._ends[layer + 1] - self._ends[layer])
        return quad[which] + self._count * layer, found
