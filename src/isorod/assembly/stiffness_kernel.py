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
    gradients,
    put,
    run,
    section_functions,
    take_fibres,
    take_geometry,
    take_gradients,
    take_rows,
)
from isorod.assembly.pattern_kernel import BLOCKS, Blocks
from isorod.compiled import F1, F2, F4, FAST, njit
from isorod.material.points import GRADIENT, MODULI, POINTS, SQUARES, call_tangent
from isorod.material.points import ROWS as _R
from isorod.space.space import Table

_1, _2, _3, _4 = (np.uint64(k) for k in range(1, 5))

# Numbers that products of section functions may take: what fits in the processor's memory beside others.
_PRODUCTS = 500_000
# Numbers that moduli and section matrices may take together.
_SECTIONS = 100_000

# Matrices of both components across, of one component's own, of one across and one along, of both along.
FOUR = types.UniTuple(F2, 4)

# Of the nine pairs of components ``3 a + b``: which of the six (01, 02, 12, 00, 11, 22) it or its mirror image is.
_PAIR = np.array([3, 0, 1, 0, 4, 2, 1, 2, 5])
# The pairs 01, 02, 12, and 10, 20, 21, among the nine.
_UP, _LOW = np.array([1, 2, 5]), np.array([3, 6, 7])


@njit(void(TABLE, i8, i8, FOUR), **FAST)
def _multiply(table: Table, begin: int, end: int, products: tuple[Array, Array, Array, Array]) -> None:
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


@njit(void(TABLE, FUNCTIONS, FIBRES, F2, F2, GRADIENTS, GRADIENTS, b1, i8, i8, i8, F1, FOUR), **FAST)
def _moduli(
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
    work: Array,
    moduli: tuple[Array, Array, Array, Array],
) -> None:
    """Fill in the moduli on disk x axis, ordered as the products of section functions are.

    Rows: place by place, of the pairs 01, 02, 12 (``plane``), of 00, 11, 22 (``square``), of all nine (``mixed``), of
    the former six (``axis``).
    """
    plane, square, mixed, axis = moduli
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
            take_rows(pressure, 1, first_place, places, place, q, begin, end, PRESSURE, work)
        if extrapolates:
            take_gradients(found, place, q, begin, end, work)
            deform(work, _R[STATE])
            take_gradients(last, place, q, begin, end, work)
            deform(work, _R[GRADIENT])
            if pressed:
                # Present and last pressure change places, and do so again.
                take_rows(before, 1, first_place, places, place, q, begin, end, BEFORE, work)
                _swap(work)
            _evaluate_all(law, pressed, work, F, stress, fibre)
            foresee(work)
            if pressed:
                _swap(work)
                press_on(work)
            for k in range(np.uint64(9 * POINTS)):
                work[_R[GRADIENT] + k] = work[_R[STATE] + k]
        else:
            take_gradients(found, place, q, begin, end, work)
            deform(work, _R[GRADIENT])
        _evaluate_all(law, pressed, work, F, stress, fibre)
        if extrapolates:
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


@njit(void(FUNCTIONS, b1, F1, F2, F2, F1), **FAST)
def _evaluate_all(law: Functions, pressed: bool, work: Array, F: Array, stress: Array, fibre: Array) -> None:
    """Fill in stress and moduli at the points of a block."""
    for k in range(np.uint64(45 * POINTS)):
        work[_R[MODULI] + k] = 0.0
    evaluate(law, work, False, F, stress, fibre)
    call_tangent(np.uint64(law.tangent), (work, law.constants, 1.0))
    if pressed:
        press(work, law.trace)
        if not law.trace:
            press_moduli(work)


@njit(void(TABLE, i8, i8, F2, F2, F2, F2, BLOCKS, F1), **FAST)
def _along(
    table: Table,
    first: int,
    last: int,
    plane: Array,
    square: Array,
    mixed: Array,
    axis: Array,
    blocks: Blocks,
    entries: Array,
) -> None:
    """Add what section matrices make of element matrices to the entries.

    Rows of these: a place along the axis each, one pair of components ``n n`` after the other, as of the moduli.
    """
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


@njit(void(F2, F2, F2, b1), **FAST)
def _add_product(left: Array, right: Array, result: Array, more: bool) -> None:
    """Set a matrix to a product, or add it."""
    if more:
        result += np.dot(left, right)
    else:
        np.dot(left, right, result)


@njit(
    void(TABLE, FUNCTIONS, FIBRES, F2, F2, F4, F4, b1, BLOCKS, F1),
    **FAST,
)
def add_stiffness(
    table: Table,
    law: Functions,
    fibres: Array,
    pressure: Array,
    before: Array,
    nodal: Array,
    earlier: Array,
    extrapolates: bool,
    blocks: Blocks,
    entries: Array,
) -> None:
    """Add the element matrices of a tangent to entries (`Blocks`).

    Parameters
    ----------
    table
        Elements and points that obey one law.
    law, fibres
        The law, which must have moduli, and its fibres ``(E, t, q, 3)``, without elements if it has none.
    pressure
        Of the mixed formulation, ``(E t, q)``, or without rows.
    nodal
        Nodal displacements ``(E, l, n, 3)``.
    before, earlier, extrapolates
        Whether the stress is that extrapolated from the last tangent, and pressure and displacements there.
    """
    elements, along, _ = table.axial.shape
    points, _, n = table.section.shape
    nn = n * n
    across, whole = section_functions(table)
    tile = min(points, max(16, _PRODUCTS // (10 * nn)))
    some = max(1, _SECTIONS // ((45 * tile + 21 * nn) * along))
    work = np.zeros(SIZE)
    room = min(some, elements) * along
    # Made once: memory that the system gives anew is slow.
    plane, square = np.empty(12 * tile * room), np.empty(9 * tile * room)
    mixed, axis = np.empty(18 * tile * room), np.empty(6 * tile * room)
    planes, squares = np.empty(4 * tile * nn), np.empty(3 * tile * nn)
    mixeds, axes = np.empty(2 * tile * nn), np.empty(tile * nn)
    sums = np.empty(21 * nn * room)
    for first in range(0, elements, some):
        last = min(first + some, elements)
        places = (last - first) * along
        found = gradients(table, nodal, first, last, across, whole)
        old = found
        if extrapolates:
            old = gradients(table, earlier, first, last, across, whole)
        ends = 3 * places * nn, 6 * places * nn, 15 * places * nn, 21 * places * nn
        for begin in range(0, points, tile):
            end = min(begin + tile, points)
            width = end - begin
            moduli = (
                plane[: 12 * width * places].reshape(3 * places, 4 * width),
                square[: 9 * width * places].reshape(3 * places, 3 * width),
                mixed[: 18 * width * places].reshape(9 * places, 2 * width),
                axis[: 6 * width * places].reshape(6 * places, width),
            )
            products = (
                planes[: 4 * width * nn].reshape(4 * width, nn),
                squares[: 3 * width * nn].reshape(3 * width, nn),
                mixeds[: 2 * width * nn].reshape(2 * width, nn),
                axes[: width * nn].reshape(width, nn),
            )
            _moduli(table, law, fibres, pressure, before, found, old, extrapolates, first, begin, end, work, moduli)
            if tile < points or first == 0:
                _multiply(table, begin, end, products)
            _add_product(moduli[0], products[0], sums[: ends[0]].reshape(3 * places, nn), begin > 0)
            _add_product(moduli[1], products[1], sums[ends[0] : ends[1]].reshape(3 * places, nn), begin > 0)
            _add_product(moduli[2], products[2], sums[ends[1] : ends[2]].reshape(9 * places, nn), begin > 0)
            _add_product(moduli[3], products[3], sums[ends[2] : ends[3]].reshape(6 * places, nn), begin > 0)
        _along(
            table,
            first,
            last,
            sums[: ends[0]].reshape(places, 3 * nn),
            sums[ends[0] : ends[1]].reshape(places, 3 * nn),
            sums[ends[1] : ends[2]].reshape(places, 9 * nn),
            sums[ends[2] : ends[3]].reshape(places, 6 * nn),
            blocks,
            entries,
        )
