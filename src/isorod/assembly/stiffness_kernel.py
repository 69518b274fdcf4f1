"""The element matrices of a tangent, compiled; shapes as in `isorod.assembly.element_kernel`.

Moduli are evaluated block by block where they are wanted (`isorod.assembly.block_kernel`), pulled back to disk x axis
and left to products of matrices with those of pairs of section functions: all a section's points at once, or some where
there are many.  What that leaves at each place along the axis is summed up with products of axis functions.  Of the
pairs of components ``a b`` those with ``a <= b`` will do where rows and columns have the same derivatives.
"""

import numpy as np
from numba import b1, i8, types, void

from isorod.arrays import Array
from isorod.assembly.block_kernel import (
    BEFORE,
    PRESSURE,
    SIZE,
    STATE,
    deform,
    exceed,
    foresee,
    press,
    press_moduli,
    press_on,
    pull_back_moduli,
)
from isorod.assembly.element_kernel import TABLE
from isorod.assembly.field_kernel import (
    FIBRES,
    FUNCTIONS,
    GRADIENTS,
    Functions,
    evaluate,
    put,
    run,
    take_fibres,
    take_geometry,
    take_gradients,
    take_rows,
)
from isorod.assembly.pattern_kernel import BLOCKS, Blocks
from isorod.compiled import F1, F2, FAST, njit
from isorod.material.points import GRADIENT, MODULI, POINTS, SQUARES, call_tangent
from isorod.material.points import ROWS as _R
from isorod.space.space import Table

_1, _2, _3, _4 = (np.uint64(k) for k in range(1, 5))

# Matrices of both components across, of one component's own, of one across and one along, of both along.
FOUR = types.UniTuple(F2, 4)

# Of the nine pairs of components ``3 a + b``: which of the six (01, 02, 12, 00, 11, 22) it or its mirror image is.
_PAIR = np.array([3, 0, 1, 0, 4, 2, 1, 2, 5])
# The pairs 01, 02, 12, and 10, 20, 21, among the nine.
_UP, _LOW = np.array([1, 2, 5]), np.array([3, 6, 7])


@njit(void(TABLE, i8, i8, FOUR), **FAST)
def multiply(table: Table, begin: int, end: int, products: tuple[Array, Array, Array, Array]) -> None:
    """Fill in products of two section functions ``i k``, a column each, at points from ``begin`` to before ``end``.

    Both across, of the directions 00, 01, 10, 11 (``plane``) or 00, 01 + 10, 11 (``square``); the first across, in
    directions 0 and 1 (``mixed``); neither (``axis``).  Rows: direction by direction, point by point.
    """
    plane, square, mixed, axis = products
    n, points = table.section.shape[2], end - begin
    for p in range(points):
        for i in range(n):
            x, y, z = table.section[begin + p, 0, i], table.section[begin + p, 1, i], table.section[begin + p, 2, i]
            for k in range(n):
                f = table.section[begin + p, 0, k]
                g = table.section[begin + p, 1, k]
                h = table.section[begin + p, 2, k]
                ik = i * n + k
                plane[p, ik] = x * f
                plane[points + p, ik] = x * g
                plane[2 * points + p, ik] = y * f
                plane[3 * points + p, ik] = y * g
                square[p, ik] = x * f
                square[points + p, ik] = x * g + y * f
                square[2 * points + p, ik] = y * g
                mixed[p, ik] = x * h
                mixed[points + p, ik] = y * h
                axis[p, ik] = z * h


@njit(void(TABLE, FUNCTIONS, FIBRES, F2, F2, GRADIENTS, GRADIENTS, b1, i8, i8, i8, FOUR), **FAST)
def moduli(
    table: Table,
    law: Functions,
    fibres: Array,
    pressure: Array,
    before: Array,
    found: tuple[Array, Array],
    last: tuple[Array, Array],
    extrapolates: bool,
    first: int,
    begin: int,
    end: int,
    pulled: tuple[Array, Array, Array, Array],
) -> None:
    """Fill in the moduli on disk x axis, ordered as the products of section functions are (`multiply`).

    Rows: place by place, of the pairs 01, 02, 12, of 00, 11, 22, of all nine, of the former six.

    Parameters
    ----------
    table
        Elements and points that obey one law.
    law, fibres
        The law, and its fibres ``(E, t, q, 3)``, without elements if it has none.
    pressure
        Of the mixed formulation, ``(E t, q)``, or without rows.
    found
        Gradients, from those of the element ``first`` on (`isorod.assembly.field_kernel.stresses`).
    last, before, extrapolates
        Whether the stress is extrapolated from the last tangent, and gradients and pressure there.
    begin, end
        The points are those of the section from ``begin`` to before ``end``.
    pulled
        To be filled.
    """
    plane, square, mixed, axis = pulled
    work = np.zeros(SIZE)
    along, points = table.axial.shape[1], end - begin
    places, first_place = found[1].shape[0] // 3, first * along
    pressed = pressure.shape[0] > 0
    F, stress, fibre = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    place, q = 0, begin
    for _ in range(0, places * points, POINTS):
        take_geometry(table, first, places, place, q, begin, end, work)
        if fibres.shape[0]:
            take_fibres(fibres, along, first, places, place, q, begin, end, work)
        if pressed:
            take_rows(pressure, first_place, places, place, q, begin, end, PRESSURE, work)
        # The last state if there is one, then the present.
        for state in range(0 if extrapolates else 1, 2):
            take_gradients(found, place, q, begin, end, work)
            if state:
                deform(work, _R[GRADIENT])
            else:
                deform(work, _R[STATE])
                take_gradients(last, place, q, begin, end, work)
                deform(work, _R[GRADIENT])
                if pressed:
                    # Present and last pressure change places, and do so again.
                    take_rows(before, first_place, places, place, q, begin, end, BEFORE, work)
                    _swap(work)
            for k in range(np.uint64(45 * POINTS)):
                work[_R[MODULI] + k] = 0.0
            evaluate(law, work, False, F, stress, fibre)
            call_tangent(np.uint64(law.tangent), (work, law.constants, 1.0))
            if pressed:
                press(work, law.trace)
                if not law.trace:
                    press_moduli(work)
            if not state:
                foresee(work)
                if pressed:
                    _swap(work)
                    press_on(work)
            elif extrapolates:
                exceed(work)
        pull_back_moduli(work)
        k, length = 0, 1
        while k < POINTS and length:
            at, s, p = k, place, q - begin
            k, place, q, length = run(place, q, begin, end, places, k)
            for h in range(3):
                r = (MODULI + 9 * h) * POINTS + at
                put(work, r, plane, 3 * s + h, p, length)
                put(work, r + POINTS, plane, 3 * s + h, points + p, length)
                put(work, r + 3 * POINTS, plane, 3 * s + h, 2 * points + p, length)
                put(work, r + 4 * POINTS, plane, 3 * s + h, 3 * points + p, length)
                put(work, r + 8 * POINTS, axis, 6 * s + h, p, length)
                up, low = 9 * s + _UP[h], 9 * s + _LOW[h]
                put(work, r + 2 * POINTS, mixed, up, p, length)
                put(work, r + 5 * POINTS, mixed, up, points + p, length)
                put(work, r + 6 * POINTS, mixed, low, p, length)
                put(work, r + 7 * POINTS, mixed, low, points + p, length)
                r = (SQUARES + 6 * h) * POINTS + at
                put(work, r, square, 3 * s + h, p, length)
                put(work, r + POINTS, square, 3 * s + h, points + p, length)
                put(work, r + 3 * POINTS, square, 3 * s + h, 2 * points + p, length)
                put(work, r + 2 * POINTS, mixed, 9 * s + 4 * h, p, length)
                put(work, r + 4 * POINTS, mixed, 9 * s + 4 * h, points + p, length)
                put(work, r + 5 * POINTS, axis, 6 * s + 3 + h, p, length)


@njit(void(F1), **FAST)
def _swap(work: Array) -> None:
    """Let present and last pressure change places."""
    for k in range(np.uint64(POINTS)):
        x = work[_R[BEFORE] + k]
        work[_R[BEFORE] + k] = work[_R[PRESSURE] + k]
        work[_R[PRESSURE] + k] = x


@njit(void(TABLE, i8, i8, FOUR, BLOCKS, F1), **FAST)
def add_blocks(
    table: Table, first: int, last: int, sums: tuple[Array, Array, Array, Array], blocks: Blocks, entries: Array
) -> None:
    """Add what section matrices of the elements ``first .. last - 1`` make of element matrices to entries (`Blocks`).

    Rows of these: a place along the axis each, one pair of components ``n n`` after the other, as of the moduli.
    """
    plane, square, mixed, axis = sums
    along, functions = table.axial.shape[1:]
    n = table.section.shape[2]
    nn = n * n
    pairs = functions * (functions + 1) // 2
    # Products of both functions and of both derivatives, a pair a row; of functions with the second's derivative.
    alike, steep = np.empty((pairs, along)), np.empty((pairs, along))
    second = np.empty((functions * functions, along))
    both, one = np.empty((pairs, 6 * nn)), np.empty((functions * functions, 9 * nn))
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
        _combine(alike, plane, s, both, 0)
        _combine(alike, square, s, both, 3 * nn)
        _combine(steep, axis, s, both, 0)
        _combine(second, mixed, s, one, 0)
        p = 0
        for j in range(functions):
            for m in range(j, functions):
                jm, mj = j * functions + m, m * functions + j
                _scatter(both[p], one[jm], one[mj], n, blocks.start[e, j, m], blocks.width[e, j], False, entries)
                if m > j:
                    _scatter(both[p], one[jm], one[mj], n, blocks.start[e, m, j], blocks.width[e, m], True, entries)
                p += 1


@njit(void(F2, F2, i8, F2, i8), **FAST)
def _combine(factors: Array, rows: Array, first: int, sums: Array, column: int) -> None:
    """Add the products of factors ``(p, t)`` with ``t`` rows, from the first on, to columns of sums ``(p, ...)``.

    They are small ones, which BLAS is slow at.
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


@njit(void(F1, F1, F1, i8, i8, i8, b1, F1), **FAST)
def _scatter(
    both: Array, second: Array, first: Array, n: int, start: int, width: int, transposed: bool, entries: Array
) -> None:
    """Add a block of an element matrix, or its transpose, to the entries from ``start`` on, if it is not negative.

    Parameters
    ----------
    both
        Of the six pairs of components, what has the derivatives of both alike, shape ``(6 n n,)``.
    second, first
        Of all nine, what has the second's derivative along the axis; the same of the block with places changed.
    """
    if start < 0:
        return
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
