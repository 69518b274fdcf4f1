"""Materials of the user's own: a compiled function, Abaqus' UMAT, or a behaviour of MFront."""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import CodeType, FunctionType, MappingProxyType
from typing import Any, ClassVar, Literal

import numba
import numpy as np
from numba import carray, cfunc, types

from isorod.errors import InputError, finite
from isorod.material.memory import Timed
from isorod.material.points import STATES
from isorod.material.proof import check_waves
from isorod.material.user_kernel import FUNCTION, MFRONT, TIME, UMAT, VARIABLES

# Angle of the rotation in which a routine is checked, radians.
_ANGLE = 0.3

# Releases of TFEL whose generic interface has the mass density.
_TFEL = 4

# Suffix of MFront's functions of a behaviour, but not of its metadata.
_THREE = "_Tridimensional"


@dataclass(frozen=True, eq=False)
class UserMaterial(Timed):
    """A law whose stress is computed by a user routine, step by step.

    The routine returns the stress at the end of a step from both deformation gradients, its state variables at the
    start, the time of the step and its constants.  Newton's method takes the symmetric part of the tangent.

    Parameters
    ----------
    routine
        A function ``update(F_old, F, state, dt, constants)`` that Numba can compile; it returns the first
        Piola-Kirchhoff stress ``(3, 3)`` and overwrites the state variables ``(n,)`` by those at the end; its tangent
        is computed by differences.  Or the address of a routine with another interface (`library`).
    variables
        Number of its state variables.  All are zero at rest.
    parameters
        Its constants.
    interface
        ``"function"``; ``"umat"``, Abaqus' subroutine, with temperature, fields and coordinates zero, KSTEP 1, and KINC
        1 in the first step and 2 later; or ``"mfront"``, MFront's generic interface of a finite strain behaviour (TFEL
        4 or later).
    name
        Its name in errors.

    Raises
    ------
    InputError
        If it fails at rest or has a stress there; a rotation causes stress; a plane wave has no positive modulus; a
        constant is not finite; there are too many state variables.
    """

    routine: Callable[..., Any] | int
    variables: int
    parameters: Sequence[float] = ()
    interface: Literal["function", "umat", "mfront"] = "function"
    name: str = "routine"

    kernel: ClassVar[str] = "user_kernel"
    clock: ClassVar[int] = TIME
    stores: ClassVar[bool] = False
    splits: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._prove()

    def _check(self) -> None:
        """Raise `InputError` if a constant or the number of state variables is invalid."""
        finite(f"{self.name}, constants", list(self.parameters))
        most = STATES - VARIABLES
        if not 0 <= self.variables <= most:
            raise InputError(f"{self.name}: got {self.variables} state variables, need 0 to {most}")

    @property
    def states(self) -> dict[str, int]:  # type: ignore[override]
        """Components of its state: ``F``, stress and strain at the start of the step, work; then the routine's own."""
        known = {"_F": 9, "_stress": 9, "_strain": 6, "_work": 1}
        return known | {f"state_{number}": 1 for number in range(1, self.variables + 1)}

    @property
    def values(self) -> tuple[float, ...]:
        """Address, time of the step, interface, number of state variables, time before, and the routine's constants."""
        address = self.routine if isinstance(self.routine, int) else _wrapped(self.routine).address
        kind = {"function": FUNCTION, "umat": UMAT, "mfront": MFRONT}[self.interface]
        return float(address), self.step, kind, float(self.variables), self.since, *map(float, self.parameters)

    @property
    def identity(self) -> str:
        """Its name, code and interface, independent of addresses."""
        code = "" if isinstance(self.routine, int) else sha256(repr(_code(self.routine)).encode()).hexdigest()[:8]
        given = self.interface, self.variables, tuple(self.parameters)
        return f"{type(self).__name__} {self.name} {code} {given}"

    @property
    def frozen(self) -> "UserMaterial":
        """Raises `InputError`: a routine defines no law without flow."""
        raise InputError(f"{self.name}: modes and motions do not take routines; leave them out")

    def _prove(self) -> None:
        """Check the routine at rest and in a rotation.

        Raises
        ------
        InputError
            If something is not finite, a stress is not zero, or a plane wave has no positive modulus.
        """
        law, rest = self.lasting(1.0), np.eye(3)[None]
        moduli = law.tangent(rest)
        scale = float(np.abs(moduli).max())
        if not 0.0 < scale < np.inf:
            raise InputError(f"{self.name}: the largest modulus at rest is {scale:g}, need a finite one, not zero")
        c, s = np.cos(_ANGLE), np.sin(_ANGLE)
        for what, F in (("at rest", np.eye(3)), ("in a rotation", np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))):
            stress = float(np.abs(law.stress(F[None])).max())
            if not stress <= 1e-8 * scale:
                raise InputError(f"{self.name}: a stress of {stress:.3g} {what}, need none")
        check_waves(self.name, law, scale)


def _code(made: Any, known: Mapping[str, Any] = MappingProxyType({}), within: tuple[Any, ...] = ()) -> Any:
    """Return the definition of a function, the same in any process: its code, and the values its names refer to."""
    made = getattr(made, "py_func", made)
    if any(made is one for one in within):
        return None
    within = (*within, made)
    if isinstance(made, FunctionType):
        around = (one.cell_contents for one in made.__closure__ or ())
        known = made.__globals__ | dict(zip(made.__code__.co_freevars, around, strict=True))
        return _code(made.__code__, known, within)
    if isinstance(made, CodeType):
        names = made.co_names + made.co_freevars
        used = (*made.co_consts, *(known[name] for name in names if name in known))
        return made.co_code, names, [_code(one, known, within) for one in used]
    return made.tolist() if isinstance(made, np.ndarray) else getattr(made, "__name__", repr(made))


@cache
def _wrapped(routine: Callable[..., Any]) -> Any:
    """Return a C callback that calls a user function with arrays; kept as long as the process."""
    inner = routine if hasattr(routine, "py_func") else numba.njit(routine)

    number = types.CPointer(types.float64)

    @cfunc(types.void(number, number, number, types.int64, number, number, types.int64, number))
    def called(F_old: Any, F: Any, state: Any, m: int, dt: Any, constants: Any, c: int, stress: Any) -> None:
        result = inner(carray(F_old, (3, 3)), carray(F, (3, 3)), carray(state, (m,)), dt[0], carray(constants, (c,)))
        # By component: assignment of arrays takes longer to compile than all the rest.
        fits = result.shape == (3, 3)
        for k in range(9):
            stress[k] = result[k // 3, k % 3] if fits else np.nan

    return called


def library(
    path: Path,
    function: str,
    interface: Literal["umat", "mfront"] = "umat",
    states: int = 0,
    constants: list[float] | None = None,
) -> UserMaterial:
    """Return the law of a routine in a shared library.

    Parameters
    ----------
    path
        The library, for example made by `gfortran -shared -fPIC -O2 -o law.so law.f`.
    function
        Its symbol there; Fortran compilers append an underscore: `umat_`.
    interface
        `"umat"`, Abaqus' subroutine, or `"mfront"`, MFront's generic interface of a finite strain behaviour.
    states
        Number of its state variables.
    constants
        Its constants (PROPS), or material properties.
    """
    try:
        loaded = ctypes.CDLL(str(Path(path).resolve()))
        routine = getattr(loaded, function)
    except OSError as error:
        raise InputError(f"{path}: cannot be loaded: {error}") from None
    except AttributeError:
        raise InputError(f"{path}: it has no function {function!r}; `nm -D` lists those it has") from None
    if interface == "mfront":
        _released(loaded, path, function)
    address = ctypes.cast(routine, ctypes.c_void_p).value or 0
    name = f"{Path(path).name}, {function} {sha256(Path(path).read_bytes()).hexdigest()[:8]}"
    return UserMaterial(address, states, tuple(constants or ()), interface, name)


def _released(loaded: ctypes.CDLL, path: Path, function: str) -> None:
    """Raise `InputError` for a behaviour made by a release of TFEL with an older interface."""
    try:
        text = ctypes.c_char_p.in_dll(loaded, f"{function.removesuffix(_THREE)}_tfel_version").value
    except ValueError:
        return
    release = (text or b"").decode()
    if not release.split(".")[0].isdigit() or int(release.split(".")[0]) < _TFEL:
        raise InputError(f"{path}: made by TFEL {release}, need {_TFEL} or later")
