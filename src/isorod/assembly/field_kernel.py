"""Gradients of a displacement at quadrature points, block by block, and what the law makes of them, compiled.

Elements are taken some at a time (`isorod.assembly.region`).  Sums over section functions are products of matrices,
whose rows are the places along the axis and the components, and left to BLAS; what belongs to single points is done in
blocks (`isorod.assembly.block_kernel`).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array, Index
from isorod.assembly.block_kernel import INVERSE, PRESSURE, SIZE, STEPS, WEIGHT, Steps
from isorod.assembly.element_kernel import TABLE
from isorod.compiled import F1, F2, FAST, I2, njit
from isorod.material.points import ACTIVE, DETERMINANT, ENERGY, FIBRE, POINTS, call_block, call_step
from isorod.material.points import ROWS as _R
from isorod.space.space import Table

_W, _3 = np.uint64(POINTS), np.uint64(3)


class Functions(NamedTuple):
    """A law's compiled functions, by their addresses (`isorod.material.points.Compiled`), and its constants."""

    block: int
    tangent: int
    constants: Array


FUNCTIONS = types.NamedTuple([i8, i8, F1], Functions)
FIBRES = types.Array(f8, 4, "A", readonly=True)
# Gradients across and along.
GRADIENTS = types.UniTuple(F2, 2)


@njit(GRADIENTS(TABLE, F1, I2, i8, i8), **FAST)
def coefficients(table: Table, local: Array, starts: Index, first: int, last: int) -> tuple[Array, Array]:
    """Return the section coefficients of displacements, and their derivatives along the axis.

    They are those of the elements ``first .. last - 1``, shape ``(3 e t, n)``: rows place by place, and of each place
    component by component.

    Parameters
    ----------
    local, starts
        Degrees of freedom, and where those of each element's layers begin, shape ``(E, l)``.
    """
    along, functions = table.axial.shape[1:]
    n = table.section.shape[2]
    values, slopes = np.empty(((last - first) * along * 3, n)), np.empty(((last - first) * along * 3, n))
    near = np.empty((functions, 3 * n))
    row = 0
    for e in range(first, last):
        for j in range(functions):
            for i in range(3 * n):
                near[j, i] = local[starts[e, j] + i]
        for t in range(along):
            for i in range(n):
                for a in range(3):
                    value = slope = 0.0
                    for j in range(functions):
                        value += table.axial[e, t, j] * near[j, 3 * i + a]
                        slope += table.slopes[e, t, j] * near[j, 3 * i + a]
                    values[row + a, i] = value
                    slopes[row + a, i] = slope
            row += 3
    return values, slopes


@njit(types.UniTuple(i8, 4)(i8, i8, i8, i8, i8, i8), **FAST)
def run(place: int, q: int, begin: int, end: int, places: int, k: int) -> tuple[int, int, int, int]:
    """Return the points side by side that come next into a block, and where the run after them begins.

    Points of a block are those of the section from ``begin`` to before ``end``, place after place along the axis;
    behind the last of them a block keeps what it had.

    Parameters
    ----------
    place, q
        Where the run begins.
    k
        How many points the block has before it.

    Returns
    -------
    after, next_place, next_q, length
        Number of points in the block with the run, where the next one begins, and how long this one is; a length of 0
        where there is none.
    """
    if place >= places:
        return k, place, q, 0
    length = min(POINTS - k, end - q)
    if q + length < end:
        return k + length, place, q + length, length
    return k + length, place + 1, begin, length


@njit(**FAST)
def _take(source: Array, row: Any, column: Any, length: int, work: Array, at: Any) -> None:
    """Copy a run of a row of an array to a row of a block."""
    row, column, at = np.uint64(row), np.uint64(column), np.uint64(at)
    for k in range(np.uint64(length)):
        work[at + k] = source[row, column + k]


@njit(**FAST)
def put(work: Array, at: Any, target: Array, row: Any, column: Any, length: int) -> None:
    """Copy a run of a row of a block to a row of an array."""
    row, column, at = np.uint64(row), np.uint64(column), np.uint64(at)
    for k in range(np.uint64(length)):
        target[row, column + k] = work[at + k]


@njit(void(GRADIENTS, i8, i8, i8, i8, F1), **FAST)
def take_gradients(found: tuple[Array, Array], place: int, q: int, begin: int, end: int, work: Array) -> None:
    """Fill the rows of the stress of a block with gradients (`run`)."""
    plane, axis = found
    points, places = axis.shape[1], axis.shape[0] // 3
    k, after, next_q, length = 0, place, q, 1
    while k < POINTS:
        at = k
        k, after, next_q, length = run(place, q, begin, end, places, k)
        if not length:
            return
        for a in range(3):
            _take(plane, 3 * place + a, q, length, work, 3 * a * POINTS + at)
            _take(plane, 3 * place + a, points + q, length, work, (3 * a + 1) * POINTS + at)
            _take(axis, 3 * place + a, q, length, work, (3 * a + 2) * POINTS + at)
        place, q = after, next_q


@njit(void(TABLE, i8, i8, i8, i8, i8, i8, F1), **FAST)
def take_geometry(table: Table, first: int, places: int, place: int, q: int, begin: int, end: int, work: Array) -> None:
    """Fill in inverse Jacobians and weights at the points of a block (`run`)."""
    along = table.axial.shape[1]
    k, after, next_q, length = 0, place, q, 1
    while k < POINTS:
        at = k
        k, after, next_q, length = run(place, q, begin, end, places, k)
        if not length:
            return
        inverse = table.inverse[first + place // along, place % along]
        weights = table.weights[first + place // along, place % along]
        to, begins = np.uint64(at), np.uint64(q)
        for m in range(np.uint64(length)):
            for d in range(np.uint64(3)):
                for a in range(np.uint64(3)):
                    work[_R[INVERSE] + (_3 * d + a) * _W + to + m] = inverse[begins + m, d, a]
            work[_R[WEIGHT] + to + m] = weights[begins + m]
        place, q = after, next_q


@njit(void(FIBRES, i8, i8, i8, i8, i8, i8, i8, F1), **FAST)
def take_fibres(
    fibres: Array, along: int, first: int, places: int, place: int, q: int, begin: int, end: int, work: Array
) -> None:
    """Fill in the fibres at the points of a block (`run`)."""
    k, after, next_q, length = 0, place, q, 1
    while k < POINTS:
        at = k
        k, after, next_q, length = run(place, q, begin, end, places, k)
        if not length:
            return
        for m in range(length):
            for a in range(fibres.shape[3]):
                value = fibres[first + place // along, place % along, q + m, a]
                work[(FIBRE + a) * POINTS + at + m] = value
        place, q = after, next_q


@njit(void(F2, i8, i8, i8, i8, i8, i8, i8, F1), **FAST)
def take_rows(
    values: Array, first: int, places: int, place: int, q: int, begin: int, end: int, row: int, work: Array
) -> None:
    """Fill a row of a block with values whose rows are places along the axis, from the place ``first`` on (`run`)."""
    k, after, next_q, length = 0, place, q, 1
    while k < POINTS:
        at = k
        k, after, next_q, length = run(place, q, begin, end, places, k)
        if not length:
            return
        _take(values, first + place, q, length, work, row * POINTS + at)
        place, q = after, next_q


@njit(void(TABLE, i8, GRADIENTS, i8, F2), **FAST)
def determinants(table: Table, deform: int, found: tuple[Array, Array], first: int, out: Array) -> None:
    """Fill in ``det F`` ``(e t, q)`` of gradients on disk x axis; ``deform`` and the others are those of `stresses`."""
    points, places = out.shape[1], out.shape[0]
    work = np.zeros(SIZE)
    place, q = 0, 0
    for _ in range(0, places * points, POINTS):
        take_gradients(found, place, q, 0, points, work)
        take_geometry(table, first, places, place, q, 0, points, work)
        call_step(np.uint64(deform), (work,))
        k, length = 0, 1
        while k < POINTS and length:
            at, row, column = k, place, q
            k, place, q, length = run(place, q, 0, points, places, k)
            put(work, DETERMINANT * POINTS + at, out, row, column, length)


@njit(f8(TABLE, FUNCTIONS, STEPS, FIBRES, F2, GRADIENTS, i8, b1), **FAST)
def stresses(
    table: Table,
    law: Functions,
    steps: Steps,
    fibres: Array,
    pressure: Array,
    found: tuple[Array, Array],
    first: int,
    wanted: bool,
) -> float:
    """Replace gradients on disk x axis by the stress there times the volume; return the energy, if that is wanted.

    Parameters
    ----------
    table
        Elements and points that obey one law.
    law, steps, fibres
        The law, what happens besides, and fibres ``(E, t, q, 3 families)``, without elements if the law has none.
    pressure
        Of the mixed formulation, ``(E t, q)``, or without rows.
    found
        Rows of places along the axis, from those of element ``first`` on, and components: the derivatives by both
        directions across, ``2 q`` columns, and those along.
    """
    plane, axis = found
    along, points = table.axial.shape[1], axis.shape[1]
    places = axis.shape[0] // 3
    work = np.zeros(SIZE)
    energy = 0.0
    place, q = 0, 0
    for begin in range(0, places * points, POINTS):
        take_gradients(found, place, q, 0, points, work)
        take_geometry(table, first, places, place, q, 0, points, work)
        if fibres.shape[0]:
            take_fibres(fibres, along, first, places, place, q, 0, points, work)
        call_step(np.uint64(steps.deform), (work,))
        call_block(np.uint64(law.block), (work, law.constants, 1.0, wanted))
        if steps.press:
            take_rows(pressure, first * along, places, place, q, 0, points, PRESSURE, work)
            call_step(np.uint64(steps.press), (work,))
        call_step(np.uint64(steps.pull_back), (work,))
        if wanted:
            for k in range(np.uint64(min(POINTS, places * points - begin))):
                energy += work[_R[WEIGHT] + k] * (work[_R[ENERGY] + k] + work[_R[ACTIVE] + k])
        k, length = 0, 1
        while k < POINTS and length:
            at, row, column = k, place, q
            k, place, q, length = run(place, q, 0, points, places, k)
            for a in range(3):
                put(work, 3 * a * POINTS + at, plane, 3 * row + a, column, length)
                put(work, (3 * a + 1) * POINTS + at, plane, 3 * row + a, points + column, length)
                put(work, (3 * a + 2) * POINTS + at, axis, 3 * row + a, column, length)
    return energy


@njit(void(TABLE, F2, F2, i8, i8, I2, F1), **FAST)
def add_resultants(
    table: Table, values: Array, slopes: Array, first: int, last: int, starts: Index, forces: Array
) -> None:
    """Add what integrals of stress against section functions make of nodal forces; rows, places as `coefficients`."""
    along, functions = table.axial.shape[1:]
    n = values.shape[1]
    row = 0
    for e in range(first, last):
        for t in range(along):
            for j in range(functions):
                x, y, at = table.axial[e, t, j], table.slopes[e, t, j], starts[e, j]
                for i in range(n):
                    for a in range(3):
                        forces[at + 3 * i + a] += x * values[row + a, i] + y * slopes[row + a, i]
            row += 3
