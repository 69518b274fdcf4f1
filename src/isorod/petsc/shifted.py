"""A symmetric matrix less a multiple of another one with a smaller sparsity pattern."""

import numpy as np
from numba import b1, f8, i8
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.compiled import F1, STRICT, njit
from isorod.petsc.matrix import components_of
from isorod.petsc.rows import P1, Compressed, component_rows, local_rows


def upper_rows(matrix: PETSc.Mat, shift: float, other: PETSc.Mat) -> Compressed | None:
    """Return the upper triangle of ``matrix - shift other``; None unless both are AIJ or MAIJ on one rank.

    Entries below the diagonal have positions, but no values.  The other matrix may multiply each of several interlaced
    components (PETSc's MAIJ).  PETSc's own function, by a copy with entries of all components, takes as long as a
    factorisation.
    """
    if matrix.getType() != "seqaij" or other.getType() not in ("seqaij", "seqmaij"):
        return None
    own, components = local_rows(matrix).own, components_of(other)
    theirs = component_rows(other, components).own
    values = np.empty_like(own.values)
    if not _subtract(*own, *theirs, components, shift, values):
        return None
    return Compressed(own.start, own.column, values)


@njit(b1(P1, P1, F1, P1, P1, F1, i8, f8, F1), **STRICT)
def _subtract(
    start: Array,
    column: Array,
    values: Array,
    other_start: Array,
    other_column: Array,
    others: Array,
    components: int,
    shift: float,
    result: Array,
) -> bool:
    """Fill in the upper triangle's values; return whether the pattern has all entries of the other matrix."""
    for i in range(start.size - 1):
        low, high = start[i], start[i + 1]
        node, place = i // components, i % components
        begin, end = other_start[node], other_start[node + 1]
        while low < high and column[low] < i:
            low += 1
        while begin < end and other_column[begin] < node:
            begin += 1
        for k in range(low, high):
            result[k] = values[k]
        k = low
        for m in range(begin, end):
            target = components * other_column[m] + place
            # In a row without gaps, as nearly all are, the column gives the position.
            guess = low + target - column[low] if low < high else high
            if low <= guess < high and column[guess] == target:
                k = guess
            while k < high and column[k] < target:
                k += 1
            if k == high or column[k] != target:
                return False
            result[k] -= shift * others[m]
    return True
