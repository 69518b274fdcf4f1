"""Determinant and inverse of many 3 x 3 matrices at once; LAPACK's, one by one, takes ten times as long."""

import numpy as np

from isorod.disk import Array


def cofactors(matrices: Array) -> Array:
    """Return the cofactors of matrices ``(..., 3, 3)``."""
    a, b, c = (matrices[..., row, :] for row in range(3))
    return np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=-2)


def determinant(matrices: Array) -> Array:
    """Return the determinants of matrices ``(..., 3, 3)``."""
    return np.sum(matrices[..., 0, :] * _cross(matrices[..., 1, :], matrices[..., 2, :]), axis=-1)


def inverse(matrices: Array) -> tuple[Array, Array]:
    """Return the inverses (C order) and determinants of matrices ``(..., 3, 3)``."""
    minors = cofactors(matrices)
    det = np.sum(matrices[..., 0, :] * minors[..., 0, :], axis=-1)
    return np.ascontiguousarray(np.swapaxes(minors, -1, -2) / det[..., None, None]), det


def _cross(a: Array, b: Array) -> Array:
    result = np.empty_like(a)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        result[..., k] = a[..., i] * b[..., j] - a[..., j] * b[..., i]
    return result
