"""What `isorod.space.polynomial` computes over the points of a section, compiled."""

import numpy as np
from numba import types

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, F3, I2, R2, R3, STRICT, njit

# A section has no principal directions of its own where its moments of inertia differ by less than this share.
ROUND = 1e-9


@njit(types.Tuple((F2, F1, F1))(F2, F1, F2, F2, F2), **STRICT)
def principal_frame(
    polygon: Array, area: Array, values: Array, first: Array, second: Array
) -> tuple[Array, Array, Array]:
    """Return a section's polygon in its principal coordinates, each over half its extent; extents; shares of the area.

    Parameters
    ----------
    polygon
        Control points, shape ``(n, 2)``.
    area
        Weights of points of the disk, shape ``(m,)``.
    values, first, second
        The harmonic functions and their derivatives there, shape ``(m, n)``.
    """
    a, b = first @ polygon, second @ polygon
    share = area * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    share /= share.sum()
    place = values @ polygon
    centroid = share @ place
    place -= centroid
    inertia = np.zeros((2, 2))
    for q in range(share.size):
        for i in range(2):
            for k in range(2):
                inertia[i, k] += share[q] * place[q, i] * place[q, k]
    sizes, found = np.linalg.eigh(inertia)
    # The wider direction first; where all are as wide, that of the first control point, not what rounding makes of it.
    axes = np.ascontiguousarray(found[:, ::-1])
    if sizes[1] - sizes[0] <= ROUND * sizes[1]:
        arm = polygon[0] - centroid
        x, y = arm / np.sqrt(arm @ arm)
        axes[0, 0], axes[1, 0], axes[0, 1], axes[1, 1] = x, y, -y, x
    turned = place @ axes
    extents = np.empty(2)
    for k in range(2):
        extents[k] = turned[:, k].max() - turned[:, k].min()
    return (polygon - centroid) @ axes / (0.5 * extents), extents, share


@njit(F2(F2, F1, F2, I2), **STRICT)
def orthogonalise(polygon: Array, share: Array, values: Array, powers: Index) -> Array:
    """Return the matrix that makes monomials orthogonal over the section, shape ``(count, count)``."""
    first, second = _monomials(values @ polygon, powers.max())
    weighted = np.empty((share.size, powers.shape[0]))
    for q in range(share.size):
        for k in range(powers.shape[0]):
            weighted[q, k] = np.sqrt(share[q]) * first[q, powers[k, 0]] * second[q, powers[k, 1]]
    triangle = np.linalg.qr(weighted)[1]
    for k in range(triangle.shape[0]):
        if triangle[k, k] < 0.0:
            triangle[k] *= -1.0
    # The inverse of the triangular factor, its rows made positive on the diagonal.
    return np.ascontiguousarray(np.linalg.inv(triangle))


@njit(types.Tuple((F2, F3))(R2, R3, F2, I2, F2), **STRICT)
def functions(harmonic: Array, slopes: Array, polygon: Array, powers: Index, mix: Array) -> tuple[Array, Array]:
    """Return values ``(m, count)`` and gradients ``(m, count, 2)`` by the disk's coordinates.

    Parameters
    ----------
    harmonic, slopes
        The harmonic functions and their gradients, shapes ``(m, n)`` and ``(m, n, 2)``.
    polygon
        Control points in the section's coordinates, shape ``(n, 2)``.
    powers
        Exponents of the monomials, shape ``(count, 2)``.
    mix
        The functions in terms of monomials, shape ``(count, count)``.
    """
    points, count = harmonic.shape[0], powers.shape[0]
    n = polygon.shape[0]
    first, second = _monomials(harmonic @ polygon, powers.max())
    values = np.zeros((points, count))
    gradients = np.zeros((points, count, 2))
    turn = np.empty((2, 2))
    for q in range(points):
        turn[:] = 0.0
        for i in range(n):
            for k in range(2):
                for c in range(2):
                    turn[k, c] += slopes[q, i, k] * polygon[i, c]
        for m in range(count):
            a, b = powers[m, 0], powers[m, 1]
            value = first[q, a] * second[q, b]
            by_first = a * first[q, max(a - 1, 0)] * second[q, b]
            by_second = b * first[q, a] * second[q, max(b - 1, 0)]
            x = by_first * turn[0, 0] + by_second * turn[0, 1]
            y = by_first * turn[1, 0] + by_second * turn[1, 1]
            # ``mix`` is triangular.
            for k in range(m, count):
                values[q, k] += value * mix[m, k]
                gradients[q, k, 0] += x * mix[m, k]
                gradients[q, k, 1] += y * mix[m, k]
    return values, gradients


@njit(**STRICT)
def _monomials(place: Array, degree: int) -> tuple[Array, Array]:
    """Return the powers of both coordinates ``(m, 2)`` up to the highest there is, shape ``(m, degree + 1)`` each."""
    first = np.ones((place.shape[0], degree + 1))
    second = np.ones((place.shape[0], degree + 1))
    for q in range(place.shape[0]):
        for k in range(1, degree + 1):
            first[q, k] = first[q, k - 1] * place[q, 0]
            second[q, k] = second[q, k - 1] * place[q, 1]
    return first, second
