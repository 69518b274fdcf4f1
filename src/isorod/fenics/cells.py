"""The maps of the cells of a dolfinx mesh from the reference cell, and shape functions, at many points at once."""

from functools import cached_property
from typing import Any

import basix
import numpy as np

from isorod.arrays import Array, Index
from isorod.fenics import compat
from isorod.tensors import inverse

# Least distance outside the reference cell up to which points count as inside.
SLACK = 1e-9

# Where the Jacobian of a cell's map, over the cube of its size, is below this, gradients are taken a hundredth nearer
# to its centre: two edges of a cell of a round cross-section may be tangent to each other at the corner.
_FLAT, _INWARD = 1e-6, 0.01

# Tolerance of equal positions, relative to a cell's size.
_SAME = 1e-8

# Iterations of Newton's method.
_STEPS = 25


class Cells:
    """The cells owned by a rank.

    Parameters
    ----------
    space
        The dolfinx space.

    Attributes
    ----------
    x
        Nodes of the geometry, shape ``(cells, n, 3)``.
    nodes
        Global numbers of the nodes of displacement, shape ``(cells, m)``.
    corners
        Vertices of the reference cell, shape ``(v, 3)``.
    faces
        Vertices of each of its facets, shape ``(facets, 3 or 4)``.
    affine
        Whether all maps are affine.
    slack
        Distance outside the reference cell up to which points count as inside: round-off, larger far from the origin.
    """

    def __init__(self, space: Any) -> None:
        mesh = space.mesh
        count = mesh.topology.index_map(3).size_local
        self.element, self.geometry = space.element.basix_element, compat.geometry_element(mesh)
        self.x: Array = mesh.geometry.x[compat.geometry_dofs(mesh, count)]
        local = compat.cell_dofs(space, count)
        numbers = space.dofmap.index_map.local_to_global(local.ravel().astype(np.int32))
        self.nodes: Index = np.asarray(numbers, dtype=np.int64).reshape(local.shape)
        kind = self.element.cell_type
        self.corners: Array = np.asarray(basix.geometry(kind), dtype=float)
        self.faces: Index = np.array(basix.topology(kind)[2], dtype=np.int64)
        self.simplex = len(self.corners) == 4
        self.affine = self.simplex and self.geometry.degree == 1
        sizes = np.ptp(self.x, axis=1).max(axis=1, initial=0.0)
        far = np.abs(self.x).max(initial=0.0) / sizes.min(initial=np.inf, where=sizes > 0.0)
        self.slack = max(SLACK, 64.0 * float(np.finfo(float).eps * far))

    @property
    def middle(self) -> Array:
        """The centre of the reference cell, shape ``(3,)``."""
        return np.asarray(self.corners.mean(axis=0))

    @property
    def rotates(self) -> bool:
        """Whether the space contains the positions on all cells of this rank, as rigid rotations require."""
        if self.element.degree >= self.geometry.degree:
            return True
        nodal = tabulated(self.geometry, 0, self.element.points)[0] @ self.x
        off = tabulated(self.element, 0, self.geometry.points)[0] @ nodal - self.x
        return bool((np.abs(off) <= _SAME * np.ptp(self.x, axis=1, keepdims=True).max(axis=2, keepdims=True)).all())

    def on_faces(self, face: Index, s: Array) -> Array:
        """Return the reference points ``(k, 3)`` of points ``s`` ``(k, 2)`` of reference facets, one facet each."""
        corner = self.corners[self.faces[face]]
        return np.asarray(corner[:, 0] + (s[:, None] @ (corner[:, 1:3] - corner[:, :1]))[:, 0])

    def outside(self, X: Array) -> Array:
        """Return the distances of reference points ``(k, 3)`` outside the reference cell, negative inside."""
        least = -X.min(axis=1)
        return np.asarray(np.maximum(least, (X.sum(axis=1) if self.simplex else X.max(axis=1)) - 1.0))

    def at(self, cells: Index, X: Array) -> tuple[Array, Array]:
        """Return positions ``(k, 3)`` of reference points ``(k, 3)``, and derivatives ``dx_a / dX_b`` ``(k, 3, 3)``."""
        tables = np.moveaxis(tabulated(self.geometry, 1, X), 0, 1) @ self.x[cells]
        return tables[:, 0], np.swapaxes(tables[:, 1:], 1, 2)

    def pulled_back(self, cells: Index, points: Array) -> Array:
        """Return the reference points of points ``(k, 3)``, each in a cell; NaN where there is none near the cell."""
        if self.affine:
            origin, back = self._back
            return np.asarray((back[cells] @ (points - origin[cells])[..., None])[..., 0])
        X = np.tile(self.middle, (len(cells), 1))
        active = np.arange(len(cells))
        for _ in range(_STEPS):
            x, J = self.at(cells[active], X[active])
            with np.errstate(divide="ignore", invalid="ignore"):
                step = (inverse(J)[0] @ (points[active] - x)[..., None])[..., 0]
            X[active] += np.clip(step, -0.5, 0.5)
            active = active[(np.abs(step).max(axis=1) > 0.1 * self.slack) & (self.outside(X[active]) < 2.0)]
        X[active] = np.nan
        return X

    @cached_property
    def _back(self) -> tuple[Array, Array]:
        """The origins of affine maps, shape ``(cells, 3)``, and their inverses ``(cells, 3, 3)``."""
        x, J = self.at(np.arange(len(self.x)), np.zeros((len(self.x), 3)))
        return x, inverse(J)[0]

    def extrapolated(self, cells: Index, X: Array, points: Array) -> Array:
        """Return the shape functions ``(k, m)`` at points by linear extrapolation from reference points of cells."""
        x, J = self.at(cells, X)
        flat = np.abs(np.linalg.det(J)) < _FLAT * np.linalg.norm(J, axis=(1, 2)) ** 3
        if flat.any():
            X = np.where(flat[:, None], X + _INWARD * (self.middle - X), X)
            x, J = self.at(cells, X)
        table = tabulated(self.element, 1, X)
        offset = inverse(J)[0] @ (points - x)[..., None]
        return np.asarray(table[0] + sum(table[1 + d] * offset[:, d] for d in range(3)))


def tabulated(element: Any, derivatives: int, X: Array) -> Array:
    """Return a scalar element's functions and their derivatives, in basix' order, shape ``(derivatives, k, m)``."""
    # basix of dolfinx 0.5.2 aborts without points.
    count = len(X)
    return np.asarray(element.tabulate(derivatives, X if count else np.zeros((1, 3)))[:, :count, :, 0])
