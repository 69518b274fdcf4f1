"""Values by node of a mesh as coefficients of dolfinx' space on it, and back."""

import numpy as np

from meshes.mesh import Array, Index


class Numbered:
    """What has a space of displacements of a mesh's own order.

    Attributes
    ----------
    node_dofs
        For each node of the mesh the place of its three coefficients in the space, shape ``(nodes,)``.
    """

    node_dofs: Index

    def to_dofs(self, nodal: Array) -> Array:
        """Return values by node ``(nodes, 3)`` as coefficients of the space, shape ``(3 nodes,)``."""
        result = np.empty_like(nodal)
        result[self.node_dofs] = nodal
        return result.ravel()

    def to_nodes(self, coefficients: Array) -> Array:
        """Return coefficients of the space ``(3 nodes,)`` by node, shape ``(nodes, 3)``."""
        return coefficients.reshape(-1, 3)[self.node_dofs]
