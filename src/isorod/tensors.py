"""Rotations; determinants and inverses of many 3 x 3 matrices: LAPACK's, one by one, take ten times as long."""

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Numbers


def cross(vector: Numbers) -> Array:
    """Return the matrix ``(3, 3)`` of the cross product with a vector on its left."""
    x, y, z = np.asarray(vector, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(vector: Numbers) -> Array:
    """Return the matrix ``(3, 3)`` of the rotation about ``vector`` by its length, radians (Rodrigues).

    Its entries for directions in the axis are exact: a rotation about ``y`` leaves ``y`` components as they are.
    """
    return np.eye(3) + turning(vector)


def turning(vector: Numbers) -> Array:
    """Return `rotation` less the identity, accurate for small angles too."""
    x, y, z = np.asarray(vector, dtype=float)
    angle = float(np.sqrt(x * x + y * y + z * z))
    if angle == 0.0:
        return np.zeros((3, 3))
    axial = cross(vector) / angle
    return np.sin(angle) * axial + 2.0 * np.sin(0.5 * angle) ** 2 * (axial @ axial)


def cofactors(matrices: Array) -> Array:
    """Return the cofactors of matrices ``(..., 3, 3)``."""
    return _matrices(_minors(_entries(matrices)), matrices)


def determinant(matrices: Array) -> Array:
    """Return the determinants of matrices ``(..., 3, 3)``."""
    a, b, c, d, e, f, g, h, i = _entries(matrices)
    det: Array = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    return det.reshape(matrices.shape[:-2])


def inverse(matrices: Array) -> tuple[Array, Array]:
    """Return the inverses (C order) and determinants of matrices ``(..., 3, 3)``."""
    entries = _entries(matrices)
    minors = _minors(entries)
    det = entries[0] * minors[0] + entries[1] * minors[1] + entries[2] * minors[2]
    transposed = minors.reshape(3, 3, -1).swapaxes(0, 1).reshape(9, -1)
    return _matrices(transposed / det, matrices), det.reshape(matrices.shape[:-2])


def _entries(matrices: Array) -> Array:
    """Return the entries row by row, each in an array of its own, ``(9, m)``: sums over these run along memory."""
    return np.ascontiguousarray(matrices.reshape(-1, 9).T)


def _matrices(entries: Array, like: Array) -> Array:
    return np.ascontiguousarray(entries.T).reshape(like.shape)


def _minors(entries: Array) -> Array:
    a, b, c, d, e, f, g, h, i = entries
    result = np.empty_like(entries)
    result[0], result[1], result[2] = e * i - f * h, f * g - d * i, d * h - e * g
    result[3], result[4], result[5] = h * c - i * b, i * a - g * c, g * b - h * a
    result[6], result[7], result[8] = b * f - c * e, c * d - a * f, a * e - b * d
    return result


def motions_of(places: Array, control: NDArray[np.bool_]) -> Array:
    """Return translations and turns about the origin of nodes at places ``(nodes, 3)``, shape ``(3 nodes, 6)``."""
    columns = np.zeros((*places.shape, 6))
    for a in range(3):
        columns[control, a, a] = 1.0
        b, c = (a + 1) % 3, (a + 2) % 3
        columns[:, b, 3 + a], columns[:, c, 3 + a] = -places[:, c], places[:, b]
    return columns.reshape(-1, 6)
