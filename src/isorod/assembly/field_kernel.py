"""Displacement gradients at quadrature points, block by block, and the law's stresses from them, compiled.

Elements are taken some at a time (`isorod.assembly.region`).  Sums over section functions are products of matrices,
whose rows are the places along the axis and the components, and left to BLAS; what belongs to single points is done in
blocks (`isorod.assembly.block_kernel`).
"""

from typing import NamedTuple

import numpy as np
from numba import b1, f8, i8, types, void

from isorod.arrays import Array, Index
from isorod.assembly.block_kernel import BEFORE, INVERSE, PRESSURE, SIZE, STEPS, WEIGHT, Steps
from isorod.assembly.element_kernel import TABLE
from isorod.compiled import F1, F2, FAST, I2, njit
from isorod.material.points import ACTIVE, DETERMINANT, ENERGY, FIBRE, POINTS, STATES, call_block, call_step
from isorod.material.points import ROWS as _R
from isorod.space.space import Table


class Functions(NamedTuple):
    """A law's compiled functions, by their addresses (`isorod.material.points.Compiled`), and its constants."""

    block: int
    tangent: int
    constants: Array


class Field(NamedTuple):
    """Gradients of a displacement on disk x axis at points of places along the axis, and the pressure.

    Attributes
    ----------
    across
        Derivatives by both directions across, a row each of each component and place, ``(6 places, q)``.
    along
        Those along the axis, ``(3 places, q)``.
    pressure
        Of the mixed formulation, ``(places, q)``, or without rows.
    """

    across: Array
    along: Array
    pressure: Array


FUNCTIONS = types.NamedTuple([i8, i8, F1], Functions)
FIELD = types.NamedUniTuple(F2, 3, Field)

# Rows of a block that are filled from arrays: gradients across and along, pressures, and what does not change.
_ACROSS, _ALONG = np.array([0, 1, 3, 4, 6, 7]), np.array([2, 5, 8])
PRESSURES, PRESSURES_BEFORE, _DETERMINANT = np.array([PRESSURE]), np.array([BEFORE]), np.array([DETERMINANT])
_KNOWN = np.concatenate([INVERSE + np.arange(10), FIBRE + np.arange(STATES)])


@njit(i8(i8, i8, i8, i8, I2), **FAST)
def fill_runs(block: int, places: int, begin: int, end: int, runs: Index) -> int:
    """Fill in the runs of points side by side that a block takes, a row each; return their number.

    Points are those of the section from ``begin`` to before ``end``, place after place along the axis; behind the last
    of them a block keeps what it had.

    Parameters
    ----------
    block
        Number of the block.
    runs
        To be filled with place along the axis, first point in the section, first point in the block and length, shape
        ``(POINTS, 4)``.
    """
    width, count, k = end - begin, 0, 0
    point = block * POINTS
    while k < POINTS and point < places * width:
        length = min(POINTS - k, width - point % width)
        runs[count, 0], runs[count, 1] = point // width, begin + point % width
        runs[count, 2], runs[count, 3] = k, length
        count, k, point = count + 1, k + length, point + length
    return count


@njit(**FAST)
def take(values: Array, rows: Index, runs: Index, work: Array) -> None:
    """Fill rows of a block with values ``(places rows, q)`` at its points, the same number of rows for each place."""
    for r in range(runs.shape[0]):
        first = runs[r, 0] * rows.size
        q, at, length = np.uint64(runs[r, 1]), np.uint64(runs[r, 2]), np.uint64(runs[r, 3])
        for a in range(rows.size):
            row, to = np.uint64(first + a), np.uint64(rows[a] * POINTS) + at
            for k in range(length):
                work[to + k] = values[row, q + k]


@njit(**FAST)
def put(work: Array, rows: Index, runs: Index, values: Array) -> None:
    """Fill values at a block's points with rows of it, as `take` reads them."""
    for r in range(runs.shape[0]):
        first = runs[r, 0] * rows.size
        q, at, length = np.uint64(runs[r, 1]), np.uint64(runs[r, 2]), np.uint64(runs[r, 3])
        for a in range(rows.size):
            row, start = np.uint64(first + a), np.uint64(rows[a] * POINTS) + at
            for k in range(length):
                values[row, q + k] = work[start + k]


@njit(void(FIELD, I2, F1), **FAST)
def take_gradients(field: Field, runs: Index, work: Array) -> None:
    """Fill the rows of the stress of a block with gradients on disk x axis."""
    take(field.across, _ACROSS, runs, work)
    take(field.along, _ALONG, runs, work)


@njit(void(F2, i8, I2, F1), **FAST)
def take_known(known: Array, places: int, runs: Index, work: Array) -> None:
    """Fill in the constant data: inverse Jacobian, weight and the law's own data, a row each for each place."""
    take(known, _KNOWN[: known.shape[0] // places], runs, work)


@njit(void(i8, F2, FIELD, F2), **FAST)
def determinants(deform: int, known: Array, field: Field, out: Array) -> None:
    """Fill in ``det F`` ``(places, q)`` (`stresses`)."""
    places, points = out.shape
    work, runs = np.zeros(SIZE), np.empty((POINTS, 4), np.int64)
    for block in range(-(-places * points // POINTS)):
        these = runs[: fill_runs(block, places, 0, points, runs)]
        take_gradients(field, these, work)
        take_known(known, places, these, work)
        call_step(np.uint64(deform), (work,))
        put(work, _DETERMINANT, these, out)


@njit(f8(FUNCTIONS, STEPS, F2, FIELD, b1), **FAST)
def stresses(law: Functions, steps: Steps, known: Array, field: Field, with_energy: bool) -> float:
    """Replace gradients on disk x axis by the stress there times the volume; return the energy if requested.

    Parameters
    ----------
    law, steps
        The law of the points, and the other steps.
    known
        Constant data of the points (`take_known`).
    field
        Their gradients and pressures.
    """
    points, places = field.along.shape[1], field.along.shape[0] // 3
    work, runs = np.zeros(SIZE), np.empty((POINTS, 4), np.int64)
    energy = 0.0
    for block in range(-(-places * points // POINTS)):
        these = runs[: fill_runs(block, places, 0, points, runs)]
        take_gradients(field, these, work)
        take_known(known, places, these, work)
        call_step(np.uint64(steps.deform), (work,))
        call_block(np.uint64(law.block), (work, law.constants, 1.0, with_energy))
        if steps.press:
            take(field.pressure, PRESSURES, these, work)
            call_step(np.uint64(steps.press), (work,))
        call_step(np.uint64(steps.pull_back), (work,))
        if with_energy:
            for k in range(np.uint64(min(POINTS, places * points - block * POINTS))):
                energy += work[_R[WEIGHT] + k] * (work[_R[ENERGY] + k] + work[_R[ACTIVE] + k])
        put(work, _ACROSS, these, field.across)
        put(work, _ALONG, these, field.along)
    return energy


@njit(void(TABLE, F2, F2, i8, i8, I2, F1), **FAST)
def add_resultants(
    table: Table, values: Array, slopes: Array, first: int, last: int, starts: Index, forces: Array
) -> None:
    """Add the nodal forces of integrals of stress against section functions, rows by component and place."""
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
