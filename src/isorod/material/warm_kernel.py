"""Laws with memory of solids that expand, compiled: those of ``F / g``, ``g`` the free stretch, called by address.

The energy is ``g^3 W``, so that the stress is ``g^2 P`` and moduli ``g A`` of the law's own, and of what it loses in a
step there is ``g^3``.  Its state is that of ``F / g``.

Constants: addresses of the law's functions of a block, of moduli and of the next state; number of values of its state,
and 1 where the last is what was dissipated; coefficient of expansion; temperature, or its share where 1 follows and
points have one each, behind the state; then the law's own.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.points import (
    BLOCK,
    DETERMINANT,
    ENERGY,
    FIBRE,
    GRADIENT,
    LOST,
    MODULI,
    MODULI_WORK,
    POINTS,
    ROWS,
    STRESS,
    TANGENT,
    call_block,
    call_tangent,
)

_BLOCK, _TANGENT, _UPDATE, _WIDTH, _LOSES, _EXPANSION, _HEAT, _FIELD, OWN = range(9)

_W = np.uint64(POINTS)


@njit(**FAST)
def _free(work: Array, constants: Array, kept: Array, g: Array) -> int:
    """Take the free stretch off a block's deformation gradients, which are kept; return where its loss stands."""
    width = int(constants[_WIDTH])
    for k in range(_W):
        own = work[np.uint64(POINTS * (FIBRE + width)) + k] if constants[_FIELD] > 0.0 else 1.0
        g[k] = 1.0 + constants[_EXPANSION] * constants[_HEAT] * own
    kept[:] = work[POINTS * GRADIENT : POINTS * (DETERMINANT + 1)]
    for a in range(9):
        for k in range(_W):
            work[ROWS[GRADIENT + a] + k] /= g[k]
    for k in range(_W):
        work[ROWS[DETERMINANT] + k] /= g[k] ** 3
    return POINTS * (FIBRE + width - 1)


@njit(**FAST)
def _loaded(work: Array, kept: Array, g: Array) -> None:
    """Put a block's deformation gradients back, and make the law's stress that of the whole."""
    work[POINTS * GRADIENT : POINTS * (DETERMINANT + 1)] = kept
    for a in range(9):
        for k in range(_W):
            work[ROWS[STRESS + a] + k] *= g[k] * g[k]


@njit(**FAST)
def _ask(address: Any, work: Array, constants: Array, activation: float, wanted: bool, row: int) -> None:
    """Call a function of the law; of a step's loss, which is added to that before in a row, there is ``g^3``."""
    kept, g = np.empty(10 * POINTS), np.empty(POINTS)
    place = _free(work, constants, kept, g)
    before = work[place : place + POINTS].copy()
    call_block(np.uint64(address), (work, constants[OWN:], activation, wanted))
    _loaded(work, kept, g)
    row = place if row < 0 else row
    for k in range(POINTS):
        if wanted:
            work[ROWS[ENERGY] + np.uint64(k)] *= g[k] ** 3
        if constants[_LOSES] > 0.0:
            work[row + k] = before[k] + g[k] ** 3 * (work[row + k] - before[k])


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy."""
    if not wanted:
        # There is no loss to be told.
        work[POINTS * LOST : POINTS * (LOST + 1)] = 0.0
    _ask(constants[_BLOCK], work, constants, activation, wanted, POINTS * LOST)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    _ask(constants[_UPDATE], work, constants, activation, wanted, -1)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli."""
    kept, g = np.empty(10 * POINTS), np.empty(POINTS)
    before = work[POINTS * MODULI : POINTS * MODULI_WORK].copy()
    stress = work[POINTS * STRESS : POINTS * (STRESS + 9)].copy()
    work[POINTS * MODULI : POINTS * MODULI_WORK] = 0.0
    _free(work, constants, kept, g)
    call_tangent(np.uint64(constants[_TANGENT]), (work, constants[OWN:], activation))
    _loaded(work, kept, g)
    work[POINTS * STRESS : POINTS * (STRESS + 9)] = stress
    for row in range(MODULI, MODULI_WORK):
        for k in range(POINTS):
            work[POINTS * row + k] = before[POINTS * (row - MODULI) + k] + g[k] * work[POINTS * row + k]
