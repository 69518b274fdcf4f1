"""Laws that flow with time, by logarithmic strain, compiled: elastic beside branches whose stress relaxes.

Von Mises' stress of a branch falls as ``q' = -c q^n`` while it is not strained.  A step relaxes for half of its time,
is strained, and relaxes for the other half, each exactly: an error of second order in the time, and none where nothing
moves.  Where ``n = 1`` the strain grows straight in time, without error.

Constants: shear modulus, time of the step, number of branches, of each its share of that modulus, ``c`` and ``n``,
Lame's first parameter.  State: the strain at the start of the step, the viscous strain of each branch, and what was
dissipated: work and energy on the straight way of the strain.
"""

from typing import Any

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

# Branches at most: their states have no more room.
MOST = 3

_W = np.uint64(POINTS)

# Share of a time of relaxation below which a step is told by a series.
_SHORT = 1e-3


@njit(**FAST)
def _left(q: float, c: float, n: float, time: float) -> float:
    """Return what share of a stress relaxation leaves."""
    if n == 1.0:
        return np.exp(-c * time)
    return (1.0 + (n - 1.0) * c * time * q ** (n - 1.0)) ** (-1.0 / (n - 1.0))


@njit(**FAST)
def _shares(x: float) -> tuple[float, float, float]:
    """Return what a time ``x``, in times of relaxation, leaves, by how much the strain adds, and a share lost."""
    kept, share = np.exp(-x), -np.expm1(-x) / x if x > 1e-8 else 1.0 - 0.5 * x
    # Digits cancel in short steps.
    rest = x / 3.0 - x**2 / 4.0 + 7.0 / 60.0 * x**3 if x < _SHORT else (1.0 - share) / x - 0.5 * share**2
    return kept, share, rest


@njit(**FAST)
def _relax(
    work: Array, constants: Array, which: int, before: Array, change: Array, elastic: Array, lost: Array
) -> None:
    """Let a branch relax: fill in its elastic strain at the end of the step.

    Parameters
    ----------
    before, change
        Deviators of the strain at the start, and what the step adds, ``(6, POINTS)``.
    elastic
        To be filled.
    lost
        What the branch dissipates in the step is added to it, ``(POINTS,)``.
    """
    mu, time = constants[3 + 3 * which] * constants[0], constants[1]
    c, n = constants[4 + 3 * which], constants[5 + 3 * which]
    for m in range(6):
        row = np.uint64(POINTS * (FIBRE + 6 + 6 * which + m))
        for k in range(_W):
            elastic[m, k] = before[m, k] - work[row + k]
    if n != 1.0:
        for k in range(_W):
            lost[k] += _creep(k, 2.0 * mu, c, n, 0.5 * time, change, elastic)
        return
    x = c * time
    kept, share, rest = _shares(x)
    # The work of the mean stress, less what is stored.
    of_start, mixed, of_change = mu * x * (1.0 + kept) * share, 2.0 * mu * share * share * x, 2.0 * mu * rest
    for m in range(6):
        for k in range(_W):
            s, d = elastic[m, k], change[m, k]
            lost[k] += TWICE[m] * (of_start * s * s + mixed * d * s + of_change * d * d)
        for k in range(_W):
            elastic[m, k] = kept * elastic[m, k] + share * change[m, k]


@njit(**FAST)
def _creep(k: Any, stiffness: float, c: float, n: float, half: float, change: Array, elastic: Array) -> float:
    """Let a point of a branch relax for half of a step, be strained, and relax again; return what it dissipates."""
    stress, size = stiffness * np.sqrt(1.5), 0.0
    for m in range(6):
        size += TWICE[m] * elastic[m, k] ** 2
    kept = _left(stress * np.sqrt(size), c, n, half)
    lost = (1.0 - kept * kept) * size
    size = 0.0
    for m in range(6):
        elastic[m, k] = kept * elastic[m, k] + change[m, k]
        size += TWICE[m] * elastic[m, k] ** 2
    kept = _left(stress * np.sqrt(size), c, n, half)
    for m in range(6):
        elastic[m, k] *= kept
    return 0.5 * stiffness * (lost + (1.0 - kept * kept) * size)


@njit(**FAST)
def _growth(constants: Array, which: int, size: float) -> tuple[float, float]:
    """Return by how much the elastic strain of a branch, of norm ``size``, grows with the strain, across and along."""
    mu, time = constants[3 + 3 * which] * constants[0], constants[1]
    c, n = constants[4 + 3 * which], constants[5 + 3 * which]
    if n == 1.0:
        share = _shares(c * time)[1]
        return share, share
    # Of what is left at the end: what it was before relaxing.
    q = 2.0 * mu * np.sqrt(1.5) * size
    kept = (1.0 - (n - 1.0) * c * 0.5 * time * q ** (n - 1.0)) ** (1.0 / (n - 1.0))
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
def _add(factor: float, values: Array, square: float, more: Array, total: Array) -> None:
    """Add a multiple of symmetric tensors ``(6, POINTS)`` to others, and another one of ``more`` on their diagonals."""
    for m in range(6):
        other = square if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            total[m, k] += factor * values[m, k] + other * more[k]


@njit(**FAST)
def _add_energy(factor: float, values: Array, work: Array) -> None:
    """Add a multiple of the squares of symmetric tensors to the row of the energy."""
    for m in range(6):
        for k in range(_W):
            work[ROWS[ENERGY] + k] += factor * TWICE[m] * values[m, k] * values[m, k]


@njit(**FAST)
def _lost(count: int) -> Any:
    """Return where the row of what was dissipated begins."""
    return np.uint64(POINTS * (FIBRE + 6 + 6 * count))


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy, that of the elastic strains."""
    spectral, principal, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    stress, strain, before = np.zeros((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    change, elastic, lost = np.empty((6, POINTS)), np.empty((6, POINTS)), np.zeros(POINTS)
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    take_strains(spectral, principal, strain, trace)
    _deviators(work, strain, trace, before, change)
    rest, bulk = mu, lame + 2.0 / 3.0 * mu
    for i in range(count):
        rest -= constants[3 + 3 * i] * mu
    _add(2.0 * rest, strain, bulk, trace, stress)
    if wanted:
        for k in range(_W):
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = 0.5 * bulk * trace[k] * trace[k], 0.0
        _add_energy(rest, strain, work)
    for i in range(count):
        _relax(work, constants, i, before, change, elastic, lost)
        _add(2.0 * constants[3 + 3 * i] * mu, elastic, 0.0, trace, stress)
        if wanted:
            _add_energy(constants[3 + 3 * i] * mu, elastic, work)
    if wanted:
        for k in range(_W):
            work[ROWS[LOST] + k] = work[_lost(count) + k] + lost[k]
    put_stress(work, spectral, principal, stress)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral, principal, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    total, strain, before = np.zeros((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    change, each, lost = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS)
    turned, elastic = np.empty((6, POINTS)), np.empty((MOST, 6, POINTS))
    c, frame, stress, moduli = np.empty(3), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    take_strains(spectral, principal, strain, trace)
    _deviators(work, strain, trace, before, change)
    rest, bulk = 1.0, lame + 2.0 / 3.0 * mu
    for i in range(count):
        rest -= constants[3 + 3 * i]
    _add(2.0 * mu * rest, strain, bulk, trace, total)
    for i in range(count):
        _relax(work, constants, i, before, change, each, lost)
        _add(2.0 * constants[3 + 3 * i] * mu, each, 0.0, trace, total)
        turn(each, spectral, elastic[i])
    turn(total, spectral, turned)
    for k in range(_W):
        take_frame(spectral, k, c, frame)
        sheared = rest
        for m in range(6):
            stress[m] = turned[m, k]
            for n in range(6):
                moduli[m, n] = 0.0
        for i in range(count):
            share, size = constants[3 + 3 * i], 0.0
            for m in range(6):
                size += TWICE[m] * elastic[i, m, k] ** 2
            across, along = _growth(constants, i, np.sqrt(size))
            sheared += share * across
            if size > 0.0 and along != across:
                more = 2.0 * share * mu * (along - across) / size
                for m in range(6):
                    for n in range(6):
                        moduli[m, n] += more * elastic[i, m, k] * elastic[i, n, k]
        for m in range(6):
            for n in range(6):
                own = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] += 2.0 * mu * sheared * (own - both / 3.0) + bulk * both
        add_moduli(work, k, c, frame, stress, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    spectral, principal, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    stress, strain, before = np.zeros((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    change, elastic, lost = np.empty((6, POINTS)), np.empty((6, POINTS)), np.zeros(POINTS)
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    take_strains(spectral, principal, strain, trace)
    _deviators(work, strain, trace, before, change)
    _add(2.0 * mu, strain, lame + 2.0 / 3.0 * mu, trace, stress)
    for i in range(count):
        _relax(work, constants, i, before, change, elastic, lost)
        for m in range(6):
            row = np.uint64(POINTS * (FIBRE + 6 + 6 * i + m))
            for k in range(_W):
                elastic[m, k] = strain[m, k] - elastic[m, k]
            for k in range(_W):
                work[row + k] = elastic[m, k]
        _add(-2.0 * constants[3 + 3 * i] * mu, elastic, 0.0, trace, stress)
    for k in range(_W):
        work[_lost(count) + k] += lost[k]
    put_stress(work, spectral, principal, stress)
    for m in range(6):
        row, third = np.uint64(POINTS * (FIBRE + m)), 1.0 / 3.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            work[row + k] = strain[m, k] + third * trace[k]
