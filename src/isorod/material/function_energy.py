"""A stored energy as a function that Numba compiles: stress by complex steps, moduli by differences of these.

Complex steps (Squire & Trapp, SIAM Review 40 (1998) 110-112) lose no digits, so that the stress is exact to rounding;
central differences of it, of a step of 1e-5, leave the moduli an error of about 1e-10.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from inspect import signature
from typing import Any

import numba
import numpy as np
from numba.core.errors import NumbaError

from isorod.arrays import Array
from isorod.compiled import FAST, STRICT, cofactors
from isorod.errors import InputError
from isorod.material.points import (
    DETERMINANT,
    FIBRE,
    GRADIENT,
    MODULI,
    POINT,
    POINTS,
    ROWS,
    SQUARES,
    TANGENT,
    Compiled,
)

_TINY, _STEP = 1e-30, 1e-5


@dataclass(frozen=True)
class FunctionEnergy:
    """What `isorod.material.energy.Energy` is for an expression.

    Parameters
    ----------
    function
        Takes ``F`` ``(3, 3)``, real or complex, the constants ``(c,)`` and, where there are families of fibres, their
        directions ``(3 families,)``, and returns the energy per reference volume.
    added
        Whether ``- p ln J + bulk/2 (ln J)^2`` is added: ``p`` and ``bulk`` are the last two constants.
    """

    function: Callable[..., Any]
    added: bool

    quadratic = True
    factor = None

    @property
    def volume(self) -> Any:
        """Something where a volumetric energy is added, else None."""
        return True if self.added else None

    @property
    def families(self) -> int:
        """Number of fibre directions: one where the function takes any."""
        return 1 if self._takes > 2 else 0

    @property
    def _takes(self) -> int:
        return len(signature(getattr(self.function, "py_func", self.function)).parameters)

    def __str__(self) -> str:
        """Return what tells functions apart in other processes too."""
        code = getattr(self.function, "py_func", self.function).__code__
        return f"{code.co_code.hex()} {code.co_consts} {self.added}"

    @property
    def expression(self) -> Any:
        """Raise `InputError`: there is none."""
        raise InputError("energy: a compiled function has no expression; finite elements need one of SymPy")

    @cached_property
    def compiled(self) -> Compiled:
        """The compiled functions.

        Raises
        ------
        InputError
            If Numba cannot compile the function for complex ``F``.
        """
        given = self.function if hasattr(self.function, "py_func") else numba.njit(self.function)
        added = self.added
        if self._takes > 2:
            energy = given
        else:

            @numba.njit
            def energy(F: Any, constants: Array, fibre: Array) -> Any:
                return given(F, constants)

        @numba.njit
        def whole(F: Any, constants: Array, fibre: Array) -> Any:
            if not added:
                return energy(F, constants, fibre)
            det = F[0, 0] * (F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]) + F[0, 1] * (F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2])
            log = np.log(det + F[0, 2] * (F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]))
            return energy(F, constants[:-2], fibre) + (0.5 * constants[-1] * log - constants[-2]) * log

        try:
            return Compiled(_point(whole), None, _tangent(whole))
        except NumbaError as error:
            raise InputError(f"energy: complex steps are impossible, Numba says: {_first_line(error)}") from None


def _first_line(error: Exception) -> str:
    """Return the line of an error of Numba that says what it is about."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [line.removeprefix(">>> ") for line in lines if line.startswith(">>> ")]
    return f"there is no {told[0]}" if told else next((one for one in lines if "Failed in" not in one), lines[0])


def _point(whole: Any) -> Any:
    """Return a law's function of a point (`isorod.material.points.POINT`)."""

    @numba.njit(POINT, **STRICT)
    def point(F: Array, constants: Array, fibre: Array, activation: float, stress: Array) -> tuple[float, float]:
        valid = 1.0 if cofactors(F, stress) > 0.0 else np.nan
        moved = F.astype(np.complex128)
        for a in range(3):
            for A in range(3):
                moved[a, A] += _TINY * 1j
                stress[a, A] = valid * whole(moved, constants, fibre).imag / _TINY
                moved[a, A] = F[a, A]
        return valid * whole(moved, constants, fibre).real, 0.0

    return point


def _tangent(whole: Any) -> Any:
    """Return a law's function of a block's moduli (`isorod.material.points.TANGENT`)."""

    @numba.njit
    def second(moved: Any, i: int, j: int, constants: Array, fibre: Array) -> float:
        a, A, b, B = i // 3, i % 3, j // 3, j % 3
        at, other = moved[a, A], moved[b, B]
        moved[a, A] += _TINY * 1j
        moved[b, B] += _STEP
        found = whole(moved, constants, fibre).imag
        moved[b, B] -= 2.0 * _STEP
        found -= whole(moved, constants, fibre).imag
        moved[b, B] = other
        moved[a, A] = at
        return found / (2.0 * _STEP * _TINY)

    @numba.njit(TANGENT, **FAST)
    def tangent(work: Array, constants: Array, activation: float) -> None:
        moved, fibre = np.empty((3, 3), np.complex128), np.empty(6)
        for k in range(POINTS):
            for i in range(9):
                moved[i // 3, i % 3] = work[ROWS[GRADIENT] + np.uint64(POINTS * i + k)]
            for i in range(6):
                fibre[i] = work[ROWS[FIBRE] + np.uint64(POINTS * i + k)]
            valid = 1.0 if work[ROWS[DETERMINANT] + np.uint64(k)] > 0.0 else np.nan
            for a in range(3):
                row = SQUARES + 6 * a
                for A in range(3):
                    for B in range(A, 3):
                        value = second(moved, 3 * a + A, 3 * a + B, constants, fibre)
                        work[ROWS[0] + np.uint64(POINTS * row + k)] += valid * value
                        row += 1
                for b in range(a + 1, 3):
                    row_of_pair = MODULI + 9 * (a + b - 1)
                    for A in range(3):
                        for B in range(3):
                            value = second(moved, 3 * a + A, 3 * b + B, constants, fibre)
                            work[ROWS[0] + np.uint64(POINTS * (row_of_pair + 3 * A + B) + k)] += valid * value

    return tangent
