"""The rows of a matrix that a rank has, without a copy of them."""

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.petsc.library import POINTER, function

# Array of the integers that PETSc counts with.
P1 = types.Array(from_dtype(np.dtype(PETSc.IntType)), 1, "C")

INTEGER: Any = ctypes.c_int64 if np.dtype(PETSc.IntType).itemsize == 8 else ctypes.c_int32

# Types of matrices whose arrays these are.
_OURS = ("seqaij", "mpiaij")


class Compressed(NamedTuple):
    """Compressed rows, not to be written to: first entry of each row ``(rows + 1,)``, ascending columns, values."""

    start: NDArray[Any]
    column: NDArray[Any]
    values: NDArray[np.float64]


class LocalRows(NamedTuple):
    """A rank's rows.

    Attributes
    ----------
    own
        Their entries at columns that are numbers of these rows, counted from the first of them.
    others
        The other entries, at places of ``columns``; no rows on one rank.
    columns
        Columns of the matrix, ascending, that the others are at.
    """

    own: Compressed
    others: Compressed
    columns: NDArray[Any]


def local_rows(matrix: PETSc.Mat) -> LocalRows:
    """Return the rows of this rank of a matrix of any type that PETSc makes AIJ of."""
    if matrix.getType() not in _OURS:
        matrix = matrix.convert("aij", PETSc.Mat())
    return _local_rows(matrix.handle, matrix.getLocalSize()[0], matrix)


def component_rows(matrix: PETSc.Mat, components: int) -> LocalRows:
    """Return this rank's rows of what a matrix of interlaced components (MAIJ) does to each; its own if of one."""
    if components == 1:
        return local_rows(matrix)
    one = POINTER()
    function("MatMAIJGetAIJ", POINTER, ctypes.POINTER(POINTER))(matrix.handle, ctypes.byref(one))
    return _local_rows(one.value, matrix.getLocalSize()[0] // components, matrix)


def _local_rows(handle: int | None, rows: int, matrix: PETSc.Mat) -> LocalRows:
    """Return the rows of an AIJ matrix given by its handle, which another one keeps alive."""
    if matrix.getType().startswith("seq"):
        nothing = Compressed(np.zeros(rows + 1, dtype=PETSc.IntType), np.empty(0, dtype=PETSc.IntType), np.empty(0))
        return LocalRows(_arrays(handle, rows, matrix), nothing, nothing.column)
    own, others, columns = POINTER(), POINTER(), POINTER()
    where = ctypes.POINTER(POINTER)
    call = function("MatMPIAIJGetSeqAIJ", POINTER, where, where, where)
    call(handle, ctypes.byref(own), ctypes.byref(others), ctypes.byref(columns))
    found = _arrays(others.value, rows, matrix)
    count = int(found.column.max(initial=-1)) + 1
    return LocalRows(_arrays(own.value, rows, matrix), found, _array(columns.value, count, INTEGER, matrix))


def _arrays(handle: int | None, rows: int, matrix: PETSc.Mat) -> Compressed:
    """Return the arrays of a matrix on one rank."""
    start, column, values = POINTER(), POINTER(), POINTER()
    where = ctypes.POINTER(POINTER)
    call = function("MatSeqAIJGetCSRAndMemType", POINTER, where, where, where, POINTER)
    call(handle, ctypes.byref(start), ctypes.byref(column), ctypes.byref(values), None)
    first = _array(start.value, rows + 1, INTEGER, matrix)
    count = int(first[-1]) if rows else 0
    kinds = (column, INTEGER), (values, ctypes.c_double)
    return Compressed(first, *(_array(place.value, count, kind, matrix) for place, kind in kinds))


def _array(address: int | None, count: int, kind: Any, matrix: PETSc.Mat) -> NDArray[Any]:
    """Return an array that a matrix has, and keeps alive with it."""
    if not count or not address:
        return np.zeros(count, dtype=np.dtype(kind))
    buffer = (kind * count).from_address(address)
    buffer.matrix = matrix
    return np.ctypeslib.as_array(buffer)
