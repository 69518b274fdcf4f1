"""Laws with memory and thermal expansion, compiled: the law is called by address with ``F / g``, ``g`` free stretch.

The energy is ``g^3 W``, so that the stress is ``g^2 P``, moduli are ``g A``, and the dissipation of a step is ``g^3``
times the law's.  Its state is that of ``F / g``.

Constants: addresses of the law's functions of a block, of moduli and of the next state; number of values of its state;
1 if the last is the dissipated energy; coefficient of expansion; temperature, or its fraction if 1 follows and each
point has one, behind the state; then the law's own.
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
    """Divide a block's deformation gradients by the free stretch and keep them; return the offset of its loss."""
    width = int(constants[_WIDTH])
    for k in range(_W):
        factor = work[np.uint64(POINTS * (FIBRE + width)) + k] if constants[_FIELD] > 0.0 else 1.0
        g[k] = 1.0 + constants[_EXPANSION] * constants[_HEAT] * factor
    kept[:] = work[POINTS * GRADIENT : POINTS * (DETERMINANT + 1)]
    for a in range(9):
        for k in range(_W):
            work[ROWS[GRADIENT + a] + k] /= g[k]
    for k in range(_W):
        work[ROWS[DETERMINANT] + k] /= g[k] ** 3
    return POINTS * (FIBRE + width - 1)


@njit(**FAST)
def _loaded(work: Array, kept: Array, g: Array) -> None:
    """Restore a block's deformation gradients, and scale the law's stress."""
    work[POINTS * GRADIENT : POINTS * (DETERMINANT + 1)] = kept
    for a in range(9):
        for k in range(_W):
            work[ROWS[STRESS + a] + k] *= g[k] * g[k]


@njit(**FAST)
def _ask(address: Any, work: Array, constants: Array, activation: float, with_energy: bool, row: int) -> None:
    """Call a function of the law; scale by ``g^3`` the energy, and the increment of the loss in a row."""
    kept, g = np.empty(10 * POINTS), np.empty(POINTS)
    place = _free(work, constants, kept, g)
    before = work[place : place + POINTS].copy()
    call_block(np.uint64(address), (work, constants[OWN:], activation, with_energy))
    _loaded(work, kept, g)
    row = place if row < 0 else row
    for k in range(POINTS):
        if with_energy:
            work[ROWS[ENERGY] + np.uint64(k)] *= g[k] ** 3
        if constants[_LOSES] > 0.0:
            work[row + k] = before[k] + g[k] ** 3 * (work[row + k] - before[k])


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and on demand the energy."""
    if not with_energy:
        # The law does not fill in its loss.
        work[POINTS * LOST : POINTS * (LOST + 1)] = 0.0
    _ask(constants[_BLOCK], work, constants, activation, with_energy, POINTS * LOST)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    _ask(constants[_UPDATE], work, constants, activation, with_energy, -1)


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
