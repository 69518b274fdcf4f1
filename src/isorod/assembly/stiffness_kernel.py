"""The element matrices of a tangent, compiled; shapes as in `isorod.assembly.element_kernel`.

Moduli are evaluated block by block (`isorod.assembly.block_kernel`), pulled back to disk x axis and multiplied, as
matrices, with products of pairs of section functions: at all points of a section at once, or at some of many.  The
section matrices at places along the axis are summed with products of axis functions.  Where rows and columns have the
same derivatives, pairs of components ``a b`` with ``a <= b`` suffice.
"""

from typing import Any

import numpy as np
from numba import i8, types, void

from isorod.arrays import Array
from isorod.assembly.block_kernel import BEFORE, PRESSURE, SIZE, STATE, STEPS, Steps
from isorod.assembly.element_kernel import TABLE
from isorod.assembly.field_kernel import (
    FIELD,
    FUNCTIONS,
    PRESSURES,
    PRESSURES_BEFORE,
    Field,
    Functions,
    fill_runs,
    take,
    take_gradients,
    take_known,
)
from isorod.assembly.moduli_rows import moduli_rows
from isorod.assembly.pattern_kernel import BLOCKS, Blocks
from isorod.compiled import F1, F2, FAST, njit
from isorod.material.points import GRADIENT, MODULI, POINTS, call_block, call_step, call_tangent
from isorod.material.points import ROWS as _R
from isorod.space.space import Table

_1, _2, _3, _4 = (np.uint64(k) for k in range(1, 5))

# Matrices of both components across, of one component's own, of one across and one along, of both along.
FOUR = types.UniTuple(F2, 4)

# For each of the nine pairs of components ``3 a + b``: its number, or its transpose's, among 01, 02, 12, 00, 11, 22.
_PAIR = np.array([3, 0, 1, 0, 4, 2, 1, 2, 5])

# The matrix, of four, of each of a block's rows of moduli, and its row there at a place.
_MATRIX, _ROW = moduli_rows()
# Rows a place of each matrix, and of all matrices before it.
_ROWS, _BEFORE = np.array([12, 9, 18, 6]), np.array([0, 12, 21, 39])


@njit(void(TABLE, i8, i8, FOUR), **FAST)
def multiply(table: Table, begin: int, end: int, products: tuple[Array, Array, Array, Array]) -> None:
    """Fill in products of two section functions ``i k``, a column each, at points from ``begin`` to before ``end``.

    Both across, of the directions 00, 01, 10, 11 (``plane``) or 00, 01 + 10, 11 (``square``); the first across, in
    directions 0 and 1 (``mixed``); neither (``axis``).  Rows: direction by direction, point by point.
    """
    plane, square, mixed, axis = products
    points = end - begin
    for p in range(points):
        f, g, h = table.section[begin + p, 0], table.section[begin + p, 1], table.section[begin + p, 2]
        _outer(f, f, plane[p])
        _outer(f, g, plane[points + p])
        _outer(g, f, plane[2 * points + p])
        _outer(g, g, plane[3 * points + p])
        for k in range(square.shape[1]):
            square[p, k] = plane[p, k]
            square[points + p, k] = plane[points + p, k] + plane[2 * points + p, k]
            square[2 * points + p, k] = plane[3 * points + p, k]
        _outer(f, h, mixed[p])
        _outer(g, h, mixed[points + p])
        _outer(h, h, axis[p])


@njit(**FAST)
def _outer(first: Array, second: Array, products: Array) -> None:
    """Fill in the products of all of the first with all of the second, as one row."""
    n = np.uint64(second.size)
    for i in range(np.uint64(first.size)):
        x, at = first[i], i * n
        for k in range(n):
            products[at + k] = x * second[k]


@njit(void(FUNCTIONS, STEPS, F2, FIELD, FIELD, types.UniTuple(i8, 2), F1), **FAST)
def moduli(
    law: Functions, steps: Steps, known: Array, now: Field, last: Field, span: tuple[int, int], pulled: Array
) -> None:
    """Fill in the moduli on disk x axis, ordered as the products of section functions are (`multiply`).

    Parameters
    ----------
    law, steps, known
        As for `isorod.assembly.field_kernel.stresses`.
    now, last
        The present field, and that at the last tangent if the stress is extrapolated from it.
    span
        The points are those of the section from the first to before the second.
    pulled
        To be filled with four matrices (`FOUR`), one behind the other.  Rows: place by place, of the pairs 01, 02, 12,
        of 00, 11, 22, of all nine, of the former six.
    """
    begin, end = span
    points, places = end - begin, now.along.shape[0] // 3
    work, runs = np.zeros(SIZE), np.empty((POINTS, 4), np.int64)
    for block in range(-(-places * points // POINTS)):
        these = runs[: fill_runs(block, places, begin, end, runs)]
        take_known(known, places, these, work)
        if steps.press:
            take(now.pressure, PRESSURES, these, work)
        # With extrapolation three passes: F of the present state, stress and moduli of the last, then of the present.
        for turn in range(0 if steps.foresee else 2, 3):
            if turn == 1:
                # Swap present and last pressure; swapped back below.
                if steps.press:
                    take(last.pressure, PRESSURES_BEFORE, these, work)
                    _swap(work)
                take_gradients(last, these, work)
            else:
                take_gradients(now, these, work)
            call_step(np.uint64(steps.deform), (work,))
            if turn == 0:
                for k in range(np.uint64(10 * POINTS)):
                    work[_R[STATE] + k] = work[_R[GRADIENT] + k]
                continue
            for k in range(np.uint64(45 * POINTS)):
                work[_R[MODULI] + k] = 0.0
            call_block(np.uint64(law.block), (work, law.constants, 1.0, False))
            call_tangent(np.uint64(law.tangent), (work, law.constants, 1.0))
            if steps.press:
                call_step(np.uint64(steps.press), (work,))
            if steps.press_moduli:
                call_step(np.uint64(steps.press_moduli), (work,))
            if turn == 1:
                call_step(np.uint64(steps.foresee), (work,))
                if steps.press:
                    _swap(work)
                    call_step(np.uint64(steps.press_on), (work,))
            elif steps.exceed:
                call_step(np.uint64(steps.exceed), (work,))
        call_step(np.uint64(steps.pull_back), (work,))
        for i in range(these.shape[0]):
            place, p, at, length = these[i, 0], these[i, 1] - begin, these[i, 2], these[i, 3]
            for r in range(45):
                matrix = _MATRIX[r]
                to = (_BEFORE[matrix] * places + _ROWS[matrix] * place + _ROW[r]) * points + p
                _copy(work, (MODULI + r) * POINTS + at, pulled, to, length)


@njit(**FAST)
def _copy(work: Array, at: Any, target: Array, to: Any, length: int) -> None:
    """Copy a run of a row of a block."""
    at, to = np.uint64(at), np.uint64(to)
    for k in range(np.uint64(length)):
        target[to + k] = work[at + k]


@njit(**FAST)
def _swap(work: Array) -> None:
    """Swap present and last pressure."""
    for k in range(np.uint64(POINTS)):
        x = work[_R[BEFORE] + k]
        work[_R[BEFORE] + k] = work[_R[PRESSURE] + k]
        work[_R[PRESSURE] + k] = x


@njit(void(TABLE, i8, i8, FOUR, BLOCKS, F1), **FAST)
def add_blocks(
    table: Table, first: int, last: int, sums: tuple[Array, Array, Array, Array], blocks: Blocks, entries: Array
) -> None:
    """Add the element matrices of elements ``first .. last - 1``, summed from section matrices, to entries (`Blocks`).

    Rows of ``sums``: one for each place along the axis, with pairs of components ``n n`` in the order of the moduli.
    """
    along, functions = table.axial.shape[1:]
    n = table.section.shape[2]
    nn = n * n
    pairs = functions * (functions + 1) // 2
    # Products of both functions and of both derivatives, a pair a row; of functions with the second's derivative.
    alike, steep = np.empty((pairs, along)), np.empty((pairs, along))
    second = np.empty((functions * functions, along))
    both, one = np.empty((pairs, 6 * nn)), np.empty((functions * functions, 9 * nn))
    factors, totals = (alike, alike, second, steep), (both, both, one, both)
    for e in range(first, last):
        p = 0
        for j in range(functions):
            for m in range(functions):
                for t in range(along):
                    second[j * functions + m, t] = table.axial[e, t, j] * table.slopes[e, t, m]
                if m < j:
                    continue
                for t in range(along):
                    alike[p, t] = table.axial[e, t, j] * table.axial[e, t, m]
                    steep[p, t] = table.slopes[e, t, j] * table.slopes[e, t, m]
                p += 1
        s = (e - first) * along
        both[:] = 0.0
        one[:] = 0.0
        # Loops, since each call in the source would be compiled separately.
        for g in range(4):
            _combine(factors[g], sums[g], s, totals[g], 3 * nn if g == 1 else 0)
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                jm, mj = j * functions + m, m * functions + j
                for turn in range(2 if m > j else 1):
                    row, column = (m, j) if turn else (j, m)
                    start, width = blocks.start[e, row, column], blocks.width[e, row, column]
                    _scatter((both[p], one[jm], one[mj]), n, start, width, turn == 1, entries)
                p += 1


@njit(**FAST)
def _combine(factors: Array, rows: Array, first: int, sums: Array, column: int) -> None:
    """Add the products of factors ``(p, t)`` with ``t`` rows, from the first on, to columns of sums ``(p, ...)``.

    BLAS is slow at such small products.
    """
    count, s, c = np.uint64(rows.shape[1]), np.uint64(first), np.uint64(column)
    along = factors.shape[1]
    for p in range(np.uint64(factors.shape[0])):
        t = np.uint64(0)
        while t + _3 < along:
            w, x, y, z = factors[p, t], factors[p, t + _1], factors[p, t + _2], factors[p, t + _3]
            r = s + t
            for k in range(count):
                sums[p, c + k] += w * rows[r, k] + x * rows[r + _1, k] + y * rows[r + _2, k] + z * rows[r + _3, k]
            t += _4
        while t < along:
            x = factors[p, t]
            for k in range(count):
                sums[p, c + k] += x * rows[s + t, k]
            t += _1


@njit(**FAST)
def _scatter(sums: tuple[Array, ...], n: int, start: int, width: int, transposed: bool, entries: Array) -> None:
    """Add a block of an element matrix, or its transpose, to the entries from ``start`` on, if it is not negative.

    Parameters
    ----------
    sums
        Terms with the same derivatives of both functions, of six pairs of components, shape ``(6 n n,)``; terms with
        the second's derivative along the axis, of all nine pairs; the latter of the transposed block.
    """
    if start < 0:
        return
    both, second, first = sums
    count, rows, begin = np.uint64(n), np.uint64(width), np.uint64(start)
    nn = count * count
    for a in range(_3):
        for b in range(_3):
            # Of ``(i, a), (k, b)``, or where rows are those of the second function of ``(k, b), (i, a)``.
            alike, own, other = np.uint64(_PAIR[_3 * a + b]) * nn, (_3 * a + b) * nn, (_3 * b + a) * nn
            across, down = (_1, count) if a <= b else (count, _1)
            for i in range(count):
                for k in range(count):
                    value = (
                        both[alike + i * down + k * across] + second[own + i * count + k] + first[other + k * count + i]
                    )
                    if transposed:
                        entries[begin + (_3 * k + b) * rows + _3 * i + a] += value
                    else:
                        entries[begin + (_3 * i + a) * rows + _3 * k + b] += value
