"""The elements of one body that a rank assembles: their forces, tangents and masses."""

from functools import cached_property

import numpy as np

from isorod.arrays import Array, Index
from isorod.assembly import element_kernel
from isorod.assembly.extrapolation import Extrapolation
from isorod.assembly.pattern import Entries, Numbered, Pattern
from isorod.assembly.stiffness_kernel import merged_stiffness, stiffness
from isorod.model.body import Body
from isorod.model.load import Spin
from isorod.space.space import Table


class Part:
    """The elements of one body that this rank assembles."""

    def __init__(self, body: Body, index: int, first_node: int, first_dof: int, first: int, last: int) -> None:
        self.body = body
        self.index = index
        self.table: Table = body.space.tabulate(first, last)
        self.laws = body.laws_at(self.table.u)
        self.layers = body.space.element_layers[first:last]
        self.width = self.layer_dofs(body)
        dofs = first_dof + self.width * self.layers[:, :, None] + np.arange(self.width)
        self.dofs: Index = dofs.reshape(self.layers.shape[0], -1)
        self.shape = (*self.layers.shape, body.space.layer_nodes, 3)
        self.slots: Index = np.empty(0, dtype=np.int64)
        # As `layers`, negative where supports hold all of a layer; the assembler, which knows, fills it in.
        self.free_layers: Index = self.layers
        self.extrapolation: Extrapolation | None = None
        self.first_node = first_node
        self.first_dof = first_dof

    @staticmethod
    def layer_dofs(body: Body) -> int:
        """Return the number of degrees of freedom of a layer."""
        return 3 * body.space.layer_nodes

    @cached_property
    def pattern(self) -> Pattern:
        """Pattern of the degrees of freedom, those of layers left out that supports hold."""
        return Pattern(self.free_layers, self.width)

    @cached_property
    def mass(self) -> Array:
        """Element mass matrices of one component, shape ``(E, l n, l n)``."""
        t = self.table
        density = self.body.densities[t.first : t.first + t.elements, None, None]
        mass = element_kernel.mass(t.section, t.axial, density * t.weights)
        return mass.reshape(mass.shape[0], mass.shape[1] * mass.shape[2], -1)

    def mass_entries(self, lumped: bool, number: Index) -> tuple[Entries, Array]:
        """Return where in a matrix with ``number`` of each of the model's nodes the mass of one component is, and that mass."""
        if lumped:
            nodes = number[self.dofs[:, ::3].ravel() // 3]
            return (nodes, nodes), self.lumped_mass().ravel()
        pattern = Pattern(self.free_layers, self.body.space.layer_nodes)
        return Numbered(pattern, number[self.first_node :]), pattern.merge(self.mass)

    def lumped_mass(self) -> Array:
        """Return the element masses of one component, shape ``(E, l n)``."""
        space = self.body.space
        carries = space.is_carrier[space.element_nodes[0]]
        diagonal = np.einsum("eii->ei", self.mass)
        return np.where(carries, self.mass @ carries.astype(float), diagonal)

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

    def forces(self, local: Array, factor: float) -> Array:
        """Return the internal forces, shape of ``dofs``."""
        stress = self.laws.at(factor).stress(self.gradients(local))
        return element_kernel.internal_forces(self.table, stress).reshape(self.dofs.shape)

    def matrices(self, local: Array, factor: float) -> Array:
        """Return the element tangents, shape ``(E, l n 3, l n 3)``."""
        matrices = stiffness(self.table, *self._moduli(local, factor))
        return matrices.reshape(*self.dofs.shape, self.dofs.shape[1])

    def entries(self, local: Array, factor: float) -> Array:
        """Return the sum of the element tangents as entries of the pattern; they themselves, much larger, are not kept."""
        return merged_stiffness(self.table, *self._moduli(local, factor), self.pattern.blocks)

    def _moduli(self, local: Array, factor: float) -> tuple[Array, Array]:
        """Return the moduli as `isorod.assembly.stiffness_kernel.stiffness` takes them: at points, or Lame's parameters of elements."""
        laws, elements = self.laws.at(factor), self.layers.shape[0]
        isotropic = laws.isotropic
        if isotropic is not None:
            return np.empty((elements, 0, 0, 3, 3, 3, 3)), isotropic
        F = self.gradients(local)
        tangent = np.ascontiguousarray(laws.tangent(F))
        if self.extrapolation is not None:
            tangent = self.extrapolation.tangent(F, laws.stress(F), tangent)
        return tangent, np.zeros((elements, 2))


# Relative error of a stress, in units of the stiffness, that is taken for rounding of the deformation gradient.
ROUNDING = 1e-15
