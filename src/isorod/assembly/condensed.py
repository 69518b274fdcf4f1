"""Contributions ``T^T K T`` of the matrix of rods or of a solid to the matrix of a system with ties."""

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
    """Slaves with common masters, such as those of one component of a weld.

    Attributes
    ----------
    slaves : (s,)
        Their numbers among all slaves, ascending.
    masters : (m,)
        Unknowns of the system that they depend on, ascending.
    rows : (s, m)
        Coefficients of the slaves in terms of the masters; few are zero.
    """

    slaves: Index
    masters: Index
    rows: Array


def groups(dependent: csr_array) -> list[Group]:
    """Return groups of slaves without common masters, given the slaves' rows ``(slaves, unknowns)``."""
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


class _CrossBlock(NamedTuple):
    """Block of a part's matrix that couples a group's slaves to other unknowns.

    Attributes
    ----------
    group
        The group.
    others : (n,)
        The other unknowns.
    matrix : (n, s)
        Its sparsity, a row for each of them; the values are set by `product`.
    which
        Positions of its entries among those of the part's matrix.
    """

    group: Group
    others: Index
    matrix: csr_array
    which: Index

    def product(self, entries: Array) -> Array:
        """Return the product ``(n, m)`` with the rows of the slaves."""
        self.matrix.data[:] = entries[self.which]
        return np.asarray(self.matrix @ self.group.rows)


class Condensed:
    """Entries of ``T^T K T`` from this rank's rows of a part's own matrix ``K``.

    Entries whose row and column are no slaves come first, in the order of ``K``.  Dense blocks of each group of slaves
    follow: the slaves' rows are nearly dense.

    Parameters
    ----------
    own
        The part's matrix.
    number : (n,)
        Unknown of the system of each of the part's, -1 where it is held or a slave.
    slave : (n,)
        Number of each of the part's unknowns among all slaves, -1 if it is none.
    every
        All groups of slaves.

    Attributes
    ----------
    rows, columns
        Row and column of all entries in the system; negative where an entry is dropped.
    """

    def __init__(self, own: PETSc.Mat, number: Index, slave: Index, every: Sequence[Group]) -> None:
        rows, columns = indices(own)
        self._group, self._place = _grouped(slave, every)
        self._every, self._free = every, number >= 0
        tied = self._group >= 0
        self._of_rows = list(self._cross_blocks(rows, columns, tied | self._free))
        self._of_columns = list(self._cross_blocks(columns, rows, self._free))
        places = [(number[rows], number[columns])]
        for one in self._of_rows:
            free, blocks = self._split_others(one)
            places.append(_block(number[one.others[free]], one.group.masters)[::-1])
            places += [_block(one.group.masters, other.masters) for other, _, _ in blocks]
        places += [_block(number[one.others], one.group.masters) for one in self._of_columns]
        self.rows, self.columns = (np.concatenate(each) for each in zip(*places, strict=True))

    def values(self, own: PETSc.Mat) -> Array:
        """Return the values of all entries from the present values of the part's matrix."""
        rows = local_rows(own)
        entries = np.concatenate([rows.own.values, rows.others.values])
        values = [entries]
        for one in self._of_rows:
            product = one.product(entries)
            free, blocks = self._split_others(one)
            values.append(product[free].ravel())
            values += [(product[some].T @ other.rows[own]).ravel() for other, some, own in blocks]
        values += [one.product(entries).ravel() for one in self._of_columns]
        return np.concatenate(values)

    def _cross_blocks(self, mine: Index, others: Index, kept: Mask) -> Iterator[_CrossBlock]:
        """Yield the blocks of slaves among ``mine``, the entries' rows or columns, with ``others`` that are kept."""
        some = np.flatnonzero((self._group[mine] >= 0) & kept[others])
        split = _split(self._group[mine[some]], len(self._every)) if some.size else []
        for group, own in zip(self._every, split, strict=False):
            if not own.size:
                continue
            which = some[own]
            unknowns, row = np.unique(others[which], return_inverse=True)
            place = self._place[mine[which]]
            order = np.lexsort((place, row))
            start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=unknowns.size))])
            shape = unknowns.size, group.slaves.size
            matrix = csr_array((np.ones(own.size), place[order], start), shape=shape)
            yield _CrossBlock(group, unknowns, matrix, which[order])

    def _split_others(self, block: _CrossBlock) -> tuple[Mask, list[tuple[Group, Index, Index]]]:
        """Return which others are no slaves, and for each group which are its slaves, and their positions in it."""
        group = self._group[block.others]
        blocks: list[tuple[Group, Index, Index]] = []
        for k in np.unique(group[group >= 0]):
            some = np.flatnonzero(group == k)
            blocks.append((self._every[k], some, self._place[block.others[some]]))
        return group < 0, blocks


def _grouped(slave: Index, every: Sequence[Group]) -> tuple[Index, Index]:
    """Return the group of each of a part's unknowns, -1 if it is no slave, and its position in the group."""
    count = max((int(one.slaves.max()) for one in every), default=-1) + 1
    known = np.full((2, max(count, int(slave.max(initial=-1)) + 1) + 1), -1)
    for k, one in enumerate(every):
        known[:, one.slaves] = np.full(one.slaves.size, k), np.arange(one.slaves.size)
    group, place = known[:, slave]
    return group, place


def _block(rows: Index, columns: Index) -> tuple[Index, Index]:
    """Return rows and columns of the entries of a dense block, row by row."""
    return np.repeat(rows, columns.size), np.tile(columns, rows.size)


def indices(matrix: PETSc.Mat) -> tuple[Index, Index]:
    """Return row and column of each entry of this rank's rows, those in the diagonal block first."""
    own, others, ghosts = local_rows(matrix)
    numbers = np.arange(*matrix.getOwnershipRange(), dtype=np.int64)
    rows = np.concatenate([np.repeat(numbers, np.diff(part.start)) for part in (own, others)])
    columns = np.empty_like(rows)
    np.add(own.column, matrix.getOwnershipRange()[0], out=columns[: own.column.size])
    columns[own.column.size :] = ghosts[others.column]
    return rows, columns
