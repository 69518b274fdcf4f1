"""Penalty contact of a surface of a mesh with a rigid plane or cylinder: the interface of `surfaces.Contact`."""

import numpy as np
from scipy import sparse

from comparisons.fem.contact import closest_kernel
from comparisons.fem.contact.closest_kernel import Points
from comparisons.fem.contact.pressing_kernel import Pressing
from isorod.model.contact import Cylinder, Plane
from meshes.mesh import Array


class Obstacle:
    """Energy ``sum 1/2 penalty gap^2 dA`` over points that are inside an obstacle, ``dA`` on the reference surface.

    Parameters
    ----------
    points
        Of the surface.
    what
        The obstacle.
    penalty
        Force per volume.
    """

    def __init__(self, points: Points, what: Plane | Cylinder, penalty: float) -> None:
        self._points, self._what, self.penalty = points, what, penalty
        direction = np.array(what.normal if isinstance(what, Plane) else what.axis, dtype=float)
        self._direction = direction / np.linalg.norm(direction)

    def _gaps(self, nodes: Array) -> tuple[Array, Array, Array]:
        """Return gaps ``(m,)``, normals ``(m, 3)``, and the distance of each point from a cylinder's axis ``(m,)``."""
        x = np.empty((len(self._points.weights), 3))
        closest_kernel.place(nodes, self._points, x)
        away = x - np.array(self._what.point, dtype=float)
        along = away @ self._direction
        if isinstance(self._what, Plane):
            return along, np.broadcast_to(self._direction, x.shape), np.full(len(x), np.inf)
        across = away - along[:, None] * self._direction
        distance = np.linalg.norm(across, axis=1)
        return distance - self._what.radius, across / np.maximum(distance, 1e-300)[:, None], distance

    def _pressures(self, gaps: Array) -> Array:
        return np.maximum(0.0, -self.penalty * gaps)

    def add_forces(self, nodes: Array, out: Array) -> Pressing:
        """Add the gradient of the energy to ``out``, both arrays of shape ``(nodes, 3)``."""
        supports, functions, weights = self._points
        gaps, normals, _ = self._gaps(nodes)
        pressures = self._pressures(gaps)
        active = np.flatnonzero(pressures)
        force = -(pressures * weights)[active, None] * normals[active]
        np.add.at(out, supports[active], functions[active][:, :, None] * force[:, None])
        return Pressing(
            float(0.5 * (pressures**2 / self.penalty) @ weights),
            float(pressures @ weights),
            float(weights[active].sum()),
            -force.sum(axis=0),
            float(gaps.min()),
        )

    def stiffness(self, nodes: Array) -> sparse.coo_array:
        """Return the second derivative of the energy, rows and columns ``3 node + component``; entries repeat."""
        supports, functions, weights = self._points
        gaps, normals, distance = self._gaps(nodes)
        pressures = self._pressures(gaps)
        active = np.flatnonzero(pressures)
        normal = normals[active]
        local = self.penalty * np.einsum("mi,mj->mij", normal, normal)
        # A cylinder's normal turns as the point moves round.
        round_it = np.eye(3) - np.einsum("mi,mj->mij", normal, normal) - np.outer(self._direction, self._direction)
        local -= (pressures / distance)[active, None, None] * round_it
        local *= weights[active, None, None]
        active_functions, n = functions[active], 3 * functions.shape[1]
        blocks = np.einsum("ma,mb,mij->maibj", active_functions, active_functions, local).reshape(len(active), n, n)
        unknowns = (3 * supports[active][:, :, None] + np.arange(3)).reshape(len(active), n)
        rows, columns = (np.repeat(unknowns, n, axis=1), np.tile(unknowns, n))
        size = 3 * len(nodes)
        return sparse.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size))
