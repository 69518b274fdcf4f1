"""Cholesky's factors of banded symmetric matrices in panels, by LAPACK and BLAS, and solves with them.

Columns are taken in panels of those that reach equally far down, as the unknowns of one layer of a rod do.  The lower
band is stored column by column, entry ``(i, j)`` at ``j W + i``, where ``W + 1`` is the length of a column: with ``W``
as the leading dimension, every block of the band is a dense matrix to BLAS.  Thus a panel takes three calls, on entries
in the band's envelope only.

If only the first columns are eliminated, the others hold the Schur complement.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import b1, f8, from_dtype, i8, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, F3, FAST, I1, STRICT, njit
from isorod.petsc.blas import add_product, add_square, divide, factorise
from isorod.petsc.rows import P1, Compressed

# Fewest columns of a panel, whether or not they reach equally far, and most columns (measured: widths from 40 to 300).
_LEAST, MOST = 8, 64

# A negative pivot is taken where it adds no more than this many times the largest entry on the diagonal to it.
_GROWTH = 10.0

_NOTHING = np.empty(0, dtype=np.int64)


class Ordered(NamedTuple):
    """A symmetric matrix, and a border of ``s`` more unknowns, in the order of elimination.

    Attributes
    ----------
    rows, first, own, backward
        Column ``j`` of ``own`` is row ``first + j``, or backward ``first + own - 1 - j``, of compressed rows; entries
        at columns before ``first`` come, backward, after those.
    apart
        Columns, ascending, rows and values of more entries below the diagonal.
    after
        Number of unknowns that come behind and have no rows here.
    border, corner : (own, s), (s, s)
        What couples the border to the first columns, and its own block.
    """

    rows: Compressed
    first: int
    own: int
    backward: bool = False
    apart: tuple[Index, Index, Array] = (_NOTHING, _NOTHING, np.empty(0))
    after: int = 0
    border: Array = np.empty((1, 0))
    corner: Array = np.empty((0, 0))


# How far `eliminate` is.
PROGRESS = np.dtype(
    [
        # The next panel, the number of panels, and of negative pivots so far.
        ("panel", np.int64),
        ("panels", np.int64),
        ("negative", np.int64),
        # The first columns in the band and in the border.
        ("band", np.int64),
        ("border", np.int64),
        # Columns that were cleared, and those that have their entries; of the entries given apart, the next.
        ("cleared", np.int64),
        ("filled", np.int64),
        ("apart", np.int64),
        # The largest entry on the matrix' diagonal.
        ("scale", np.float64),
    ]
)


class Elimination(NamedTuple):
    """What `eliminate` works on.

    Attributes
    ----------
    cut, end
        `panels`, with room for one a column.
    band : (columns, W + 1)
        Becomes the factors; if it has room for less than all columns, each is forgotten when room is needed.
    border, corner : (columns, s), (s, s)
        Those of the matrix, the first with zeros behind.  They become the border's Schur complement, the corner in the
        upper triangle, the border what couples it to the columns that are left.
    block : (MOST, MOST)
        Receives the diagonal block of the panel that cannot be eliminated.
    progress : (1,)
        `PROGRESS`.
    """

    cut: Index
    end: Index
    band: Array
    border: Array
    corner: Array
    block: Array
    progress: Any


_COMPRESSED = types.NamedTuple([P1, P1, F1], Compressed)
_ORDERED = types.NamedTuple([_COMPRESSED, i8, i8, b1, types.Tuple([I1, I1, F1]), i8, F2, F2], Ordered)
_ELIMINATION = types.NamedTuple([I1, I1, F2, F2, F2, F2, types.Array(from_dtype(PROGRESS), 1, "C")], Elimination)


@njit(i8(_ORDERED, I1), **STRICT)
def reaches(matrix: Ordered, reach: Any) -> int:
    """Raise how far down columns reach, ``(n,)``, to where rows have entries and to where columns before them reach."""
    start, column, last = matrix.rows.start, matrix.rows.column, 0
    for j in range(reach.size):
        if j < matrix.own:
            i = _row(matrix, j)
            if start[i + 1] > start[i]:
                farthest = i - column[start[i]] if matrix.backward else column[start[i + 1] - 1] - i
                reach[j] = max(reach[j], j + farthest + 1)
        last = max(last, reach[j], j + 1)
        reach[j] = last
    return last


@njit(**STRICT)
def _row(matrix: Ordered, j: int) -> int:
    """Return the row of a column in the order of elimination."""
    return matrix.first + matrix.own - 1 - j if matrix.backward else matrix.first + j


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


@njit(i8(_ORDERED, _ELIMINATION), **STRICT)
def eliminate(matrix: Ordered, work: Elimination) -> int:
    """Eliminate panels, from the next one on; return their number, or which one cannot be eliminated as it is.

    A panel is cut before and after the first pivot that is not positive.  That one, where little is lost by it, is a
    panel by itself, with a negative entry on the diagonal of ``L``: its sign is that of ``J``.
    """
    cut, end, now = work.cut, work.end, work.progress[0]
    flat, width, sides = work.band.reshape(-1), work.band.shape[1] - 1, work.border.shape[1]
    corner = work.corner.reshape(-1)
    k = now.panel
    while k < now.panels:
        c, c1, bottom = cut[k], cut[k + 1], end[k]
        _make_room(work, c, bottom)
        _fill(matrix, work, c1)
        n, h = c1 - c, bottom - c1
        diagonal = flat[(c - now.band) * (width + 1) :]
        for j in range(n):
            for i in range(j, n):
                work.block[j, i] = diagonal[j * width + i]
        failed = factorise(diagonal, width, n)
        if failed:
            for j in range(n):
                for i in range(j, n):
                    diagonal[j * width + i] = work.block[j, i]
            if failed > 1:
                # What comes before the pivot that is not positive is a panel.
                _cut_panel(work, k, c + failed - 1)
                continue
            if not _is_mild(diagonal[: bottom - c], now.scale):
                break
            if n > 1:
                _cut_panel(work, k, c + 1)
                n, h = 1, bottom - c - 1
            root = np.sqrt(-diagonal[0])
            diagonal[0] = -root
            for e in range(1, bottom - c):
                diagonal[e] /= root
            now.negative += 1
        sign = 1.0 if failed else -1.0
        below = diagonal[n:]
        if h:
            if not failed:
                divide(below, width, h, n, diagonal, width)
            add_square(diagonal[n * (width + 1) :], width, h, n, sign, below, width)
        if sides:
            border = work.border[c - now.border :]
            mine = border.reshape(-1)
            if failed:
                for e in range(sides):
                    border[0, e] /= root
            else:
                divide(mine, sides, sides, n, diagonal, width)
            add_square(corner, sides, sides, n, sign, mine, sides)
            if h:
                add_product(border[n:].reshape(-1), sides, h, n, sign, mine, below, width)
        k += 1
    now.panel = k
    if k == now.panels:
        total = matrix.own + matrix.after
        _make_room(work, cut[k], total)
        _fill(matrix, work, matrix.own)
    return k


@njit(**STRICT)
def _make_room(work: Elimination, c: int, bottom: int) -> None:
    """Forget columns before ``c`` where there is no room for those before ``bottom``, and clear what is new."""
    now, band, border = work.progress[0], work.band, work.border
    if bottom - now.band > band.shape[0]:
        # Number by number: rows at once are 30 functions more to compile.
        for j in range(now.cleared - c):
            for e in range(band.shape[1]):
                band[j, e] = band[c - now.band + j, e]
        now.band = c
    if border.size and bottom - now.border > border.shape[0]:
        left = max(border.shape[0] - (c - now.border), 0)
        for j in range(left):
            for e in range(border.shape[1]):
                border[j, e] = border[c - now.border + j, e]
        border[left:] = 0.0
        now.border = c
    for j in range(now.cleared, bottom):
        band[j - now.band] = 0.0
    now.cleared = max(now.cleared, bottom)


@njit(**STRICT)
def _fill(matrix: Ordered, work: Elimination, c1: int) -> None:
    """Add the matrix' entries to the columns before ``c1`` that have not got them."""
    now, start, column, values = work.progress[0], matrix.rows.start, matrix.rows.column, matrix.rows.values
    for j in range(now.filled, min(c1, matrix.own)):
        i, into = _row(matrix, j), work.band[j - now.band]
        low, high = start[i], start[i + 1]
        if high > low and column[low] <= i <= column[high - 1] == column[low] + high - 1 - low:
            # Nothing is left out, as in nearly all rows: the entries lie side by side.
            here = low + i - column[low]
            now.scale = max(now.scale, abs(values[here]))
            if matrix.backward:
                for e in range(here - low + 1):
                    into[e] += values[here - e]
            else:
                for e in range(high - here):
                    into[e] += values[here + e]
            continue
        for e in range(low, high):
            if column[e] == i:
                now.scale = max(now.scale, abs(values[e]))
            if (column[e] <= i) if matrix.backward else (column[e] >= i):
                into[abs(column[e] - i)] += values[e]
    now.filled = max(now.filled, c1)
    columns, rows, more = matrix.apart
    while now.apart < more.size and columns[now.apart] < c1:
        j = columns[now.apart]
        work.band[j - now.band, rows[now.apart] - j] += more[now.apart]
        now.apart += 1


@njit(**STRICT)
def _cut_panel(work: Elimination, k: int, column: int) -> None:
    """Cut a panel before one of its columns."""
    cut, end, now = work.cut, work.end, work.progress[0]
    for m in range(now.panels, k, -1):
        cut[m + 1] = cut[m]
        end[m] = end[m - 1]
    cut[k + 1] = column
    now.panels += 1


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
