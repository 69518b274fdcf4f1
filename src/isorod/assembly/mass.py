"""Entries of mass matrices, of all components of a node or, where these are alike, of one."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.part import Part
from isorod.assembly.pattern import Pattern, add, joined


class Masses(NamedTuple):
    """Entries of a mass matrix, where they are, and their pattern if it has a layout."""

    entries: Array
    indices: Callable[[], tuple[Index, Index]]
    pattern: Pattern | None


def lumped_mass(parts: Sequence[Part], numbers: Sequence[Index]) -> Masses:
    """Return the entries of lumped masses; of some components each node's numbers are given."""
    nodes = joined([part.nodes for part in parts], int)
    places = joined([number[nodes] for number in numbers], int)
    entries = joined([part.lumped_mass() for part in parts], float)
    return Masses(np.tile(entries, len(numbers)), lambda: (places, places), None)


def consistent_mass(parts: Sequence[Part], numbers: Sequence[Index], rows: tuple[PETSc.Comm, int] | None) -> Masses:
    """Return the entries of the consistent mass; rows are a pattern's of one component."""
    alone = len(numbers) == 1
    # A layer is held if all components are.
    number = numbers[0] if alone else np.max(numbers, axis=0)
    pattern = Pattern([part.of_nodes for part in parts], number, rows if alone else None)
    entries = np.zeros(pattern.total)
    for part, blocks in zip(parts, pattern.blocks, strict=True):
        add(part.mass, blocks, entries)

    def indices() -> tuple[Index, Index]:
        found = [pattern.indices(number) for number in numbers]
        return joined([row for row, _ in found], int), joined([column for _, column in found], int)

    return Masses(entries if alone else np.tile(entries, len(numbers)), indices, pattern if alone else None)
