"""The few PETSc functions that petsc4py does not wrap in every version isorod runs with, called in its own library."""

import ctypes
import re
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from petsc4py import PETSc

_POINTER = ctypes.c_void_p

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


def preallocate_coo(matrix: PETSc.Mat, rows: NDArray[Any], columns: NDArray[Any]) -> None:
    """Preallocate a matrix by global row and column indices; negative ones are ignored."""
    # PETSc sorts the arrays in place.
    rows = np.array(rows, dtype=PETSc.IntType)
    columns = np.array(columns, dtype=PETSc.IntType)
    call = _function("MatSetPreallocationCOO", _POINTER, ctypes.c_ssize_t, _POINTER, _POINTER)
    _check(call(matrix.handle, rows.size, rows.ctypes.data, columns.ctypes.data))


def set_values_coo(matrix: PETSc.Mat, values: NDArray[np.float64]) -> None:
    """Set the entries in the order of `preallocate_coo`, repeated ones added up."""
    values = np.ascontiguousarray(values, dtype=PETSc.ScalarType)
    call = _function("MatSetValuesCOO", _POINTER, _POINTER, ctypes.c_int)
    _check(call(matrix.handle, values.ctypes.data, int(PETSc.InsertMode.INSERT_VALUES)))


def solver_types(snes: PETSc.SNES) -> dict[str, str]:
    """Return the names of a nonlinear solver and of what it is made of."""
    ksp = snes.getKSP()
    pc = ksp.getPC()
    names = {"snes": snes.getType(), "ksp": ksp.getType(), "pc": pc.getType()}
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
