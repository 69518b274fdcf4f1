"""A law's compiled functions: their arguments, calls from compiled loops, and the loops over points.

A law has two compiled functions, of the stress and the energy at a block of points (``BLOCK``) and of the moduli there
(``TANGENT``).  Loops call them by their addresses, which plain arrays can hold: so loops do not depend on laws and stay
in Numba's cache on disk.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from llvmlite import ir
from numba import b1, f8, i8, types, u8, void
from numba.core import cgutils
from numba.extending import intrinsic

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F5, FAST, cofactors, njit
from isorod.compiling import Kernel

# Points in a block: half of those in a section of order 2 with 8 control points.  Measured: blocks of 16 or less are
# unrolled before they are vectorised, and three times slower, those of 24 in part.
POINTS = 32

# Rows of the work space of a block, ``POINTS`` numbers each: the stress P (9) that a law writes, F (9) and det F, the
# law's values at the point (``STATES`` at most: the fibres, 3 each of two families, then a temperature; or the state of
# a law with memory), the energy density and its derivative by the activation, which a law writes on demand, and rows
# for its own use, in the first of which a law with memory writes the energy dissipated since rest.
STATES = 48
STRESS, GRADIENT, DETERMINANT, FIBRE = 0, 9, 18, 19
ENERGY, ACTIVE, FREE = FIBRE + STATES, FIBRE + STATES + 1, FIBRE + STATES + 2
LOST = FREE
OWN = FREE + 1
WORK = OWN + 108

# Further rows for moduli: ``dP_aA/dF_bB`` of the pairs of components ``ab`` 01, 02, 12, each with all nine ``AB``, then
# of 00, 11, 22, each with the ``AB`` 00, 01, 02, 11, 12, 22.  The others follow by symmetry.
MODULI = WORK
SQUARES = MODULI + 27
MODULI_WORK = SQUARES + 18

# Offset of each row.  Unsigned, as all indices into the work space: only then does the compiler see that rows do not
# overlap.
ROWS = tuple(np.uint64(POINTS * k) for k in range(2 * MODULI_WORK))

BLOCK = void(F1, F1, f8, b1)
"""``(work, constants, activation, with_energy)``: fills the rows of the first Piola-Kirchhoff stress, NaN where ``F``
is inverted, and if ``with_energy`` those of the energy per reference volume without activation and of the energy added
by full activation.  ``activation`` is a fraction of the law's own; energy and stress are linear in it."""

TANGENT = void(F1, F1, f8)
"""``(work, constants, activation)``: adds to the rows of the moduli of a block whose stress the law's ``BLOCK``
function has filled in before."""

STEP = void(F1)
"""``(work,)``: any other operation at the points of a block (`isorod.assembly.block_kernel`)."""


class Compiled:
    """A law's functions, made by `numba.njit`: compiled, or read from Numba's cache, on first use.

    Parameters
    ----------
    block, tangent
        Functions with the signatures ``BLOCK`` and ``TANGENT``.
    update
        For a law with memory a function with the signature ``BLOCK`` that fills the rows of the stress, and those of
        the state with the state at the end of a step.
    """

    def __init__(self, block: Any, tangent: Any, update: Any = None) -> None:
        # Referenced, since code is freed with its dispatcher.
        self._block, self._tangent, self._update = block, tangent, update

    @cached_property
    def block(self) -> int:
        """Address of the function of a block."""
        return address(self._block, BLOCK)

    @cached_property
    def tangent(self) -> int:
        """Address of the function of a block's moduli."""
        return address(self._tangent, TANGENT)

    @cached_property
    def update(self) -> int:
        """Address of the function that updates the state."""
        return address(self._update, BLOCK)


def address(function: Kernel, signature: Any) -> int:
    """Return the address of compiled code that other compiled code may call (`call_step`)."""
    dispatcher = function.compiled
    if tuple(signature.args) not in dispatcher.overloads:
        dispatcher.compile(signature)
    result = dispatcher.get_compile_result(signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name))


def caller(signature: Any) -> Callable[..., Any]:
    """Return an intrinsic ``(address, arguments)`` by which compiled code calls a function of this signature."""

    def build(context: Any, builder: Any, _: Any, values: Any) -> Any:
        kinds = [context.get_value_type(kind) for kind in signature.args]
        kind = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
        function = builder.inttoptr(values[0], kind.as_pointer())
        return builder.call(function, cgutils.unpack_tuple(builder, values[1]))

    @intrinsic  # type: ignore[misc]
    def call(typing: Any, address: Any, arguments: Any) -> Any:
        return signature.return_type(u8, types.Tuple(signature.args)), build

    return call  # type: ignore[no-any-return]


call_block, call_tangent, call_step = (caller(kind) for kind in (BLOCK, TANGENT, STEP))


@njit(void(F3, F2, i8, F2, F1), **FAST)
def _take(F: Array, fibres: Array, begin: int, scratch: Array, work: Array) -> None:
    """Fill the rows of a block with the values of points from ``begin`` on; the last point fills it up."""
    for k in range(np.uint64(POINTS)):
        m: Any = min(begin + np.int64(k), F.shape[0] - 1)
        for a in range(3):
            for A in range(3):
                work[ROWS[GRADIENT] + np.uint64(POINTS * (3 * a + A)) + k] = F[m, a, A]
        for a in range(fibres.shape[1]):
            work[ROWS[FIBRE] + np.uint64(POINTS * a) + k] = fibres[m, a]
        work[ROWS[DETERMINANT] + k] = cofactors(F[m], scratch)


@njit(void(u8, F3, F1, F2, F2, F3), **FAST)
def at_points(block: int, F: Array, constants: Array, fibres: Array, energy: Array, stress: Array) -> None:
    """Fill in energies ``(points, 2)`` and stresses ``(points, 3, 3)`` at full activation.

    Parameters
    ----------
    block
        Address of the law's function.
    F, fibres
        Deformation gradients ``(points, 3, 3)`` and the law's values at the points ``(points, width)``.
    constants
        The law's, any shape ``(c,)``.
    """
    work, scratch = np.zeros(WORK * POINTS), np.empty((3, 3))
    count = F.shape[0]
    for begin in range(0, count, POINTS):
        _take(F, fibres, begin, scratch, work)
        call_block(block, (work, constants, 1.0, True))
        for k in range(np.uint64(min(POINTS, count - begin))):
            m = begin + np.int64(k)
            energy[m, 0], energy[m, 1] = work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k]
            for a in range(3):
                for A in range(3):
                    stress[m, a, A] = work[np.uint64(POINTS * (3 * a + A)) + k]


@njit(void(u8, F3, F1, F2), **FAST)
def next_states(update: int, F: Array, constants: Array, states: Array) -> None:
    """Replace states ``(points, m)`` at the start of a step, which ends at ``F``, by those at its end.

    Parameters
    ----------
    update
        Address of the law's function.
    F, constants
        As those of `at_points`.
    """
    work, scratch = np.zeros(WORK * POINTS), np.empty((3, 3))
    count = F.shape[0]
    for begin in range(0, count, POINTS):
        _take(F, states, begin, scratch, work)
        call_block(update, (work, constants, 1.0, False))
        for k in range(np.uint64(min(POINTS, count - begin))):
            m = begin + np.int64(k)
            for a in range(states.shape[1]):
                states[m, a] = work[ROWS[FIBRE] + np.uint64(POINTS * a) + k]


@njit(void(u8, u8, F3, F1, F2, F5), **FAST)
def moduli_at_points(block: int, tangent: int, F: Array, constants: Array, fibres: Array, moduli: Array) -> None:
    """Fill in the moduli ``(points, 3, 3, 3, 3)`` at full activation.

    Parameters
    ----------
    block, tangent
        Addresses of the law's functions.
    F, constants, fibres
        As those of `at_points`.
    """
    work, scratch = np.zeros(MODULI_WORK * POINTS), np.empty((3, 3))
    count = F.shape[0]
    for begin in range(0, count, POINTS):
        _take(F, fibres, begin, scratch, work)
        work[POINTS * MODULI :] = 0.0
        call_block(block, (work, constants, 1.0, False))
        call_tangent(tangent, (work, constants, 1.0))
        for k in range(np.uint64(min(POINTS, count - begin))):
            m = begin + np.int64(k)
            for a in range(3):
                for b in range(3):
                    for A in range(3):
                        for B in range(3):
                            moduli[m, a, A, b, B] = work[modulus_row(a, A, b, B) + k]


@njit(u8(i8, i8, i8, i8), **FAST)
def modulus_row(a: int, A: int, b: int, B: int) -> Any:
    """Return the offset of the row of the modulus ``dP_aA/dF_bB``."""
    if a == b:
        low, high = min(A, B), max(A, B)
        return np.uint64(POINTS * (SQUARES + 6 * a + (high if low == 0 else low + high + 1)))
    if a > b:
        a, A, b, B = b, B, a, A
    return np.uint64(POINTS * (MODULI + 9 * (a + b - 1) + 3 * A + B))


@njit(**FAST)
def add_pair(work: Array, k: int, row: int, x: float, y: float, p: tuple[float, ...], q: tuple[float, ...]) -> None:
    """Add ``x p_A q_B + y p_B q_A`` to the nine rows of moduli that begin at a row's place, at one point."""
    work[row + k] += (x + y) * (p[0] * q[0])
    work[row + ROWS[1] + k] += x * (p[0] * q[1]) + y * (p[1] * q[0])
    work[row + ROWS[2] + k] += x * (p[0] * q[2]) + y * (p[2] * q[0])
    work[row + ROWS[3] + k] += x * (p[1] * q[0]) + y * (p[0] * q[1])
    work[row + ROWS[4] + k] += (x + y) * (p[1] * q[1])
    work[row + ROWS[5] + k] += x * (p[1] * q[2]) + y * (p[2] * q[1])
    work[row + ROWS[6] + k] += x * (p[2] * q[0]) + y * (p[0] * q[2])
    work[row + ROWS[7] + k] += x * (p[2] * q[1]) + y * (p[1] * q[2])
    work[row + ROWS[8] + k] += (x + y) * (p[2] * q[2])


@njit(**FAST)
def add_square(work: Array, k: int, row: int, x: float, p: tuple[float, ...]) -> None:
    """Add ``x p_A p_B`` to the six rows of moduli that begin at a row's place, at one point."""
    p0, p1, p2 = x * p[0], x * p[1], x * p[2]
    work[row + k] += p0 * p[0]
    work[row + ROWS[1] + k] += p0 * p[1]
    work[row + ROWS[2] + k] += p0 * p[2]
    work[row + ROWS[3] + k] += p1 * p[1]
    work[row + ROWS[4] + k] += p1 * p[2]
    work[row + ROWS[5] + k] += p2 * p[2]


@njit(**FAST)
def add_products(
    work: Array, k: int, x: float, y: float, p: tuple[float, ...], q: tuple[float, ...], r: tuple[float, ...]
) -> None:
    """Add ``x G_aA G_bB + y G_aB G_bA``, ``G`` of rows ``p, q, r``, to the moduli at one point."""
    add_pair(work, k, ROWS[MODULI], x, y, p, q)
    add_pair(work, k, ROWS[MODULI + 9], x, y, p, r)
    add_pair(work, k, ROWS[MODULI + 18], x, y, q, r)
    add_square(work, k, ROWS[SQUARES], x + y, p)
    add_square(work, k, ROWS[SQUARES + 6], x + y, q)
    add_square(work, k, ROWS[SQUARES + 12], x + y, r)


@njit(**FAST)
def add_identity(work: Array, k: int, row: int, x: float) -> None:
    """Add ``x d_AB`` to the six rows of moduli that begin at a row's place, at one point."""
    work[row + k] += x
    work[row + ROWS[3] + k] += x
    work[row + ROWS[5] + k] += x
