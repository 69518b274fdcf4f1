"""The element matrices of a tangent, compiled; shapes as in `isorod.assembly.element_kernel`.

Sums over the section's points are products of matrices, left to BLAS, and so are those along the axis.  Of the pairs of
components ``a b`` those with ``a <= b`` will do where rows and columns have the same derivatives.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from isorod.arrays import Array, Index
from isorod.assembly.element_kernel import TABLE
from isorod.assembly.pattern_kernel import BLOCKS, Blocks
from isorod.compiled import F1, F2, F7, FAST
from isorod.space.space import Table

# The pairs of components a <= b among all nine, and the place of each of the nine, or of its mirror image, among these.
_UPPER: Index = np.array([0, 1, 2, 4, 5, 8])
_PLACE: Index = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


@njit(**FAST)
def _pull_back(moduli: Array, half: Array, weight: float, inverse: Array, tangent: Array) -> None:
    """Fill ``moduli`` ``(d, c, 3 a + b)`` with ``weight dP_aA/dF_bB dxi_d/dx_A dxi_c/dx_B``.

    ``half`` ``(3, 9)`` is for work.
    """
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


@njit(**FAST)
def _pull_back_isotropic(moduli: Array, weight: float, inverse: Array, lame: float, mu: float) -> None:
    """Do the same for ``dP_aA/dF_bB = lame d_aA d_bB + mu (d_ab d_AB + d_aB d_bA)``."""
    for d in range(3):
        for c in range(d, 3):
            product = 0.0
            for a in range(3):
                product += inverse[d, a] * inverse[c, a]
            product *= weight * mu
            for a in range(3):
                x = weight * lame * inverse[d, a]
                y = weight * mu * inverse[c, a]
                for b in range(3):
                    moduli[d, c, 3 * a + b] = x * inverse[c, b] + y * inverse[d, b]
                moduli[d, c, 4 * a] += product
    for a in range(3):
        for b in range(3):
            moduli[1, 0, 3 * a + b] = moduli[0, 1, 3 * b + a]


@njit(**FAST)
def _place(matrix: Array, j: int, m: int, block: Array) -> None:
    """Put a block ``(n, 3, n, 3)`` into an element matrix ``(l, n, 3, l, n, 3)``, and its transpose across."""
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


@njit(**FAST)
def _add(entries: Array, start: int, width: int, block: Array, transposed: bool) -> None:
    """Add a block ``(n, 3, n, 3)``, or its transpose, to the entries that begin at ``start``, rows ``width`` apart.

    Nothing is added where ``start`` is negative.
    """
    if start < 0:
        return
    size = 3 * block.shape[0]
    flat = block.reshape(size, size)
    for i in range(size):
        row = entries[start + i * width : start + i * width + size]
        if transposed:
            for k in range(size):
                row[k] += flat[k, i]
        else:
            for k in range(size):
                row[k] += flat[i, k]


class _Work(NamedTuple):
    """Arrays that each element fills anew.

    Rows: derivatives in the section (``across``), and the functions themselves, which stand for those along the axis
    (``whole``). Columns, times the moduli: to rows across, of all nine pairs those along the axis, of six pairs those
    across; to rows along the axis, of six pairs those along it.  Section matrices of each point along the axis: both
    across, mixed, mixed the other way round, both along.
    """

    across: Array
    whole: Array
    to_across: Array
    to_whole: Array
    mixed_plane: Array
    axis: Array
    matrices: Array
    factors: Array
    block: Array


@njit(**FAST)
def _work(section: Array, along: int, functions: int) -> _Work:
    """Return room for elements of so many points and functions along."""
    points, _, n = section.shape
    across = np.empty((n, points, 2))
    whole = np.empty((n, points))
    for q in range(points):
        for i in range(n):
            across[i, q, 0] = section[q, 0, i]
            across[i, q, 1] = section[q, 1, i]
            whole[i, q] = section[q, 2, i]
    pairs = functions * (functions + 1) // 2
    return _Work(
        across,
        whole,
        np.empty((points, 2, 15, n)),
        np.empty((points, 6, n)),
        np.empty((n, 15, n)),
        np.empty((n, 6, n)),
        np.empty((along, 4, n, 3, n, 3)),
        np.empty((pairs, along, 4)),
        np.empty((pairs, n, 3, n, 3)),
    )


@njit(**FAST)
def _blocks(table: Table, e: int, tangent: Array, isotropic: Array, w: _Work) -> None:
    """Fill ``w.block`` with an element's blocks of axis functions ``j <= m``, in this order; moduli are its own."""
    section, axial, slopes = table.section, table.axial[e], table.slopes[e]
    inverse, weights = table.inverse[e], table.weights[e]
    along, functions = axial.shape
    points, _, n = section.shape
    pairs = w.block.shape[0]
    moduli, half = np.empty((3, 3, 9)), np.empty((3, 9))
    for t in range(along):
        for q in range(points):
            if tangent.size:
                _pull_back(moduli, half, weights[t, q], inverse[t, q], tangent[t, q])
            else:
                _pull_back_isotropic(moduli, weights[t, q], inverse[t, q], isotropic[0], isotropic[1])
            for d in range(2):
                for ab in range(9):
                    x = moduli[d, 2, ab]
                    for k in range(n):
                        w.to_across[q, d, ab, k] = x * section[q, 2, k]
                for h in range(6):
                    x = moduli[d, 0, _UPPER[h]]
                    y = moduli[d, 1, _UPPER[h]]
                    for k in range(n):
                        w.to_across[q, d, 9 + h, k] = x * section[q, 0, k] + y * section[q, 1, k]
            for h in range(6):
                x = moduli[2, 2, _UPPER[h]]
                for k in range(n):
                    w.to_whole[q, h, k] = x * section[q, 2, k]
        np.dot(
            w.across.reshape(n, 2 * points), w.to_across.reshape(2 * points, 15 * n), w.mixed_plane.reshape(n, 15 * n)
        )
        np.dot(w.whole, w.to_whole.reshape(points, 6 * n), w.axis.reshape(n, 6 * n))
        for i in range(n):
            for a in range(3):
                for k in range(n):
                    for b in range(3):
                        row, column = (i, k) if a <= b else (k, i)
                        h = _PLACE[3 * a + b]
                        w.matrices[t, 0, i, a, k, b] = w.mixed_plane[row, 9 + h, column]
                        w.matrices[t, 1, i, a, k, b] = w.mixed_plane[i, 3 * a + b, k]
                        w.matrices[t, 2, i, a, k, b] = w.mixed_plane[k, 3 * b + a, i]
                        w.matrices[t, 3, i, a, k, b] = w.axis[row, h, column]
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                w.factors[p, t, 0] = axial[t, j] * axial[t, m]
                w.factors[p, t, 1] = axial[t, j] * slopes[t, m]
                w.factors[p, t, 2] = slopes[t, j] * axial[t, m]
                w.factors[p, t, 3] = slopes[t, j] * slopes[t, m]
                p += 1
    np.dot(
        w.factors.reshape(pairs, 4 * along), w.matrices.reshape(4 * along, 9 * n * n), w.block.reshape(pairs, 9 * n * n)
    )


@njit(F7(TABLE, F7, F2), **FAST)
def stiffness(table: Table, tangent: Array, isotropic: Array) -> Array:
    """Return element matrices ``(E, l, n, 3, l, n, 3)`` of the tangent moduli ``dP/dF`` ``(E, t, q, 3, 3, 3, 3)``.

    The moduli must have major symmetry, as those of a stored energy do.  Where ``t`` and ``q`` are 0 there, each
    element has those of isotropic linear elasticity, Lame's parameters ``isotropic`` ``(E, 2)``, the second one the
    shear modulus.
    """
    elements, along, functions = table.axial.shape
    n = table.section.shape[2]
    work = _work(table.section, along, functions)
    result = np.empty((elements, functions, n, 3, functions, n, 3))
    for e in range(elements):
        _blocks(table, e, tangent[e], isotropic[e], work)
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                _place(result[e], j, m, work.block[p])
                p += 1
    return result


@njit(F1(TABLE, F7, F2, BLOCKS), **FAST)
def merged_stiffness(table: Table, tangent: Array, isotropic: Array, blocks: Blocks) -> Array:
    """Return the sum of the same element matrices as entries, as `isorod.assembly.pattern_kernel.merge` does."""
    elements, along, functions = table.axial.shape
    work = _work(table.section, along, functions)
    start, width = blocks.start, blocks.width
    result = np.zeros(blocks.total)
    for e in range(elements):
        _blocks(table, e, tangent[e], isotropic[e], work)
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                _add(result, start[e, j, m], width[e, j], work.block[p], False)
                if j < m:
                    _add(result, start[e, m, j], width[e, m], work.block[p], True)
                p += 1
    return result
