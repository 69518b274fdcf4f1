"""Ends of rods that are welded deep within others: their nodes move with the cells round them."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from meshes import abaqus, nodal
from meshes.mesh import Array, Index, Mesh

# Cells in which a node is looked for, steps of Newton's method there, and how far outside of one, in cells, it may be.
_NEAR, _STEPS, _OUTSIDE = 8, 20, 0.1

# Shares of nodes below this are rounding.
_ROUNDING = 1e-12


def interpolation(mesh: Mesh, cells: Index, points: Array) -> tuple[Index, Array]:
    """Return nodes ``(m, n)`` and their functions at points ``(m, 3)`` within cells of a mesh.

    Raises
    ------
    InputError
        If a point is in none of them.
    """
    own = mesh.cells[cells]
    near = cKDTree(mesh.points[own].mean(axis=1)).query(points, k=min(_NEAR, len(own)))[1].reshape(len(points), -1)
    where = np.full((*near.shape, 3), 0.5)
    for _ in range(_STEPS):
        places, values, slopes = nodal.at_points(mesh.reference, mesh.order, where.reshape(-1, 3))
        nodes = own[near][..., places]
        corners = mesh.points[nodes].reshape(-1, len(places), 3)
        rest = np.repeat(points, near.shape[1], axis=0) - np.einsum("qn,qna->qa", values, corners)
        step = np.linalg.solve(np.einsum("qnb,qna->qab", slopes, corners), rest[..., None])[..., 0]
        where = np.clip(where + step.reshape(where.shape), -0.5, 1.5)
    outside = np.abs(where - 0.5).max(axis=2) - 0.5
    best = np.arange(len(points)), outside.argmin(axis=1)
    if outside[best].max() > _OUTSIDE:
        raise InputError(
            "an end that is partly within the other rod is not written to .inp; let it begin on its surface"
        )
    return nodes[best], values.reshape(*near.shape, -1)[best]


def equations(number: Index, slaves: Index, nodes: Index, values: Array) -> Iterator[str]:
    """Yield the equations of nodes ``(m,)`` of a mesh that move as others ``(m, n)`` do, by these functions."""
    for slave, masters, own in zip(number[slaves].tolist(), number[nodes].tolist(), values.tolist(), strict=True):
        if slave:
            some = [(node, value) for node, value in zip(masters, own, strict=True) if abs(value) > _ROUNDING]
            for k in (1, 2, 3):
                yield from abaqus.equation([f"{slave},{k},1.", *(f"{node},{k},{-value:.12g}" for node, value in some)])
