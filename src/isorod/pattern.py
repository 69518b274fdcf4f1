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
        count = element_layers.max() + 1
        keys = element_layers[:, :, None] * count + element_layers[:, None, :]
        pairs, where = np.unique(keys, return_inverse=True)
        row_layer, column_layer = np.divmod(pairs, count)
        layers, first, columns = np.unique(row_layer, return_index=True, return_counts=True)
        widths = columns * size
        base = np.concatenate([[0], np.cumsum(widths * size)])
        place = np.searchsorted(layers, row_layer)
        start = base[place] + (np.arange(pairs.size) - first[place]) * size
        self.size = size
        self.total = int(base[-1])
        self._start = np.ascontiguousarray(start[where].reshape(keys.shape))
        self._width = np.ascontiguousarray(widths[np.searchsorted(layers, element_layers)])
        self._layers, self._first, self._column_layer = layers, np.append(first, pairs.size), column_layer

    def indices(self) -> tuple[Index, Index]:
        """Return row and column of each entry, ``layer size + place``, shape ``(total,)``."""
        return kernel.pattern_indices(self._layers, self._first, self._column_layer, self.size, self.total)

    def merge(self, blocks: Array) -> Array:
        """Return the entries ``(total,)`` of the sum of element matrices ``(E, l size, l size)``."""
        elements, functions, _ = self._start.shape
        shaped = blocks.reshape(elements, functions, self.size, functions, self.size)
        return kernel.merge(shaped, self._start, self._width, self.total)
