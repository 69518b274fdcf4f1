"""The element matrices of a tangent, compiled; shapes as in `isorod.assembly.element_kernel`.

Sums over the section's points are products of matrices, left to BLAS, and so are those along the axis.  Of the pairs of
components ``a b`` those with ``a <= b`` will do where rows and columns have the same derivatives.
"""

from typing import NamedTuple

import numpy as np
from numba import types, void

from isorod.arrays import Array, Index
from isorod.assembly.element_kernel import TABLE
from isorod.assembly.pattern_kernel import BLOCKS, Blocks
from isorod.compiled import F1, F2, F7, FAST, njit
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
def _add(entries: Array, start: int, width: int, block: Array, size: int, transposed: bool) -> None:
    """Add a block of ``size`` rows, row by row in ``block``, or its transpose, to the entries that begin at ``start``.

    Rows are ``width`` entries apart; nothing is added where ``start`` is negative.
    """
    if start < 0:
        return
    for i in range(size):
        row = entries[start + i * width : start + i * width + size]
        if transposed:
            for k in range(size):
                row[k] += block[k * size + i]
        else:
            for k in range(size):
                row[k] += block[i * size + k]


class Work(NamedTuple):
    """Arrays that each element fills anew but the first two, shaped as the products of matrices take them.

    Rows: derivatives in the section (``across``, ``(n, 2 q)``), and the functions themselves, which stand for those
    along the axis (``whole``, ``(n, q)``).  Columns, times the moduli: to rows across, of all nine pairs those along
    the axis, of six pairs those across (``to_across``, ``(2 q, 15 n)``); to rows along the axis, of six pairs those
    along it (``to_whole``, ``(q, 6 n)``).  Their products ``mixed_plane`` and ``axis``.  Section matrices of each point
    along the axis, rows of ``n 3 n 3`` entries: both across, mixed, mixed the other way round, both along
    (``matrices``, ``4 t`` rows), their ``factors``, and the ``block`` of each pair of axis functions.
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

    @classmethod
    def of(cls, table: Table) -> "Work":
        """Return room for the elements of a table."""
        _, along, functions = table.axial.shape
        points, _, n = table.section.shape
        pairs = functions * (functions + 1) // 2
        sizes = (
            *((2 * points, 15 * n), (points, 6 * n), (n, 15 * n), (n, 6 * n)),
            *((4 * along, 9 * n * n), (pairs, 4 * along), (pairs, 9 * n * n)),
        )
        room = cls(*(cls.lines(size) for size in ((n, 2 * points), (n, points), *sizes)))
        room.across.reshape(n, points, 2)[:] = table.section[:, :2].transpose(2, 0, 1)
        room.whole[:] = table.section[:, 2].T
        return room

    @staticmethod
    def lines(shape: tuple[int, int]) -> Array:
        """Return an array that begins where a line of the processor's cache does: that saves a tenth of the time."""
        size = shape[0] * shape[1]
        raw = np.empty(size + 7)
        skip = -raw.ctypes.data // 8 % 8
        return raw[skip : skip + size].reshape(shape)


@njit(void(TABLE, F7, F2, BLOCKS, types.NamedUniTuple(F2, 9, Work), F1), **FAST)
def add_stiffness(table: Table, tangent: Array, isotropic: Array, blocks: Blocks, w: Work, entries: Array) -> None:
    """Add the element matrices of the tangent moduli ``dP/dF`` ``(E, t, q, 3, 3, 3, 3)`` to entries (`Blocks`).

    The moduli must have major symmetry, as those of a stored energy do.  Where ``t`` and ``q`` are 0 there, each
    element has those of isotropic linear elasticity, Lame's parameters ``isotropic`` ``(E, 2)``, the second one the
    shear modulus.
    """
    section, axial, slopes, inverse, weights = table.section, table.axial, table.slopes, table.inverse, table.weights
    elements, along, functions = axial.shape
    points, _, n = section.shape
    moduli, half = np.empty((3, 3, 9)), np.empty((3, 9))
    for e in range(elements):
        for t in range(along):
            for q in range(points):
                if tangent.size:
                    _pull_back(moduli, half, weights[e, t, q], inverse[e, t, q], tangent[e, t, q])
                else:
                    _pull_back_isotropic(moduli, weights[e, t, q], inverse[e, t, q], isotropic[e, 0], isotropic[e, 1])
                for d in range(2):
                    row = w.to_across[2 * q + d]
                    for ab in range(9):
                        x = moduli[d, 2, ab]
                        for k in range(n):
                            row[ab * n + k] = x * section[q, 2, k]
                    for h in range(6):
                        x = moduli[d, 0, _UPPER[h]]
                        y = moduli[d, 1, _UPPER[h]]
                        for k in range(n):
                            row[(9 + h) * n + k] = x * section[q, 0, k] + y * section[q, 1, k]
                for h in range(6):
                    x = moduli[2, 2, _UPPER[h]]
                    for k in range(n):
                        w.to_whole[q, h * n + k] = x * section[q, 2, k]
            np.dot(w.across, w.to_across, w.mixed_plane)
            np.dot(w.whole, w.to_whole, w.axis)
            place = 0
            for i in range(n):
                for a in range(3):
                    for k in range(n):
                        for b in range(3):
                            first, second = (i, k) if a <= b else (k, i)
                            h = _PLACE[3 * a + b]
                            w.matrices[4 * t, place] = w.mixed_plane[first, (9 + h) * n + second]
                            w.matrices[4 * t + 1, place] = w.mixed_plane[i, (3 * a + b) * n + k]
                            w.matrices[4 * t + 2, place] = w.mixed_plane[k, (3 * b + a) * n + i]
                            w.matrices[4 * t + 3, place] = w.axis[first, h * n + second]
                            place += 1
            p = 0
            for j in range(functions):
                for m in range(j, functions):
                    w.factors[p, 4 * t] = axial[e, t, j] * axial[e, t, m]
                    w.factors[p, 4 * t + 1] = axial[e, t, j] * slopes[e, t, m]
                    w.factors[p, 4 * t + 2] = slopes[e, t, j] * axial[e, t, m]
                    w.factors[p, 4 * t + 3] = slopes[e, t, j] * slopes[e, t, m]
                    p += 1
        np.dot(w.factors, w.matrices, w.block)
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                for turn in range(2 if j < m else 1):
                    first, second = (j, m) if turn == 0 else (m, j)
                    start, width = blocks.start[e, first, second], blocks.width[e, first]
                    _add(entries, start, width, w.block[p], 3 * n, turn == 1)
                p += 1
