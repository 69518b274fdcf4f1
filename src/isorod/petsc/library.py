"""The few PETSc functions that petsc4py does not wrap in every version isorod runs with, called in its own library."""

import ctypes
import re
from functools import cache
from typing import Any

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
