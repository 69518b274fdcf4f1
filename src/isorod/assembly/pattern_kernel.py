"""Sparsity patterns of layered elements, compiled."""

from typing import Any, NamedTuple

import numpy as np
from numba import i8, njit, types

from isorod.arrays import Array, Index
from isorod.compiled import F1, F5, FAST, I1, I2, I3


class Coupling(NamedTuple):
    """Layer ``layers[r]`` couples with the layers ``columns[first[r] : first[r + 1]]``, ``size`` entries in each."""

    layers: Index
    first: Index
    columns: Index
    size: int


class Blocks(NamedTuple):
    """Where the blocks of element matrices are among ``total`` entries.

    Block ``j, m`` of element ``e`` begins at ``start[e, j, m]``, negative if it has no place; its rows are
    ``width[e, j]`` entries apart.
    """

    start: Index
    width: Index
    total: int


COUPLING = types.NamedTuple([I1, I1, I1, i8], Coupling)
BLOCKS = types.NamedTuple([I3, I2, i8], Blocks)


@njit(types.Tuple((COUPLING, BLOCKS))(I2, i8), **FAST)
def pattern(element_layers: Index, size: int) -> tuple[Coupling, Blocks]:
    """Return how elements ``(E, l)`` couple layers of ``size`` entries, row by row; negative layers are none."""
    elements, functions = element_layers.shape
    count = element_layers.max() + 1
    keys = np.empty(elements * functions * functions, dtype=np.int64)
    place = 0
    for e in range(elements):
        for j in range(functions):
            for m in range(functions):
                if element_layers[e, j] >= 0 and element_layers[e, m] >= 0:
                    keys[place] = element_layers[e, j] * count + element_layers[e, m]
                    place += 1
    pairs = np.unique(keys[:place])
    columns = pairs % count
    layers = np.unique(pairs // count)
    first = np.searchsorted(pairs, layers * count)
    first = np.append(first, pairs.size)
    start = np.full((elements, functions, functions), -1, dtype=np.int64)
    width = np.zeros((elements, functions), dtype=np.int64)
    for e in range(elements):
        for j in range(functions):
            if element_layers[e, j] < 0:
                continue
            row = np.searchsorted(layers, element_layers[e, j])
            width[e, j] = (first[row + 1] - first[row]) * size
            for m in range(functions):
                if element_layers[e, m] < 0:
                    continue
                pair = np.searchsorted(pairs, element_layers[e, j] * count + element_layers[e, m])
                start[e, j, m] = size * (first[row] * size + pair - first[row])
    return Coupling(layers, first, columns, size), Blocks(start, width, pairs.size * size * size)


@njit(types.UniTuple(I1, 2)(COUPLING, I1), **FAST)
def pattern_indices(coupling: Coupling, number: Index) -> tuple[Index, Index]:
    """Return the numbers of row and column of each entry of an `isorod.assembly.pattern.Pattern`."""
    layers, first, columns, size = coupling
    total = columns.size * size * size
    row = np.empty(total, dtype=np.int64)
    column = np.empty(total, dtype=np.int64)
    place = 0
    for r in range(layers.size):
        for i in range(size):
            own = number[layers[r] * size + i]
            for c in range(first[r], first[r + 1]):
                other = columns[c] * size
                for k in range(size):
                    row[place] = own
                    column[place] = number[other + k]
                    place += 1
    return row, column


@njit(**FAST)
def pattern_rows(coupling: Coupling, number: Index, entries: Index, start: Any, column: Any) -> int:
    """Fill in the compressed rows of the entries of a pattern that have a number.

    Returns how many there are, or -1 if rows or columns do not ascend.

    Parameters
    ----------
    coupling
        Which layers couple.
    number
        Number of what is at ``layer size + place``, negative where there is none.
    entries
        To be filled with which entries they are, if it has room: it need not where all are.
    start, column
        To be filled with the first entry of each row and the columns.
    """
    layers, first, columns, size = coupling
    total = 0
    place = 0
    row = -1
    near = np.empty(size * np.diff(first).max() if layers.size else 0, dtype=np.int64)
    for r in range(layers.size):
        # All rows of a layer have the same columns.
        width = size * (first[r + 1] - first[r])
        count = 0
        last = -1
        ascend = True
        for c in range(first[r], first[r + 1]):
            for k in range(size):
                other = number[columns[c] * size + k]
                if other >= 0:
                    ascend = ascend and other > last
                    last = other
                    column[total + count] = other
                    near[count] = (c - first[r]) * size + k
                    count += 1
        begin = total
        for i in range(size):
            own = number[layers[r] * size + i]
            if own >= 0:
                if own <= row or not ascend:
                    return -1
                while row < own:
                    row += 1
                    start[row] = total
                if total > begin:
                    column[total : total + count] = column[begin : begin + count]
                for k in range(count if entries.size else 0):
                    entries[total + k] = place + near[k]
                total += count
            place += width
    for i in range(row + 1, start.size):
        start[i] = total
    return total


@njit(F1(F5, BLOCKS), **FAST)
def merge(matrices: Array, blocks: Blocks) -> Array:
    """Return the sum of element matrices ``(E, l, size, l, size)`` as entries of a pattern."""
    elements, functions, size = matrices.shape[:3]
    start, width = blocks.start, blocks.width
    result = np.zeros(blocks.total)
    for e in range(elements):
        for j in range(functions):
            for i in range(size):
                for m in range(functions):
                    if start[e, j, m] < 0:
                        continue
                    place = start[e, j, m] + i * width[e, j]
                    for k in range(size):
                        result[place + k] += matrices[e, j, i, m, k]
    return result
