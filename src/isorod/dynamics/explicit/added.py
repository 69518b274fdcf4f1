"""Stiffness-proportional mass scaling of explicit steps (`isorod.dynamics.explicit.mass`)."""

from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from isorod.arrays import Array, Index
from isorod.assembly import element_kernel
from isorod.assembly.gradients import deformation_gradients
from isorod.assembly.partition import ElementRange
from isorod.assembly.pattern import Layers, Pattern, add
from isorod.assembly.region import regions
from isorod.material.law import Material
from isorod.material.places import alone
from isorod.space.space import Table
from isorod.tensors import inverse


class Elements:
    """The elements of one body on a rank: matrices of all its nodes, and measures of their deformation.

    Parameters
    ----------
    elements
        The range of elements.
    """

    def __init__(self, elements: ElementRange) -> None:
        self._elements, self._space = elements, elements.body.space

    @cached_property
    def _table(self) -> Table:
        return self._space.tabulate(self._elements.first, self._elements.last)

    @cached_property
    def _moduli(self) -> Array:
        """P-wave moduli times volumes at the points, ``(E, t, q)``."""
        body = self._elements.body
        return body.at_points(self._table, [law.modulus for law in body.laws]) * self._table.weights

    @cached_property
    def _masses(self) -> Array:
        """Masses of the points, ``(E, t, q)``."""
        return self._elements.body.densities_at(self._table) * self._table.weights

    def consistent(self) -> csr_matrix:
        """Return the mass of one component, shape ``(nodes, nodes)``."""
        return self._sum(element_kernel.mass(self._table.section, self._table.axial, self._masses))

    def gradients(self) -> csr_matrix:
        """Return ``G``, of one component, shape ``(nodes, nodes)``."""
        table, matrices = self._table, []
        for e in range(table.elements):
            plane = np.einsum("tj,qdi->tqdji", table.axial[e], table.section[:, :2])
            axis = np.einsum("tj,qi->tqji", table.slopes[e], table.section[:, 2])[:, :, None]
            gradient = np.swapaxes(table.inverse[e], -1, -2) @ np.concatenate([plane, axis], axis=2).reshape(
                *table.weights.shape[1:], 3, -1
            )
            weighted = self._moduli[e, :, :, None, None] * gradient
            functions = gradient.shape[-1]
            matrices.append(gradient.reshape(-1, functions).T @ weighted.reshape(-1, functions))
        return self._sum(np.stack(matrices))

    def _sum(self, matrices: Array) -> csr_matrix:
        """Return the sum of element matrices of one component."""
        pattern = self._pattern(self._space.layer_nodes)
        size, entries = self._table.axial.shape[2] * self._space.layer_nodes, np.zeros(pattern.total)
        add(matrices.reshape(-1, size, size), pattern.blocks[0], entries)
        return csr_matrix((entries, *_compressed(pattern, self._space.nodes)), (self._space.nodes, self._space.nodes))

    def tangent(self, displacement: Array) -> csr_matrix:
        """Return ``K`` at nodal displacements ``(nodes, 3)``, of all components, shape ``(3 nodes, 3 nodes)``.

        It is that of the laws at rest in the deformed shape: gradients are by the deformed positions.
        """
        table, pattern, elements = self._table, self._all_components, self._elements
        nodal = self._nodal(displacement).reshape(*elements.layers.shape, -1, 3)
        F = deformation_gradients(table, nodal)
        moved = table._replace(inverse=np.ascontiguousarray(table.inverse @ inverse(F)[0]))
        entries, still = np.zeros(pattern.total), np.zeros(3 * self._space.nodes)
        for region in regions(moved, elements.body.laws_at(table.u, table.xi)):
            region.add_stiffness(still, elements.width * elements.layers, 0.0, pattern.blocks[0], entries)
        columns, starts = self._rows
        return csr_matrix((entries, columns, starts), (3 * self._space.nodes, 3 * self._space.nodes))

    @cached_property
    def _all_components(self) -> Pattern:
        return self._pattern(self._elements.width)

    @cached_property
    def _rows(self) -> tuple[Index, Index]:
        """Columns of the tangent's entries, row by row, and the start of each row."""
        return _compressed(self._all_components, 3 * self._space.nodes)

    def _pattern(self, size: int) -> Pattern:
        """Return the pattern of the elements' layers, ``size`` rows each."""
        return Pattern([Layers(size * self._elements.layers, size)], np.arange(size * self._space.layers))

    def _nodal(self, displacement: Array) -> Array:
        nodes = self._space.element_nodes[self._elements.first : self._elements.last]
        return np.ascontiguousarray(displacement[nodes])

    @cached_property
    def _means(self) -> Array:
        """Means over elements of the functions' gradients, ``(E, 3, l n)``."""
        t = self._table
        inverse = (t.weights / t.weights.sum(axis=(1, 2), keepdims=True))[..., None, None] * t.inverse
        plane = np.einsum("etqda,etj,qdi->eaji", inverse[:, :, :, :2], t.axial, t.section[:, :2], optimize=True)
        axis = np.einsum("etqa,etj,qi->eaji", inverse[:, :, :, 2], t.slopes, t.section[:, 2], optimize=True)
        return np.asarray((plane + axis).reshape(t.elements, 3, -1))

    def change(self, displacement: Array) -> float:
        """Return the largest component of elements' mean gradients of nodal displacements ``(nodes, 3)``."""
        return float(np.abs(self._means @ self._nodal(displacement)).max(initial=0.0))

    def slowest(self, shears: bool) -> float:
        """Return the ``s`` that doubles the inertia of a rotating section or, with ``shears``, of one in shear.

        It is the smallest mean of ``rho r^2`` over the P-wave modulus, or the shear modulus, of all elements.
        """
        table, body = self._table, self._elements.body
        moduli = self._moduli
        if shears:
            shear_moduli = {law: _shear(law) for law in dict.fromkeys(body.laws)}
            moduli = body.at_points(table, [shear_moduli[law] for law in body.laws]) * table.weights
        inertia = _inertia(self._nodal(self._space.positions), table, self._masses)
        return float((inertia / moduli.sum(axis=2)).min(initial=np.inf))


def _compressed(pattern: Pattern, size: int) -> tuple[Index, Index]:
    """Return the columns of a pattern's entries, and the start of each of ``size`` rows."""
    rows, columns = pattern.indices()
    starts = np.append(0, np.cumsum(np.bincount(rows, minlength=size)))
    # SciPy's preferred type of indices.
    return columns.astype(np.int32), starts.astype(np.int32)


def _shear(law: Material) -> float:
    """Return the largest shear modulus of a law at rest, of three planes."""
    moduli = law.at(0.0).placed(alone()).tangent(np.eye(3)[None])[0]
    return max(float(moduli[a, b, a, b]) for a, b in ((0, 1), (0, 2), (1, 2)))


def _inertia(positions: Array, table: Table, masses: Array) -> Array:
    """Return the smaller principal moment of inertia in the section, of masses ``(E, t, q)``, shape ``(E, t)``."""
    nodal = positions.reshape(table.elements, table.axial.shape[2], -1, 3)
    x = np.einsum("qi,etj,ejia->etqa", table.section[:, 2], table.axial, nodal, optimize=True)
    x -= np.einsum("etq,etqa->eta", masses / masses.sum(axis=2, keepdims=True), x)[:, :, None]
    spread = np.einsum("etq,etqa,etqb->etab", masses, x, x, optimize=True)
    # Of a plane section the smallest eigenvalue, along the normal, is zero.
    return np.asarray(np.linalg.eigvalsh(spread)[:, :, 1])
