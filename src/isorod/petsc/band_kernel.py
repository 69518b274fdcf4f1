"""Cholesky's factors of banded symmetric matrices in panels, by LAPACK and BLAS, and solves with them.

Columns are taken in panels of those that reach equally far down, as the unknowns of one layer of a rod do.  The lower
band is kept column by column, entry ``(i, j)`` at ``j W + i`` of the whole, where ``W + 1`` is the length of a column:
with ``W`` for the leading dimension, every block of the band is a dense matrix to BLAS.  Thus a panel takes three
calls, and no entries but those in the band's envelope.

Only the first columns need be eliminated: what is left in the others is the Schur complement.
"""

from typing import Any

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, FAST, I1, STRICT, njit
from isorod.petsc.blas import dgemm, dpotrf, dsyrk, dtrsm
from isorod.petsc.rows import P1

# Columns that reach differently far are one panel up to so many, and those that reach equally far are cut after so
# many (measured: widths from 40 to 300).
_LEAST, MOST = 8, 64

BYTES, NUMBERS = types.Array(types.uint8, 1, "C"), types.Array(types.int32, 1, "C")
WORD, UNIT = np.array([*b"LRTN"], dtype=np.uint8), np.array([1.0, -1.0])

# What `eliminate` keeps of how far it is: the next panel; the first columns in the band and in the border's buffer;
# the columns that were cleared, and those that were filled, so far; of the entries given apart, the next; the number of
# panels, and of negative pivots.
PANEL, BASE, BORDER_BASE, CLEARED, FILLED, APART, COUNT, NEGATIVE = range(8)

# A negative pivot is taken where it adds no more than this many times the largest entry on the diagonal to it.
_GROWTH = 10.0


@njit(i8(P1, P1, i8, i8, b1, I1), **STRICT)
def reaches(start: Any, column: Any, first: int, own: int, backward: bool, reach: Any) -> int:
    """Raise how far down columns reach, ``(n,)``, to where rows have entries and to where columns before them reach.

    Column ``j`` of ``own`` is row ``first + j``, or backward ``first + own - 1 - j``, of compressed rows; entries at
    columns before ``first`` come, backward, after those.
    """
    last = 0
    for j in range(reach.size):
        if j < own:
            i = first + own - 1 - j if backward else first + j
            if start[i + 1] > start[i]:
                farthest = i - column[start[i]] if backward else column[start[i + 1] - 1] - i
                reach[j] = max(reach[j], j + farthest + 1)
        last = max(last, reach[j], j + 1)
        reach[j] = last
    return last


@njit(i8(I1, I1, I1), **STRICT)
def panels(reach: Any, cut: Any, end: Any) -> int:
    """Fill in the first column of each panel, and its last row plus 1; return their number."""
    count = 0
    c = 0
    while c < reach.size:
        j = c + 1
        while j < reach.size and j - c < MOST and (reach[j] == reach[c] or j - c < _LEAST):
            j += 1
        cut[count], end[count] = c, reach[j - 1]
        count += 1
        c = j
    cut[count] = c
    return count


@njit(i8(P1, P1, F1, i8, i8, i8, b1, I1, I1, F1, I1, I1, F1, i8, F1, F2, F2, I1, F1, BYTES, NUMBERS, F1), **STRICT)
def eliminate(
    start: Any,
    column: Any,
    values: Any,
    first: int,
    own: int,
    total: int,
    backward: bool,
    apart_column: Any,
    apart_row: Any,
    apart: Any,
    cut: Any,
    end: Any,
    a: Any,
    width: int,
    edge: Any,
    corner: Any,
    block: Any,
    state: Any,
    scale: Any,
    word: Any,
    number: Any,
    unit: Any,
) -> int:
    """Eliminate panels, from where the state says; return their number, or which one cannot be as it is.

    A panel is cut before and after the first pivot that is not positive.  That one, where little is lost by it, is a
    panel by itself, with a negative entry on the diagonal of ``L``: its sign is that of ``J``.

    Parameters
    ----------
    start, column, values, first, own, backward
        The matrix, as `reaches` takes it.
    total
        Number of columns, those included that have no rows here.
    apart_column, apart_row, apart
        More entries below the diagonal, by ascending columns.
    cut, end
        `panels`, as many as the state says, with room for one a column.
    a, width : (columns (W + 1),), W
        The band becomes the factors; if it has room for less than all columns, each is forgotten when room is needed.
    edge, corner : (rows s,), (s, s)
        A border of more unknowns, coupled to the first columns, row by row, and their own block: it becomes their
        Schur complement, in the upper triangle, and the border, its last rows, what couples them to the columns that
        are left.
    block : (MOST, MOST)
        Receives the diagonal block of the panel that cannot be eliminated.
    state : (8,)
    scale : (1,)
        Raised to the largest entry on the matrix' diagonal so far.
    word, number, unit
        `WORD`, room for five integers, and `UNIT`, to be given to Fortran.
    """
    sides = corner.shape[0]
    size, rows = a.size // (width + 1), 0
    if sides:
        rows = edge.size // sides
    lower, right, transposed, plain = word[0:].ctypes, word[1:].ctypes, word[2:].ctypes, word[3:].ctypes
    number[2], number[3] = width, sides
    order, height, lead = number[0:].ctypes, number[1:].ctypes, number[2:].ctypes
    beside, result = number[3:].ctypes, number[4:].ctypes
    one, minus = unit[0:].ctypes, unit[1:].ctypes
    k = state[PANEL]
    while True:
        last = k == state[COUNT]
        c, c1 = cut[k], own if last else cut[k + 1]
        bottom = total if last else end[k]
        if bottom - state[BASE] > size:
            gone = (c - state[BASE]) * (width + 1)
            for e in range((state[CLEARED] - c) * (width + 1)):
                a[e] = a[gone + e]
            state[BASE] = c
        if sides and bottom - state[BORDER_BASE] > rows:
            gone = (c - state[BORDER_BASE]) * sides
            for e in range(edge.size):
                edge[e] = edge[gone + e] if gone + e < edge.size else 0.0
            state[BORDER_BASE] = c
        for e in range((state[CLEARED] - state[BASE]) * (width + 1), (bottom - state[BASE]) * (width + 1)):
            a[e] = 0.0
        state[CLEARED] = max(state[CLEARED], bottom)
        for j in range(state[FILLED], c1 if c1 < own else own):
            i = first + own - 1 - j if backward else first + j
            low, high = start[i], start[i + 1]
            at = (j - state[BASE]) * (width + 1)
            if high > low and column[low] <= i <= column[high - 1] == column[low] + high - 1 - low:
                # Nothing is left out, as in nearly all rows: the entries lie side by side.
                here = low + i - column[low]
                scale[0] = max(scale[0], abs(values[here]))
                if backward:
                    for e in range(here - low + 1):
                        a[at + e] += values[here - e]
                else:
                    for e in range(high - here):
                        a[at + e] += values[here + e]
                continue
            for e in range(low, high):
                if column[e] == i:
                    scale[0] = max(scale[0], abs(values[e]))
                if (column[e] <= i) if backward else (column[e] >= i):
                    a[at + abs(column[e] - i)] += values[e]
        state[FILLED] = max(state[FILLED], c1)
        while state[APART] < apart.size and apart_column[state[APART]] < c1:
            j, i = apart_column[state[APART]], apart_row[state[APART]]
            a[(j - state[BASE]) * (width + 1) + i - j] += apart[state[APART]]
            state[APART] += 1
        if last:
            break
        n, h = c1 - c, end[k] - c1
        number[0], number[1] = n, h
        o = (c - state[BASE]) * (width + 1)
        for j in range(n):
            for i in range(j, n):
                block[j, i] = a[o + j * width + i]
        diagonal = a[o:].ctypes
        dpotrf(lower, order, diagonal, lead, result)
        sign, positive = minus, number[4] == 0
        if not positive:
            for j in range(n):
                for i in range(j, n):
                    a[o + j * width + i] = block[j, i]
            if number[4] > 1:
                # What comes before the pivot that is not positive is a panel.
                _divide(cut, end, k, c + number[4] - 1, state)
                continue
            if not _is_mild(a[o : o + bottom - c], scale[0]):
                state[PANEL] = k
                return k
            if n > 1:
                _divide(cut, end, k, c + 1, state)
                n, h = 1, bottom - c - 1
                number[0], number[1] = n, h
            root = np.sqrt(-a[o])
            a[o] = -root
            for e in range(o + 1, o + bottom - c):
                a[e] /= root
            state[NEGATIVE] += 1
            sign = one
        below = a[o + n :].ctypes
        if h:
            if positive:
                dtrsm(right, lower, transposed, plain, height, order, one, diagonal, lead, below, lead)
            rest = a[o + n * (width + 1) :].ctypes
            dsyrk(lower, plain, height, order, sign, below, lead, one, rest, lead)
        if sides:
            q = (c - state[BORDER_BASE]) * sides
            mine = edge[q:].ctypes
            if positive:
                dtrsm(right, lower, transposed, plain, beside, order, one, diagonal, lead, mine, beside)
            else:
                for e in range(q, q + sides):
                    edge[e] /= -a[o]
            dsyrk(lower, plain, beside, order, sign, mine, beside, one, corner.ctypes, beside)
            if h:
                others = edge[q + n * sides :].ctypes
                dgemm(plain, transposed, beside, height, order, sign, mine, beside, below, lead, one, others, beside)
        k += 1
    state[PANEL] = k
    return k


@njit(**STRICT)
def _divide(cut: Any, end: Any, k: int, column: int, state: Any) -> None:
    """Divide a panel before one of its columns."""
    for m in range(state[COUNT], k, -1):
        cut[m + 1] = cut[m]
        end[m] = end[m - 1]
    cut[k + 1] = column
    state[COUNT] += 1


@njit(**STRICT)
def _is_mild(column: Any, scale: float) -> bool:
    """Return whether a column with a negative pivot adds little to what is below it, and the pivot is not huge."""
    pivot = -column[0]
    if not 0.0 < pivot <= _GROWTH * scale:
        return False
    largest = 0.0
    for e in range(1, column.size):
        largest = max(largest, abs(column[e]))
    return bool(largest * largest <= _GROWTH * scale * pivot)


@njit(void(F2, I1, I1, I1, F3, F1), **FAST)
def forward(band: Any, cut: Any, end: Any, odd: Any, inverse: Any, x: Any) -> None:
    """Solve ``L y = x`` in place; what is left of the unknowns that were not eliminated is their right-hand side.

    Of the panels that were not positive definite, ``odd``, ``inverse`` has those of their blocks of ``L``.
    """
    next_odd = 0
    for k in range(end.size):
        j, c1, bottom = cut[k], cut[k + 1], end[k]
        if next_odd < odd.size and odd[next_odd] == k:
            _multiply(inverse[next_odd], x[j:c1], False)
            next_odd += 1
            for i in range(j, c1):
                _subtract(band[i, c1 - i :], x[i], x[c1:bottom])
            continue
        # Two columns at a time: what is subtracted from passes through memory half as often.
        while j + 1 < c1:
            one, two = band[j], band[j + 1]
            a = x[j] / one[0]
            b = (x[j + 1] - one[1] * a) / two[0]
            x[j], x[j + 1] = a, b
            one, two, rest = one[2:], two[1:], x[j + 2 : bottom]
            for i in range(rest.size):
                rest[i] -= one[i] * a + two[i] * b
            j += 2
        if j < c1:
            x[j] /= band[j, 0]
            _subtract(band[j, 1:], x[j], x[j + 1 : bottom])


@njit(void(F2, I1, I1, I1, F3, F2, F1), **FAST)
def back(band: Any, cut: Any, end: Any, odd: Any, inverse: Any, sign: Any, x: Any) -> None:
    """Solve ``L^T x = J y`` in place, given the unknowns that were not eliminated; ``sign`` is ``J`` of odd panels.

    Of others ``J`` is the sign of the diagonal of ``L``.
    """
    next_odd = odd.size - 1
    for k in range(end.size - 1, -1, -1):
        c, j, bottom = cut[k], cut[k + 1] - 1, end[k]
        if next_odd >= 0 and odd[next_odd] == k:
            for i in range(c, j + 1):
                x[i] = sign[next_odd, i - c] * x[i] - _dot(band[i, j + 1 - i :], x[j + 1 : bottom])
            _multiply(inverse[next_odd], x[c : j + 1], True)
            next_odd -= 1
            continue
        while j > c:
            one, two, rest = band[j - 1], band[j], x[j + 1 : bottom]
            below_one, below_two = one[2:], two[1:]
            a = b = 0.0
            for i in range(rest.size):
                a += below_one[i] * rest[i]
                b += below_two[i] * rest[i]
            x[j] = (np.copysign(1.0, two[0]) * x[j] - b) / two[0]
            x[j - 1] = (np.copysign(1.0, one[0]) * x[j - 1] - a - one[1] * x[j]) / one[0]
            j -= 2
        if j == c:
            x[j] = (np.copysign(1.0, band[j, 0]) * x[j] - _dot(band[j, 1:], x[j + 1 : bottom])) / band[j, 0]


@njit(void(F1, f8, F1), **FAST)
def _subtract(factors: Array, amount: float, x: Array) -> None:
    for i in range(x.size):
        x[i] -= amount * factors[i]


@njit(f8(F1, F1), **FAST)
def _dot(factors: Array, x: Array) -> float:
    total = 0.0
    for i in range(x.size):
        total += factors[i] * x[i]
    return total


@njit(void(F2, F1, b1), **FAST)
def _multiply(matrix: Array, x: Array, transposed: bool) -> None:
    """Multiply by the leading block of a matrix in place."""
    before = x.copy()
    for i in range(x.size):
        x[i] = 0.0
        for j in range(x.size):
            x[i] += (matrix[j, i] if transposed else matrix[i, j]) * before[j]
