"""Points of contacts over ranks: each computes its own, and results are gathered on all.

Every rank has and places all surfaces; elements, their matrices and factors are distributed elsewhere.  Elements of the
surfaces are assigned to ranks in turn, since contact is at a few places.
"""

from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.packed import Packed, Table

if TYPE_CHECKING:
    from petsc4py import PETSc


class Ranks:
    """The ranks of a communicator, or this one alone where there is none."""

    def __init__(self, comm: "PETSc.Comm | None" = None) -> None:
        self._comm = None if comm is None or comm.getSize() == 1 else comm.tompi4py()
        # Tables, the points of each rank in turn, and their numbers.
        self._known: tuple[Packed, Index, Index] | None = None

    def split(self, packed: Packed) -> Packed:
        """Assign this rank its points; return the tables."""
        if self._comm is not None:
            packed.own[:] = self._owners(packed) == self._comm.rank
        return packed

    def _owners(self, packed: Packed) -> Index:
        """Return the rank of each point."""
        assert self._comm is not None
        counts = []
        for pass_ in packed.passes:
            slave = packed.surfaces[pass_["slave"]]
            counts.append(np.full(slave["elements"], pass_["along"] * slave["around"] * pass_["across"]))
        each = np.concatenate([np.empty(0, dtype=np.int64), *counts])
        return np.repeat(np.arange(each.size) % self._comm.size, each)

    def gather(self, packed: Packed, *tables: Array | Table) -> None:
        """Fill tables with a row for each point, ``(Q, ...)``, on all ranks from the rows of each rank's points."""
        if self._comm is None:
            return
        if self._known is None or self._known[0].own is not packed.own:
            owners = self._owners(packed)
            points = np.bincount(owners, minlength=self._comm.size)
            self._known = packed, np.argsort(owners, kind="stable"), points
        _, order, points = self._known
        for table in tables:
            mine, whole = table[packed.own], np.empty_like(table)
            counts = points * (table.itemsize * int(np.prod(table.shape[1:])))
            self._comm.Allgatherv(mine.view(np.uint8), (whole.view(np.uint8), counts))
            table[order] = whole

    def sums(self, array: Array, *numbers: float) -> tuple[Array, Array]:
        """Return the sums over all ranks of an array of any shape, and of some numbers, the same on all ranks."""
        if self._comm is None:
            return array, np.array(numbers)
        own = np.concatenate([array.ravel(), numbers])
        total = np.empty_like(own)
        self._comm.Allreduce(own, total)
        return total[: array.size].reshape(array.shape), total[array.size :]
