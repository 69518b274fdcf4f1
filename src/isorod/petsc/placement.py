"""Where the entries that ranks have go in a matrix over all of them.

PETSc's own way (COO) sorts all entries by comparing them, and keeps several numbers for each.  Here they are counted
into place, once, and only those of rows that other ranks have travel.
"""

from typing import Any

import numpy as np
from numba import i8, void
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Index
from isorod.compiled import F1, I1, STRICT, njit
from isorod.petsc.layout import split_matrix
from isorod.petsc.rows import P1, Compressed

# Of messages with entries.
_TAG = 17


class Placement:
    """Places of this rank's entries, and of those that come from others.

    Parameters
    ----------
    comm, own
        All ranks, and the number of this one's rows.
    rows, columns
        Of each entry in the whole matrix; negative ones are ignored.
    """

    def __init__(self, comm: PETSc.Comm, own: int, rows: Index, columns: Index) -> None:
        self._whole, self._comm = comm, comm.tompi4py()
        bounds = np.concatenate([[0], np.cumsum(self._comm.allgather(own))])
        low, high = bounds[self._comm.rank : self._comm.rank + 2]
        away = np.flatnonzero((columns >= 0) & (((rows >= 0) & (rows < low)) | (rows >= high)))
        owner = np.searchsorted(bounds, rows[away], side="right") - 1
        self._sent = {int(rank): away[owner == rank] for rank in np.unique(owner)}
        outbox = [self._sent.get(rank) for rank in range(self._comm.size)]
        inbox = self._comm.alltoall([None if one is None else (rows[one], columns[one]) for one in outbox])
        found = {rank: pair for rank, pair in enumerate(inbox) if pair is not None}
        lengths = [rows.size, *(pair[0].size for pair in found.values())]
        rows, columns = (
            np.concatenate([given, *(pair[k] for pair in found.values())]) for k, given in enumerate((rows, columns))
        )
        # Columns that are numbers of these rows come first in a row, counted from the first of them.
        behind = np.where(columns < low, columns + own, columns)
        turned = np.where((columns >= low) & (columns < high), columns - low, behind)
        here = np.where((rows >= low) & (rows < high) & (columns >= 0), rows - low, -1)
        start, column, places = (np.zeros(n, dtype=PETSc.IntType) for n in (own + 1, rows.size, rows.size))
        column = column[: gather(here, turned, int(bounds[-1]), start, column, places)]
        inside = column < own
        before = np.concatenate([[0], np.cumsum(inside)]).astype(PETSc.IntType)
        others = column[~inside]
        others[others < own + low] -= own
        self._own, self._others = (
            Compressed(first, across, np.zeros(across.size, dtype=PETSc.ScalarType))
            for first, across in ((before[start], column[inside]), (start - before[start], others))
        )
        count = int(before[-1])
        order = np.where(inside, before[:-1], count + np.arange(column.size) - before[:-1])
        places = np.where(places < 0, -1, order[places] if order.size else -1)
        runs = [_runs(part, count) for part in np.split(places, np.cumsum(lengths[:-1]))]
        self._runs = runs[0]
        self._received = dict(zip(found, zip(lengths[1:], runs[1:], strict=True), strict=True))

    def matrix(self, sizes: tuple[int, int]) -> PETSc.Mat:
        """Return a new matrix of so many rows here and in all, whose arrays are these: keep it no longer than this."""
        return split_matrix(self._whole, sizes, self._own, self._others)

    def set(self, matrix: PETSc.Mat, values: NDArray[np.float64]) -> None:
        """Set the entries of the matrix made here, repeated ones added up."""
        sent = [self._comm.Isend(values[which], rank, _TAG) for rank, which in self._sent.items()]
        own, others = self._own.values, self._others.values
        own[:] = 0.0
        others[:] = 0.0
        _add(np.ascontiguousarray(values), *self._runs, own, others)
        for rank, (count, runs) in self._received.items():
            more = np.empty(count)
            self._comm.Recv(more, rank, _TAG)
            _add(more, *runs, own, others)
        for one in sent:
            one.Wait()
        matrix.assemble()


def _runs(places: NDArray[Any], own: int) -> tuple[Index, Index, Index]:
    """Return where runs of entries begin, how long they are and where the first goes: most entries lie as they come."""
    if not places.size:
        return (np.empty(0, dtype=np.int64),) * 3
    # Neither from what has no place, -1, to the first one, nor from the last of the own to the first of the others.
    begins = np.flatnonzero(np.r_[True, (np.diff(places) != 1) | (places[:-1] < 0) | (places[1:] == own)])
    lengths = np.diff(begins, append=places.size)
    there = places[begins] >= 0
    return begins[there], lengths[there], places[begins[there]].astype(np.int64)


@njit(void(F1, I1, I1, I1, F1, F1), **STRICT)
def _add(values: Any, begins: Any, lengths: Any, places: Any, own: Any, others: Any) -> None:
    """Add runs of values to entries, those with places beyond the first ones to the others."""
    for r in range(begins.size):
        b, p = begins[r], places[r]
        if p < own.size:
            for e in range(lengths[r]):
                own[p + e] += values[b + e]
        else:
            for e in range(lengths[r]):
                others[p - own.size + e] += values[b + e]


@njit(i8(I1, I1, i8, P1, P1, P1), **STRICT)
def gather(rows: Any, columns: Any, width: int, start: Any, column: Any, places: Any) -> int:
    """Fill compressed rows, each entry once, and where each of those given comes, -1 if an index is negative.

    Entries are counted into ``width`` columns, then into rows, which leaves the columns of each row in order.  Returns
    the number of entries.
    """
    size = start.size - 1
    first = np.zeros(max(size, width) + 1, dtype=np.int64)
    for k in range(rows.size):
        places[k] = -1
        if rows[k] >= 0 and columns[k] >= 0:
            first[columns[k] + 1] += 1
            start[rows[k] + 1] += 1
    for i in range(width):
        first[i + 1] += first[i]
    for i in range(size):
        start[i + 1] += start[i]
    by_column = np.empty(start[size], dtype=np.int64)
    for k in range(rows.size):
        if rows[k] >= 0 and columns[k] >= 0:
            by_column[first[columns[k]]] = k
            first[columns[k]] += 1
    order = np.empty_like(by_column)
    first[: size + 1] = start
    for k in by_column:
        order[first[rows[k]]] = k
        first[rows[k]] += 1
    total = at = 0
    for i in range(size):
        last, end = -1, start[i + 1]
        start[i] = total
        while at < end:
            k = order[at]
            if columns[k] != last:
                last = columns[k]
                column[total] = last
                total += 1
            places[k] = total - 1
            at += 1
    start[size] = total
    return total
