"""Von Mises' plasticity by logarithmic strain, compiled: the return to the yield surface in closed form.

Constants: shear modulus, kinematic modulus ``H``, number of points of the table, its plastic strains and yield
stresses in turn, Lame's first parameter.  State: plastic strain, six numbers, accumulated plastic strain, and what
was dissipated.
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

_W = np.uint64(POINTS)

# Of the yield stress, above which a stress has to be to flow: the rest is rounding.
_ROUNDING = 1e-12


@njit(**FAST)
def _yield_stress(p: float, constants: Array) -> float:
    """Return the yield stress at an accumulated plastic strain: behind the table's last point that of this one."""
    count = int(constants[2])
    for k in range(1, count):
        p0, s0, p1, s1 = constants[1 + 2 * k], constants[2 + 2 * k], constants[3 + 2 * k], constants[4 + 2 * k]
        if p < p1:
            return s0 + (p - p0) * (s1 - s0) / (p1 - p0)
    return constants[2 + 2 * count]


@njit(**FAST)
def _flow(q: float, p: float, stiffness: float, constants: Array) -> tuple[float, float]:
    """Return the plastic strain of a step and the slope of the yield stress at its end.

    It is the root ``d`` of ``q - stiffness d - yield_stress(p + d)``, piece by piece of the table.
    """
    count = int(constants[2])
    for k in range(1, count):
        p0, s0, p1, s1 = constants[1 + 2 * k], constants[2 + 2 * k], constants[3 + 2 * k], constants[4 + 2 * k]
        if p < p1 and q - stiffness * (p1 - p) < s1:
            slope = (s1 - s0) / (p1 - p0)
            return (q - s0 - (p - p0) * slope) / (stiffness + slope), slope
    return (q - constants[2 + 2 * count]) / stiffness, 0.0


@njit(**FAST)
def _dissipated(p: float, constants: Array) -> float:
    """Return the work of the yield stress up to an accumulated plastic strain."""
    count, work = int(constants[2]), 0.0
    for k in range(1, count):
        p0, s0, p1, s1 = constants[1 + 2 * k], constants[2 + 2 * k], constants[3 + 2 * k], constants[4 + 2 * k]
        along = min(max(p - p0, 0.0), p1 - p0)
        work += along * (s0 + 0.5 * along * (s1 - s0) / (p1 - p0))
    return work + max(p - constants[1 + 2 * count], 0.0) * constants[2 + 2 * count]


@njit(**FAST)
def _try(work: Array, constants: Array, strain: Array, trace: Array, stress: Array, way: Array, size: Array) -> None:
    """Fill in stress and relative deviator of a step without flow, ``(6, POINTS)``, and the norm of the latter."""
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    for k in range(_W):
        size[k] = 0.0
    # Short loops: the compiler sees which arrays lie apart.
    for m in range(6):
        row, square = np.uint64(POINTS * (FIBRE + m)), 1.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            stress[m, k] = 2.0 * mu * (strain[m, k] - work[row + k])
        for k in range(_W):
            way[m, k] = stress[m, k] - 2.0 / 3.0 * (kinematic * work[row + k] + square * mu * trace[k])
        for k in range(_W):
            stress[m, k] += square * lame * trace[k]
        for k in range(_W):
            size[k] += TWICE[m] * way[m, k] * way[m, k]
    for k in range(_W):
        size[k] = np.sqrt(size[k])


@njit(**FAST)
def _respond(
    work: Array, k: Any, constants: Array, stress: Array, way: Array, size: Array, goes_on: bool
) -> tuple[float, float]:
    """Let a point flow whose stress is beyond the yield surface (`_try`), and its state go on, if that is wanted.

    Parameters
    ----------
    stress, way
        To be replaced: stress and direction of flow at the end of the step; columns are points.

    Returns
    -------
    step, slope
        Accumulated plastic strain of the step, and slope of the yield stress at its end.
    """
    mu, kinematic = constants[0], constants[1]
    p, q = work[ROWS[FIBRE + 6] + k], np.sqrt(1.5) * size[k]
    # Tables do not fall: most points are done with their first stress.
    if not q > constants[4]:
        return 0.0, 0.0
    if not q > _yield_stress(p, constants) * (1.0 + _ROUNDING):
        return 0.0, 0.0
    step, slope = _flow(q, p, 3.0 * mu + kinematic, constants)
    for m in range(6):
        way[m, k] /= size[k]
        flown = np.sqrt(1.5) * step * way[m, k]
        stress[m, k] -= 2.0 * mu * flown
        if goes_on:
            work[np.uint64(POINTS * (FIBRE + m)) + k] += flown
    if goes_on:
        work[ROWS[FIBRE + 6] + k] += step
        work[ROWS[FIBRE + 7] + k] = _dissipated(p + step, constants)
    return step, slope


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: that of the elastic strain and of kinematic hardening."""
    spectral, principal, strain = principal_strains(work), np.empty((3, POINTS)), np.empty((6, POINTS))
    stress, way, trace, size = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS), np.empty(POINTS)
    take_strains(spectral, principal, strain, trace)
    _try(work, constants, strain, trace, stress, way, size)
    for k in range(_W):
        step, _ = _respond(work, k, constants, stress, way, size, False)
        if wanted:
            energy = 0.5 * constants[constants.size - 1] * trace[k] ** 2
            for m in range(6):
                plastic = work[np.uint64(POINTS * (FIBRE + m)) + k]
                plastic += np.sqrt(1.5) * step * way[m, k] if step > 0.0 else 0.0
                energy += TWICE[m] * (constants[0] * (strain[m, k] - plastic) ** 2 + constants[1] / 3.0 * plastic**2)
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0
            work[ROWS[LOST] + k] = _dissipated(work[ROWS[FIBRE + 6] + k] + step, constants)
    put_stress(work, spectral, principal, stress)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral, principal, strain = principal_strains(work), np.empty((3, POINTS)), np.empty((6, POINTS))
    stress, way, trace, size = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS), np.empty(POINTS)
    turned, along = np.empty((6, POINTS)), np.empty((6, POINTS))
    steps, slopes = np.empty(POINTS), np.empty(POINTS)
    c, frame, own, moduli = np.empty(3), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    take_strains(spectral, principal, strain, trace)
    _try(work, constants, strain, trace, stress, way, size)
    for k in range(_W):
        steps[k], slopes[k] = _respond(work, k, constants, stress, way, size, False)
    turn(stress, spectral, turned)
    turn(way, spectral, along)
    for k in range(_W):
        take_frame(spectral, k, c, frame)
        back, forth = 0.0, 0.0
        if steps[k] > 0.0:
            back = 2.0 * mu * np.sqrt(1.5) * steps[k] / size[k]
            forth = 3.0 * mu / (3.0 * mu + kinematic + slopes[k]) - back
        for m in range(6):
            own[m] = turned[m, k]
            for n in range(6):
                same = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * (1.0 - back) * same + (lame + 2.0 * mu * back / 3.0) * both
                if steps[k] > 0.0:
                    moduli[m, n] -= 2.0 * mu * forth * along[m, k] * along[n, k]
        add_moduli(work, k, c, frame, own, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    spectral, principal, strain = principal_strains(work), np.empty((3, POINTS)), np.empty((6, POINTS))
    stress, way, trace, size = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS), np.empty(POINTS)
    take_strains(spectral, principal, strain, trace)
    _try(work, constants, strain, trace, stress, way, size)
    for k in range(_W):
        _respond(work, k, constants, stress, way, size, True)
    put_stress(work, spectral, principal, stress)
