"""Factors of a banded symmetric matrix whose rows several ranks share.

The first rows of a rank, as far as the previous rank's band reaches, separate the two.  Each rank eliminates its other
rows: the first one downwards, the last one upwards, each towards its only separator, with no more fill-in than on one
rank; ranks between have a separator at either end, and the one before them causes fill-in of its width all along, which
is not kept.  The Schur complement of the separators is banded, too, and small: every rank factorises it.

Where a rank has no rows besides its separator, or the factors are refused, the first rank factorises all rows, with row
exchanges if needed.
"""

from typing import Any

import numpy as np
from numba import i8, void
from petsc4py import PETSc
from scipy.linalg import lapack

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, STRICT, njit
from isorod.petsc.band import Factors
from isorod.petsc.band_kernel import Ordered
from isorod.petsc.rows import P1, Compressed, LocalRows, local_rows


class DistributedFactors:
    """Factors over the ranks of a matrix.

    Attributes
    ----------
    negative
        Number of negative eigenvalues; None where rows were exchanged, from which it is not known.
    """

    def __init__(self) -> None:
        self.negative: int | None = None
        self._inner = Factors()
        self._outer = Factors()
        self._whole: _Whole | None = None
        self._comm: Any = None

    def factorise(self, matrix: PETSc.Mat) -> bool:
        """Factorise; return False if the matrix is singular."""
        self._whole = None
        if self.eliminate(matrix):
            return True
        self._inner, self._outer = Factors(), Factors()
        self._whole = _Whole(matrix)
        self.negative = self._whole.negative
        return self._whole.regular

    def eliminate(self, matrix: PETSc.Mat, keep: bool = True, fill: float = np.inf) -> bool:
        """Factorise without row exchanges; return whether that succeeded.

        Without ``keep`` only the inertia remains, no factors.  A matrix whose factors would have more than ``fill``
        times its entries is refused.
        """
        self._comm = matrix.getComm().tompi4py()
        rows = local_rows(matrix)
        if self._comm.size == 1:
            size = matrix.getSize()[0]
            done = self._inner.factorise(Ordered(rows.own, 0, size), size, keep, fill)
            self.negative = self._inner.negative
            return done
        self._bounds = np.array(matrix.getOwnershipRanges(), dtype=np.int64)
        if not self._separate(rows):
            return False
        return self._join(self._inner.factorise(self._ordered(rows), self._own - self._before, keep, fill))

    def _separate(self, rows: LocalRows) -> bool:
        """Find the separators; return whether each rank has more rows than its separator."""
        rank = self._comm.rank
        reach = int(rows.columns[-1]) + 1 - self._bounds[rank + 1] if rows.columns.size else 0
        # Of each rank the separator before it.
        self._sizes = np.array([0, *self._comm.allgather(max(int(reach), 0))], dtype=np.int64)
        self._before, self._after = int(self._sizes[rank]), int(self._sizes[rank + 1])
        self._own = int(self._bounds[rank + 1] - self._bounds[rank])
        self._backward = self._before > 0 and self._after == 0
        self._between = self._before > 0 and self._after > 0
        self._first = np.concatenate([[0], np.cumsum(self._sizes)])
        return bool((np.diff(self._bounds) > self._sizes[:-1]).all())

    def _ordered(self, rows: LocalRows) -> Ordered:
        """Return this rank's rows in the order of elimination."""
        if self._backward:
            return Ordered(rows.own, 0, self._own, backward=True)
        first = self._before
        own = self._own - first
        row, place, values = _entries(rows.others)
        column = rows.columns[place].astype(np.int64) - self._bounds[self._comm.rank + 1]
        ahead = column >= 0
        row, column, values = row[ahead] - first, own + column[ahead], values[ahead]
        inside = row >= 0
        ordered = Ordered(rows.own, first, own, False, (row[inside], column[inside], values[inside]), self._after)
        if not first:
            return ordered
        # Rows of the separator before: their own block, and the coupling to later rows and the separator after.
        corner, border = np.zeros((first, first)), np.zeros((own + self._after, first))
        separator, place, coupling = _entries(rows.own, first)
        within = place < first
        corner[separator[within], place[within]] = coupling[within]
        border[place[~within] - first, separator[~within]] = coupling[~within]
        border[column[~inside], row[~inside] + first] = values[~inside]
        high = int(np.flatnonzero(border.any(axis=1)).max(initial=-1)) + 1
        self._border = border[:high].copy()
        return ordered._replace(border=self._border, corner=corner)

    def _join(self, done: bool) -> bool:
        """Factorise the matrix of the separators; return whether all factorisations succeeded."""
        inner, empty = self._inner, np.empty((0, 0))
        if not done:
            mine = None
        elif self._backward:
            mine = (inner.negative, inner.schur[::-1, ::-1].copy(), empty, empty)
        else:
            mine = (inner.negative, inner.corner, inner.border, inner.schur)
        parts = self._comm.allgather(mine)
        if any(part is None for part in parts):
            return False
        done = self._outer.factorise(_separators(parts, self._sizes), int(self._first[-1]))
        self.negative = sum(part[0] for part in parts) + self._outer.negative
        return done

    def solve(self, right: Array) -> Array:
        """Return this rank's solution for its right-hand side, or for the columns of several."""
        if right.ndim > 1 and (self._whole is not None or self._comm.size > 1):
            return np.stack([self.solve(one) for one in right.T], axis=1)
        if self._whole is not None:
            return self._whole.solve(right)
        if self._comm.size == 1:
            x = right.copy()
            self._inner.solve(x)
            return x
        own, before, after = self._own, self._before, self._after
        x = np.zeros(own - before + after) if self._between else np.zeros(own + after)
        x[: x.size - after] = right[::-1] if self._backward else right[before:] if self._between else right
        self._inner.forward(x)
        if not before and not after:
            self._inner.back(x)
        outer = np.zeros(self._first[-1])
        left = outer[self._first[self._comm.rank] :][:before]
        ahead = outer[self._first[self._comm.rank + 1] :][:after]
        if self._backward:
            left[:] = x[own - before :][::-1]
        elif after:
            ahead[:] = x[x.size - after :]
        if self._between:
            half = x.copy()
            x[x.size - after :] = 0.0
            self._inner.back(x)
            left[:] = right[:before] - self._border.T @ x[: self._border.shape[0]]
        # As buffers, not pickled: eigensolvers call this often.
        summed = np.empty_like(outer)
        self._comm.Allreduce(outer, summed)
        outer = summed
        self._outer.solve(outer)
        left = outer[self._first[self._comm.rank] :][:before]
        ahead = outer[self._first[self._comm.rank + 1] :][:after]
        if self._backward:
            x[own - before :] = left[::-1]
        elif self._between:
            x[:] = 0.0
            x[: self._border.shape[0]] = self._border @ left
            self._inner.forward(x)
            x = half - x
        if after:
            x[x.size - after :] = ahead
        if before or after:
            self._inner.back(x)
        if self._backward:
            return x[::-1]
        return np.concatenate([left, x[: own - before]]) if self._between else x[:own]


def _entries(rows: Compressed, count: int | None = None) -> tuple[Index, Index, Array]:
    """Return row, column and value of the entries of the first rows, or of all."""
    start = rows.start if count is None else rows.start[: count + 1]
    total = int(start[-1])
    return (
        np.repeat(np.arange(start.size - 1), np.diff(start)),
        rows.column[:total].astype(np.int64),
        rows.values[:total],
    )


def _separators(parts: list[Any], sizes: Index) -> Ordered:
    """Return the matrix of the separators from the ranks' Schur complements."""
    first = np.concatenate([[0], np.cumsum(sizes)])
    blocks = [np.zeros((n, n)) for n in sizes]
    for rank, (_, corner, _, schur) in enumerate(parts):
        blocks[rank][: len(corner)] += corner
        blocks[rank + 1][: len(schur)] += schur
    rows: list[Array] = []
    columns: list[Index] = []
    for rank, block in enumerate(blocks):
        # The rank between two separators has their coupling.
        line, low, high = [block], first[rank], first[rank + 1]
        if rank and parts[rank - 1][2].size:
            line.insert(0, parts[rank - 1][2])
            low = first[rank - 1]
        if rank < len(parts) and parts[rank][2].size:
            line.append(parts[rank][2].T)
            high = first[rank + 2]
        rows.append(np.hstack(line))
        columns.append(np.tile(np.arange(low, high), (block.shape[0], 1)))
    counts = [one.shape[1] for one in rows for _ in range(one.shape[0])]
    start = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
    column = np.concatenate([one.ravel() for one in columns]).astype(PETSc.IntType)
    values = np.concatenate([one.ravel() for one in rows])
    return Ordered(Compressed(start, column, values), 0, int(first[-1]))


class _Whole:
    """All rows on the first rank: band factors or, where these are refused, LU with row exchanges.

    Attributes
    ----------
    regular, negative
        Whether the matrix is regular, and its number of negative eigenvalues, None if not known; on every rank.
    """

    regular: bool
    negative: int | None

    def __init__(self, matrix: PETSc.Mat) -> None:
        self._comm = matrix.getComm().tompi4py()
        self._size = matrix.getSize()[0]
        self._counts = np.diff(matrix.getOwnershipRanges())
        rows = self._gathered(matrix)
        self._factors: Factors | None = None
        info = 0
        if rows is not None:
            self._factors = Factors() if self._comm.size > 1 else None
            if self._factors is None or not self._factors.factorise(Ordered(rows, 0, self._size), self._size):
                self._factors = None
                self._width = _bandwidth(rows.start, rows.column)
                whole = np.zeros((self._size, 3 * self._width + 1))
                _fill(*rows, whole)
                self._lu, self._pivots, info = lapack.dgbtrf(whole.T, self._width, self._width, overwrite_ab=1)
        negative = None if self._factors is None else self._factors.negative
        self.regular, self.negative = self._comm.bcast((info <= 0, negative))

    def _gathered(self, matrix: PETSc.Mat) -> Compressed | None:
        """Return all rows on the first rank, None on others."""
        if self._comm.size == 1:
            return local_rows(matrix).own
        parts = self._comm.gather(matrix.getValuesCSR())
        if parts is None:
            return None
        start, column, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        counts = np.concatenate([np.diff(part[0]) for part in parts])
        start = np.concatenate([[0], np.cumsum(counts)]).astype(PETSc.IntType)
        return Compressed(start, column, values)

    def solve(self, right: Array) -> Array:
        """Return this rank's solution for its right-hand side."""
        parts = self._comm.gather(right)
        solutions = None
        if parts is not None:
            x = np.concatenate(parts)
            if self._factors is not None:
                self._factors.solve(x)
            else:
                x, _ = lapack.dgbtrs(self._lu, self._width, self._width, x, self._pivots, overwrite_b=1)
            solutions = np.split(x, np.cumsum(self._counts)[:-1])
        return np.asarray(self._comm.scatter(solutions))


@njit(i8(P1, P1), **STRICT)
def _bandwidth(start: Any, column: Any) -> int:
    """Return how far the entries of compressed rows reach from the diagonal."""
    width = 0
    for i in range(start.size - 1):
        if start[i + 1] > start[i]:
            width = max(width, i - column[start[i]], column[start[i + 1] - 1] - i)
    return width


@njit(void(P1, P1, F1, F2), **STRICT)
def _fill(start: Any, column: Any, values: Array, result: Array) -> None:
    """Fill in the band as LAPACK's dgbtrf takes it transposed, with room for row exchanges, shape ``(n, 3 w + 1)``."""
    twice = 2 * (result.shape[1] // 3)
    for i in range(start.size - 1):
        for k in range(start[i], start[i + 1]):
            result[column[k], twice + i - column[k]] = values[k]
