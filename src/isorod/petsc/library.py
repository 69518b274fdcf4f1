"""PETSc functions that petsc4py does not wrap in all supported versions, called in its library by ctypes."""

import ctypes
import re
from collections.abc import Callable
from functools import cache
from typing import Any

from petsc4py import PETSc

POINTER = ctypes.c_void_p

# Options that PETSc reads only when it ends.
_AT_THE_END = re.compile(r"(options_left|options_view|malloc_\w+|memory_view|objects_\w+|log_\w+|citations)$")


@cache
def function(name: str, *kinds: Any) -> Callable[..., None]:
    """Return a function of PETSc's library that takes arguments of some kinds and raises `PETSc.Error` if it fails."""
    routine = getattr(ctypes.CDLL(PETSc.__file__), name)
    routine.argtypes = kinds

    def call(*arguments: Any) -> None:
        code = routine(*arguments)
        if code:
            raise PETSc.Error(code)

    return call


def adopted(handle: Any, comm: PETSc.Comm) -> PETSc.Mat:
    """Return the petsc4py matrix of a PETSc handle: petsc4py takes none, but its own matrix can be replaced by it."""
    result = PETSc.Mat().create(comm)
    function("MatHeaderReplace", POINTER, ctypes.POINTER(POINTER))(result.handle, ctypes.byref(handle))
    return result


def set_singular(pc: PETSc.PC, singular: bool) -> None:
    """Say whether a preconditioner met a zero pivot: linear solves with it then fail."""
    # PC_FACTOR_NUMERIC_ZEROPIVOT, PC_NOERROR.
    function("PCSetFailedReason", POINTER, ctypes.c_int)(pc.handle, 2 if singular else 0)


def forget(handle: int) -> None:
    """Reset a preconditioner, given by its handle, to the empty type ``none``."""
    function("PCSetType", POINTER, ctypes.c_char_p)(handle, b"none")


def pc_name(pc: PETSc.PC) -> str:
    """Return the type of a preconditioner; for one in Python the name of its class."""
    return type(pc.getPythonContext()).__name__.lower() if pc.getType() == "python" else str(pc.getType())


def solver_types(snes: PETSc.SNES) -> dict[str, str]:
    """Return the types of a nonlinear solver and of its linear solver, preconditioner and factorisation."""
    ksp = snes.getKSP()
    pc = ksp.getPC()
    names = {"snes": snes.getType(), "ksp": ksp.getType(), "pc": pc_name(pc)}
    if pc.getType() in ("lu", "cholesky"):
        names["factor"] = pc.getFactorSolverType()
    return names


def is_used(name: str) -> bool:
    """Return whether something has asked for a PETSc option since it was set."""
    # PetscBool is an int, in later versions one byte of it.
    used = ctypes.c_int()
    function("PetscOptionsUsed", POINTER, ctypes.c_char_p, ctypes.c_void_p)(None, name.encode(), ctypes.byref(used))
    return bool(used.value)


def unused_options() -> list[str]:
    """Return the PETSc options given on the command line that nothing has asked for so far, as ``-name value``.

    They are removed, so that PETSc does not report them again when it ends.
    """
    count = ctypes.c_int()
    names = ctypes.POINTER(ctypes.c_char_p)()
    values = ctypes.POINTER(ctypes.c_char_p)()
    arguments = (None, ctypes.byref(count), ctypes.byref(names), ctypes.byref(values))
    kinds = (POINTER, POINTER, POINTER, POINTER)
    function("PetscOptionsLeftGet", *kinds)(*arguments)
    left, names_left = [], []
    for k in range(count.value):
        if _AT_THE_END.match(names[k].decode()):
            continue
        value = values[k]
        names_left.append(names[k].decode())
        left.append(f"-{names[k].decode()}" + (f" {value.decode()}" if value else ""))
    function("PetscOptionsLeftRestore", *kinds)(*arguments)
    for name in names_left:
        PETSc.Options().delValue(name)
    return left
