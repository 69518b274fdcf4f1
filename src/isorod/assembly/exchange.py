"""Exchange of values between the degrees of freedom of a rank's elements and vectors of unknowns."""

from functools import cached_property

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index


class Exchange:
    """Local storage of a rank's degrees of freedom, in slots; its scatters are created on first use.

    Parameters
    ----------
    vector
        A vector of unknowns; None where this rank has them all.
    free
        Unknown of each of the assembler's degrees of freedom, -1 if it is held.
    window
        Degrees of freedom of this rank, ascending; None where it has them all.
    numbers
        The assembler's number of each of the model's degrees of freedom, ascending.
    bound
        The model's degrees of freedom that supports hold or tie.
    """

    def __init__(
        self,
        vector: PETSc.Vec | None,
        free: Index,
        window: Index | None,
        numbers: Index,
        bound: Index,
    ) -> None:
        self._vector, self._window, self.numbers, self._bound = vector, window, numbers, bound
        mine = free if window is None else free[window]
        self._slots = np.flatnonzero(mine >= 0)
        self._unknowns = mine[self._slots]
        self.size = mine.size

    def slots(self, dofs: Index) -> Index:
        """Return the slots of degrees of freedom that this rank has."""
        return dofs if self._window is None else np.searchsorted(self._window, dofs)

    def add_unknowns(self, x: PETSc.Vec, local: Array) -> None:
        """Add the unknowns to the slots of the degrees of freedom that are not held."""
        if self._window is None:
            local[self._slots] += x.array_r[self._unknowns]
            return
        scatter, near = self._scatter
        scatter.scatter(x, near, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)
        local[self._slots] += near.array_r

    def store(self, local: Array, out: PETSc.Vec) -> None:
        """Fill a vector of unknowns with the sums of what is in their slots, on all ranks."""
        if self._window is None:
            out.array_w[:] = np.bincount(self._unknowns, local[self._slots], out.getLocalSize())
            return
        scatter, near = self._scatter
        near.array_w[:] = local[self._slots]
        out.zeroEntries()
        scatter.scatter(near, out, PETSc.InsertMode.ADD_VALUES, PETSc.ScatterMode.REVERSE)

    @cached_property
    def _scatter(self) -> tuple[PETSc.Scatter, PETSc.Vec]:
        near = PETSc.Vec().createSeq(self._unknowns.size)
        unknowns = PETSc.IS().createGeneral(self._unknowns.astype(PETSc.IntType), PETSc.COMM_SELF)
        return PETSc.Scatter().create(self._vector, unknowns, near, None), near

    def all_unknowns(self, x: PETSc.Vec) -> Array:
        """Return all unknowns, on every rank."""
        if self._window is None:
            return np.array(x.array_r)
        scatter, everything = self._everything
        scatter.scatter(x, everything, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)
        return np.array(everything.array_r)

    @cached_property
    def _everything(self) -> tuple[PETSc.Scatter, PETSc.Vec]:
        return PETSc.Scatter.toAll(self._vector)

    @cached_property
    def moved(self) -> tuple[Index, Index]:
        """The model's degrees of freedom that this rank has, and their slots."""
        if self._window is None:
            return np.arange(self.numbers.size), self.numbers
        of_number = np.full(max(int(self._window.max(initial=-1)), int(self.numbers.max(initial=-1))) + 1, -1)
        of_number[self.numbers] = np.arange(self.numbers.size)
        moved = of_number[self._window]
        slots = np.flatnonzero(moved >= 0)
        return moved[slots], slots

    @cached_property
    def bound(self) -> tuple[Index, Index]:
        """Degrees of freedom of `Model.bound` on this rank, by their positions there, and their slots."""
        moved, slots = self.moved
        of_bound = np.full(self.numbers.size, -1)
        of_bound[self._bound] = np.arange(self._bound.size)
        number = of_bound[moved]
        return number[number >= 0], slots[number >= 0]
