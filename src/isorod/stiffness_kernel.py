"""The element matrices of a tangent, compiled; shapes as in `isorod.kernel`.

Sums over the section's points are products of matrices, left to BLAS, and so are those along the axis.  Of the pairs of components
``a b`` those with ``a <= b`` will do where rows and columns have the same derivatives.
"""

from typing import Any

import numpy as np
from numba import njit

from isorod.disk import Array
from isorod.spline import Index

_OPTIONS: Any = {"cache": True, "fastmath": {"contract", "reassoc", "nsz", "arcp"}, "error_model": "numpy"}
_D3 = "f8[:,:,::1]"
_D5 = "f8[:,:,:,:,::1]"
_D7 = "f8[:,:,:,:,:,:,::1]"

# The pairs of components a <= b among all nine, and the place of each of the nine, or of its mirror image, among these.
_UPPER: Index = np.array([0, 1, 2, 4, 5, 8])
_PLACE: Index = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


@njit(**_OPTIONS)
def _pull_back(moduli: Array, half: Array, weight: float, inverse: Array, tangent: Array) -> None:
    """Fill ``moduli`` ``(d, c, 3 a + b)`` with ``weight dP_aA/dF_bB dxi_d/dx_A dxi_c/dx_B``; ``half`` ``(3, 9)`` is for work."""
    for d in range(3):
        g0 = weight * inverse[d, 0]
        g1 = weight * inverse[d, 1]
        g2 = weight * inverse[d, 2]
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    half[c, 3 * a + b] = g0 * tangent[a, 0, b, c] + g1 * tangent[a, 1, b, c] + g2 * tangent[a, 2, b, c]
        for c in range(3):
            for ab in range(9):
                moduli[d, c, ab] = (
                    inverse[c, 0] * half[0, ab] + inverse[c, 1] * half[1, ab] + inverse[c, 2] * half[2, ab]
                )


@njit(**_OPTIONS)
def _place(matrix: Array, j: int, m: int, block: Array) -> None:
    """Put a block ``(n, 3, n, 3)`` into an element matrix ``(l, n, 3, l, n, 3)``, and its transpose on the other side."""
    n = block.shape[0]
    for i in range(n):
        for a in range(3):
            for k in range(n):
                for b in range(3):
                    matrix[j, i, a, m, k, b] = block[i, a, k, b]
    if j < m:
        for i in range(n):
            for a in range(3):
                for k in range(n):
                    for b in range(3):
                        matrix[m, i, a, j, k, b] = block[k, b, i, a]


@njit(f"{_D7}({_D3}, {_D3}, {_D3}, {_D5}, {_D3}, {_D7})", **_OPTIONS)
def stiffness(section: Array, axial: Array, slopes: Array, inverse: Array, weights: Array, tangent: Array) -> Array:
    """Return element matrices ``(E, l, n, 3, l, n, 3)`` of the tangent moduli ``dP/dF`` ``(E, t, q, 3, 3, 3, 3)``.

    The moduli must have major symmetry, as those of a stored energy do.
    """
    elements, along, functions = axial.shape
    points, _, n = section.shape
    result = np.empty((elements, functions, n, 3, functions, n, 3))
    # Rows: derivatives in the section, and the functions themselves, which stand for those along the axis.
    across = np.empty((n, points, 2))
    whole = np.empty((n, points))
    for q in range(points):
        for i in range(n):
            across[i, q, 0] = section[q, 0, i]
            across[i, q, 1] = section[q, 1, i]
            whole[i, q] = section[q, 2, i]
    # Columns, times the moduli: to rows across, of all nine pairs those along the axis, of six pairs those across; to rows along
    # the axis, of six pairs those along it.
    to_across = np.empty((points, 2, 15, n))
    to_whole = np.empty((points, 6, n))
    mixed_plane = np.empty((n, 15, n))
    axis = np.empty((n, 6, n))
    # Section matrices of each point along the axis: both across, mixed, mixed the other way round, both along.
    matrices = np.empty((along, 4, n, 3, n, 3))
    pairs = functions * (functions + 1) // 2
    factors = np.empty((pairs, along, 4))
    block = np.empty((pairs, n, 3, n, 3))
    moduli, half = np.empty((3, 3, 9)), np.empty((3, 9))
    for e in range(elements):
        for t in range(along):
            for q in range(points):
                _pull_back(moduli, half, weights[e, t, q], inverse[e, t, q], tangent[e, t, q])
                for d in range(2):
                    for ab in range(9):
                        x = moduli[d, 2, ab]
                        for k in range(n):
                            to_across[q, d, ab, k] = x * section[q, 2, k]
                    for h in range(6):
                        x = moduli[d, 0, _UPPER[h]]
                        y = moduli[d, 1, _UPPER[h]]
                        for k in range(n):
                            to_across[q, d, 9 + h, k] = x * section[q, 0, k] + y * section[q, 1, k]
                for h in range(6):
                    x = moduli[2, 2, _UPPER[h]]
                    for k in range(n):
                        to_whole[q, h, k] = x * section[q, 2, k]
            np.dot(across.reshape(n, 2 * points), to_across.reshape(2 * points, 15 * n), mixed_plane.reshape(n, 15 * n))
            np.dot(whole, to_whole.reshape(points, 6 * n), axis.reshape(n, 6 * n))
            for i in range(n):
                for a in range(3):
                    for k in range(n):
                        for b in range(3):
                            row, column = (i, k) if a <= b else (k, i)
                            h = _PLACE[3 * a + b]
                            matrices[t, 0, i, a, k, b] = mixed_plane[row, 9 + h, column]
                            matrices[t, 1, i, a, k, b] = mixed_plane[i, 3 * a + b, k]
                            matrices[t, 2, i, a, k, b] = mixed_plane[k, 3 * b + a, i]
                            matrices[t, 3, i, a, k, b] = axis[row, h, column]
            p = 0
            for j in range(functions):
                for m in range(j, functions):
                    factors[p, t, 0] = axial[e, t, j] * axial[e, t, m]
                    factors[p, t, 1] = axial[e, t, j] * slopes[e, t, m]
                    factors[p, t, 2] = slopes[e, t, j] * axial[e, t, m]
                    factors[p, t, 3] = slopes[e, t, j] * slopes[e, t, m]
                    p += 1
        np.dot(
            factors.reshape(pairs, 4 * along), matrices.reshape(4 * along, 9 * n * n), block.reshape(pairs, 9 * n * n)
        )
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                _place(result[e], j, m, block[p])
                p += 1
    return result
