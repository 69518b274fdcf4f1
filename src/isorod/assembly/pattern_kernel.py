"""Sparsity patterns of layered elements, compiled."""

from typing import Any, NamedTuple

from numba import i8, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F5, FAST, I1, I2, I3, njit
from isorod.petsc.matrix import P1


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


@njit(types.UniTuple(i8, 2)(I2, COUPLING, I3, I2, I1, I1), **FAST)
def couple(
    element_layers: Index, coupling: Coupling, start: Index, width: Index, mark: Index, near: Index
) -> tuple[int, int]:
    """Fill in how elements ``(E, l)`` couple layers, row by row; return the numbers of rows and of couplings.

    Parameters
    ----------
    element_layers
        Negative where there is none.
    coupling
        With room for all layers, and one more in ``first``, and for ``E l l`` couplings.
    start, width
        Of `Blocks`, filled where blocks have a place.
    mark, near
        Work space: -1 for each layer, and room for each element's layers.
    """
    layers, first, columns, size = coupling
    elements, functions = element_layers.shape
    count = mark.size
    # The elements' layers sorted by layers; in the room of ``first`` where those of a layer begin, in the end where
    # they end.
    for r in range(count + 1):
        first[r] = 0
    for e in range(elements):
        for j in range(functions):
            if element_layers[e, j] >= 0:
                first[element_layers[e, j] + 1] += 1
    for r in range(count):
        first[r + 1] += first[r]
    for e in range(elements):
        for j in range(functions):
            if element_layers[e, j] >= 0:
                near[first[element_layers[e, j]]] = e * functions + j
                first[element_layers[e, j]] += 1
    rows = pairs = begin = 0
    for r in range(count):
        end = first[r]
        if end == begin:
            continue
        top = pairs
        for k in range(begin, end):
            e = near[k] // functions
            for m in range(functions):
                column = element_layers[e, m]
                if column < 0 or mark[column] >= top:
                    continue
                # Into its place among those of the row, which are few.
                c = pairs
                while c > top and columns[c - 1] > column:
                    columns[c] = columns[c - 1]
                    c -= 1
                columns[c] = column
                mark[column] = top
                pairs += 1
        for c in range(top, pairs):
            mark[columns[c]] = c
        for k in range(begin, end):
            e, j = near[k] // functions, near[k] % functions
            for m in range(functions):
                if element_layers[e, m] >= 0:
                    start[e, j, m] = size * (top * (size - 1) + mark[element_layers[e, m]])
            width[e, j] = (pairs - top) * size
        layers[rows] = r
        # At or before ``r``, and read.
        first[rows] = top
        rows += 1
        begin = end
    first[rows] = pairs
    return rows, pairs


@njit(void(COUPLING, I1, I1, I1), **FAST)
def pattern_indices(coupling: Coupling, number: Index, row: Index, column: Index) -> None:
    """Fill in the numbers of row and column of each entry of an `isorod.assembly.pattern.Pattern`."""
    layers, first, columns, size = coupling
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


@njit(i8(COUPLING, I1, I1, P1, P1, I1), **FAST)
def pattern_rows(coupling: Coupling, number: Index, entries: Index, start: Any, column: Any, near: Index) -> int:
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
    near
        Work space for the entries of one row.
    """
    layers, first, columns, size = coupling
    total = 0
    place = 0
    row = -1
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
                    for k in range(count):
                        column[total + k] = column[begin + k]
                for k in range(count if entries.size else 0):
                    entries[total + k] = place + near[k]
                total += count
            place += width
    for i in range(row + 1, start.size):
        start[i] = total
    return total


@njit(void(F5, BLOCKS, F1), **FAST)
def merge(matrices: Array, blocks: Blocks, entries: Array) -> None:
    """Add element matrices ``(E, l, size, l, size)`` to entries of a pattern."""
    elements, functions, size = matrices.shape[:3]
    start, width = blocks.start, blocks.width
    for e in range(elements):
        for j in range(functions):
            for i in range(size):
                for m in range(functions):
                    if start[e, j, m] < 0:
                        continue
                    place = start[e, j, m] + i * width[e, j]
                    for k in range(size):
                        entries[place + k] += matrices[e, j, i, m, k]
