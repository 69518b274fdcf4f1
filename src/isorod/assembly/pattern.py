"""The sparsity pattern of a body's elements, each entry once and row by row.

Nodes couple with whole layers, so a row's columns are whole layers too; entries that several elements share are added
up before PETSc sees them.  On one rank they are the matrix's compressed rows as they come; on several, its COO
preallocation has a third of the entries to sort, and finds them sorted.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly import pattern_kernel
from isorod.assembly.pattern_kernel import Blocks, Coupling
from isorod.petsc.matrix import Rows


class Pattern:
    """Pattern of elements that couple layers of ``size`` entries each.

    Parameters
    ----------
    element_layers
        Layers of each element, shape ``(E, l)``; negative where supports hold a layer, which then has no entries.
    size
        Entries of a layer: nodes, or degrees of freedom.

    Attributes
    ----------
    blocks
        Where blocks of element matrices are among the entries (`isorod.assembly.pattern_kernel.Blocks`).
    """

    def __init__(self, element_layers: Index, size: int) -> None:
        self.size = size
        element_layers = np.ascontiguousarray(element_layers)
        elements, functions = element_layers.shape
        count = int(element_layers.max(initial=-1)) + 1
        layers, first, columns = (np.empty(n, dtype=int) for n in (count, count + 1, elements * functions**2))
        start, width = np.full((elements, functions, functions), -1), np.zeros((elements, functions), dtype=int)
        mark, near = np.full(count, -1), np.empty(elements * functions, dtype=int)
        room = Coupling(layers, first, columns, size)
        rows, pairs = pattern_kernel.couple(element_layers, room, start, width, mark, near)
        self._coupling = Coupling(layers[:rows], first[: rows + 1], columns[:pairs], size)
        self.blocks = Blocks(start, width, pairs * size * size)

    def indices(self, number: Index) -> tuple[Index, Index]:
        """Return row and column of each entry, shape ``(total,)``, as numbers of what is at ``layer size + place``."""
        row, column = np.empty(self.blocks.total, dtype=int), np.empty(self.blocks.total, dtype=int)
        pattern_kernel.pattern_indices(self._coupling, np.ascontiguousarray(number), row, column)
        return row, column

    def compressed_rows(self, number: Index, size: int) -> Rows | None:
        """Return the entries that have a number as compressed rows of a matrix of ``size``; None if some descend."""
        total = self.blocks.total
        there = number[: number.size // self.size * self.size].reshape(-1, self.size)[self._coupling.layers]
        whole = bool((there >= 0).all())
        start, column = np.empty(size + 1, dtype=PETSc.IntType), np.empty(total, dtype=PETSc.IntType)
        entries = np.empty(0 if whole else total, dtype=np.int64)
        near = np.empty(self.size * int(np.diff(self._coupling.first).max(initial=0)), dtype=int)
        count = pattern_kernel.pattern_rows(self._coupling, np.ascontiguousarray(number), entries, start, column, near)
        if count < 0 or total > np.iinfo(PETSc.IntType).max:
            return None
        return Rows(None if whole else entries[:count], start, column[:count])

    def merge(self, matrices: Array) -> Array:
        """Return the entries ``(total,)`` of the sum of element matrices ``(E, l size, l size)``."""
        entries = np.zeros(self.blocks.total)
        self.add(matrices, entries, np.arange(self.blocks.start.shape[0]))
        return entries

    def add(self, matrices: Array, entries: Array, which: Index) -> None:
        """Add the matrices ``(e, l size, l size)`` of some elements to the entries."""
        functions = self.blocks.start.shape[1]
        shaped = matrices.reshape(-1, functions, self.size, functions, self.size)
        blocks = Blocks(self.blocks.start[which], self.blocks.width[which], self.blocks.total)
        pattern_kernel.merge(np.ascontiguousarray(shaped), blocks, entries)


class Numbered(NamedTuple):
    """The entries of a pattern: what is at ``layer size + place`` has this number, negative if it is held."""

    pattern: Pattern
    number: Index


# Where the entries of a matrix are: in a pattern, or rows and columns of each.
Entries = Numbered | tuple[Index, Index]


def rows_and_columns(entries: Sequence[Entries]) -> tuple[Index, Index]:
    """Return rows and columns of all entries, those of held degrees of freedom negative."""
    pairs = [one.pattern.indices(one.number) if isinstance(one, Numbered) else one for one in entries]
    return joined([pair[0] for pair in pairs], int), joined([pair[1] for pair in pairs], int)


def joined(arrays: Sequence[Any], kind: type) -> Any:
    """Return one array of several, or of none."""
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate([np.empty(0, dtype=kind), *arrays])
