"""The sparsity pattern of a body's elements, each entry once and row by row.

Nodes couple with whole layers, so a row's columns are whole layers too; entries that several elements share are added
up before PETSc sees them.  On one rank they are the matrix's compressed rows as they come; on several, its COO
preallocation has a third of the entries to sort, and finds them sorted.
"""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly import pattern_kernel
from isorod.petsc.matrix import Rows


class Pattern:
    """Pattern of elements that couple layers of ``size`` entries each.

    Parameters
    ----------
    element_layers
        Layers of each element, shape ``(E, l)``; negative where supports hold a layer, which then has no entries.
    size
        Entries of a layer: nodes, or degrees of freedom.
    """

    def __init__(self, element_layers: Index, size: int) -> None:
        self.size = size
        self._layers, self._first, self._columns, self._start, self._width, self.total = pattern_kernel.pattern(
            np.ascontiguousarray(element_layers), size
        )

    @property
    def places(self) -> tuple[Index, Index, int]:
        """Where each element's blocks of layers begin, how far their rows are apart, and the number of entries, as `isorod.assembly.pattern_kernel.pattern` says."""
        return self._start, self._width, self.total

    def indices(self, number: Index) -> tuple[Index, Index]:
        """Return row and column of each entry, shape ``(total,)``, as numbers of what is at ``layer size + place``."""
        return pattern_kernel.pattern_indices(
            self._layers, self._first, self._columns, self.size, self.total, np.ascontiguousarray(number)
        )

    def compressed_rows(self, number: Index, size: int) -> Rows | None:
        """Return the entries that have a number as the compressed rows of a matrix of ``size``, or None if numbers do not ascend."""
        there = number[: number.size // self.size * self.size].reshape(-1, self.size)[self._layers]
        whole = bool((there >= 0).all())
        start, column = np.empty(size + 1, dtype=PETSc.IntType), np.empty(self.total, dtype=PETSc.IntType)
        places = np.empty(0 if whole else self.total, dtype=np.int64)
        count = pattern_kernel.pattern_rows(
            *(self._layers, self._first, self._columns, self.size),
            *(np.ascontiguousarray(number), places, start, column),
        )
        if count < 0 or self.total > np.iinfo(PETSc.IntType).max:
            return None
        return Rows(None if whole else places[:count], start, column[:count])

    def merge(self, blocks: Array) -> Array:
        """Return the entries ``(total,)`` of the sum of element matrices ``(E, l size, l size)``."""
        elements, functions, _ = self._start.shape
        shaped = blocks.reshape(elements, functions, self.size, functions, self.size)
        return pattern_kernel.merge(shaped, self._start, self._width, self.total)
