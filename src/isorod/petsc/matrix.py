"""The few PETSc functions that petsc4py does not wrap in every version isorod runs with, called in its own library."""

import ctypes
import re
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from petsc4py import PETSc

_POINTER = ctypes.c_void_p

# Attribute of a matrix whose arrays were made here: which of the given entries is where, and the arrays.
_ARRAYS = "isorod_arrays"

# Options that PETSc reads only when it ends.
_AT_THE_END = re.compile(r"(options_left|options_view|malloc_\w+|memory_view|objects_\w+|log_\w+|citations)$")


@cache
def _function(name: str, *arguments: Any) -> Any:
    function = getattr(ctypes.CDLL(PETSc.__file__), name)
    function.argtypes = arguments
    return function


def _check(code: int) -> None:
    if code:
        raise PETSc.Error(code)


class Rows(NamedTuple):
    """Compressed rows: which of the given entries comes where (None: as they come), first entry of each row, columns."""

    places: NDArray[Any] | None
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
        Returns global rows and columns of each entry; negative ones are ignored.  `set_values` takes the values in this order.
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
    start = np.zeros(size + 1, dtype=PETSc.IntType)
    places, column = np.empty(rows.size, dtype=np.int64), np.empty(rows.size, dtype=PETSc.IntType)
    total = _compress(rows, columns, start, places, column)
    if total < 0:
        order = np.lexsort((columns, rows))
        total = _compress(rows[order], columns[order], start, places, column)
        if total < 0:
            return None
        places = order[places[:total]]
    return Rows(places[:total], start, column[:total])


@njit(cache=True)
def _compress(rows: Any, columns: Any, start: Any, places: Any, column: Any) -> int:
    """Fill compressed rows with the entries that are no negative ones, and return their number, or -1 if they do not ascend."""
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
        places[total] = k
        column[total] = j
        total += 1
    for i in range(last_row + 1, start.size):
        start[i] = total
    return total


def preallocate(matrix: PETSc.Mat, rows: NDArray[Any], columns: NDArray[Any]) -> None:
    """Preallocate a matrix, once more perhaps, by global row and column indices (COO); negative ones are ignored."""
    matrix.setAttr(_ARRAYS, None)
    # PETSc sorts the arrays in place.
    rows = np.array(rows, dtype=PETSc.IntType)
    columns = np.array(columns, dtype=PETSc.IntType)
    call = _function("MatSetPreallocationCOO", _POINTER, ctypes.c_ssize_t, _POINTER, _POINTER)
    _check(call(matrix.handle, rows.size, rows.ctypes.data, columns.ctypes.data))


def set_values(matrix: PETSc.Mat, values: NDArray[np.float64]) -> None:
    """Set the entries in the order in which the matrix got room for them, repeated ones added up."""
    arrays = matrix.getAttr(_ARRAYS)
    if arrays is None:
        values = np.ascontiguousarray(values, dtype=PETSc.ScalarType)
        call = _function("MatSetValuesCOO", _POINTER, _POINTER, ctypes.c_int)
        _check(call(matrix.handle, values.ctypes.data, int(PETSc.InsertMode.INSERT_VALUES)))
        return
    rows, mine = arrays
    if rows.places is None:
        mine[:] = values
    else:
        np.take(values, rows.places, out=mine, mode="clip")
    matrix.assemble()


def compressed_rows(matrix: PETSc.Mat) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.float64]]:
    """Return first entry of each row, columns and values of a matrix on one rank, not to be written to."""
    arrays = matrix.getAttr(_ARRAYS)
    if arrays is None:
        start, column, values = matrix.getValuesCSR()
        return start, column, values
    rows, mine = arrays
    return rows.start, rows.column, mine


def negative_eigenvalues(matrix: PETSc.Mat) -> int:
    """Return the number of negative eigenvalues of a symmetric matrix (Sylvester's law of inertia), by MUMPS; options ``-sturm_...``."""
    pc = PETSc.PC().create(matrix.getComm())
    pc.setOptionsPrefix("sturm_")
    try:
        pc.setOperators(matrix)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        # MUMPS knows the inertia only if its root node is not ScaLAPACK's and it looks for zero pivots.
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(13, 1)
        factor.setMumpsIcntl(24, 1)
        pc.setFromOptions()
        pc.setUp()
        negative, _, _ = factor.getInertia()
        return int(negative)
    finally:
        pc.destroy()


def set_singular(pc: PETSc.PC, singular: bool) -> None:
    """Say whether a preconditioner met a zero pivot: linear solves with it then fail."""
    # PC_FACTOR_NUMERIC_ZEROPIVOT, PC_NOERROR.
    _check(_function("PCSetFailedReason", _POINTER, ctypes.c_int)(pc.handle, 2 if singular else 0))


def forget(handle: int) -> None:
    """Make a preconditioner, given by its handle, one that does nothing and has nothing."""
    _check(_function("PCSetType", _POINTER, ctypes.c_char_p)(handle, b"none"))


def pc_name(pc: PETSc.PC) -> str:
    """Return the type of a preconditioner, of one that is written in Python the name of its class."""
    return type(pc.getPythonContext()).__name__.lower() if pc.getType() == "python" else str(pc.getType())


def solver_types(snes: PETSc.SNES) -> dict[str, str]:
    """Return the names of a nonlinear solver and of what it is made of."""
    ksp = snes.getKSP()
    pc = ksp.getPC()
    names = {"snes": snes.getType(), "ksp": ksp.getType(), "pc": pc_name(pc)}
    if pc.getType() in ("lu", "cholesky"):
        names["factor"] = pc.getFactorSolverType()
    return names


def unused_options() -> list[str]:
    """Return the PETSc options given on the command line that nothing has asked for so far, as ``-name value``.

    They are forgotten, so that PETSc does not complain of them once more when it ends.
    """
    count = ctypes.c_int()
    names = ctypes.POINTER(ctypes.c_char_p)()
    values = ctypes.POINTER(ctypes.c_char_p)()
    out = (ctypes.byref(count), ctypes.byref(names), ctypes.byref(values))
    kinds = (_POINTER, _POINTER, _POINTER, _POINTER)
    _check(_function("PetscOptionsLeftGet", *kinds)(None, *out))
    left, names_left = [], []
    for k in range(count.value):
        if _AT_THE_END.match(names[k].decode()):
            continue
        value = values[k]
        names_left.append(names[k].decode())
        left.append(f"-{names[k].decode()}" + (f" {value.decode()}" if value else ""))
    _check(_function("PetscOptionsLeftRestore", *kinds)(None, *out))
    for name in names_left:
        PETSc.Options().delValue(name)
    return left


def componentwise(matrix: PETSc.Mat, components: int) -> PETSc.Mat:
    """Return the matrix that multiplies each of several interlaced components by the given one (PETSc's MAIJ).

    It stores one entry where a matrix of blocks would store ``components^2``.
    """
    made = _POINTER()
    _check(
        _function("MatCreateMAIJ", _POINTER, ctypes.c_int, ctypes.POINTER(_POINTER))(
            matrix.handle, components, ctypes.byref(made)
        )
    )
    result = PETSc.Mat().create(matrix.getComm())
    # petsc4py takes no foreign handle, but its own may become the matrix.
    _check(_function("MatHeaderReplace", _POINTER, ctypes.POINTER(_POINTER))(result.handle, ctypes.byref(made)))
    return result
