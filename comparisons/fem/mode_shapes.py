"""Mode shapes at the nodes of a mesh, in memory and in files."""

from pathlib import Path

import numpy as np

from comparisons.fem.modal import Modes
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.output.results import write_arrays
from meshes.mesh import Array, Mesh


def nodal(found: Modes) -> Array | None:
    """Return the mode shapes at the nodes of the `Mesh`, shape ``(modes, nodes, 3)``, on rank 0; None elsewhere."""
    mesh = found.domain.mesh
    count = mesh.topology.index_map(mesh.topology.dim).size_local
    rows = compat.geometry_dofs(mesh, count)
    numbers = np.asarray(mesh.geometry.input_global_indices)
    order = (
        round(rows.shape[1] ** (1.0 / 3.0)) - 1 if found.domain.shape == "hexahedron" else {4: 1, 10: 2}[rows.shape[1]]
    )
    where = compat.reference_nodes(found.domain.shape, order)
    local = np.zeros((len(found.shapes), len(mesh.geometry.x), 3))
    evaluate = compat.expression(found.displacement, where, FAST)
    for k, shape in enumerate(found.shapes):
        found.carry(shape)
        local[k, rows] = evaluate(mesh, np.arange(count, dtype=np.int32)).reshape(count, -1, 3)
    used = np.unique(rows)
    parts = mesh.comm.gather((numbers[used], local[:, used]), root=0)
    if parts is None:
        return None
    whole = np.zeros((len(found.shapes), 1 + max(int(part[0].max()) for part in parts if part[0].size), 3))
    for where_to, values in parts:
        whole[:, where_to] = values
    return whole


def save(found: Modes, mesh: Mesh | None, path: Path) -> None:
    """Write the mode shapes to an ``.npz`` file, from rank 0, which has the mesh; every rank must call.

    Arrays: ``frequencies`` ``(modes,)``; ``modes`` ``(modes, nodes, 3)`` with ``x^T M x = 1``; of each node its
    position ``points`` ``(nodes, 3)``, its parameters on the Rod ``xi`` ``(nodes, 2)`` and ``u`` ``(nodes,)``, and its
    share of the volume ``weights`` ``(nodes,)``, for inner products; ``cells`` and their ``shape`` and ``order`` as in
    `meshes.mesh.Mesh`.
    """
    values = nodal(found)
    if values is None or mesh is None or mesh.parameters is None:
        return
    arrays = {
        "frequencies": found.frequencies,
        "modes": values,
        "points": mesh.points,
        "xi": mesh.parameters[:, :2],
        "u": mesh.parameters[:, 2],
        "weights": mesh.node_volumes(),
        "cells": mesh.cells,
        "shape": np.array(mesh.shape),
        "order": np.array(mesh.order),
    }

    write_arrays(path, **arrays)
