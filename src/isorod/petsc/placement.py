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
        more = [np.concatenate([np.empty(0, np.int64), *(pair[k] for pair in found.values())]) for k in range(2)]
        count = rows.size + more[0].size
        start, other_start = (np.zeros(own + 1, dtype=PETSc.IntType) for _ in range(2))
        column, other_column = (np.empty(count, dtype=PETSc.IntType) for _ in range(2))
        places, received = (np.full(n, -1, dtype=PETSc.IntType) for n in (rows.size, more[0].size))
        arrays = np.ascontiguousarray(rows), np.ascontiguousarray(columns), *more
        _place(*arrays, int(low), start, column, other_start, other_column, places, received)
        self._own, self._others = (
            Compressed(first, across[: first[-1]].copy(), np.zeros(first[-1], dtype=PETSc.ScalarType))
            for first, across in ((start, column), (other_start, other_column))
        )
        self._runs = _runs(places, int(start[-1]))
        ends = np.cumsum([pair[0].size for pair in found.values()], dtype=np.int64)
        self._received = {
            rank: (part.size, _runs(part, int(start[-1])))
            for rank, part in (zip(found, np.split(received, ends[:-1]), strict=True) if found else ())
        }

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


@njit(void(I1, I1, I1, I1, i8, P1, P1, P1, P1, P1, P1), **STRICT)
def _place(
    rows: Any,
    columns: Any,
    more_rows: Any,
    more_columns: Any,
    low: int,
    start: Any,
    column: Any,
    other_start: Any,
    other_column: Any,
    places: Any,
    more: Any,
) -> None:
    """Fill compressed rows, each entry once, and where each of those given, and of more, is.

    Columns that are numbers of these rows are counted from the first of them, and the entries there come first in the
    places; the others come behind.
    """
    own = start.size - 1
    # The entries of each row, in the order given.
    first = np.zeros(own + 1, dtype=np.int64)
    for k in range(rows.size + more.size):
        i = (rows[k] if k < rows.size else more_rows[k - rows.size]) - low
        j = columns[k] if k < rows.size else more_columns[k - rows.size]
        if 0 <= i < own and j >= 0:
            first[i + 1] += 1
    for i in range(own):
        first[i + 1] += first[i]
    order = np.empty(first[own], dtype=places.dtype)
    for k in range(rows.size + more.size):
        i = (rows[k] if k < rows.size else more_rows[k - rows.size]) - low
        j = columns[k] if k < rows.size else more_columns[k - rows.size]
        if 0 <= i < own and j >= 0:
            order[first[i]] = k
            first[i] += 1
    inside = outside = begin = 0
    for i in range(own):
        for e in range(begin, first[i]):
            # By ascending columns: nearly all rows come so.
            k = order[e]
            j = columns[k] if k < rows.size else more_columns[k - rows.size]
            at = e
            while at > begin:
                before = order[at - 1]
                if (columns[before] if before < rows.size else more_columns[before - rows.size]) <= j:
                    break
                order[at] = before
                at -= 1
            order[at] = k
        last = -1
        for e in range(begin, first[i]):
            k = order[e]
            j = columns[k] if k < rows.size else more_columns[k - rows.size]
            mine = low <= j < low + own
            if j != last:
                last = j
                if mine:
                    column[inside] = j - low
                    inside += 1
                else:
                    other_column[outside] = j
                    outside += 1
            # Those of others are counted from the end, until the number of these is known.
            place = inside - 1 if mine else -1 - outside
            if k < rows.size:
                places[k] = place
            else:
                more[k - rows.size] = place
        begin = first[i]
        start[i + 1], other_start[i + 1] = inside, outside
    for k in range(places.size):
        if places[k] < -1:
            places[k] = inside - 2 - places[k]
    for k in range(more.size):
        if more[k] < -1:
            more[k] = inside - 2 - more[k]
