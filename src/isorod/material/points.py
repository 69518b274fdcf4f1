"""A law's compiled functions: what they are given, how compiled loops call them, and the loops over points.

A law has one compiled function of a point (``POINT``), and may have one of a block of points (``BLOCK``), which does
the same faster.  Loops that know no law find them by their addresses, which plain arrays can hold: such loops stay in
Numba's cache on disk, whatever laws there are.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from llvmlite import ir
from numba import b1, f8, types, u8, void
from numba.core import cgutils
from numba.extending import intrinsic

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, FAST, STRICT, njit

# Points in a block: half of those in a section of order 2 with 8 control points.  Measured: blocks of 16 or less are
# unrolled before they are vectorised, and three times slower, those of 24 in part.
POINTS = 32

# Rows of the work space of a block, ``POINTS`` numbers each: the stress P (9) that a law writes, F (9) and det F, the
# fibre (3), the energy density and its derivative by the activation that a law writes if asked for, and what it may
# use.
STRESS, GRADIENT, DETERMINANT, FIBRE, ENERGY, ACTIVE, FREE = 0, 9, 18, 19, 22, 23, 24
WORK = FREE + 6

# Where each row begins.  Unsigned, as all indices into the work space: only then does the compiler see that rows do not
# overlap.
ROWS = tuple(np.uint64(POINTS * k) for k in range(WORK))

POINT = types.UniTuple(f8, 2)(F2, F1, F1, f8, F2)
"""``(F, constants, fibre, activation, stress)``: fills ``stress``, the first Piola-Kirchhoff one, shape ``(3, 3)`` as
``F``, with NaN where ``F`` cannot be, and returns the energy per reference volume without activation and what full
activation adds.  ``activation`` is the share of the law's own, and energy and stress are linear in it."""

BLOCK = void(F1, F1, f8, b1)
"""``(work, constants, activation, wanted)``: fills the rows of the stress, and of the energies if ``wanted``."""


class Compiled:
    """A law's functions, made by `numba.njit`: compiled, or read from Numba's cache, when they are first asked for.

    Parameters
    ----------
    point, block
        Functions that take what ``POINT`` and ``BLOCK`` say; the second may be left out.
    """

    def __init__(self, point: Any, block: Any = None) -> None:
        # The code lives as long as what holds it.
        self._point, self._block = point, block

    @cached_property
    def point(self) -> int:
        """Address of the function of a point."""
        return _address(self._point, POINT)

    @cached_property
    def block(self) -> int:
        """Address of the function of a block, zero where there is none."""
        return 0 if self._block is None else _address(self._block, BLOCK)


def _address(function: Any, signature: Any) -> int:
    if tuple(signature.args) not in function.overloads:
        function.compile(signature)
    result = function.get_compile_result(signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name))


def _caller(signature: Any) -> Callable[..., Any]:
    """Return what compiled code calls a function of this signature with: ``(address, arguments)``."""

    def build(context: Any, builder: Any, _: Any, values: Any) -> Any:
        kinds = [context.get_value_type(kind) for kind in signature.args]
        kind = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
        function = builder.inttoptr(values[0], kind.as_pointer())
        return builder.call(function, cgutils.unpack_tuple(builder, values[1]))

    @intrinsic  # type: ignore[misc]
    def call(typing: Any, address: Any, arguments: Any) -> Any:
        return signature.return_type(u8, types.Tuple(signature.args)), build

    return call  # type: ignore[no-any-return]


call_point, call_block = _caller(POINT), _caller(BLOCK)


@njit(void(u8, F3, F1, F2, F2, F3), **STRICT)
def at_points(point: int, F: Array, constants: Array, fibres: Array, energy: Array, stress: Array) -> None:
    """Fill in energies ``(points, 2)`` and stresses ``(points, 3, 3)`` at full activation.

    Parameters
    ----------
    point
        Address of the law's function.
    F, fibres
        Deformation gradients ``(points, 3, 3)`` and unit vectors ``(points, 3)``.
    constants
        The law's, any shape ``(c,)``.
    """
    for m in range(F.shape[0]):
        energy[m, 0], energy[m, 1] = call_point(point, (F[m], constants, fibres[m], 1.0, stress[m]))


@njit(void(u8, F1, F1, f8, F2, F2, F1), **FAST)
def by_points(
    point: int, work: Array, constants: Array, activation: float, F: Array, stress: Array, fibre: Array
) -> None:
    """Fill the rows of stress and energies of a block, point by point: for laws without a ``BLOCK`` function.

    Parameters
    ----------
    point
        Address of the law's ``POINT`` function.
    work
        Rows of the block, ``WORK`` of ``POINTS`` numbers.
    constants, activation
        Of the law, shape ``(c,)``; share of its own activation.
    F, stress, fibre
        Work space, shapes ``(3, 3)``, ``(3, 3)``, ``(3,)``.
    """
    for k in range(np.uint64(POINTS)):
        for a in range(3):
            fibre[a] = work[ROWS[FIBRE] + np.uint64(POINTS * a) + k]
            for A in range(3):
                F[a, A] = work[ROWS[GRADIENT] + np.uint64(POINTS * (3 * a + A)) + k]
        rest, active = call_point(point, (F, constants, fibre, activation, stress))
        work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = rest, active
        for a in range(3):
            for A in range(3):
                work[np.uint64(POINTS * (3 * a + A)) + k] = stress[a, A]
