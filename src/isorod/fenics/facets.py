"""Facets of cells as polynomial surfaces, and closest points on them for many points at once."""

import numpy as np

from isorod.arrays import Array, Index
from isorod.fenics.cells import SLACK, Cells

# Intervals of the grid of initial guesses, iterations of Newton's method, and halvings of a step.
_GRID, _STEPS, _HALVINGS = 4, 30, 8

# Step in the reference facet below which the iteration has converged.
_CLOSE = 1e-12


class Facets:
    """Facets of cells: ``x = sum_m c_m s^i t^j``, with points ``(s, t)`` of the reference triangle or square.

    Parameters
    ----------
    cells
        The cells.
    cell, face
        The cell of each facet, and its number among the facets of the cell.

    Attributes
    ----------
    samples
        Points of each facet, with those of its boundary, shape ``(facets, m, 3)``.
    """

    def __init__(self, cells: Cells, cell: Index, face: Index) -> None:
        self._simplex, self._flat = cells.simplex, cells.affine
        degree = cells.geometry.degree
        nodes = _grid(self._simplex, degree)
        self._powers: Index = np.rint(degree * nodes).astype(np.int64)
        X = cells.on_faces(np.repeat(face, len(nodes)), np.tile(nodes, (len(face), 1)))
        x = cells.at(np.repeat(cell, len(nodes)), X)[0].reshape(len(face), len(nodes), 3)
        self._coefficients: Array = np.linalg.inv(self._functions(nodes, 0)[0]) @ x
        self._grid = _grid(self._simplex, 1 if self._flat else max(_GRID, degree))
        self.samples: Array = self._functions(self._grid, 0)[0] @ self._coefficients

    def nearest(self, facets: Index, points: Array) -> tuple[Array, Array]:
        """Return the closest points ``(k, 2)`` of facets, one for each point ``(k, 3)``, and distances ``(k,)``."""
        start = np.square(self.samples[facets] - points[:, None]).sum(axis=2).argmin(axis=1)
        s, active = self._grid[start], np.arange(len(points))
        for _ in range(_STEPS):
            coefficients = self._coefficients[facets[active]]
            r, slopes, curves = self._offsets(coefficients, points[active], s[active])
            g = (slopes @ r[..., None])[..., 0]
            metric = hessian = slopes @ np.swapaxes(slopes, 1, 2)
            if not self._flat:
                # Far from a curved facet the square of the distance need not be convex.
                curvature = (curves @ r[..., None])[..., 0]
                hessian = metric + curvature[:, [[0, 1], [1, 2]]]
                convex = (_det(hessian) > 1e-3 * _det(metric)) & (np.trace(hessian, axis1=1, axis2=2) > 0.0)
                hessian = np.where(convex[:, None, None], hessian, metric)
            step = _constrained(hessian, g, s[active], self._simplex)
            if not self._flat:
                self._halve(step, coefficients, points[active], s[active], np.square(r).sum(axis=1))
            s[active] += step
            active = active[np.abs(step).max(axis=1) > _CLOSE]
            if self._flat or not len(active):
                break
        x = (self._functions(s, 0)[0][:, None] @ self._coefficients[facets])[:, 0]
        return s, np.linalg.norm(x - points, axis=1)

    def _halve(self, step: Array, coefficients: Array, points: Array, s: Array, before: Array) -> None:
        """Halve, in place, steps that increase the distance."""
        longer = np.arange(len(step))
        for _ in range(_HALVINGS):
            x = (self._functions(s[longer] + step[longer], 0)[0][:, None] @ coefficients[longer])[:, 0]
            longer = longer[np.square(x - points[longer]).sum(axis=1) > before[longer] * (1.0 + 1e-14)]
            if not len(longer):
                return
            step[longer] *= 0.5

    def _offsets(self, coefficients: Array, points: Array, s: Array) -> tuple[Array, Array, Array]:
        """Return vectors from points ``(k, 3)`` to places, and derivatives ``(k, 2, 3)`` and ``(k, 3, 3)``."""
        tables = np.moveaxis(self._functions(s, 1 if self._flat else 2), 0, 1) @ coefficients
        return tables[:, 0] - points, tables[:, 1:3], tables[:, 3:]

    def _functions(self, s: Array, derivatives: int) -> Array:
        """Return the monomials, and their derivatives by s, t, ss, st, tt, shape ``(1, 3 or 6; k, m)``."""
        parts = []
        for by in [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)][: (1, 3, 6)[derivatives]]:
            factor, powers = np.ones(len(self._powers)), self._powers.copy()
            for a in range(2):
                for _ in range(by[a]):
                    factor, powers[:, a] = factor * powers[:, a], np.maximum(powers[:, a] - 1, 0)
            parts.append(factor * s[:, :1] ** powers[:, 0] * s[:, 1:] ** powers[:, 1])
        return np.stack(parts)


def _grid(simplex: bool, per_side: int) -> Array:
    """Return a grid of points of the reference facet, including its corners, ``(m, 2)``."""
    ticks = np.linspace(0.0, 1.0, per_side + 1)
    s = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    return s[s.sum(axis=1) <= 1.0 + SLACK] if simplex else s


def _det(matrices: Array) -> Array:
    return np.asarray(matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0])


def _constrained(hessian: Array, g: Array, s: Array, simplex: bool) -> Array:
    """Return the steps ``(k, 2)`` to the minima of convex quadratics over the reference facet."""
    a, b, c = hessian[:, 0, 0], hessian[:, 0, 1], hessian[:, 1, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.stack([b * g[:, 1] - c * g[:, 0], b * g[:, 0] - a * g[:, 1]], axis=1) / (a * c - b * b)[:, None]
    target = s + step
    out = ~((target >= 0.0).all(axis=1) & ((target.sum(axis=1) if simplex else target.max(axis=1)) <= 1.0))
    if not out.any():
        return step
    hessian, g, s = hessian[out], g[out], s[out]
    best, best_step = np.full(len(s), np.inf), np.zeros((len(s), 2))
    ring = np.array([[0, 0], [1, 0], [0, 1]] if simplex else [[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    for begin, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        along, first = end - begin, begin - s
        product = hessian @ along
        slope = g @ along + (first * product).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            fraction = np.nan_to_num(np.clip(-slope / (product @ along), 0.0, 1.0))
        on_edge = first + fraction[:, None] * along
        value = (on_edge * (g + 0.5 * (hessian @ on_edge[..., None])[..., 0])).sum(axis=1)
        better = value < best
        best[better], best_step[better] = value[better], on_edge[better]
    step[out] = best_step
    return step
