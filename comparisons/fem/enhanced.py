"""Enhanced-strain 8-node bricks, the paper's finite element: trilinear, with nine incompatible modes a cell.

    F = I + grad u + (j0 / j) [a1 xi1, a2 xi2, a3 xi3] J0^-1

with the cell's vectors ``a1, a2, a3``, reference coordinates ``xi`` in [-1, 1]^3, and the map's gradient ``J`` with
determinant ``j`` (``J0, j0`` at the centre): Taylor, Beresford & Wilson (1976), Simo & Armero, Int. J. Numer. Methods
Eng. 33 (1992) 1413-1449. dolfinx cannot eliminate the modes cell by cell, so they are global unknowns: same solution,
unfair run times.
"""

from typing import Any

import dolfinx.fem
import numpy as np
import ufl

from isorod.fenics import compat
from meshes.mesh import Array, gradients


def space(mesh: Any) -> Any:
    """Return the mixed space of displacement (first) and modes."""
    displacement = compat.element(mesh, "Lagrange", 1, 3)
    return compat.function_space(mesh, compat.mixed_element([displacement, compat.element(mesh, "DQ", 0, 9)]))


def deformation_gradient(state: Any) -> Any:
    """Return ``F`` of a function of that space, in UFL."""
    mesh = state.function_space.mesh
    u, modes = ufl.split(state)
    constants = compat.function_space(mesh, compat.element(mesh, "DQ", 0, 9))
    center = dolfinx.fem.Function(constants)
    center.x.array[:] = _center_jacobians(mesh, len(center.x.array) // 9).ravel()
    jacobian = ufl.as_matrix([[center[3 * a + b] for b in range(3)] for a in range(3)])
    xi = _reference_coordinates(mesh)
    directions = ufl.as_matrix([[modes[3 * b + a] * xi[b] for b in range(3)] for a in range(3)])
    scale = ufl.det(jacobian) / ufl.JacobianDeterminant(mesh)
    return ufl.Identity(3) + ufl.grad(u) + scale * directions * ufl.inv(jacobian)


def _reference_coordinates(mesh: Any) -> Any:
    """Return the function whose value is the position in the reference cube [-1, 1]^3."""
    corners = compat.function_space(mesh, compat.element(mesh, "DQ", 1, 3))
    xi = dolfinx.fem.Function(corners)
    nodal = xi.x.array.reshape(-1, 3)
    for cell in range(len(nodal) // 8):
        nodal[corners.dofmap.cell_dofs(cell)] = 2.0 * compat.interpolation_points(corners) - 1.0
    return xi


def _center_jacobians(mesh: Any, cells: int) -> Array:
    """Return the gradients of the map from [0, 1]^3 at the cells' centres, ghosts included, ``(cells, 3, 3)``."""
    slopes = gradients("hexahedron", 1, compat.reference_nodes("hexahedron", 1), np.full((1, 3), 0.5))[0]
    # To [-1, 1]^3 it is half of that; J0 enters as j0 J0^-1 / j, which scales the modes and changes no result.
    return np.einsum("nb,cna->cab", slopes, mesh.geometry.x[compat.geometry_dofs(mesh, cells)])
