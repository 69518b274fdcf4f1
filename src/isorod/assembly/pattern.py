"""The sparsity pattern of layered elements, each entry once and row by row.

Nodes couple with whole layers, so a row's columns are whole layers too; entries common to several elements are summed
before PETSc gets them.  They are ordered as the matrix's own arrays (`isorod.petsc.layout`): a rank's diagonal block,
its off-diagonal block, then the entries of other ranks' rows, which are sent there.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly import pattern_kernel
from isorod.assembly.pattern_kernel import Blocks, CompressedRows, Coupling, Pairs
from isorod.petsc.layout import Layout, Rows, Squares, rows_alone

# Pairs of layers: rows and columns of this rank; its rows, columns of other ranks; rows of other ranks.
_OWN, _OTHERS, _AWAY = range(3)


class Layers(NamedTuple):
    """Layers of a body's elements: where the numbers of each begin, shape ``(E, l)``, and how many there are."""

    places: Index
    size: int


class Pattern:
    """Pattern of the elements that a rank has.

    Parameters
    ----------
    bodies
        Layers of the bodies, body by body, at ascending places.
    number
        Number of what is at each place, negative if it is held.  A layer that is held as a whole has no entries.
    rows
        The communicator and the number of this rank's rows, if a matrix with just these entries is to be laid out.

    Attributes
    ----------
    blocks
        For each body, the positions of its element matrices' blocks among the entries.
    total
        Number of entries.
    layout
        Their positions in a matrix over these ranks; None without ranks, and where rows or columns would not ascend,
        as with tied unknowns.
    """

    def __init__(self, bodies: Sequence[Layers], number: Index, rows: tuple[PETSc.Comm, int] | None = None) -> None:
        self._number = np.ascontiguousarray(number)
        self.layout: Layout | None = None
        mine, which, whole = self._couplings(bodies)
        pairs = None if rows is None else self._over_ranks(mine, whole, *rows)
        if pairs is None:
            pairs = mine
            self._coupling, self.total = pairs.row_by_row(_OWN, 0)
        elif pairs is not mine:
            which = np.append(np.searchsorted(pairs.key, mine.key), -1)[which]
        self.blocks: list[Blocks] = []
        end = 0
        for one in bodies:
            elements, functions = one.places.shape
            begin, end = end, end + elements * functions**2
            start, width = (
                values[which[begin:end]].reshape(elements, functions, functions)
                for values in (pairs.start, pairs.width)
            )
            self.blocks.append(Blocks(start, width, self.total))

    def _couplings(self, bodies: Sequence[Layers]) -> "tuple[_Pairs, Index, bool]":
        """Return pairs of layers, the pair of each block of each element, and whether no layer is held in part.

        The pair is -1 for blocks without entries.
        """
        keys, sizes, whole = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)], True
        for places, size in bodies:
            first, plain = self._first(places.ravel(), np.full(places.size, size))
            whole, there = whole and plain, (first >= 0).reshape(places.shape)
            key = places[:, :, None] * self._number.size + places[:, None, :]
            keys.append(np.where(there[:, :, None] & there[:, None, :], key, -1).ravel())
            sizes.append(np.full(key.size, size))
        key, index, which = np.unique(np.concatenate(keys), return_index=True, return_inverse=True)
        held = int(key.size > 0 and key[0] < 0)
        pairs = _Pairs(key[held:], np.concatenate(sizes)[index[held:]], self._number.size)
        return pairs, which - held, whole

    def _first(self, places: Index, sizes: Index) -> tuple[Index, bool]:
        """Return the first number of each layer, -1 if all of it is held, and whether none is held in part."""
        first = np.empty(places.size, dtype=np.int64)
        return first, bool(pattern_kernel.first_numbers(np.ascontiguousarray(places), sizes, self._number, first))

    def _over_ranks(self, mine: "_Pairs", whole: bool, ranks: PETSc.Comm, count: int) -> "_Pairs | None":
        """Find the layout of a matrix with ``count`` rows on this rank; return its pairs, None if there is none."""
        comm = ranks.tompi4py()
        if comm.size == 1:
            own, self.total = mine.row_by_row(_OWN, 0)
            alone = self._rows(own, 0, count, True, 0, whole)
            self.layout = None if alone is None else rows_alone(alone)
            return None if alone is None else mine
        bounds = np.concatenate([[0], np.cumsum(comm.allgather(count))])
        low, high = (int(bound) for bound in bounds[comm.rank : comm.rank + 2])
        owner, _ = self._owners(mine.row, mine.size, bounds)
        inbox = comm.alltoall([mine.some(owner == rank) if rank != comm.rank else None for rank in range(comm.size)])
        received = {rank: one for rank, one in enumerate(inbox) if one is not None and one.key.size}
        pairs = mine.joined(received.values())
        owner, _ = self._owners(pairs.row, pairs.size, bounds)
        beside, whole = self._owners(pairs.column, pairs.size, bounds)
        pairs.kind = np.where(owner != comm.rank, _AWAY, np.where(beside == comm.rank, _OWN, _OTHERS))
        own, inner = pairs.row_by_row(_OWN, 0)
        others, self.total = pairs.row_by_row(_OTHERS, inner)
        sent = dict[int, slice]()
        for rank in np.unique(owner[owner != comm.rank]):
            begin, self.total = self.total, pairs.block_by_block(np.flatnonzero(owner == rank), self.total)
            sent[int(rank)] = slice(begin, self.total)
        inside = self._rows(own, low, high, True, 0, whole)
        outside = self._rows(others, low, high, False, inner, whole)
        if comm.allreduce(inside is None or outside is None) or inside is None or outside is None:
            return None
        self.layout = Layout(inside, outside, sent, {rank: pairs.squares(one.key) for rank, one in received.items()})
        return pairs

    def _owners(self, places: Index, sizes: Index, bounds: Index) -> tuple[Index, bool]:
        """Return the ranks of layers, and whether none of these is held in part."""
        first, whole = self._first(places, sizes)
        return np.searchsorted(bounds, first, side="right") - 1, whole

    def _rows(self, coupling: Coupling, low: int, high: int, inside: bool, begin: int, whole: bool) -> Rows | None:
        """Return the compressed rows ``low .. high - 1`` of entries from ``begin`` on; None if they do not ascend."""
        widths = coupling.sizes * np.diff(coupling.first)
        total = int((widths * coupling.sizes).sum())
        start, column = np.empty(high - low + 1, dtype=PETSc.IntType), np.empty(total, dtype=PETSc.IntType)
        entries = np.empty(0 if whole else total, dtype=np.int64)
        near = np.empty(int(widths.max(initial=0)), dtype=np.int64)
        out = CompressedRows(entries, start, column, near)
        count = pattern_kernel.pattern_rows(coupling, self._number, low, high, inside, begin, out)
        if count < 0 or begin + total > np.iinfo(PETSc.IntType).max:
            return None
        return Rows(slice(begin, begin + total) if whole else entries[:count], start, column[:count])

    def indices(self, number: Index | None = None) -> tuple[Index, Index]:
        """Return row and column of each entry of a pattern without layout, by other numbers if given."""
        row, column = np.empty(self.total, dtype=np.int64), np.empty(self.total, dtype=np.int64)
        number = self._number if number is None else np.ascontiguousarray(number)
        pattern_kernel.pattern_indices(self._coupling, number, row, column)
        return row, column


class _Pairs:
    """Pairs of layers that couple, once each: row by row, by ascending columns.

    Parameters
    ----------
    key
        Place of the row's layer times ``places``, plus that of the column's.
    size
        Number of unknowns of these layers.

    Attributes
    ----------
    row, column
        Places of the layers.
    kind
        Which rank's row and column it is: `_OWN`, `_OTHERS` or `_AWAY`.
    start, width
        First entry and row stride of each pair's block, with a -1 appended for blocks without a place.
    """

    def __init__(self, key: Index, size: Index, places: int) -> None:
        self.key, self.size, self._places = key, size, places
        self.row, self.column = np.divmod(key, max(places, 1))
        self.kind = np.full(key.size, _OWN)
        self.start, self.width = np.full((2, key.size + 1), -1)

    def some(self, which: Any) -> "_Pairs":
        """Return some of the pairs, not yet placed."""
        return _Pairs(self.key[which], self.size[which], self._places)

    def joined(self, more: "Iterable[_Pairs]") -> "_Pairs":
        """Return the union of these pairs and others, not yet placed."""
        everything = [self, *more]
        key, index = np.unique(np.concatenate([one.key for one in everything]), return_index=True)
        return _Pairs(key, np.concatenate([one.size for one in everything])[index], self._places)

    def row_by_row(self, kind: int, begin: int) -> tuple[Coupling, int]:
        """Place the pairs of a kind row by row; return their coupling and the end of their entries."""
        rows, sizes, first, columns = np.empty((4, self.key.size + 1), dtype=np.int64)
        room = Coupling(rows, sizes, first, columns)
        given = Pairs(self.row, self.column, self.size, self.kind, self.start, self.width)
        count, pairs, end = pattern_kernel.row_by_row(given, kind, begin, room)
        return Coupling(rows[:count], sizes[:count], first[: count + 1], columns[:pairs]), end

    def block_by_block(self, which: Index, begin: int) -> int:
        """Place some pairs, one block after the other; return the end of their entries."""
        ends = begin + np.cumsum(self.size[which] ** 2)
        self.start[which] = ends - self.size[which] ** 2
        self.width[which] = self.size[which]
        return int(ends[-1])

    def squares(self, key: Index) -> Squares:
        """Return the blocks of the pairs with some keys."""
        which = np.searchsorted(self.key, key)
        return Squares(self.start[which], self.width[which], self.size[which])


def add(matrices: Array, blocks: Blocks, entries: Array, which: Any = slice(None)) -> None:
    """Add matrices ``(e, l size, l size)`` of some of a body's elements to the entries of a pattern."""
    start, width = blocks.start[which], blocks.width[which]
    functions = start.shape[1]
    size = matrices.shape[1] // functions
    shaped = np.ascontiguousarray(matrices.reshape(-1, functions, size, functions, size))
    pattern_kernel.merge(shaped, Blocks(start, width, blocks.total), entries)


def joined(arrays: Sequence[NDArray[Any]], kind: type) -> NDArray[Any]:
    """Return several arrays, or none, concatenated and flattened."""
    return np.concatenate([np.empty(0, dtype=kind), *(one.ravel() for one in arrays)])
