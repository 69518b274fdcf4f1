"""Norton's creep by logarithmic strain, compiled: all of the shear stress relaxes.

Von Mises' stress falls as ``q' = -c q^n`` while nothing moves.  A step relaxes for half of its time, is strained, and
relaxes for the other half, each exactly: an error of second order in the time, and none where nothing moves.

Constants: shear modulus, time of the step, ``c``, ``n``, Lame's first parameter.  State: the strain at the start of the
step, then the viscous strain.
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
    turn,
    turn_back,
)
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, POINTS, ROWS, TANGENT


@njit(**FAST)
def _left(q: float, c: float, n: float, time: float) -> float:
    """Return what share of a stress relaxation leaves."""
    if n == 1.0:
        return np.exp(-c * time)
    return (1.0 + (n - 1.0) * c * time * q ** (n - 1.0)) ** (-1.0 / (n - 1.0))


@njit(**FAST)
def _tensor(work: Array, k: Any, first: int, tensor: Array) -> None:
    for m in range(6):
        tensor[m] = work[np.uint64(POINTS * (FIBRE + first + m)) + k]


@njit(**FAST)
def _relax(
    work: Array, k: Any, constants: Array, frame: Array, deviator: Array, before: Array, elastic: Array
) -> tuple[float, float]:
    """Fill in the elastic strain at the end of the step, in the principal frame.

    Parameters
    ----------
    deviator, before
        Of the strain, at the end and at the start of the step.

    Returns
    -------
    across, along
        By how much it grows with the strain, across it and along it.
    """
    time, c, n = constants[1], constants[2], constants[3]
    flown, turned = np.empty(6), np.empty(6)
    _tensor(work, k, 6, flown)
    turn(flown, frame, turned)
    size = 0.0
    for m in range(6):
        elastic[m] = before[m] - turned[m]
        size += TWICE[m] * elastic[m] ** 2
    stress = 2.0 * constants[0] * np.sqrt(1.5)
    kept = _left(stress * np.sqrt(size), c, n, 0.5 * time)
    size = 0.0
    for m in range(6):
        elastic[m] = kept * elastic[m] + deviator[m] - before[m]
        size += TWICE[m] * elastic[m] ** 2
    kept = _left(stress * np.sqrt(size), c, n, 0.5 * time)
    for m in range(6):
        elastic[m] *= kept
    return kept, kept**n


@njit(**FAST)
def _deviators(work: Array, k: Any, frame: Array, strain: Array, deviator: Array, before: Array) -> float:
    """Fill in the deviators of the strain at the end and at the start of the step, in the frame; return its trace."""
    last = np.empty(6)
    _tensor(work, k, 0, last)
    turn(last, frame, before)
    trace, past = strain[0] + strain[1] + strain[2], before[0] + before[3] + before[5]
    for m in range(6):
        square = FIRST[m] == SECOND[m]
        deviator[m] = strain[FIRST[m]] - trace / 3.0 if square else 0.0
        before[m] -= past / 3.0 if square else 0.0
    return trace


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy, that of the elastic strain."""
    spectral = principal_strains(work)
    c, strain, stress, frame = np.empty(3), np.empty(3), np.empty(6), np.empty((3, 3))
    deviator, before, elastic = np.empty(6), np.empty(6), np.empty(6)
    mu, lame = constants[0], constants[constants.size - 1]
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        trace = _deviators(work, k, frame, strain, deviator, before)
        _relax(work, k, constants, frame, deviator, before, elastic)
        energy = 0.5 * (lame + 2.0 / 3.0 * mu) * trace**2
        for m in range(6):
            stress[m] = 2.0 * mu * elastic[m] + ((lame + 2.0 / 3.0 * mu) * trace if FIRST[m] == SECOND[m] else 0.0)
            energy += mu * TWICE[m] * elastic[m] ** 2
        put_stress(work, k, c, frame, stress)
        if wanted:
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral = principal_strains(work)
    c, strain, stress, frame = np.empty(3), np.empty(3), np.empty(6), np.empty((3, 3))
    deviator, before, elastic, moduli = np.empty(6), np.empty(6), np.empty(6), np.empty((6, 6))
    mu, lame = constants[0], constants[constants.size - 1]
    bulk = lame + 2.0 / 3.0 * mu
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        trace = _deviators(work, k, frame, strain, deviator, before)
        across, along = _relax(work, k, constants, frame, deviator, before, elastic)
        size = 0.0
        for m in range(6):
            stress[m] = 2.0 * mu * elastic[m] + (bulk * trace if FIRST[m] == SECOND[m] else 0.0)
            size += TWICE[m] * elastic[m] ** 2
        bent = 2.0 * mu * (along - across) / size if size > 0.0 else 0.0
        for m in range(6):
            for n in range(6):
                own = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * across * (own - both / 3.0) + bulk * both + bent * elastic[m] * elastic[n]
        add_moduli(work, k, c, frame, stress, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Replace the state by that at the end of the step."""
    spectral = principal_strains(work)
    c, strain, frame, turned, after = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty(6), np.empty(6)
    deviator, before, elastic = np.empty(6), np.empty(6), np.empty(6)
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        _deviators(work, k, frame, strain, deviator, before)
        _relax(work, k, constants, frame, deviator, before, elastic)
        for m in range(6):
            turned[m] = deviator[m] - elastic[m]
        turn_back(turned, frame, after)
        for m in range(6):
            work[np.uint64(POINTS * (FIBRE + 6 + m)) + k] = after[m]
            turned[m] = strain[FIRST[m]] if FIRST[m] == SECOND[m] else 0.0
        turn_back(turned, frame, after)
        for m in range(6):
            work[np.uint64(POINTS * (FIBRE + m)) + k] = after[m]
