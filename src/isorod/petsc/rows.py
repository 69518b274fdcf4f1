"""A rank's rows of a matrix, without a copy."""

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.petsc.library import POINTER, function

# Array of PETSc's integers.
P1 = types.Array(from_dtype(np.dtype(PETSc.IntType)), 1, "C")

INTEGER: Any = ctypes.c_int64 if np.dtype(PETSc.IntType).itemsize == 8 else ctypes.c_int32

# Types of matrices with such arrays.
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
        The diagonal block, columns counted from its first row.
    others
        The other entries, with columns as positions in ``columns``; empty on one rank.
    columns
        Columns of the others in the matrix, ascending.
    """

    own: Compressed
    others: Compressed
    columns: NDArray[Any]


def local_rows(matrix: PETSc.Mat) -> LocalRows:
    """Return this rank's rows of a matrix of any type that PETSc converts to AIJ."""
    if matrix.getType() not in _OURS:
        matrix = matrix.convert("aij", PETSc.Mat())
    return _local_rows(matrix.handle, matrix.getLocalSize()[0], matrix)


def component_rows(matrix: PETSc.Mat, components: int) -> LocalRows:
    """Return this rank's rows of a MAIJ matrix' block of one component; its own rows if it has one component."""
    if components == 1:
        return local_rows(matrix)
    one = POINTER()
    function("MatMAIJGetAIJ", POINTER, ctypes.POINTER(POINTER))(matrix.handle, ctypes.byref(one))
    return _local_rows(one.value, matrix.getLocalSize()[0] // components, matrix)


def _local_rows(handle: int | None, rows: int, matrix: PETSc.Mat) -> LocalRows:
    """Return the rows of an AIJ matrix given by its handle; ``matrix`` keeps it alive."""
    if matrix.getType().startswith("seq"):
        nothing = Compressed(np.zeros(rows + 1, dtype=PETSc.IntType), np.empty(0, dtype=PETSc.IntType), np.empty(0))
        return LocalRows(_arrays(handle, rows, matrix), nothing, nothing.column)
    own, others, columns = POINTER(), POINTER(), POINTER()
    where = ctypes.POINTER(POINTER)
    call = function("MatMPIAIJGetSeqAIJ", POINTER, where, where, where)
    call(handle, ctypes.byref(own), ctypes.byref(others), ctypes.byref(columns))
    outside = _arrays(others.value, rows, matrix)
    count = int(outside.column.max(initial=-1)) + 1
    return LocalRows(_arrays(own.value, rows, matrix), outside, _array(columns.value, count, INTEGER, matrix))


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
    """Return an array of a matrix, which it keeps alive."""
    if not count or not address:
        return np.zeros(count, dtype=np.dtype(kind))
    buffer = (kind * count).from_address(address)
    buffer.matrix = matrix
    return np.ctypeslib.as_array(buffer)
