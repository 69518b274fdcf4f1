"""Where the entries of a matrix are: patterns of elements with numbers of their own, or rows and columns."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from isorod.arrays import Index
from isorod.assembly.pattern import Pattern


class Numbered(NamedTuple):
    """The entries of a pattern: what is at ``layer size + place`` has this number, negative if it is held."""

    pattern: Pattern
    number: Index


# Or rows and columns of each.
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
