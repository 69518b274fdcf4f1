"""What the matrix of a part, of rods or of a solid, adds to that of the system that ties make of the parts."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc
from scipy.sparse import bmat, csr_array
from scipy.sparse.csgraph import connected_components

from isorod.arrays import Array, Index
from isorod.petsc.rows import local_rows

Mask = NDArray[np.bool_]


class Group(NamedTuple):
    """Slaves that have masters in common, as those of one component of a weld.

    Attributes
    ----------
    slaves : (s,)
        Their numbers among all slaves, ascending.
    masters : (m,)
        Unknowns of the system that they depend on, ascending.
    rows : (s, m)
        What they are of these: few of them are zero.
    """

    slaves: Index
    masters: Index
    rows: Array


def groups(dependent: csr_array) -> list[Group]:
    """Return slaves, of which rows ``(slaves, unknowns)`` are given, as groups that have no master in common."""
    masters, columns = np.unique(dependent.indices, return_inverse=True)
    rows = csr_array((dependent.data, columns, dependent.indptr), shape=(dependent.shape[0], masters.size))
    if not masters.size:
        return []
    count, label = connected_components(bmat([[None, rows], [rows.T, None]]), directed=False)
    of_slaves, of_masters = (_split(one, count) for one in np.split(label, [rows.shape[0]]))
    return [
        Group(own, masters[theirs], np.ascontiguousarray(rows[own][:, theirs].toarray()))
        for own, theirs in zip(of_slaves, of_masters, strict=True)
        if own.size and theirs.size
    ]


def _split(label: Index, count: int) -> list[Index]:
    """Return the places of each label."""
    return np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label, minlength=count))[:-1])


class _Piece(NamedTuple):
    """What a group's slaves have to do with other unknowns of a part.

    Attributes
    ----------
    group
        The group.
    others : (n,)
        The other unknowns.
    matrix : (n, s)
        A row of each of them; the values are given each time.
    which
        Where these are among the entries of the part's matrix.
    """

    group: Group
    others: Index
    matrix: csr_array
    which: Index

    def product(self, entries: Array) -> Array:
        """Return the product ``(n, m)`` with what slaves are of masters."""
        self.matrix.data[:] = entries[self.which]
        return np.asarray(self.matrix @ self.group.rows)


class Condensed:
    """Entries of ``T^T K T``, of this rank's rows of a part's own matrix ``K``.

    Where no tie determines row or column they are those of ``K``, in the order of its own.  Behind them are blocks of
    each group of slaves, full ones since what slaves are of their masters nearly is.

    Parameters
    ----------
    own
        The part's matrix.
    number : (n,)
        Unknown of the system of each of the part's, -1 where it is held or a slave.
    slave : (n,)
        Number of each of the part's among all slaves, -1 of those that are none.
    every
        All groups of slaves.

    Attributes
    ----------
    rows, columns
        Places of all entries in the system, negative ones of those that are in none.
    """

    def __init__(self, own: PETSc.Mat, number: Index, slave: Index, every: Sequence[Group]) -> None:
        rows, columns = indices(own)
        self._group, self._place = _grouped(slave, every)
        self._every, self._free = every, number >= 0
        tied = self._group >= 0
        self._of_rows = list(self._pieces(rows, columns, tied | self._free))
        self._of_columns = list(self._pieces(columns, rows, self._free))
        places = [(number[rows], number[columns])]
        for one in self._of_rows:
            free, blocks = self._split_others(one)
            places.append(_block(number[one.others[free]], one.group.masters)[::-1])
            places += [_block(one.group.masters, other.masters) for other, _, _ in blocks]
        places += [_block(number[one.others], one.group.masters) for one in self._of_columns]
        self.rows, self.columns = (np.concatenate(each) for each in zip(*places, strict=True))

    def values(self, own: PETSc.Mat) -> Array:
        """Return the values of all entries, of the part's matrix as it is now."""
        found = local_rows(own)
        entries = np.concatenate([found.own.values, found.others.values])
        values = [entries]
        for one in self._of_rows:
            product = one.product(entries)
            free, blocks = self._split_others(one)
            values.append(product[free].ravel())
            values += [(product[some].T @ other.rows[own]).ravel() for other, some, own in blocks]
        values += [one.product(entries).ravel() for one in self._of_columns]
        return np.concatenate(values)

    def _pieces(self, mine: Index, others: Index, kept: Mask) -> Iterator[_Piece]:
        """Yield what the slaves among ``mine``, rows or columns of entries, have to do with others that are kept."""
        some = np.flatnonzero((self._group[mine] >= 0) & kept[others])
        split = _split(self._group[mine[some]], len(self._every)) if some.size else []
        for group, own in zip(self._every, split, strict=False):
            if not own.size:
                continue
            which = some[own]
            found, row = np.unique(others[which], return_inverse=True)
            place = self._place[mine[which]]
            order = np.lexsort((place, row))
            start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=found.size))])
            shape = found.size, group.slaves.size
            yield _Piece(group, found, csr_array((np.ones(own.size), place[order], start), shape=shape), which[order])

    def _split_others(self, piece: _Piece) -> tuple[Mask, list[tuple[Group, Index, Index]]]:
        """Return which of the others are no slaves, and of each group which ones are, and their places in it."""
        group = self._group[piece.others]
        blocks: list[tuple[Group, Index, Index]] = []
        for k in np.unique(group[group >= 0]):
            some = np.flatnonzero(group == k)
            blocks.append((self._every[k], some, self._place[piece.others[some]]))
        return group < 0, blocks


def _grouped(slave: Index, every: Sequence[Group]) -> tuple[Index, Index]:
    """Return of a part's unknowns the group of those that are slaves, else -1, and their place in it."""
    count = max((int(one.slaves.max()) for one in every), default=-1) + 1
    known = np.full((2, max(count, int(slave.max(initial=-1)) + 1) + 1), -1)
    for k, one in enumerate(every):
        known[:, one.slaves] = np.full(one.slaves.size, k), np.arange(one.slaves.size)
    group, place = known[:, slave]
    return group, place


def _block(rows: Index, columns: Index) -> tuple[Index, Index]:
    """Return the places of the entries of a full block, row by row."""
    return np.repeat(rows, columns.size), np.tile(columns, rows.size)


def indices(matrix: PETSc.Mat) -> tuple[Index, Index]:
    """Return row and column of each entry of this rank's rows, first those at columns that are numbers of these."""
    own, others, ghosts = local_rows(matrix)
    numbers = np.arange(*matrix.getOwnershipRange(), dtype=np.int64)
    rows = np.concatenate([np.repeat(numbers, np.diff(part.start)) for part in (own, others)])
    columns = np.empty_like(rows)
    np.add(own.column, matrix.getOwnershipRange()[0], out=columns[: own.column.size])
    columns[own.column.size :] = ghosts[others.column]
    return rows, columns
