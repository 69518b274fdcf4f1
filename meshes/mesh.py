"""A mesh that favours no program: nodes, cells, faces, and where each node of a cell sits in the reference cell."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from isorod.errors import InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
CellShape = Literal["hexahedron", "tetrahedron"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh of Lagrange cells of one shape and order.

    Attributes
    ----------
    shape
        ``"hexahedron"`` or ``"tetrahedron"``.
    order
        Polynomial order of the cells' geometry.
    points
        Node positions, shape ``(nodes, 3)``, units of length.
    cells
        Node numbers, shape ``(cells, nodes per cell)``, ordered as ``reference``.
    reference
        Positions of a cell's nodes in the reference cell, shape ``(nodes per cell, 3)``: the unit cube, or the unit
        simplex.
    faces
        Boundary faces by name, node numbers of shape ``(faces, nodes per face)``, ordered as ``face_reference``,
        outward normal.
    face_reference
        Positions of a face's nodes in the unit square or triangle, shape ``(nodes per face, 2)``.
    parameters
        The Rod's parameters ``xi_1, xi_2, u`` of each node, shape ``(nodes, 3)``; None if no Rod made the mesh.
    regions
        Cell numbers by name, where parts of the volume differ (in material, say); empty if they do not.
    """

    shape: CellShape
    order: int
    points: Array
    cells: Index
    reference: Array
    faces: Mapping[str, Index]
    face_reference: Array
    parameters: Array | None = None
    regions: Mapping[str, Index] = field(default_factory=dict)

    def parameters_in(self, rod: int, nodes: Index) -> Array:
        """Return the parameters ``(..., 3)`` of nodes ``(...)`` of a rod."""
        assert self.parameters is not None
        return self.parameters[nodes]

    def jacobians(self, where: Array) -> Array:
        """Return the Jacobian determinants ``(cells, m)`` at the reference points ``where`` ``(m, 3)``."""
        return np.linalg.det(self._tangents(where))

    def _tangents(self, where: Array) -> Array:
        """Return the cells' Jacobian matrices ``(cells, m, 3, 3)``."""
        slopes = gradients(self.shape, self.order, self.reference, where)
        return np.einsum("qnb,cna->cqab", slopes, self.points[self.cells], optimize=True)

    def quality(self) -> Array:
        """Return each cell's smallest scaled Jacobian at quadrature points, shape ``(cells,)``.

        That is the Jacobian determinant over the product of its columns' lengths: 1 where lines of a hexahedron cross
        at right angles.
        """
        tangents = self._tangents(gauss(self.shape, 2 * self.order + 1)[0])
        scaled: Array = np.linalg.det(tangents) / np.linalg.norm(tangents, axis=-2).prod(axis=-1)
        return scaled.min(axis=1)

    def volume(self) -> float:
        """Return the volume of the cells (length cubed); the rule is exact for the polynomial cells."""
        return float(self._cell_volumes().sum())

    def node_volumes(self) -> Array:
        """Return each node's part of the volume, shape ``(nodes,)``.

        A cell's is divided equally among its nodes.
        """
        volumes = np.repeat(self._cell_volumes() / self.cells.shape[1], self.cells.shape[1])
        return np.asarray(np.bincount(self.cells.ravel(), volumes, len(self.points)), dtype=float)

    def _cell_volumes(self) -> Array:
        where, weights = gauss(self.shape, 3 * self.order)
        return self.jacobians(where) @ weights

    def check(self) -> float:
        """Return the smallest Jacobian determinant met at quadrature points and cell vertices.

        Raises
        ------
        InputError
            If it is not positive: the message names the cell and its position.
        """
        inner, _ = gauss(self.shape, 2 * self.order + 1)
        corners = self.reference[np.isin(self.reference, (0.0, 1.0)).all(axis=1)]
        det = self.jacobians(np.concatenate([inner, corners]))
        # A corner where two edges are tangent has determinant zero, which does not matter: it is no quadrature point.
        slack = 1e-9 * np.abs(det).max()
        bad = (det[:, : len(inner)] <= 0.0).any(axis=1) | (det < -slack).any(axis=1)
        if bad.any():
            cell = int(np.argmax(bad))
            where = ", ".join(f"{value:.4g}" for value in self.points[self.cells[cell]].mean(axis=0))
            raise InputError(
                f"mesh: cell {cell} at ({where}) is inverted (Jacobian determinant {det[cell].min():.3g}); use more "
                "cells"
            )
        return float(det.min())


def join(*parts: Mesh) -> Mesh:
    """Return meshes of the same kind of cell as one: nodes and cells of each behind those of the ones before."""
    first = parts[0]
    assert all((part.shape, part.order) == (first.shape, first.order) for part in parts)
    nodes = np.cumsum([0, *(len(part.points) for part in parts)])
    cells = np.cumsum([0, *(len(part.cells) for part in parts)])
    known = [part.parameters for part in parts if part.parameters is not None]
    assert len(known) in (0, len(parts))
    return Mesh(
        first.shape,
        first.order,
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.cells + at for part, at in zip(parts, nodes, strict=False)]),
        first.reference,
        {name: face + at for part, at in zip(parts, nodes, strict=False) for name, face in part.faces.items()},
        first.face_reference,
        np.concatenate(known) if known else None,
        {name: own + at for part, at in zip(parts, cells, strict=False) for name, own in part.regions.items()},
    )


def lexicographic(order: int, dimension: int) -> Array:
    """Return the nodes of the unit square or cube, first coordinate fastest, shape ``((order + 1)^d, d)``."""
    ticks = np.arange(order + 1.0) / order
    grids = np.meshgrid(*[ticks] * dimension, indexing="ij")
    return np.stack([grid.ravel() for grid in reversed(grids)], axis=1)


def match(given: Array, target: Array) -> Index:
    """Return ``p`` with ``given[p] == target`` up to rounding: the same reference nodes in another program's order."""
    distance = np.linalg.norm(target[:, None, :] - given[None, :, :], axis=2)
    order = distance.argmin(axis=1)
    if given.shape != target.shape or distance[np.arange(len(order)), order].max() > 1e-6:
        raise ValueError("the two sets of reference nodes differ")
    return order.astype(np.int64)


def _exponents(shape: CellShape, order: int) -> Index:
    powers = np.stack(np.meshgrid(*[np.arange(order + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return powers if shape == "hexahedron" else powers[powers.sum(axis=1) <= order]


def gradients(shape: CellShape, order: int, nodes: Array, where: Array) -> Array:
    """Return gradients ``(m, nodes, 3)`` of the Lagrange functions of ``nodes`` at ``where``."""
    powers = _exponents(shape, order)
    # Centred coordinates keep the monomials' Vandermonde matrix well conditioned at the orders in use (1 to 4).
    nodes, where = 2.0 * nodes - 1.0, 2.0 * where - 1.0
    inverse = np.linalg.inv(np.prod(nodes[:, None, :] ** powers, axis=2))
    # Each coordinate's own powers once: those of every monomial took most of the time of searching points.
    own = where[:, :, None] ** np.arange(order + 1)
    slopes = np.empty((len(where), 3, len(powers)))
    for a in range(3):
        lowered = np.maximum(powers - np.eye(3, dtype=np.int64)[a], 0)
        slopes[:, a] = 2.0 * powers[:, a] * np.prod([own[:, b, lowered[:, b]] for b in range(3)], axis=0)
    return np.asarray((slopes @ inverse).swapaxes(1, 2))


def tetrahedral(order: int, nodes: Array, where: Array) -> Array:
    """Return values ``(m, nodes)`` of a tetrahedron's Lagrange functions of ``nodes`` ``(nodes, 3)`` at ``where``."""
    powers = _exponents("tetrahedron", order)
    nodes, where = 2.0 * nodes - 1.0, 2.0 * where - 1.0
    inverse = np.linalg.inv(np.prod(nodes[:, None, :] ** powers, axis=2))
    return np.asarray(np.prod(where[:, None, :] ** powers, axis=2) @ inverse)


def gauss(shape: CellShape, degree: int) -> tuple[Array, Array]:
    """Return points ``(m, 3)`` and weights ``(m,)`` of the Gauss rule of a degree on a reference cell.

    On the unit cube first coordinates vary slowest; onto the unit simplex the rule is collapsed.
    """
    count = degree // 2 + (1 if shape == "hexahedron" else 2)
    x, w = np.polynomial.legendre.leggauss(count)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    a, b, c = (grid.ravel() for grid in np.meshgrid(x, x, x, indexing="ij"))
    weights = np.einsum("i,j,k->ijk", w, w, w).ravel()
    if shape == "hexahedron":
        return np.stack([a, b, c], axis=1), weights
    points = np.stack([a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b)], axis=1)
    return points, weights * (1.0 - a) ** 2 * (1.0 - b)
