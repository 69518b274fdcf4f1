"""Positions of ranks' entries in a matrix over all of them.

PETSc's COO preallocation is a comparison sort of all entries, and keeps several numbers for each.  Here entries are
sorted into their rows by counting, once, and only those of other ranks' rows are sent.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import i8, types, void
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Index
from isorod.compiled import F1, I1, STRICT, njit
from isorod.petsc.layout import split_matrix
from isorod.petsc.rows import P1, Compressed

# Tag of messages with entries.
_TAG = 17


class Placement:
    """Positions of this rank's entries, and of those received from others.

    Parameters
    ----------
    comm, own
        The communicator, and the number of this rank's rows.
    rows, columns
        Row and column of each entry in the whole matrix; negative ones are ignored.
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
        received = {rank: pair for rank, pair in enumerate(inbox) if pair is not None}
        placed = gather([(rows, columns), *received.values()], int(low), int(high))
        self._own, self._others = (
            Compressed(first, across, np.zeros(across.size, dtype=PETSc.ScalarType))
            for first, across in (placed.own, placed.others)
        )
        runs = [_runs(places, placed.bound) for places in placed.places]
        self._bound, self._runs = placed.bound, runs[0]
        lengths = (pair[0].size for pair in received.values())
        self._received = dict(zip(received, zip(lengths, runs[1:], strict=True), strict=True))

    def matrix(self, sizes: tuple[int, int]) -> PETSc.Mat:
        """Return a new matrix with these arrays, given its rows here and in all; it must not outlive them."""
        return split_matrix(self._whole, sizes, self._own, self._others)

    def set(self, matrix: PETSc.Mat, values: NDArray[np.float64]) -> None:
        """Set the entries of the matrix made here; repeated ones are summed."""
        sent = [self._comm.Isend(values[which], rank, _TAG) for rank, which in self._sent.items()]
        own, others = self._own.values, self._others.values
        own[:] = 0.0
        others[:] = 0.0
        _add(np.ascontiguousarray(values), *self._runs, self._bound, own, others)
        for rank, (count, runs) in self._received.items():
            more = np.empty(count)
            self._comm.Recv(more, rank, _TAG)
            _add(more, *runs, self._bound, own, others)
        for one in sent:
            one.Wait()
        matrix.assemble()


class Gathered(NamedTuple):
    """Compressed rows of entries.

    Attributes
    ----------
    own, others
        First entry of each row and the columns: of the diagonal block, counted from its first row, and of the others.
    places
        For each part its entries' positions: among the own, or ``bound`` plus the position among the others; -1 if an
        index is negative or the row is not one of these.
    bound
        At least the number of own entries.
    """

    own: tuple[NDArray[Any], NDArray[Any]]
    others: tuple[NDArray[Any], NDArray[Any]]
    places: list[Index]
    bound: int


def gather(parts: Sequence[tuple[Index, Index]], low: int, high: int) -> Gathered:
    """Return the rows ``low .. high - 1`` of entries with given rows and columns, repeated ones merged."""
    own = high - low
    start = np.zeros(own + 1, dtype=np.int64)
    bound = sum(_count(*part, low, high, start) for part in parts)
    np.cumsum(start, out=start)
    free, total = start[:-1].copy(), int(start[-1])
    keys, order = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
    starts = [0, *np.cumsum([rows.size for rows, _ in parts]).tolist()]
    for first, part in zip(starts, parts, strict=False):
        _sort(*part, low, high, first, free, keys, order)
    first_own, first_others = (np.zeros(own + 1, dtype=PETSc.IntType) for _ in range(2))
    columns_own, columns_others = (np.empty(n, dtype=PETSc.IntType) for n in (bound, total - bound))
    places = np.full(starts[-1], -1)
    _compress(start, keys, order, low, bound, first_own, columns_own, first_others, columns_others, places)
    own_rows, other_rows = (
        (first, columns[: first[-1]]) for first, columns in ((first_own, columns_own), (first_others, columns_others))
    )
    return Gathered(own_rows, other_rows, np.split(places, starts[1:-1]), bound)


@njit(i8(I1, I1, i8, i8, I1), **STRICT)
def _count(rows: Any, columns: Any, low: int, high: int, start: Any) -> int:
    """Count the entries of row ``r`` in ``start[r + 1]``; return the number of those in the diagonal block."""
    inside = 0
    for k in range(rows.size):
        if low <= rows[k] < high and columns[k] >= 0:
            start[rows[k] - low + 1] += 1
            inside += low <= columns[k] < high
    return inside


@njit(void(I1, I1, i8, i8, i8, I1, I1, I1), **STRICT)
def _sort(rows: Any, columns: Any, low: int, high: int, first: int, free: Any, keys: Any, order: Any) -> None:
    """Put entries, counted from ``first``, into their rows, with keys that ascend as the columns of a row shall.

    Columns of the diagonal block come first in a row, counted from its first row.
    """
    own = high - low
    for k in range(rows.size):
        if low <= rows[k] < high and columns[k] >= 0:
            at = free[rows[k] - low]
            free[rows[k] - low] += 1
            order[at] = first + k
            column = columns[k]
            keys[at] = column + own if column < low else (column - low if column < high else column)


@njit(void(I1, I1, I1, i8, i8, P1, P1, P1, P1, I1), **STRICT)
def _compress(
    start: Any, keys: Any, order: Any, low: int, bound: int, first: Any, own: Any, first_of_others: Any, others: Any,
    places: Any,
) -> None:  # fmt: skip
    """Fill in the merged rows, and the positions of the entries.  Few rows need sorting."""
    size = start.size - 1
    inside = outside = 0
    for i in range(size):
        begin, end = start[i], start[i + 1]
        for at in range(begin + 1, end):
            if keys[at] < keys[at - 1]:
                ascending = np.argsort(keys[begin:end])
                keys[begin:end] = keys[begin:end][ascending]
                order[begin:end] = order[begin:end][ascending]
                break
        last = -1
        for at in range(begin, end):
            key = keys[at]
            if key < size:
                if key != last:
                    own[inside] = key
                    inside += 1
                places[order[at]] = inside - 1
            else:
                if key != last:
                    others[outside] = key - size if key < low + size else key
                    outside += 1
                places[order[at]] = bound + outside - 1
            last = key
        first[i + 1] = inside
        first_of_others[i + 1] = outside


@njit(types.UniTuple(I1, 3)(I1, i8), **STRICT)
def _runs(places: Any, bound: int) -> Any:
    """Return first entry, length and first position of runs of entries at consecutive positions: most are."""
    count = 0
    for k in range(places.size):
        # A run continues neither from -1 to position 0, nor from the own entries to the others.
        if places[k] >= 0 and (k == 0 or places[k] != places[k - 1] + 1 or places[k] == 0 or places[k] == bound):
            count += 1
    begins, lengths, goes = np.empty(count, np.int64), np.zeros(count, np.int64), np.empty(count, np.int64)
    run = -1
    for k in range(places.size):
        if places[k] < 0:
            continue
        if k == 0 or places[k] != places[k - 1] + 1 or places[k] == 0 or places[k] == bound:
            run += 1
            begins[run], goes[run] = k, places[k]
        lengths[run] += 1
    return begins, lengths, goes


@njit(void(F1, I1, I1, I1, i8, F1, F1), **STRICT)
def _add(values: Any, begins: Any, lengths: Any, places: Any, bound: int, own: Any, others: Any) -> None:
    """Add runs of values to entries, those with positions from ``bound`` on to the others."""
    for r in range(begins.size):
        b, p = begins[r], places[r]
        if p < bound:
            for e in range(lengths[r]):
                own[p + e] += values[b + e]
        else:
            for e in range(lengths[r]):
                others[p - bound + e] += values[b + e]
