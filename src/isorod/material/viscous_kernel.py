"""Norton's creep by logarithmic strain, compiled: all of the shear stress relaxes.

Von Mises' stress falls as ``q' = -c q^n`` while nothing moves.  A step relaxes for half of its time, is strained, and
relaxes for the other half, each exactly: an error of second order in the time, and none where nothing moves.

Constants: shear modulus, time of the step, ``c``, ``n``, Lame's first parameter.  State: the strain at the start of the
step, the viscous strain, and what was dissipated: what both halves of the time take, at their strains.
"""

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.logarithm_kernel import (
    FIRST,
    SECOND,
    TWICE,
    add_moduli,
    principal_strains,
    put_stress,
    take_frame,
    take_strains,
    turn,
)
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, LOST, POINTS, ROWS, TANGENT

_W = np.uint64(POINTS)

# Where the row of what was dissipated begins.
_DISSIPATED = ROWS[FIBRE + 12]


@njit(**FAST)
def _left(q: float, c: float, n: float, time: float) -> float:
    """Return what share of a stress relaxation leaves."""
    if n == 1.0:
        return np.exp(-c * time)
    return (1.0 + (n - 1.0) * c * time * q ** (n - 1.0)) ** (-1.0 / (n - 1.0))


@njit(**FAST)
def _relax(work: Array, constants: Array, before: Array, change: Array, elastic: Array, lost: Array) -> None:
    """Fill in the elastic strain at the end of the step, and what is dissipated in it, ``(POINTS,)``.

    Parameters
    ----------
    before, change
        Deviators of the strain at the start, and what the step adds, ``(6, POINTS)``.
    """
    for m in range(6):
        row = np.uint64(POINTS * (FIBRE + 6 + m))
        for k in range(_W):
            elastic[m, k] = before[m, k] - work[row + k]
    half, c, n = 0.5 * constants[1], constants[2], constants[3]
    stress = 2.0 * constants[0] * np.sqrt(1.5)
    for k in range(_W):
        size = 0.0
        for m in range(6):
            size += TWICE[m] * elastic[m, k] ** 2
        kept = _left(stress * np.sqrt(size), c, n, half)
        lost[k] = (1.0 - kept * kept) * size
        size = 0.0
        for m in range(6):
            elastic[m, k] = kept * elastic[m, k] + change[m, k]
            size += TWICE[m] * elastic[m, k] ** 2
        kept = _left(stress * np.sqrt(size), c, n, half)
        for m in range(6):
            elastic[m, k] *= kept
        lost[k] = constants[0] * (lost[k] + (1.0 - kept * kept) * size)


@njit(**FAST)
def _growth(constants: Array, size: float) -> tuple[float, float]:
    """Return by how much the elastic strain, of norm ``size``, grows with the strain, across it and along it."""
    half, c, n = 0.5 * constants[1], constants[2], constants[3]
    if n == 1.0:
        kept = np.exp(-c * half)
    else:
        # Of what is left at the end: what it was before relaxing.
        q = 2.0 * constants[0] * np.sqrt(1.5) * size
        kept = (1.0 - (n - 1.0) * c * half * q ** (n - 1.0)) ** (1.0 / (n - 1.0))
    return kept, kept**n


@njit(**FAST)
def _deviators(work: Array, strain: Array, trace: Array, before: Array, change: Array) -> None:
    """Make the strain at the end a deviator; fill in that at the start, and the change, ``(6, POINTS)``."""
    past = np.empty(POINTS)
    for k in range(_W):
        past[k] = work[ROWS[FIBRE] + k] + work[ROWS[FIBRE + 3] + k] + work[ROWS[FIBRE + 5] + k]
    for m in range(6):
        row, third = np.uint64(POINTS * (FIBRE + m)), 1.0 / 3.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            strain[m, k] -= third * trace[k]
        for k in range(_W):
            before[m, k] = work[row + k] - third * past[k]
        for k in range(_W):
            change[m, k] = strain[m, k] - before[m, k]


@njit(**FAST)
def _stress(constants: Array, elastic: Array, trace: Array, stress: Array) -> None:
    """Fill in the stress ``(6, POINTS)``."""
    mu, lame = constants[0], constants[constants.size - 1]
    for m in range(6):
        bulk = lame + 2.0 / 3.0 * mu if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            stress[m, k] = 2.0 * mu * elastic[m, k] + bulk * trace[k]


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy, that of the elastic strain."""
    spectral, principal, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    stress, strain, before = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    change, elastic, lost = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS)
    mu, lame = constants[0], constants[constants.size - 1]
    take_strains(spectral, principal, strain, trace)
    _deviators(work, strain, trace, before, change)
    _relax(work, constants, before, change, elastic, lost)
    _stress(constants, elastic, trace, stress)
    if wanted:
        for k in range(_W):
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = 0.5 * (lame + 2.0 / 3.0 * mu) * trace[k] * trace[k], 0.0
            work[ROWS[LOST] + k] = work[_DISSIPATED + k] + lost[k]
        for m in range(6):
            for k in range(_W):
                work[ROWS[ENERGY] + k] += mu * TWICE[m] * elastic[m, k] * elastic[m, k]
    put_stress(work, spectral, principal, stress)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral, principal, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    total, strain, before = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    change, elastic, lost = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS)
    turned, along = np.empty((6, POINTS)), np.empty((6, POINTS))
    c, frame, stress, moduli = np.empty(3), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    mu, lame = constants[0], constants[constants.size - 1]
    bulk = lame + 2.0 / 3.0 * mu
    take_strains(spectral, principal, strain, trace)
    _deviators(work, strain, trace, before, change)
    _relax(work, constants, before, change, elastic, lost)
    _stress(constants, elastic, trace, total)
    turn(total, spectral, turned)
    turn(elastic, spectral, along)
    for k in range(_W):
        take_frame(spectral, k, c, frame)
        size = 0.0
        for m in range(6):
            stress[m] = turned[m, k]
            size += TWICE[m] * along[m, k] ** 2
        across, forth = _growth(constants, np.sqrt(size))
        bent = 2.0 * mu * (forth - across) / size if size > 0.0 else 0.0
        for m in range(6):
            for n in range(6):
                own = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * across * (own - both / 3.0) + bulk * both + bent * along[m, k] * along[n, k]
        add_moduli(work, k, c, frame, stress, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    spectral, principal, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    stress, strain, before = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    change, elastic, lost = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS)
    take_strains(spectral, principal, strain, trace)
    _deviators(work, strain, trace, before, change)
    _relax(work, constants, before, change, elastic, lost)
    _stress(constants, elastic, trace, stress)
    for k in range(_W):
        work[_DISSIPATED + k] += lost[k]
    put_stress(work, spectral, principal, stress)
    for m in range(6):
        row, third = np.uint64(POINTS * (FIBRE + m)), 1.0 / 3.0 if FIRST[m] == SECOND[m] else 0.0
        viscous = np.uint64(POINTS * (FIBRE + 6 + m))
        for k in range(_W):
            work[row + k] = strain[m, k] + third * trace[k]
        for k in range(_W):
            work[viscous + k] = strain[m, k] - elastic[m, k]
