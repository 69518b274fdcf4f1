"""Norton's creep by logarithmic strain, compiled: all of the shear stress relaxes.

Von Mises' stress falls as ``q' = -c q^n`` while nothing moves.  A step relaxes for half of its time, is strained, and
relaxes for the other half, each exactly: an error of second order in the time, and none where nothing moves.

Constants: shear modulus, time of the step, ``c``, ``n``, Lame's first parameter.  State: the strain at the start of the
step, the viscous strain, and what was dissipated: what both halves of the time take, at their strains.
"""

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import exp, power
from isorod.material.logarithm_kernel import (
    FIRST,
    LOGARITHM,
    SECOND,
    STRAIN,
    TENSION,
    TRACE,
    TWICE,
    add_moduli,
    at,
    put_stress,
    strains,
)
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, LOST, POINTS, ROWS, TANGENT

_W = np.uint64(POINTS)

# Where the row of what was dissipated begins.
_DISSIPATED = ROWS[FIBRE + 12]

# Rows of a block: the elastic strain at the end of the step, its norm, what is left of it in half a step, and what the
# step dissipates; the trace of the strain at its start.
_ELASTIC, _SIZE, _KEPT, _LOSS, _PAST, _ROWS = LOGARITHM, *(LOGARITHM + 6 + m for m in range(5))


@njit(**FAST)
def _relax(constants: Array, rows: Array) -> None:
    """Let the elastic strain relax for half of the time, and add up what is lost."""
    c, n, half, stress = constants[2], constants[3], 0.5 * constants[1], 2.0 * constants[0] * np.sqrt(1.5)
    for k in range(_W):
        rows[at(_SIZE) + k] = 0.0
    for m in range(6):
        for k in range(_W):
            rows[at(_SIZE) + k] += TWICE[m] * rows[at(_ELASTIC + m) + k] * rows[at(_ELASTIC + m) + k]
    for k in range(_W):
        size = rows[at(_SIZE) + k]
        if n == 1.0:
            kept = exp(-c * half)
        else:
            # Where there is no strain: of the smallest number.
            fast = power(max(stress * np.sqrt(size), 1e-300), n - 1.0)
            kept = power(1.0 + (n - 1.0) * c * half * fast, -1.0 / (n - 1.0))
        rows[at(_KEPT) + k] = kept
        rows[at(_LOSS) + k] += constants[0] * (1.0 - kept * kept) * size
        rows[at(_SIZE) + k] = kept * np.sqrt(size)
    for m in range(6):
        for k in range(_W):
            rows[at(_ELASTIC + m) + k] *= rows[at(_KEPT) + k]


@njit(**FAST)
def _respond(work: Array, constants: Array, rows: Array) -> int:
    """Fill in the stress at the end of the step, and what comes with it; return the rule of Gauss points."""
    mu, lame = constants[0], constants[constants.size - 1]
    rule = strains(work, rows)
    for k in range(_W):
        rows[at(_PAST) + k] = work[ROWS[FIBRE] + k] + work[ROWS[FIBRE + 3] + k] + work[ROWS[FIBRE + 5] + k]
        rows[at(_LOSS) + k] = 0.0
    for m in range(6):
        row, third = np.uint64(POINTS * (FIBRE + m)), 1.0 / 3.0 if FIRST[m] == SECOND[m] else 0.0
        viscous = np.uint64(POINTS * (FIBRE + 6 + m))
        for k in range(_W):
            rows[at(_ELASTIC + m) + k] = work[row + k] - third * rows[at(_PAST) + k] - work[viscous + k]
    _relax(constants, rows)
    for m in range(6):
        row, third = np.uint64(POINTS * (FIBRE + m)), 1.0 / 3.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            change = rows[at(STRAIN + m) + k] - work[row + k]
            rows[at(_ELASTIC + m) + k] += change - third * (rows[at(TRACE) + k] - rows[at(_PAST) + k])
    _relax(constants, rows)
    for m in range(6):
        bulk = lame + 2.0 / 3.0 * mu if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            rows[at(TENSION + m) + k] = 2.0 * mu * rows[at(_ELASTIC + m) + k] + bulk * rows[at(TRACE) + k]
    return rule


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy, that of the elastic strain."""
    rows = np.empty(_ROWS * POINTS)
    bulk = constants[constants.size - 1] + 2.0 / 3.0 * constants[0]
    _respond(work, constants, rows)
    put_stress(work, rows)
    if wanted:
        for k in range(_W):
            stored = constants[0] * rows[at(_SIZE) + k] ** 2 + 0.5 * bulk * rows[at(TRACE) + k] ** 2
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = stored, 0.0
            work[ROWS[LOST] + k] = work[_DISSIPATED + k] + rows[at(_LOSS) + k]


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    rows, moduli = np.empty(_ROWS * POINTS), np.empty(36 * POINTS)
    mu, lame, c, n = constants[0], constants[constants.size - 1], constants[2], constants[3]
    bulk, half = lame + 2.0 / 3.0 * mu, 0.5 * constants[1]
    rule = _respond(work, constants, rows)
    for k in range(_W):
        # What the second half leaves of a change across the strain, and of one along it, told by what is left.
        size = rows[at(_SIZE) + k]
        if n == 1.0:
            across, forth = rows[at(_KEPT) + k], rows[at(_KEPT) + k]
        else:
            q = max(2.0 * mu * np.sqrt(1.5) * size, 1e-300)
            across = power(1.0 - (n - 1.0) * c * half * power(q, n - 1.0), 1.0 / (n - 1.0))
            forth = power(across, n)
        rows[at(_KEPT) + k] = across
        rows[at(_LOSS) + k] = 2.0 * mu * (forth - across) / (size * size) if size > 0.0 else 0.0
    for m in range(6):
        for p in range(6):
            own = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == p else 0.0
            both = 1.0 if FIRST[m] == SECOND[m] and FIRST[p] == SECOND[p] else 0.0
            for k in range(_W):
                moduli[at(6 * m + p) + k] = (
                    2.0 * mu * rows[at(_KEPT) + k] * (own - both / 3.0)
                    + bulk * both
                    + rows[at(_LOSS) + k] * rows[at(_ELASTIC + m) + k] * rows[at(_ELASTIC + p) + k]
                )
    add_moduli(work, rows, rule, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    rows = np.empty(_ROWS * POINTS)
    _respond(work, constants, rows)
    put_stress(work, rows)
    for k in range(_W):
        work[_DISSIPATED + k] += rows[at(_LOSS) + k]
    for m in range(6):
        row, third = np.uint64(POINTS * (FIBRE + m)), 1.0 / 3.0 if FIRST[m] == SECOND[m] else 0.0
        viscous = np.uint64(POINTS * (FIBRE + 6 + m))
        for k in range(_W):
            work[row + k] = rows[at(STRAIN + m) + k]
        for k in range(_W):
            work[viscous + k] = rows[at(STRAIN + m) + k] - third * rows[at(TRACE) + k] - rows[at(_ELASTIC + m) + k]
