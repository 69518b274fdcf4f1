"""Sparsity patterns of layered elements, compiled."""

from typing import Any, NamedTuple

from numba import b1, i8, types, void

from isorod.arrays import Array, Index
from isorod.compiled import F1, F5, FAST, I1, I3, njit
from isorod.petsc.rows import P1


class Coupling(NamedTuple):
    """The layer at ``rows[r]``, of ``sizes[r]`` unknowns, couples with those at ``columns[first[r] : first[r + 1]]``.

    These are of the same size.  Rows and columns are first positions in an array of numbers.
    """

    rows: Index
    sizes: Index
    first: Index
    columns: Index


class Blocks(NamedTuple):
    """Positions of the blocks of element matrices among ``total`` entries.

    Block ``j, m`` of element ``e`` begins at ``start[e, j, m]``, negative if it has no place; its rows are
    ``width[e, j, m]`` entries apart.
    """

    start: Index
    width: Index
    total: int


class Pairs(NamedTuple):
    """Pairs of layers, by ascending rows.

    Attributes
    ----------
    row, column
        Places of each pair's layers.
    size, kind
        Number of unknowns of these layers, and which rank's row and column it is.
    start, width
        First entry and row stride of each block.
    """

    row: Index
    column: Index
    size: Index
    kind: Index
    start: Index
    width: Index


class CompressedRows(NamedTuple):
    """Room for compressed rows.

    Attributes
    ----------
    entries
        Which entries of a pattern they hold; empty if these are all.
    start, column
        The first entry of each row, and the columns.
    near
        Work space for the entries of one row.
    """

    entries: Index
    start: Any
    column: Any
    near: Index


PAIRS = types.NamedUniTuple(I1, 6, Pairs)
COMPRESSED_ROWS = types.NamedTuple([I1, P1, P1, I1], CompressedRows)
COUPLING = types.NamedUniTuple(I1, 4, Coupling)
BLOCKS = types.NamedTuple([I3, I3, i8], Blocks)


@njit(b1(I1, I1, I1, I1), **FAST)
def first_numbers(places: Index, sizes: Index, number: Index, first: Index) -> bool:
    """Fill in each layer's first nonnegative number, -1 without one; return whether no layer has both signs."""
    whole = True
    for k in range(places.size):
        first[k] = -1
        held = False
        for i in range(sizes[k]):
            here = number[places[k] + i]
            if here < 0:
                held = True
            elif first[k] < 0:
                first[k] = here
        whole = whole and not (held and first[k] >= 0)
    return whole


@njit(types.UniTuple(i8, 3)(PAIRS, i8, i8, COUPLING), **FAST)
def row_by_row(pairs_of: Pairs, chosen: int, begin: int, coupling: Coupling) -> tuple[int, int, int]:
    """Place the blocks of pairs of layers of one kind, row by row, from entry ``begin`` on.

    Returns the numbers of rows and of pairs in ``coupling``, which must be large enough for all, and the end of the
    entries.
    """
    row, column, size, kind, start, width = pairs_of
    rows, sizes, first, columns = coupling
    count = pairs = k = 0
    place = begin
    while k < row.size:
        end, beside = k, 0
        while end < row.size and row[end] == row[k]:
            beside += 1 if kind[end] == chosen else 0
            end += 1
        if beside:
            rows[count], sizes[count], first[count] = row[k], size[k], pairs
            count += 1
            at = place
            for p in range(k, end):
                if kind[p] == chosen:
                    start[p], width[p] = at, beside * size[k]
                    at += size[k]
                    columns[pairs] = column[p]
                    pairs += 1
            place += beside * size[k] * size[k]
        k = end
    first[count] = pairs
    return count, pairs, place


@njit(void(COUPLING, I1, I1, I1), **FAST)
def pattern_indices(coupling: Coupling, number: Index, row: Index, column: Index) -> None:
    """Fill in the numbers of row and column of each entry, row by row."""
    rows, sizes, first, columns = coupling
    place = 0
    for r in range(rows.size):
        for i in range(sizes[r]):
            own = number[rows[r] + i]
            for c in range(first[r], first[r + 1]):
                for k in range(sizes[r]):
                    row[place] = own
                    column[place] = number[columns[c] + k]
                    place += 1


@njit(i8(COUPLING, I1, i8, i8, b1, i8, COMPRESSED_ROWS), **FAST)
def pattern_rows(
    coupling: Coupling, number: Index, low: int, high: int, inside: bool, place: int, out: CompressedRows
) -> int:
    """Fill in the compressed rows ``low .. high - 1`` of the entries of a pattern that have a number.

    Returns their number, or -1 if rows or columns do not ascend or are out of range.

    Parameters
    ----------
    coupling
        Which layers couple.
    number
        Number of what is at each place, negative where there is none.
    inside
        Whether all columns are within these rows, and counted from the first of them; else none is.
    place
        Position of the first entry.
    """
    entries, start, column, near = out
    rows, sizes, first, columns = coupling
    total = 0
    row = low - 1
    for r in range(rows.size):
        # All rows of a layer have the same columns.
        size = sizes[r]
        count = 0
        last = -1
        right = True
        for c in range(first[r], first[r + 1]):
            for k in range(size):
                other = number[columns[c] + k]
                if other >= 0:
                    right = right and other > last and (low <= other < high) == inside
                    last = other
                    column[total + count] = other - low if inside else other
                    near[count] = (c - first[r]) * size + k
                    count += 1
        begin = total
        for i in range(size):
            own = number[rows[r] + i]
            if own >= 0:
                if own <= row or own >= high or not right:
                    return -1
                while row < own:
                    row += 1
                    start[row - low] = total
                if total > begin:
                    for k in range(count):
                        column[total + k] = column[begin + k]
                for k in range(count if entries.size else 0):
                    entries[total + k] = place + near[k]
                total += count
            place += size * (first[r + 1] - first[r])
    for i in range(row + 1 - low, start.size):
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
                    place = start[e, j, m] + i * width[e, j, m]
                    for k in range(size):
                        entries[place + k] += matrices[e, j, i, m, k]
