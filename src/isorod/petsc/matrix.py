"""Sparse matrices from entries: room once, values for each assembly."""

import ctypes
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numba import i8, void
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.compiled import F1, FAST, I1, STRICT, njit
from isorod.petsc.library import POINTER, function
from isorod.petsc.placement import Placement
from isorod.petsc.rows import P1

# Attribute of a matrix whose arrays were made here: which of the given entries is where, and the arrays.
_ARRAYS = "isorod_arrays"

# Attribute of another, over several ranks: `Placement`.
_PLACEMENT = "isorod_placement"

# Attribute of another: where each of the given entries adds up, and how many there are then.
_PLACES = "isorod_places"

# Attribute of another: that it has got room for other entries.
_RENEWED = "isorod_renewed"


class Rows(NamedTuple):
    """Compressed rows.

    Attributes
    ----------
    entries : (entries,)
        Which of the given entries comes where; None if as they come.
    start : (rows + 1,)
        First entry of each row.
    column : (entries,)
    """

    entries: NDArray[Any] | None
    start: NDArray[Any]
    column: NDArray[Any]


def create_matrix(
    comm: PETSc.Comm,
    sizes: tuple[int, int],
    block: int,
    indices: Callable[[], tuple[NDArray[Any], NDArray[Any]]],
    compressed: Callable[[], Rows | None] | None = None,
) -> PETSc.Mat:
    """Return a new square AIJ matrix, or what ``-mat_type`` says, with room for given entries.

    Parameters
    ----------
    sizes, block
        Number of rows here and in all, and the block size.
    indices
        Returns global rows and columns of each entry; negative ones are ignored.  `set_values` takes the values in this
        order.
    compressed
        On one rank, a quicker way to compressed rows than through the indices.
    """
    made = PETSc.Mat()
    found = None
    if comm.getSize() == 1 and not PETSc.Options().hasName("mat_type"):
        # PETSc's COO preallocation spends most of its time on sorting what is sorted.
        found = compressed() if compressed is not None else None
        if found is None:
            found = _compressed_rows(sizes[1], *indices())
    elif not PETSc.Options().hasName("mat_type"):
        placement = Placement(comm, sizes[0], *indices())
        made = placement.matrix(comm, sizes[1])
        made.setBlockSize(block)
        made.setFromOptions()
        made.setAttr(_PLACEMENT, placement)
        return made
    if found is None:
        made.create(comm)
        made.setSizes((sizes, sizes))
        made.setBlockSize(block)
        made.setType(PETSc.Mat.Type.AIJ)
        made.setFromOptions()
        preallocate(made, *indices())
        return made
    values = np.zeros(found.column.size, dtype=PETSc.ScalarType)
    made.createAIJWithArrays((sizes, sizes), (found.start, found.column, values), comm=comm)
    made.setBlockSize(block)
    made.setFromOptions()
    made.setAttr(_ARRAYS, (found, values))
    return made


def _compressed_rows(size: int, rows: NDArray[Any], columns: NDArray[Any]) -> Rows | None:
    """Return the compressed rows of entries, or None if two are at one place."""
    if rows.size > np.iinfo(PETSc.IntType).max:
        return None
    rows, columns = np.ascontiguousarray(rows, dtype=np.int64), np.ascontiguousarray(columns, dtype=np.int64)
    start = np.zeros(size + 1, dtype=PETSc.IntType)
    entries, column = np.empty(rows.size, dtype=np.int64), np.empty(rows.size, dtype=PETSc.IntType)
    total = _compress(rows, columns, start, entries, column)
    if total < 0:
        order = np.lexsort((columns, rows))
        total = _compress(rows[order], columns[order], start, entries, column)
        if total < 0:
            return None
        entries = order[entries[:total]]
    return Rows(entries[:total], start, column[:total])


@njit(i8(I1, I1, P1, I1, P1), **STRICT)
def _compress(rows: Any, columns: Any, start: Any, entries: Any, column: Any) -> int:
    """Fill compressed rows with the entries that have no negative index; return their number, -1 if they descend."""
    total = 0
    last_row, last_column = -1, -1
    for k in range(rows.size):
        i, j = rows[k], columns[k]
        if i < 0 or j < 0:
            continue
        if i < last_row or (i == last_row and j <= last_column):
            return -1
        while last_row < i:
            last_row += 1
            start[last_row] = total
        last_column = j
        entries[total] = k
        column[total] = j
        total += 1
    for i in range(last_row + 1, start.size):
        start[i] = total
    return total


def preallocate(matrix: PETSc.Mat, rows: NDArray[Any], columns: NDArray[Any]) -> None:
    """Preallocate a matrix, once more perhaps, by global row and column indices (COO); negative ones are ignored."""
    matrix.setAttr(_ARRAYS, None)
    matrix.setAttr(_PLACES, None)
    matrix.setAttr(_RENEWED, True)
    matrix.setAttr(_PLACEMENT, None)
    if matrix.getType() == PETSc.Mat.Type.SEQAIJ and rows.size <= np.iinfo(PETSc.IntType).max:
        # PETSc's own way sorts all entries by comparing them.
        rows, columns = np.ascontiguousarray(rows, dtype=np.int64), np.ascontiguousarray(columns, dtype=np.int64)
        start = np.zeros(matrix.getSize()[0] + 1, dtype=PETSc.IntType)
        column, places = np.empty(rows.size, dtype=PETSc.IntType), np.empty(rows.size, dtype=PETSc.IntType)
        total = _gather(rows, columns, start, column, places)
        matrix.setPreallocationCSR((start, column[:total]))
        matrix.setAttr(_PLACES, (places, int(total)))
        return
    # PETSc sorts the arrays in place.
    rows = np.array(rows, dtype=PETSc.IntType)
    columns = np.array(columns, dtype=PETSc.IntType)
    call = function("MatSetPreallocationCOO", POINTER, ctypes.c_ssize_t, POINTER, POINTER)
    call(matrix.handle, rows.size, rows.ctypes.data, columns.ctypes.data)


def forget_factors(matrix: PETSc.Mat, ksp: PETSc.KSP) -> None:
    """Forget the preconditioner of a matrix that has got room for other entries since: PETSc may take it for the same.

    Of a matrix over several ranks the state of the pattern, by which it tells, is always that of the first one.
    """
    if matrix.getAttr(_RENEWED):
        ksp.getPC().reset()
        matrix.setAttr(_RENEWED, None)


@njit(i8(I1, I1, P1, P1, P1), **STRICT)
def _gather(rows: Any, columns: Any, start: Any, column: Any, places: Any) -> int:
    """Fill compressed rows, each entry once, and where each of those given comes, -1 if an index is negative.

    Entries are counted into columns, then into rows, which leaves the columns of each row in order.
    """
    size = start.size - 1
    first = np.zeros(size + 1, dtype=np.int64)
    for k in range(rows.size):
        places[k] = -1
        if rows[k] >= 0 and columns[k] >= 0:
            first[columns[k] + 1] += 1
            start[rows[k] + 1] += 1
    for i in range(size):
        first[i + 1] += first[i]
        start[i + 1] += start[i]
    by_column = np.empty(first[size], dtype=np.int64)
    for k in range(rows.size):
        if rows[k] >= 0 and columns[k] >= 0:
            by_column[first[columns[k]]] = k
            first[columns[k]] += 1
    order = np.empty_like(by_column)
    first[:] = start
    for k in by_column:
        order[first[rows[k]]] = k
        first[rows[k]] += 1
    total = at = 0
    for i in range(size):
        last, end = -1, start[i + 1]
        start[i] = total
        while at < end:
            k = order[at]
            if columns[k] != last:
                last = columns[k]
                column[total] = last
                total += 1
            places[k] = total - 1
            at += 1
    start[size] = total
    return total


@njit(void(F1, P1, F1), **STRICT)
def _add_up(values: Any, places: Any, entries: Any) -> None:
    """Set entries to the sums of the values that have a place there."""
    entries[:] = 0.0
    for k in range(values.size):
        if places[k] >= 0:
            entries[places[k]] += values[k]


def values_in_order(matrix: PETSc.Mat) -> NDArray[np.float64] | None:
    """Return the array of a matrix's values if they come in the order in which it got room for entries, else None.

    `set_values` of this array, filled, makes them the matrix's.
    """
    arrays = matrix.getAttr(_ARRAYS)
    if arrays is None or matrix.getAttr(_PLACES) is not None:
        return None
    rows, mine = arrays
    return mine if rows.entries is None else None


def set_values(matrix: PETSc.Mat, values: NDArray[np.float64]) -> None:
    """Set the entries in the order in which the matrix got room for them, repeated ones added up."""
    placement = matrix.getAttr(_PLACEMENT)
    if placement is not None:
        placement.set(matrix, values)
        return
    gathered, arrays = matrix.getAttr(_PLACES), matrix.getAttr(_ARRAYS)
    if gathered is not None:
        places, total = gathered
        pointer = POINTER()
        function("MatSeqAIJGetArray", POINTER, ctypes.POINTER(POINTER))(matrix.handle, ctypes.byref(pointer))
        _add_up(np.ascontiguousarray(values), places, _doubles(pointer.value, total))
        function("MatSeqAIJRestoreArray", POINTER, ctypes.POINTER(POINTER))(matrix.handle, ctypes.byref(pointer))
        matrix.assemble()
        return
    if arrays is None:
        values = np.ascontiguousarray(values, dtype=PETSc.ScalarType)
        call = function("MatSetValuesCOO", POINTER, POINTER, ctypes.c_int)
        call(matrix.handle, values.ctypes.data, int(PETSc.InsertMode.INSERT_VALUES))
        return
    rows, mine = arrays
    if rows.entries is None:
        if values is not mine:
            mine[:] = values
    else:
        np.take(values, rows.entries, out=mine, mode="clip")
    matrix.assemble()


def _doubles(address: int | None, count: int) -> NDArray[np.float64]:
    """Return an array of numbers that PETSc has."""
    if not count:
        return np.empty(0)
    assert address is not None
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))


def compressed_rows(matrix: PETSc.Mat) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.float64]]:
    """Return first entry of each row, columns and values of a matrix on one rank, not to be written to."""
    arrays = matrix.getAttr(_ARRAYS)
    if arrays is None:
        start, column, values = matrix.getValuesCSR()
        return start, column, values
    rows, mine = arrays
    return rows.start, rows.column, mine


def has_whole_rows(matrix: PETSc.Mat) -> bool:
    """Return whether `absolute_product` takes a matrix: one of which both triangles are stored."""
    return "aij" in matrix.getType() and "sbaij" not in matrix.getType()


def absolute_product(matrix: PETSc.Mat, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return this rank's rows of the product of a matrix's absolute values with a vector, which all of it is of."""
    start, column, values = compressed_rows(matrix)
    result = np.empty(start.size - 1)
    _absolute_product(start, column, values, vector, result)
    return result


@njit(void(P1, P1, F1, F1, F1), **FAST)
def _absolute_product(start: Any, column: Any, values: Any, vector: Any, result: Any) -> None:
    for i in range(result.size):
        value = 0.0
        for k in range(start[i], start[i + 1]):
            value += abs(values[k]) * vector[column[k]]
        result[i] = value


def componentwise(matrix: PETSc.Mat, components: int) -> PETSc.Mat:
    """Return the matrix that multiplies each of several interlaced components by the given one (PETSc's MAIJ).

    It stores one entry where a matrix of blocks would store ``components^2``.
    """
    made, where = POINTER(), ctypes.POINTER(POINTER)
    function("MatCreateMAIJ", POINTER, ctypes.c_int, where)(matrix.handle, components, ctypes.byref(made))
    result = PETSc.Mat().create(matrix.getComm())
    # petsc4py takes no foreign handle, but its own may become the matrix.
    function("MatHeaderReplace", POINTER, where)(result.handle, ctypes.byref(made))
    return result


def orthonormalise(vectors: Iterable[PETSc.Vec], mass: PETSc.Mat | None = None) -> list[PETSc.Vec]:
    """Make vectors orthonormal, in place, or ``x^T M y`` with a mass matrix (modified Gram-Schmidt); return them."""
    done: list[PETSc.Vec] = []
    # M times each of them.
    images: list[PETSc.Vec] = []
    for vector in vectors:
        for other, image in zip(done, images, strict=True):
            vector.axpy(-vector.dot(image), other)
        image = vector.copy() if mass is None else mass * vector
        size = np.sqrt(vector.dot(image))
        vector.scale(1.0 / size)
        image.scale(1.0 / size)
        done.append(vector)
        images.append(image)
    for image in images:
        image.destroy()
    return done
