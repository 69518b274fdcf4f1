"""The sparsity pattern of a body's elements, each entry once and row by row.

Nodes couple with whole layers, so a row's columns are whole layers too; entries that several elements share are added up before
PETSc sees them.  On one rank they are the matrix's compressed rows as they come; on several, its COO preallocation has a third of the
entries to sort, and finds them sorted.
"""

import numpy as np
from petsc4py import PETSc

from isorod import kernel
from isorod.disk import Array
from isorod.petsc import Rows
from isorod.spline import Index


class Pattern:
    """Pattern of elements that couple layers of ``size`` entries each.

    Parameters
    ----------
    element_layers
        Layers of each element, shape ``(E, l)``.
    size
        Entries of a layer: nodes, or degrees of freedom.
    """

    def __init__(self, element_layers: Index, size: int) -> None:
        self.size = size
        self._layers, self._first, self._columns, self._start, self._width, self.total = kernel.pattern(
            np.ascontiguousarray(element_layers), size
        )

    def indices(self, number: Index) -> tuple[Index, Index]:
        """Return row and column of each entry, shape ``(total,)``, as numbers of what is at ``layer size + place``."""
        return kernel.pattern_indices(
            self._layers, self._first, self._columns, self.size, self.total, np.ascontiguousarray(number)
        )

    def compressed_rows(self, number: Index, size: int) -> Rows | None:
        """Return the entries that have a number as the compressed rows of a matrix of ``size``, or None if numbers do not ascend."""
        start = np.empty(size + 1, dtype=PETSc.IntType)
        places, column = np.empty(self.total, dtype=np.int64), np.empty(self.total, dtype=PETSc.IntType)
        count = kernel.pattern_rows(
            *(self._layers, self._first, self._columns, self.size),
            *(np.ascontiguousarray(number), places, start, column),
        )
        if count < 0 or self.total > np.iinfo(PETSc.IntType).max:
            return None
        return Rows(places[:count], start, column[:count])

    def merge(self, blocks: Array) -> Array:
        """Return the entries ``(total,)`` of the sum of element matrices ``(E, l size, l size)``."""
        elements, functions, _ = self._start.shape
        shaped = blocks.reshape(elements, functions, self.size, functions, self.size)
        return kernel.merge(shaped, self._start, self._width, self.total)
