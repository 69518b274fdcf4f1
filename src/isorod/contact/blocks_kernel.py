"""Compiled: dense blocks, added up where they have nodes in common."""

from numba import void

from isorod.arrays import Array, Index
from isorod.compiled import F1, I1, I2, STRICT, njit


@njit(void(I2, I1, F1, F1), **STRICT)
def merge(shapes: Index, pairs: Index, blocks: Array, entries: Array) -> None:
    """Add blocks to entries.

    Parameters
    ----------
    shapes
        Nodes that are a block's rows and columns, ``(m, 2)``.
    pairs
        Number of each pair of nodes of the blocks, one block after the other, row by row.
    blocks
        Of three degrees of freedom a node, one after the other, row by row.
    entries
        Nine of each pair; are added to.
    """
    pair = first = 0
    for m in range(shapes.shape[0]):
        width = 3 * shapes[m, 1]
        for _ in range(shapes[m, 0]):
            for j in range(shapes[m, 1]):
                at = 9 * pairs[pair]
                pair += 1
                for a in range(3):
                    for b in range(3):
                        entries[at + 3 * a + b] += blocks[first + a * width + 3 * j + b]
            first += 3 * width
