"""The sparsity pattern of a body's elements, each entry once and row by row.

Nodes couple with whole layers, so a row's columns are whole layers too; entries that several elements share are added up before
PETSc sees them.  On one rank they are the matrix's compressed rows as they come; on several, its COO preallocation has a third of the
entries to sort, and finds them sorted.
"""

import numpy as np

from isorod import kernel
from isorod.disk import Array
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

    def merge(self, blocks: Array) -> Array:
        """Return the entries ``(total,)`` of the sum of element matrices ``(E, l size, l size)``."""
        elements, functions, _ = self._start.shape
        shaped = blocks.reshape(elements, functions, self.size, functions, self.size)
        return kernel.merge(shaped, self._start, self._width, self.total)
