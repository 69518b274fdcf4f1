"""Boxes about the triangles of a rigid mesh, in a tree."""

from typing import Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.packed import NODE, Table

# Most triangles in a leaf.
_FEW = 4


def tree(corners: Array) -> tuple[Index, Table]:
    """Return the order of the triangles in the tree, and its boxes, rows of `NODE`, that of all triangles first.

    Boxes are halved at the median of the middles of their triangles, across their longest side.

    Parameters
    ----------
    corners
        Of the triangles, ``(t, 3, 3)``.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    middles = 0.5 * (low + high)
    order: list[int] = []
    nodes: list[Any] = []
    # Triangles not yet in a box, and the box that has them as its second child.
    left = [(np.arange(len(corners)), -1)]
    while left:
        chosen, above = left.pop()
        box = low[chosen].min(axis=0), high[chosen].max(axis=0)
        if above >= 0:
            nodes[above] = (*nodes[above][:2], len(nodes), 0)
        if chosen.size <= _FEW:
            nodes.append((*box, len(order), chosen.size))
            order.extend(chosen)
            continue
        side = int(np.argmax(np.ptp(middles[chosen], axis=0)))
        half = chosen.size // 2
        sides = chosen[np.argpartition(middles[chosen, side], half)]
        # The first child is the next row.
        left += [(sides[half:], len(nodes)), (sides[:half], -1)]
        nodes.append((*box, 0, 0))
    return np.array(order), np.array(nodes, NODE)
