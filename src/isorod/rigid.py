"""Rigid motions of a model: which the supports leave free, and the near-null space they make."""

import numpy as np

from isorod.disk import Array
from isorod.model import Model

# A motion counts as free if it moves held components by less than this share of its size.
_TOLERANCE = 1e-8


def motions(positions: Array) -> Array:
    """Return the six infinitesimal rigid motions of nodes at ``positions`` ``(nodes, 3)``, orthonormal, shape ``(3 nodes, 6)``.

    A rod reproduces them exactly, since its functions reproduce its own map.
    """
    arm = positions - positions.mean(axis=0)
    columns = np.zeros((*positions.shape, 6))
    for a in range(3):
        columns[:, a, a] = 1.0
        columns[:, :, 3 + a] = np.cross(np.eye(3)[a], arm)
    return np.linalg.qr(columns.reshape(-1, 6))[0]


def free_motions(model: Model) -> list[tuple[int, Array]]:
    """Return the rigid motions that the supports leave free: body, and displacements of its nodes ``(nodes, 3)``."""
    found = []
    for b, body in enumerate(model.bodies):
        basis = motions(body.space.positions)
        held = model.free[3 * model.first_node[b] : 3 * model.first_node[b + 1]] < 0
        # Rows of held components only; the triangular factor has the same singular values and at most six rows.
        rows = np.linalg.qr(basis[held], mode="r") if held.any() else np.zeros((1, 6))
        _, sizes, turns = np.linalg.svd(rows, full_matrices=True)
        full = np.zeros(6)
        full[: sizes.size] = sizes
        for k in np.flatnonzero(full < _TOLERANCE):
            found.append((b, (basis @ turns[k]).reshape(-1, 3)))
    return found


def describe(positions: Array, motion: Array) -> str:
    """Return a motion in words: where it goes, or about which direction it turns."""
    arm = positions - positions.mean(axis=0)
    shift = motion.mean(axis=0)
    turn, *_ = np.linalg.lstsq(
        np.concatenate([np.cross(np.eye(3)[a], arm).reshape(-1, 1) for a in range(3)], axis=1),
        (motion - shift).ravel(),
        rcond=None,
    )
    size = np.abs(arm).max()
    turns = np.linalg.norm(turn) * size > 1e-6 * np.abs(motion).max()
    axis = turn if turns else shift
    axis = axis / np.linalg.norm(axis)
    words = ", ".join(f"{value + 0.0:.3g}" for value in np.where(np.abs(axis) < 1e-9, 0.0, axis))
    return f"turn about ({words})" if turns else f"move along ({words})"
