"""The elements of one body that a rank assembles: their forces, tangents and masses."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from isorod.arrays import Array, Index
from isorod.assembly import element_kernel
from isorod.assembly.exchange import Exchange
from isorod.assembly.extrapolation import Extrapolation
from isorod.assembly.pattern import Entries, Numbered, Pattern
from isorod.assembly.pattern_kernel import Blocks
from isorod.assembly.split import Share
from isorod.assembly.stiffness_kernel import Work, add_stiffness
from isorod.geometry.quadrature import Rule
from isorod.model.load import Spin
from isorod.space.space import Table

# Where the entries of a transposed 3 x 3 matrix are.
_TRANSPOSED = np.arange(9).reshape(3, 3).T.ravel()


class Part:
    """The elements of one body that this rank assembles.

    Parameters
    ----------
    share
        Which they are.
    free
        Unknown of each of the assembler's degrees of freedom, -1 if it is held.
    exchange
        Where their values are on this rank.
    rule
        Quadrature rule in place of the space's own.

    Attributes
    ----------
    dofs, slots
        Degrees of freedom of each element, and where this rank has their values, shape ``(E, l width)``.
    width
        Degrees of freedom of a layer.
    extrapolation
        What extrapolates the stress of the tangents, if anything does.
    """

    def __init__(self, share: Share, free: Index, exchange: Exchange, rule: Rule | None = None) -> None:
        body = share.body
        self.body, self.which = body, share.which
        self.first_node, self.first_dof = share.first_node, share.first_dof
        self.table = body.space.tabulate(share.first, share.last, rule)
        self.laws = body.laws_at(self.table.u, self.table.xi)
        self.layers = share.layers
        self.width = share.width
        self.dofs = share.dofs
        self.slots = exchange.slots(self.dofs)
        self.shape = (*self.layers.shape, body.space.layer_nodes, 3)
        self.extrapolation: Extrapolation | None = None
        # As the layers, negative where supports hold all of one.
        held = free[self.first_dof :][: body.space.layers * self.width].reshape(-1, self.width).max(axis=1) < 0
        self.free_layers = np.where(held[self.layers], -1, self.layers)

    @cached_property
    def pattern(self) -> Pattern:
        """Pattern of the degrees of freedom, those of layers left out that supports hold."""
        return Pattern(self.free_layers, self.width)

    @cached_property
    def mass(self) -> Array:
        """Element mass matrices of one component, shape ``(E, l n, l n)``."""
        t = self.table
        mass = element_kernel.mass(t.section, t.axial, self.body.densities_at(t) * t.weights)
        return mass.reshape(mass.shape[0], mass.shape[1] * mass.shape[2], -1)

    def mass_entries(self, lumped: bool, numbers: Sequence[Index]) -> list[tuple[Entries, Array]]:
        """Return where in a matrix the mass of some components is, and that mass; nodes have these numbers there."""
        if lumped:
            nodes, masses = self.dofs[:, ::3].ravel() // 3, self.lumped_mass().ravel()
            return [((number[nodes], number[nodes]), masses) for number in numbers]
        pattern = Pattern(self.free_layers, self.body.space.layer_nodes)
        masses = pattern.merge(self.mass)
        return [(Numbered(pattern, number[self.first_node :]), masses) for number in numbers]

    def lumped_mass(self) -> Array:
        """Return the element masses of one component, shape ``(E, l n)``."""
        space = self.body.space
        carriers = space.is_carrier[space.element_nodes[0]]
        diagonal = np.einsum("eii->ei", self.mass)
        return np.where(carriers, self.mass @ carriers.astype(float), diagonal)

    def centrifugal(self, local: Array, spin: Spin) -> Array:
        """Return the centrifugal forces, shape of ``dofs``."""
        space = self.body.space
        nodes = space.element_nodes[self.table.first : self.table.first + self.table.elements]
        center = space.is_carrier[nodes, None] * np.array(spin.center)
        arm = space.positions[nodes] - center + self.nodal(local).reshape(*nodes.shape, 3)
        return (self.mass @ arm @ spin.field).reshape(nodes.shape[0], -1)

    def softening(self, spin: Spin) -> Array:
        """Return the derivatives of the centrifugal forces, shape of ``matrices``."""
        size = 3 * self.mass.shape[1]
        return np.einsum("eij,ab->eiajb", self.mass, spin.field).reshape(-1, size, size)

    def nodal(self, local: Array) -> Array:
        """Return the nodal displacements, shape ``(E, l, n, 3)``, of this rank's degrees of freedom ``local``."""
        return local[self.slots].reshape(self.shape)

    def gradients(self, local: Array) -> Array:
        """Return the deformation gradients, shape ``(E, t, q, 3, 3)``."""
        return element_kernel.deformation_gradients(self.table, self.nodal(local))

    def energy(self, local: Array, factor: float) -> float:
        """Return the stored energy."""
        return float(np.sum(self.table.weights * self.laws.at(factor).energy(self.gradients(local))))

    def curvatures(self, local: Array, factor: float, motions: Iterable[Array]) -> Array:
        """Return the second derivatives of the stored energy along motions of this rank's degrees of freedom."""
        laws, weights = self.laws.at(factor), self.table.weights
        isotropic = laws.isotropic
        if isotropic is None:
            tangent = laws.tangent(self.gradients(local)).reshape(-1, 9, 9) * weights.reshape(-1, 1, 1)
        else:
            lame, mu = (isotropic.T[:, :, None, None] * weights).reshape(2, -1)
        found = []
        for motion in motions:
            slope = self.gradients(motion).reshape(-1, 9)
            slope[:, ::4] -= 1.0
            if isotropic is None:
                found.append(np.sum(slope * (tangent @ slope[:, :, None])[:, :, 0]))
                continue
            strain = slope + slope[:, _TRANSPOSED]
            found.append(lame @ slope[:, ::4].sum(axis=1) ** 2 + 0.5 * mu @ np.einsum("pi,pi->p", strain, strain))
        return np.array(found)

    def forces(self, local: Array, factor: float) -> Array:
        """Return the internal forces, shape of ``dofs``."""
        stress = self.laws.at(factor).stress(self.gradients(local))
        return element_kernel.internal_forces(self.table, stress).reshape(self.dofs.shape)

    def matrices(self, local: Array, factor: float) -> Array:
        """Return the element tangents, shape ``(E, l n 3, l n 3)``."""
        matrices = stiffness(self.table, *self._moduli(local, factor))
        return matrices.reshape(*self.dofs.shape, self.dofs.shape[1])

    def entries(self, local: Array, factor: float) -> Array:
        """Return the sum of the element tangents, much larger, as entries of the pattern."""
        return _stiffness(self.table, *self._moduli(local, factor), self.pattern.blocks)

    def _moduli(self, local: Array, factor: float) -> tuple[Array, Array]:
        """Return the moduli at points, and Lame's parameters of elements, which stand for them where there are none."""
        laws, elements = self.laws.at(factor), self.layers.shape[0]
        isotropic = laws.isotropic
        if isotropic is not None:
            return np.empty((elements, 0, 0, 3, 3, 3, 3)), isotropic
        F = self.gradients(local)
        tangent = np.ascontiguousarray(laws.tangent(F))
        if self.extrapolation is not None:
            tangent = self.extrapolation.tangent(F, laws.stress(F), tangent)
        return tangent, np.zeros((elements, 2))


def stiffness(table: Table, tangent: Array, isotropic: Array) -> Array:
    """Return element matrices ``(E, l, n, 3, l, n, 3)`` (`isorod.assembly.stiffness_kernel.add_stiffness`)."""
    elements, _, functions = table.axial.shape
    size = 3 * table.section.shape[2]
    # Each is a part of the entries by itself, whose rows are as long as it has columns.
    width = functions * size
    layer = np.arange(functions)
    start = width * width * np.arange(elements)[:, None, None] + size * (width * layer[:, None] + layer)
    blocks = Blocks(start, np.full((elements, functions), width), elements * width * width)
    return _stiffness(table, tangent, isotropic, blocks).reshape(elements, functions, size // 3, 3, functions, -1, 3)


def _stiffness(table: Table, tangent: Array, isotropic: Array, blocks: Blocks) -> Array:
    """Return the entries of a pattern to which element matrices add up."""
    result = Work.lines((1, blocks.total))[0]
    result[:] = 0.0
    add_stiffness(table, tangent, isotropic, blocks, Work.of(table), result)
    return result


# Relative error of a stress, in units of the stiffness, that is taken for rounding of the deformation gradient.
ROUNDING = 1e-15
