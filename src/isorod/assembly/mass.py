"""Entries of mass matrices: those of one component, and their positions for each component."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.part import Part
from isorod.assembly.pattern import Pattern, add, joined
from isorod.errors import InputError
from isorod.model.body import Body


class Masses(NamedTuple):
    """Entries of the mass matrix of one component.

    Attributes
    ----------
    entries
        Their values.
    places
        Returns rows and columns of the entries, for each component.
    pattern
        Their pattern, if it has a layout.
    """

    entries: Array
    places: Callable[[], list[tuple[Index, Index]]]
    pattern: Pattern | None

    def indices(self) -> tuple[Index, Index]:
        """Return rows and columns of the entries of all components, one behind the other."""
        rows, columns = zip(*self.places(), strict=True)
        return np.concatenate(rows), np.concatenate(columns)


def masses(
    parts: Sequence[Part], numbers: Sequence[Index], lumped: bool, ranks: tuple[PETSc.Comm, int] | None = None
) -> Masses:
    """Return the entries of lumped or consistent masses.

    Parameters
    ----------
    parts
        The elements of this rank.
    numbers
        The nodes' numbers, of each component.
    ranks
        Communicator and number of rows for the pattern of one component, if the matrix may have its layout.
    """
    if lumped:
        nodes = joined([part.nodes for part in parts], int)
        entries = joined([part.lumped_mass() for part in parts], float)
        return Masses(entries, lambda: [(number[nodes], number[nodes]) for number in numbers], None)
    alone = len(numbers) == 1
    # A layer is held if all components are.
    pattern = Pattern([part.of_nodes for part in parts], np.max(numbers, axis=0), ranks if alone else None)
    entries = np.zeros(pattern.total)
    for part, blocks in zip(parts, pattern.blocks, strict=True):
        add(part.mass, blocks, entries)
    return Masses(entries, lambda: [pattern.indices(number) for number in numbers], pattern if alone else None)


def refuse_massless(bodies: Sequence[Body], what: str) -> None:
    """Raise `InputError` for a body without mass, which ``what`` needs, as ``"modes need"``."""
    for b, body in enumerate(bodies):
        if not body.densities.min() > 0.0:
            raise InputError(f"density of body {b}: got {body.densities.min():g}, {what} a positive mass per volume")
