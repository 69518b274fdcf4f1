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
    turn_back,
)
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, LOST, POINTS, ROWS, TANGENT

# Branches at most: their states have no more room.
MOST = 3

# Share of a time of relaxation below which a step is told by a series.
_SHORT = 1e-3


@njit(**FAST)
def _left(q: float, c: float, n: float, time: float) -> float:
    """Return what share of a stress relaxation leaves."""
    if n == 1.0:
        return np.exp(-c * time)
    return (1.0 + (n - 1.0) * c * time * q ** (n - 1.0)) ** (-1.0 / (n - 1.0))


@njit(**FAST)
def _shares(constants: Array, which: int) -> tuple[float, float, float]:
    """Return what is left of the stress of a branch with ``n = 1``, by how much the strain adds, and a share lost."""
    x = constants[4 + 3 * which] * constants[1]
    kept, share = np.exp(-x), -np.expm1(-x) / x if x > 1e-8 else 1.0 - 0.5 * x
    # Digits cancel in short steps.
    rest = x / 3.0 - x**2 / 4.0 + 7.0 / 60.0 * x**3 if x < _SHORT else (1.0 - share) / x - 0.5 * share**2
    return kept, share, rest


@njit(**FAST)
def _branch(
    k: Any,
    constants: Array,
    which: int,
    shares: tuple[float, float, float],
    deviator: Array,
    before: Array,
    elastic: Array,
) -> tuple[float, float, float]:
    """Fill in the elastic strain of a branch at the end of the step at a point, in the principal frame.

    Parameters
    ----------
    shares
        From `_shares`.
    deviator, before
        Of the strain, at the end and at the start of the step; columns of all are points.
    elastic
        The viscous strain at the start, to be replaced.

    Returns
    -------
    across, along
        By how much it grows with the strain, across it and along it.
    lost
        What the branch dissipates in the step.
    """
    mu, time = constants[3 + 3 * which] * constants[0], constants[1]
    c, n = constants[4 + 3 * which], constants[5 + 3 * which]
    size = mixed = square = 0.0
    for m in range(6):
        change = deviator[m, k] - before[m, k]
        start = before[m, k] - elastic[m, k]
        size += TWICE[m] * start * start
        mixed += TWICE[m] * change * start
        square += TWICE[m] * change * change
        elastic[m, k] = start
    if n == 1.0:
        kept, share, rest = shares
        for m in range(6):
            elastic[m, k] = kept * elastic[m, k] + share * (deviator[m, k] - before[m, k])
        # The work of the mean stress, less what is stored.
        x = c * time
        lost = 0.5 * x * (1.0 + kept) * share * size + share * share * x * mixed + rest * square
        return share, share, 2.0 * mu * lost
    stress = 2.0 * mu * np.sqrt(1.5)
    kept = _left(stress * np.sqrt(size), c, n, 0.5 * time)
    lost = (1.0 - kept * kept) * size
    size = 0.0
    for m in range(6):
        elastic[m, k] = kept * elastic[m, k] + deviator[m, k] - before[m, k]
        size += TWICE[m] * elastic[m, k] ** 2
    kept = _left(stress * np.sqrt(size), c, n, 0.5 * time)
    for m in range(6):
        elastic[m, k] *= kept
    return kept, kept**n, mu * (lost + (1.0 - kept * kept) * size)


@njit(**FAST)
def _deviators(strain: Array, deviator: Array, before: Array, trace: Array) -> None:
    """Fill in deviator ``(6, POINTS)`` and trace of the strain at the end; make that at the start a deviator."""
    for k in range(np.uint64(POINTS)):
        trace[k] = strain[0, k] + strain[1, k] + strain[2, k]
        past = before[0, k] + before[3, k] + before[5, k]
        for m in range(6):
            square = FIRST[m] == SECOND[m]
            deviator[m, k] = strain[FIRST[m], k] - trace[k] / 3.0 if square else 0.0
            before[m, k] -= past / 3.0 if square else 0.0


@njit(**FAST)
def _lost(count: int) -> Any:
    """Return where the row of what was dissipated begins."""
    return np.uint64(POINTS * (FIBRE + 6 + 6 * count))


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy, that of the elastic strains."""
    spectral, strain, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    stress, deviator, before, elastic = (
        np.empty((6, POINTS)),
        np.empty((6, POINTS)),
        np.empty((6, POINTS)),
        np.empty((6, POINTS)),
    )
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    take_strains(spectral, strain)
    turn(work, FIBRE, spectral, before)
    _deviators(strain, deviator, before, trace)
    rest = 1.0
    for i in range(count):
        rest -= constants[3 + 3 * i]
    for k in range(np.uint64(POINTS)):
        pressed = (lame + 2.0 / 3.0 * mu) * trace[k]
        energy = 0.5 * pressed * trace[k]
        for m in range(6):
            stress[m, k] = 2.0 * rest * mu * deviator[m, k] + (pressed if FIRST[m] == SECOND[m] else 0.0)
            energy += rest * mu * TWICE[m] * deviator[m, k] ** 2
        if wanted:
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0
            work[ROWS[LOST] + k] = work[_lost(count) + k]
    for i in range(count):
        turn(work, FIBRE + 6 + 6 * i, spectral, elastic)
        shares, stiffness = _shares(constants, i), constants[3 + 3 * i] * mu
        for k in range(np.uint64(POINTS)):
            lost = _branch(k, constants, i, shares, deviator, before, elastic)[2]
            energy = 0.0
            for m in range(6):
                stress[m, k] += 2.0 * stiffness * elastic[m, k]
                energy += stiffness * TWICE[m] * elastic[m, k] ** 2
            if wanted:
                work[ROWS[ENERGY] + k] += energy
                work[ROWS[LOST] + k] += lost
    put_stress(work, spectral, strain, stress)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral, strain, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    deviator, before = np.empty((6, POINTS)), np.empty((6, POINTS))
    elastic = np.empty((MOST, 6, POINTS))
    c, frame, stress, moduli = np.empty(3), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    take_strains(spectral, strain)
    turn(work, FIBRE, spectral, before)
    _deviators(strain, deviator, before, trace)
    for i in range(count):
        turn(work, FIBRE + 6 + 6 * i, spectral, elastic[i])
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame)
        bulk = lame + 2.0 / 3.0 * mu
        sheared = 1.0
        for i in range(count):
            sheared -= constants[3 + 3 * i]
        for m in range(6):
            pressed = bulk * trace[k] if FIRST[m] == SECOND[m] else 0.0
            stress[m] = 2.0 * mu * sheared * deviator[m, k] + pressed
            for n in range(6):
                moduli[m, n] = 0.0
        for i in range(count):
            share = constants[3 + 3 * i]
            across, along, _ = _branch(k, constants, i, _shares(constants, i), deviator, before, elastic[i])
            sheared += share * across
            size = 0.0
            for m in range(6):
                stress[m] += 2.0 * share * mu * elastic[i, m, k]
                size += TWICE[m] * elastic[i, m, k] ** 2
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
    spectral, strain, trace = principal_strains(work), np.empty((3, POINTS)), np.empty(POINTS)
    stress, deviator, before, elastic = (
        np.empty((6, POINTS)),
        np.empty((6, POINTS)),
        np.empty((6, POINTS)),
        np.empty((6, POINTS)),
    )
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    take_strains(spectral, strain)
    turn(work, FIBRE, spectral, before)
    _deviators(strain, deviator, before, trace)
    for k in range(np.uint64(POINTS)):
        pressed = (lame + 2.0 / 3.0 * mu) * trace[k]
        for m in range(6):
            stress[m, k] = 2.0 * mu * deviator[m, k] + (pressed if FIRST[m] == SECOND[m] else 0.0)
    for i in range(count):
        turn(work, FIBRE + 6 + 6 * i, spectral, elastic)
        shares, stiffness = _shares(constants, i), constants[3 + 3 * i] * mu
        for k in range(np.uint64(POINTS)):
            work[_lost(count) + k] += _branch(k, constants, i, shares, deviator, before, elastic)[2]
            for m in range(6):
                elastic[m, k] = deviator[m, k] - elastic[m, k]
                stress[m, k] -= 2.0 * stiffness * elastic[m, k]
        turn_back(elastic, spectral, work, FIBRE + 6 + 6 * i)
    put_stress(work, spectral, strain, stress)
    for k in range(np.uint64(POINTS)):
        for m in range(6):
            deviator[m, k] = strain[FIRST[m], k] if FIRST[m] == SECOND[m] else 0.0
    turn_back(deviator, spectral, work, FIBRE)
