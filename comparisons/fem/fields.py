"""Displacement and von Mises stress of a finite element solution on small cells, for pictures."""

from pathlib import Path

import numpy as np
import ufl

from comparisons.fem import compat
from comparisons.fem.statics import FAST, Equilibrium
from isorod.errors import InputError
from isorod.results import write_beside


def save(found: Equilibrium, path: Path, parts: int = 3) -> None:
    """Write arrays ``points``, ``displacement`` ``(m, 3)``, ``von_mises`` ``(m,)`` and ``cells`` ``(k, 8)`` to an ``.npz`` file.

    Every brick is cut in ``parts^3`` small ones with points of its own, so that jumps of the stress show.  Serial, bricks only.
    """
    mesh = found.domain.mesh
    if found.domain.shape != "hexahedron" or mesh.comm.size > 1:
        raise InputError("fields: only bricks on one rank")
    ticks = np.linspace(0.0, 1.0, parts + 1)
    lattice = np.stack([axis.ravel() for axis in np.meshgrid(ticks, ticks, ticks, indexing="ij")], axis=1)
    F = ufl.variable(ufl.Identity(3) + ufl.grad(found.displacement))
    stress = ufl.diff(found.energy(F), F) * F.T / ufl.det(F)
    von_mises = ufl.sqrt(1.5 * ufl.inner(ufl.dev(stress), ufl.dev(stress)))
    values = ufl.as_vector([*ufl.SpatialCoordinate(mesh), *found.displacement, von_mises])
    count = mesh.topology.index_map(mesh.topology.dim).size_local
    sampled = compat.expression(values, lattice, FAST)(mesh, np.arange(count, dtype=np.int32)).reshape(-1, 7)

    index = np.arange(lattice.shape[0]).reshape(parts + 1, parts + 1, parts + 1)
    low, high = slice(None, -1), slice(1, None)
    quad = ((low, low), (high, low), (high, high), (low, high))
    corners = [index[a, b, c] for c in (low, high) for a, b in quad]
    small = np.stack([corner.ravel() for corner in corners], axis=1)
    cells = (lattice.shape[0] * np.arange(count)[:, None, None] + small).reshape(-1, 8)
    arrays = {"points": sampled[:, :3], "displacement": sampled[:, 3:6], "von_mises": sampled[:, 6], "cells": cells}

    def write(where: Path) -> None:
        with open(where, "wb") as file:
            np.savez_compressed(file, **arrays)

    write_beside(path, write)
