"""Sparse matrices from entries: preallocated once, filled in each assembly."""

import ctypes
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numba import b1, f8, i8, void
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.compiled import F1, FAST, I1, STRICT, njit
from isorod.petsc.layout import Arrays, Layout
from isorod.petsc.library import POINTER, adopted, function
from isorod.petsc.placement import Placement, gather
from isorod.petsc.rows import P1, component_rows, local_rows

# Attribute of a matrix: its arrays, allocated here, with the positions of the given entries.
_ARRAYS = "isorod_arrays"

# Attribute of a matrix preallocated by PETSc: position of each given entry, and the number of entries.
_PLACES = "isorod_places"

# Attribute of matrices of `componentwise`: number of components.
_COMPONENTS = "isorod_components"

# Attribute of a matrix whose preallocation has changed.
_RENEWED = "isorod_renewed"


def create_matrix(
    comm: PETSc.Comm,
    sizes: tuple[int, int],
    block: int,
    indices: Callable[[], tuple[NDArray[Any], NDArray[Any]]],
    layout: Layout | None = None,
    total: int = 0,
) -> PETSc.Mat:
    """Return a new square matrix, AIJ or by ``-mat_type``, preallocated for given entries.

    Parameters
    ----------
    sizes, block
        Number of rows here and in all, and the block size.
    indices
        Returns global rows and columns of each entry; negative ones are ignored.  `set_values` takes the values in this
        order.
    layout, total
        Positions and number of the entries, if known without the indices (on all ranks or none); not used with
        ``-mat_type``.
    """
    arrays: Arrays | Placement | None = None
    if not PETSc.Options().hasName("mat_type"):
        # PETSc's COO preallocation spends most of its time on sorting sorted entries.
        if layout is not None:
            arrays = Arrays(comm, layout, total)
        elif comm.getSize() > 1:
            arrays = Placement(comm, sizes[0], *indices())
    made = PETSc.Mat().create(comm) if arrays is None else arrays.matrix(sizes)
    if arrays is None:
        made.setSizes((sizes, sizes))
        made.setType(PETSc.Mat.Type.AIJ)
    made.setBlockSize(block)
    made.setFromOptions()
    if arrays is None:
        preallocate(made, *indices())
    else:
        made.setAttr(_ARRAYS, arrays)
    return made


def keep_symmetric(matrix: PETSc.Mat) -> PETSc.Mat:
    """Tell PETSc that a matrix is symmetric whatever its values, and return it."""
    for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SYMMETRY_ETERNAL):
        matrix.setOption(option, True)
    return matrix


def preallocate(matrix: PETSc.Mat, rows: NDArray[Any], columns: NDArray[Any]) -> None:
    """Preallocate a matrix, or do so again, by global row and column indices (COO); negative ones are ignored."""
    matrix.setAttr(_ARRAYS, None)
    matrix.setAttr(_PLACES, None)
    matrix.setAttr(_RENEWED, True)
    if matrix.getType() == PETSc.Mat.Type.SEQAIJ and rows.size <= np.iinfo(PETSc.IntType).max:
        # PETSc's own COO preallocation is a comparison sort of all entries.
        rows, columns = np.ascontiguousarray(rows, dtype=np.int64), np.ascontiguousarray(columns, dtype=np.int64)
        placed = gather([(rows, columns)], 0, matrix.getSize()[0])
        matrix.setPreallocationCSR(placed.own)
        matrix.setAttr(_PLACES, (placed.places[0], placed.own[1].size))
        return
    # PETSc sorts the arrays in place.
    rows = np.array(rows, dtype=PETSc.IntType)
    columns = np.array(columns, dtype=PETSc.IntType)
    call = function("MatSetPreallocationCOO", POINTER, ctypes.c_ssize_t, POINTER, POINTER)
    call(matrix.handle, rows.size, rows.ctypes.data, columns.ctypes.data)


def forget_factors(matrix: PETSc.Mat, ksp: PETSc.KSP) -> None:
    """Reset the preconditioner if the matrix' preallocation has changed, which PETSc may not notice.

    Over several ranks it compares a state of the sparsity pattern that never changes.
    """
    if renewed(matrix):
        ksp.getPC().reset()


def renewed(matrix: PETSc.Mat) -> bool:
    """Return whether a matrix' preallocation has changed since the last call."""
    result = bool(matrix.getAttr(_RENEWED))
    matrix.setAttr(_RENEWED, None)
    return result


def fits(matrix: PETSc.Mat, count: int, rows: NDArray[Any], columns: NDArray[Any]) -> bool:
    """Replace the entries after the first ``count`` if the matrix' pattern has them; return whether it does.

    Pattern and symbolic factorisation are then kept.  Only known on one rank.
    """
    known = matrix.getAttr(_PLACES)
    if known is None:
        return False
    start, column = local_rows(matrix).own[:2]
    places = np.empty(rows.size, dtype=np.int64)
    if not _find(np.ascontiguousarray(rows), np.ascontiguousarray(columns), start, column, places):
        return False
    matrix.setAttr(_PLACES, (np.concatenate([known[0][:count], places]), known[1]))
    return True


@njit(b1(I1, I1, P1, P1, I1), **STRICT)
def _find(rows: Any, columns: Any, start: Any, column: Any, places: Any) -> bool:
    """Fill in the positions of entries in compressed rows, -1 if an index is negative; return whether all exist."""
    for k in range(rows.size):
        places[k] = -1
        if rows[k] < 0 or columns[k] < 0:
            continue
        low, high = start[rows[k]], start[rows[k] + 1]
        while low < high:
            middle = (low + high) // 2
            if column[middle] < columns[k]:
                low = middle + 1
            else:
                high = middle
        if low == start[rows[k] + 1] or column[low] != columns[k]:
            return False
        places[k] = low
    return True


@njit(void(F1, I1, F1), **STRICT)
def _add_up(values: Any, places: Any, entries: Any) -> None:
    """Set entries to the sums of the values that have a place there."""
    entries[:] = 0.0
    for k in range(values.size):
        if places[k] >= 0:
            entries[places[k]] += values[k]


def zeros(matrix: PETSc.Mat, total: int) -> NDArray[np.float64]:
    """Return zeros for ``total`` entries, in the order of the matrix' preallocation, to be added to.

    They are the matrix' own values if these are in the same order; `set_values` is called in either case.
    """
    arrays = matrix.getAttr(_ARRAYS)
    own = arrays.values if isinstance(arrays, Arrays) else None
    if own is None:
        return np.zeros(total)
    own[:] = 0.0
    return own


def set_values(matrix: PETSc.Mat, values: NDArray[np.float64]) -> None:
    """Set the entries in the order of the matrix' preallocation; repeated ones are summed."""
    gathered, arrays = matrix.getAttr(_PLACES), matrix.getAttr(_ARRAYS)
    if arrays is not None:
        arrays.set(matrix, values)
        return
    if gathered is not None:
        places, total = gathered
        pointer = POINTER()
        function("MatSeqAIJGetArray", POINTER, ctypes.POINTER(POINTER))(matrix.handle, ctypes.byref(pointer))
        _add_up(np.ascontiguousarray(values), places, _doubles(pointer.value, total))
        function("MatSeqAIJRestoreArray", POINTER, ctypes.POINTER(POINTER))(matrix.handle, ctypes.byref(pointer))
        matrix.assemble()
        return
    values = np.ascontiguousarray(values, dtype=PETSc.ScalarType)
    call = function("MatSetValuesCOO", POINTER, POINTER, ctypes.c_int)
    call(matrix.handle, values.ctypes.data, int(PETSc.InsertMode.INSERT_VALUES))


def _doubles(address: int | None, count: int) -> NDArray[np.float64]:
    """Return an array of numbers that PETSc has."""
    if not count:
        return np.empty(0)
    assert address is not None
    return np.ctypeslib.as_array((ctypes.c_double * count).from_address(address))


def has_whole_rows(matrix: PETSc.Mat) -> bool:
    """Return whether `absolute_product` takes a matrix: one of which both triangles are stored."""
    return "aij" in matrix.getType() and "sbaij" not in matrix.getType()


def absolute_product(matrix: PETSc.Mat, vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return this rank's part of the product of a matrix's absolute values with a vector, of this rank's part of it."""
    rows, result = local_rows(matrix), np.zeros(vector.size)
    _add_absolute_product(*rows.own, np.ascontiguousarray(vector), result)
    if matrix.getComm().getSize() > 1:
        whole, near = matrix.createVecRight(), PETSc.Vec().createSeq(rows.columns.size)
        there = PETSc.IS().createGeneral(rows.columns, PETSc.COMM_SELF)
        scatter = PETSc.Scatter().create(whole, there, near, None)
        whole.array_w[:] = vector
        scatter.scatter(whole, near, PETSc.InsertMode.INSERT_VALUES, PETSc.ScatterMode.FORWARD)
        _add_absolute_product(*rows.others, np.array(near.array_r), result)
        for one in (scatter, there, near, whole):
            one.destroy()
    return result


@njit(void(P1, P1, F1, F1, F1), **FAST)
def _add_absolute_product(start: Any, column: Any, values: Any, vector: Any, result: Any) -> None:
    for i in range(result.size):
        value = result[i]
        for k in range(start[i], start[i + 1]):
            value += abs(values[k]) * vector[column[k]]
        result[i] = value


def componentwise(matrix: PETSc.Mat, components: int) -> PETSc.Mat:
    """Return the matrix that multiplies each of several interlaced components by the given one (PETSc's MAIJ).

    It stores one entry where a matrix of blocks would store ``components^2``.
    """
    made, kinds = POINTER(), (POINTER, ctypes.c_int, ctypes.POINTER(POINTER))
    function("MatCreateMAIJ", *kinds)(matrix.handle, components, ctypes.byref(made))
    result = adopted(made, matrix.getComm())
    result.setAttr(_COMPONENTS, components)
    return result


def components_of(matrix: PETSc.Mat) -> int:
    """Return the number of components of a matrix of `componentwise`, 1 for others."""
    return int(matrix.getAttr(_COMPONENTS) or 1)


def add_componentwise(matrix: PETSc.Mat, factor: float, other: PETSc.Mat) -> bool:
    """Add ``factor`` times a matrix of `componentwise` to a matrix with blocks of all components at its entries.

    Returns whether the matrices are such; if not, nothing is added.
    """
    components = components_of(other)
    if components == 1 or matrix.getType() not in ("seqaij", "mpiaij"):
        return False
    rows, less = local_rows(matrix), component_rows(other, components)
    parts = [(*rows.own, *less.own), (*rows.others, *less.others)]
    columns = (components * less.columns[:, None] + np.arange(components)).ravel()
    fits = np.array_equal(rows.columns, columns) and all(_add_blocks(*part, components, 0.0) for part in parts)
    if matrix.getComm().tompi4py().allreduce(not fits):
        return False
    for part in parts:
        _add_blocks(*part, components, factor)
    return True


@njit(b1(P1, P1, F1, P1, P1, F1, i8, f8), **STRICT)
def _add_blocks(
    start: Any, column: Any, values: Any, start_of: Any, column_of: Any, values_of: Any, components: int, factor: float
) -> bool:
    """Add ``factor`` times rows of one component to those of all; return whether these have blocks at its entries.

    Nothing is added if the factor is zero.
    """
    if start.size != components * (start_of.size - 1) + 1:
        return False
    for i in range(start_of.size - 1):
        begin, count = start_of[i], start_of[i + 1] - start_of[i]
        for a in range(components):
            at = start[components * i + a]
            if start[components * i + a + 1] - at != components * count:
                return False
            for k in range(count):
                if column[at + components * k + a] != components * column_of[begin + k] + a:
                    return False
                if factor != 0.0:
                    values[at + components * k + a] += factor * values_of[begin + k]
    return True


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
