"""Matrices with arrays allocated here: positions of the entries, and which are sent to other ranks' rows.

PETSc uses the arrays directly, so that values summed in them are the matrix's, without a copy.
"""

import ctypes
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import void
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.compiled import F1, I1, STRICT, njit
from isorod.petsc.library import POINTER, adopted, function
from isorod.petsc.rows import INTEGER, Compressed

# Tag of messages with entries.
_TAG = 18


class Rows(NamedTuple):
    """Compressed rows.

    Attributes
    ----------
    entries : slice or (entries,)
        Which of the given entries they are.
    start : (rows + 1,)
        First entry of each row.
    column : (entries,)
    """

    entries: slice | NDArray[Any]
    start: NDArray[Any]
    column: NDArray[Any]


class Squares(NamedTuple):
    """Square blocks of entries: block ``b`` begins at ``start[b]``, and its ``size[b]`` rows are ``width[b]`` apart."""

    start: Index
    width: Index
    size: Index


class Layout(NamedTuple):
    """Where entries are in a matrix.

    Attributes
    ----------
    own
        This rank's diagonal block, columns counted from its first row.
    others
        Its off-diagonal block: columns of other ranks.
    sent
        The entries to be sent to each rank.
    received
        Positions of the entries received from each rank, block by block.
    """

    own: Rows
    others: Rows
    sent: Mapping[int, slice]
    received: Mapping[int, Squares]


def rows_alone(rows: Rows) -> Layout:
    """Return the layout of all rows on one rank."""
    nothing = Rows(slice(0, 0), np.zeros(rows.start.size, dtype=PETSc.IntType), np.empty(0, dtype=PETSc.IntType))
    return Layout(rows, nothing, {}, {})


class Arrays:
    """The arrays of one matrix over a communicator.

    Parameters
    ----------
    layout
        Positions of the entries.
    total
        Number of entries, those to be sent included.

    Attributes
    ----------
    values
        All entries, if the matrix' own are in the same order, else None.
    own, others
        This rank's rows as in the layout, with values.
    """

    def __init__(self, comm: PETSc.Comm, layout: Layout, total: int) -> None:
        self._comm, self._layout = comm, layout
        in_order = isinstance(layout.own.entries, slice) and isinstance(layout.others.entries, slice)
        self.values = np.zeros(total) if in_order else None
        self.own, self.others = (self._rows(one) for one in (layout.own, layout.others))
        # PETSc renumbers them in place.
        self.others = self.others._replace(column=self.others.column.copy())

    def _rows(self, rows: Rows) -> Compressed:
        values = np.zeros(rows.column.size) if self.values is None else self.values[rows.entries]
        return Compressed(rows.start, rows.column, values)

    def matrix(self, sizes: tuple[int, int]) -> PETSc.Mat:
        """Return a new matrix with these arrays, given its rows here and in all; it must not outlive them."""
        if self._comm.getSize() > 1:
            return split_matrix(self._comm, sizes, self.own, self.others)
        return PETSc.Mat().createAIJWithArrays((sizes, sizes), tuple(self.own), comm=self._comm)

    def set(self, matrix: PETSc.Mat, values: Array) -> None:
        """Set the matrix made here from all entries."""
        layout = self._layout
        if values is not self.values and self.values is not None:
            self.values[:] = values
            values = self.values
        elif layout.received and self.values is None:
            values = values.copy()
        if self._comm.getSize() > 1:
            self._exchange(values)
        if self.values is None:
            for rows, mine in ((layout.own, self.own), (layout.others, self.others)):
                if isinstance(rows.entries, slice):
                    mine.values[:] = values[rows.entries]
                else:
                    np.take(values, rows.entries, out=mine.values, mode="clip")
        matrix.assemble()

    def _exchange(self, values: Array) -> None:
        """Send the entries of other ranks' rows, and add those received."""
        comm = self._comm.tompi4py()
        sent = [comm.Isend(values[which], rank, _TAG) for rank, which in self._layout.sent.items()]
        for rank, squares in self._layout.received.items():
            more = np.empty(int((squares.size**2).sum()))
            comm.Recv(more, rank, _TAG)
            _add_squares(more, *squares, values)
        for one in sent:
            one.Wait()


def split_matrix(comm: PETSc.Comm, sizes: tuple[int, int], own: Compressed, others: Compressed) -> PETSc.Mat:
    """Return a new matrix over several ranks with arrays of a `Layout`, which it must not outlive."""
    from mpi4py import MPI

    rows, total = sizes
    made, communicator = POINTER(), comm.tompi4py()
    # MPI's handle of a communicator is an integer or an address.
    kind: Any = ctypes.c_int if MPI._sizeof(communicator) == ctypes.sizeof(ctypes.c_int) else POINTER
    handle = kind.from_address(MPI._addressof(communicator))
    arrays = [one.ctypes.data for part in (own, others) for one in part]
    kinds = (kind, *(INTEGER,) * 4, *(POINTER,) * 7)
    call = function("MatCreateMPIAIJWithSplitArrays", *kinds)
    call(handle, rows, rows, total, total, *arrays, ctypes.byref(made))
    return adopted(made, comm)


@njit(void(F1, I1, I1, I1, F1), **STRICT)
def _add_squares(more: Any, start: Any, width: Any, size: Any, values: Any) -> None:
    """Add consecutive blocks, each row by row, to values (`Squares`)."""
    at = 0
    for b in range(start.size):
        for i in range(size[b]):
            to = start[b] + i * width[b]
            for k in range(size[b]):
                values[to + k] += more[at]
                at += 1
