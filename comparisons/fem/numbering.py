"""Values by node of a mesh as coefficients of dolfinx' space on it, and back."""

import numpy as np

from meshes.mesh import Array, Index


class Numbered:
    """A space of displacements of a mesh's own order, perhaps among other unknowns.

    Attributes
    ----------
    node_dofs
        For each node of the mesh the place of its three coefficients in the space of displacements, ``(nodes,)``.
    """

    node_dofs: Index

    @property
    def places(self) -> Index:
        """Place of the coefficients of each node among all unknowns, shape ``(nodes, 3)``."""
        return 3 * self.node_dofs[:, None] + np.arange(3)

    @property
    def unknowns(self) -> int:
        """Number of unknowns, held ones included."""
        return 3 * self.node_dofs.size

    @property
    def numbers(self) -> Index:
        """Number of each among those of all ranks, shape ``(nodes, 3)``."""
        return self.places

    def to_dofs(self, nodal: Array) -> Array:
        """Return values by node ``(nodes, 3)`` as coefficients of all unknowns, zero for other unknowns."""
        result = np.zeros(self.unknowns)
        result[self.places] = nodal
        return result

    def to_nodes(self, coefficients: Array) -> Array:
        """Return the coefficients of all unknowns that are displacements by node, shape ``(nodes, 3)``."""
        return coefficients[self.places]
