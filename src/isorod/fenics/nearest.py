"""The nearest points of cells, and of facets of theirs, to many points at once."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.fenics.cells import SLACK, Cells
from isorod.fenics.spheres import Spheres

# Points that are looked for at a time.
_AT_ONCE = 20_000

# Share by which a curved cell may reach beyond the sphere about its nodes.
_CURVED = 1.25

# Steps of Newton's method on a curved facet, and of each step's halving.
_STEPS, _HALVINGS = 30, 8


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
    carrier, face
        The cell of each facet, and which of its facets it is.
    """

    def __init__(self, cells: Cells, some: Index, carrier: Index, face: Index) -> None:
        self._cells, self._some, self._carrier, self._face = cells, some, carrier, face
        margin = 1.0 if cells.geometry.degree == 1 else _CURVED
        self._around = Spheres(cells.x[some], margin) if len(some) else None
        self._samples = _samples(cells.simplex, 1 if cells.affine else 4)
        if len(carrier):
            count = len(self._samples)
            X = cells.on_faces(np.repeat(face, count), np.tile(self._samples, (len(face), 1)))
            self._places = cells.at(np.repeat(carrier, count), X, 0)[0].reshape(len(face), count, 3)
            self._facets = Spheres(self._places, margin)

    def __call__(self, points: Array) -> Place:
        """Return the nearest place of each point ``(q, 3)``."""
        parts = [self._some_of(points[k : k + _AT_ONCE]) for k in range(0, len(points), _AT_ONCE)]
        if not parts:
            return _nowhere(0)
        return Place(*(np.concatenate(part) for part in zip(*parts, strict=True)))

    def _some_of(self, points: Array) -> Place:
        place = _nowhere(len(points))
        if self._around is not None:
            self._look_within(points, place)
        if len(self._carrier):
            left = np.flatnonzero(place.cell < 0)
            self._project(points, left, place)
        return place

    def _look_within(self, points: Array, place: Place) -> None:
        assert self._around is not None
        of, things = self._around.pairs(points, np.zeros(len(points)))
        box = self._cells.x[self._some]
        low, high = box.min(axis=1), box.max(axis=1)
        slack = (SLACK if self._cells.geometry.degree == 1 else _CURVED - 1.0) * (high - low).max(axis=1, keepdims=True)
        low, high = low - slack, high + slack
        near = ((points[of] >= low[things]) & (points[of] <= high[things])).all(axis=1)
        of, cell = of[near], self._some[things[near]]
        X = self._cells.pulled_back(cell, points[of])
        outside = self._cells.outside(X)
        within = outside <= SLACK
        of, cell, X, outside = of[within], cell[within], X[within], outside[within]
        best = _first_of(of, outside)
        place.cell[of[best]], place.X[of[best]], place.distance[of[best]] = cell[best], X[best], 0.0

    def _project(self, points: Array, left: Index, place: Place) -> None:
        """Set the places of the points that are ``left``."""
        points = points[left]
        _, bound = self._on_facets(self._facets.first(points), points)
        of, things = self._facets.pairs(points, bound * (1.0 + SLACK))
        s, distance = self._on_facets(things, points[of])
        best = _first_of(of, distance)
        things = things[best]
        place.cell[left], place.distance[left] = self._carrier[things], distance[best]
        place.X[left] = self._cells.on_faces(self._face[things], s[best])

    def _on_facets(self, things: Index, points: Array) -> tuple[Array, Array]:
        """Return the points ``(k, 2)`` of reference facets nearest to points, of a facet each, and the distances."""
        cells, carrier, face = self._cells, self._carrier[things], self._face[things]
        corner = cells.corners[cells.faces[face]]
        axes = np.swapaxes(corner[:, 1:3] - corner[:, :1], 1, 2)

        def away(own: Index, s: Array) -> tuple[Array, Array, Array]:
            x, J, second = cells.at(carrier[own], cells.on_faces(face[own], s), 2)
            slopes = J @ axes[own]
            curves = np.einsum("kadc,kdi,kcj->kaij", second, axes[own], axes[own])
            return x - points[own], slopes, curves

        start = np.linalg.norm(self._places[things] - points[:, None], axis=2).argmin(axis=1)
        s = self._samples[start].copy()
        distance = np.empty(len(s))
        active = np.arange(len(s))
        for _ in range(1 if cells.affine else _STEPS):
            r, slopes, curves = away(active, s[active])
            g = np.einsum("kai,ka->ki", slopes, r)
            metric = np.einsum("kai,kaj->kij", slopes, slopes)
            hessian = metric + np.einsum("kaij,ka->kij", curves, r)
            # Far from a curved facet the square of the distance need not be convex.
            good = (np.linalg.det(hessian) > 1e-3 * np.linalg.det(metric)) & (np.trace(hessian, axis1=1, axis2=2) > 0.0)
            step = _constrained(np.where(good[:, None, None], hessian, metric), g, s[active], cells.simplex)
            if not cells.affine:
                before = np.einsum("ka,ka->k", r, r)
                for _ in range(_HALVINGS):
                    after = np.square(away(active, s[active] + step)[0]).sum(axis=1)
                    worse = after > before * (1.0 + 1e-14)
                    if not worse.any():
                        break
                    step[worse] *= 0.5
            s[active] += step
            active = active[np.abs(step).max(axis=1) > 1e-12]
            if not len(active):
                break
        distance = np.linalg.norm(cells.at(carrier, cells.on_faces(face, s), 0)[0] - points, axis=1)
        return s, distance


def _nowhere(count: int) -> Place:
    return Place(np.full(count, -1, dtype=np.int64), np.zeros((count, 3)), np.full(count, np.inf))


def _first_of(of: Index, key: Array) -> Index:
    """Return of each number in ``of`` where it stands with the least key, in the order of numbers."""
    order = np.lexsort((key, of))
    first = np.ones(len(of), dtype=bool)
    first[1:] = np.diff(of[order]) > 0
    return np.asarray(order[first], dtype=np.int64)


def _samples(simplex: bool, per_side: int) -> Array:
    """Return a grid of points of the reference facet, its corners among them, ``(m, 2)``."""
    ticks = np.linspace(0.0, 1.0, per_side + 1)
    s = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
    return s[s.sum(axis=1) <= 1.0 + SLACK] if simplex else s


def _constrained(hessian: Array, g: Array, s: Array, simplex: bool) -> Array:
    """Return the steps ``(k, 2)`` to the minima of convex quadratics over the reference facet."""
    (a, b), (_, c) = np.moveaxis(hessian, 0, -1)
    det = a * c - b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.stack([b * g[:, 1] - c * g[:, 0], b * g[:, 0] - a * g[:, 1]], axis=1) / det[:, None]
    to = s + step
    out = ~((to >= 0.0).all(axis=1) & ((to.sum(axis=1) if simplex else to.max(axis=1)) <= 1.0))
    if not out.any():
        return step
    best = np.full(out.sum(), np.inf)
    hessian, g, s, found = hessian[out], g[out], s[out], np.zeros((out.sum(), 2))
    ring = np.array([[0, 0], [1, 0], [0, 1]] if simplex else [[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    for begin, end in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        along, first = end - begin, begin - s
        slope = g @ along + np.einsum("ki,kij,j->k", first, hessian, along)
        share = np.clip(-slope / np.einsum("i,kij,j->k", along, hessian, along), 0.0, 1.0)
        on_edge = first + share[:, None] * along
        value = np.einsum("ki,ki->k", g, on_edge) + 0.5 * np.einsum("ki,kij,kj->k", on_edge, hessian, on_edge)
        better = value < best
        best[better], found[better] = value[better], on_edge[better]
    step[out] = found
    return step
