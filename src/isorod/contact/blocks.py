"""Entries of a sparse matrix, the sum of dense blocks, one for each patch of contact."""

from collections.abc import Callable
from itertools import count

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.packed import Row, Table

# Numbers are unique, also across models: a matrix may be used for one after the other.
_NUMBERS = count(1)


class Blocks:
    """The pattern of blocks, which is rebuilt from the present and last patches where a new one is not in it.

    Parameters
    ----------
    kind
        Type of the rows of patches.

    Attributes
    ----------
    rows, columns
        Of all entries, each once: adjacent patches have most of their nodes in common.
    room
        Size of all blocks, one after the other.
    version
        Number of the pattern, unique among all blocks, new at each change; 0 before the first.
    """

    def __init__(self, kind: np.dtype) -> None:  # type: ignore[type-arg]
        self._patches = np.empty(0, kind)
        self._last = self._patches
        self._begin = np.zeros(1, dtype=np.int64)
        # Which entry each value of the blocks adds to.
        self._entry = np.empty(0, dtype=np.int64)
        self.rows = self.columns = np.empty(0, dtype=np.int64)
        self.version = 0

    @property
    def room(self) -> int:
        """See the class."""
        return int(self._begin[-1])

    def begin(self, patches: Table, nodes: Callable[[Row], tuple[Index, Index]]) -> Index:
        """Return where the block of each of some patches begins among all blocks.

        Parameters
        ----------
        patches
            Rows of patches, in any order.
        nodes
            Returns the nodes of a patch whose degrees of freedom are a block's rows, and those of its columns.  It is
            not kept, to avoid a reference cycle with the object whose method it is.
        """
        touched, which = np.unique(patches, return_inverse=True)
        if not np.isin(touched, self._patches).all():
            self._renew(np.union1d(touched, self._last), nodes)
        self._last = touched
        return self._begin[np.searchsorted(self._patches, touched)][which]

    def merge(self, blocks: Array) -> Array:
        """Return the entries ``(len(rows),)`` of the sum of blocks ``(room,)``."""
        return np.bincount(self._entry, blocks, self.rows.size).astype(np.float64, copy=False)

    def _renew(self, patches: Table, nodes_of: Callable[[Row], tuple[Index, Index]]) -> None:
        """Rebuild the pattern from these patches, sorted."""
        self._patches = patches
        self.version = next(_NUMBERS)
        nodes = [nodes_of(patch) for patch in patches]
        shapes = [(down.size, across.size) for down, across in nodes]
        many = 1 + max(int(across.max()) for _, across in nodes)
        keys = np.concatenate([(many * down[:, None] + across).ravel() for down, across in nodes])
        pairs, number = np.unique(keys, return_inverse=True)
        down, across = (3 * one[:, None, None] for one in np.divmod(pairs, many))
        shape = pairs.size, 3, 3
        self.rows = np.broadcast_to(down + np.arange(3)[:, None], shape).ravel()
        self.columns = np.broadcast_to(across + np.arange(3), shape).ravel()
        ends = np.cumsum([rows * columns for rows, columns in shapes])
        # A block has three rows and columns a node, row by row.
        three = np.arange(3)[:, None, None], np.arange(3)
        within = [
            (9 * one.reshape(rows, 1, columns, 1) + 3 * three[0] + three[1]).ravel()
            for one, (rows, columns) in zip(np.split(number, ends[:-1]), shapes, strict=True)
        ]
        self._entry = np.concatenate(within)
        self._begin = np.append(0, 9 * ends)
