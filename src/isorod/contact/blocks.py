"""Dense blocks of a sparse matrix, one for each patch where sides touch."""

from collections.abc import Callable

import numpy as np

from isorod.arrays import Index
from isorod.contact.packed import Row, Table


class Blocks:
    """The pattern of blocks, which is made anew where a patch comes that is not in it, of those of now and of last.

    Parameters
    ----------
    kind
        Of the rows of patches.
    nodes
        Returns the nodes of a patch whose degrees of freedom are a block's rows, and those of its columns.

    Attributes
    ----------
    rows, columns
        Of all entries, block by block.
    version
        Counts how often the pattern has changed.
    """

    def __init__(self, kind: np.dtype, nodes: Callable[[Row], tuple[Index, Index]]) -> None:  # type: ignore[type-arg]
        self._nodes = nodes
        self._patches = np.empty(0, kind)
        self._last = self._patches
        self._begin = np.zeros(1, dtype=np.int64)
        self.rows = self.columns = np.empty(0, dtype=np.int64)
        self.version = 0

    def begin(self, patches: Table) -> Index:
        """Return where the block of each of some patches begins among the entries."""
        touched, which = np.unique(patches, return_inverse=True)
        if not np.isin(touched, self._patches).all():
            self._renew(np.union1d(touched, self._last))
        self._last = touched
        return self._begin[np.searchsorted(self._patches, touched)][which]

    def _renew(self, patches: Table) -> None:
        """Make the pattern anew, of these patches, sorted."""
        self._patches = patches
        self.version += 1
        rows, columns, sizes = [], [], [0]
        for patch in patches:
            down, across = ((3 * nodes[:, None] + np.arange(3)).ravel() for nodes in self._nodes(patch))
            rows.append(np.repeat(down, across.size))
            columns.append(np.tile(across, down.size))
            sizes.append(down.size * across.size)
        self.rows, self.columns = np.concatenate(rows), np.concatenate(columns)
        self._begin = np.cumsum(sizes)
