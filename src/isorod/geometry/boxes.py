"""Axis-aligned boxes: pairs that overlap."""

from collections.abc import Iterator

import numpy as np

from isorod.arrays import Array, Index

# Pairs tested together.
_BLOCK = 2_000_000


def pairs(low: Array, high: Array) -> tuple[Index, Index]:
    """Return the pairs of boxes that overlap or touch, each once.

    Boxes are sorted along the axis on which they are spread the most, and each is tested against those that begin
    before it ends.

    Parameters
    ----------
    low, high
        Lower and upper corners, shape ``(m, 3)``.

    Returns
    -------
    first, second
        Numbers of the boxes, shape ``(pairs,)``.
    """
    if low.shape[0] < 2:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    sizes = np.maximum((high - low).mean(axis=0), np.finfo(float).tiny)
    axis = int(np.argmax(np.ptp(low + high, axis=0) / sizes))
    order = np.argsort(low[:, axis], kind="stable")
    blocks = list(_swept(low[order], high[order], axis))
    first, second = (np.concatenate([block[k] for block in blocks]) for k in (0, 1))
    return order[first], order[second]


def _swept(low: Array, high: Array, axis: int) -> Iterator[tuple[Index, Index]]:
    """Yield the pairs of boxes in the order in which they begin along an axis, a block of boxes at a time."""
    count = np.searchsorted(low[:, axis], high[:, axis], "right") - np.arange(low.shape[0]) - 1
    others = [k for k in range(3) if k != axis]
    total = np.concatenate([[0], np.cumsum(count)])
    begin = 0
    while begin < low.shape[0]:
        end = max(int(np.searchsorted(total, total[begin] + _BLOCK, "right")) - 1, begin + 1)
        first = np.repeat(np.arange(begin, end), count[begin:end])
        second = first + 1 + np.arange(first.size) - (total[first] - total[begin])
        for k in others:
            meet = (low[first, k] <= high[second, k]) & (low[second, k] <= high[first, k])
            first, second = first[meet], second[meet]
        yield first, second
        begin = end
