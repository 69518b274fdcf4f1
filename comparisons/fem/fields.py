"""Displacement and von Mises stress of a finite element solution on small cells, for pictures."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import ufl

from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import Energy
from meshes.mesh import Array, Index


class Sampler:
    """Small cells, ``parts^3`` to a brick with points of their own, so that jumps of the stress show.

    Serial, bricks only.

    Parameters
    ----------
    displacement
        A dolfinx function.
    laws
        Laws, each with the cells that have it.
    parts
        Small cells along a brick's edge.

    Attributes
    ----------
    points, cells
        Reference positions ``(m, 3)``, and corners of hexahedra ``(k, 8)``.
    """

    def __init__(self, displacement: Any, laws: Sequence[tuple[Energy, Index]], parts: int = 3) -> None:
        mesh = displacement.function_space.mesh
        self._mesh = mesh
        ticks = np.linspace(0.0, 1.0, parts + 1)
        lattice = np.stack([axis.ravel() for axis in np.meshgrid(ticks, ticks, ticks, indexing="ij")], axis=1)
        count = mesh.topology.index_map(mesh.topology.dim).size_local
        self._shape = count, len(lattice)
        # dolfinx numbers cells with 32 bits.
        self._parts: list[tuple[Any, Any]] = []
        for law, rows in laws:
            F = ufl.variable(ufl.Identity(3) + ufl.grad(displacement))
            stress = ufl.diff(law(F), F) * F.T / ufl.det(F)
            von_mises = ufl.sqrt(1.5 * ufl.inner(ufl.dev(stress), ufl.dev(stress)))
            values = ufl.as_vector([*ufl.SpatialCoordinate(mesh), *displacement, von_mises])
            self._parts.append((compat.expression(values, lattice, FAST), np.asarray(rows, dtype=np.int32)))
        self.points: Array = self._values()[:, :3]
        index = np.arange(len(lattice)).reshape(parts + 1, parts + 1, parts + 1)
        low, high = slice(None, -1), slice(1, None)
        quad = ((low, low), (high, low), (high, high), (low, high))
        small = np.stack([index[a, b, c].ravel() for c in (low, high) for a, b in quad], axis=1)
        self.cells: Index = (len(lattice) * np.arange(count)[:, None, None] + small).reshape(-1, 8)

    def _values(self) -> Array:
        values = np.empty((*self._shape, 7))
        for evaluate, rows in self._parts:
            values[rows] = evaluate(self._mesh, rows).reshape(rows.size, -1, 7)
        return values.reshape(-1, 7)

    def state(self) -> tuple[Array, Array]:
        """Return the displacement ``(m, 3)`` and the von Mises stress ``(m,)`` of the function as it is now."""
        values = self._values()
        return values[:, 3:6], values[:, 6]
