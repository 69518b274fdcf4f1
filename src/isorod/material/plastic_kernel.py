"""Von Mises' plasticity by logarithmic strain, compiled: the return to the yield surface in closed form.

Constants: shear modulus, kinematic modulus ``H``, number of points of the table, its plastic strains and yield
stresses in turn, Lame's first parameter.  State: plastic strain, six numbers, and accumulated plastic strain.
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

STATES = 7

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
def _respond(
    work: Array, k: Any, constants: Array, frame: Array, strain: Array, stress: Array, way: Array, plastic: Array
) -> tuple[float, float, float]:
    """Fill in stress, direction of flow and plastic strain at the end of the step, in the principal frame.

    Returns
    -------
    step, slope, size
        Accumulated plastic strain of the step, slope of the yield stress at its end, and norm of the deviator that
        returns.
    """
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    before = np.empty(6)
    for m in range(6):
        before[m] = work[np.uint64(POINTS * (FIBRE + m)) + k]
    turn(before, frame, plastic)
    p = work[ROWS[FIBRE + 6] + k]
    trace = strain[0] + strain[1] + strain[2]
    size = 0.0
    for m in range(6):
        square = FIRST[m] == SECOND[m]
        elastic = (strain[FIRST[m]] if square else 0.0) - plastic[m]
        stress[m] = 2.0 * mu * elastic + (lame * trace if square else 0.0)
        way[m] = 2.0 * mu * (elastic - (trace / 3.0 if square else 0.0)) - 2.0 / 3.0 * kinematic * plastic[m]
        size += TWICE[m] * way[m] * way[m]
    size = np.sqrt(size)
    q = np.sqrt(1.5) * size
    if not q > _yield_stress(p, constants) * (1.0 + _ROUNDING):
        return 0.0, 0.0, size
    step, slope = _flow(q, p, 3.0 * mu + kinematic, constants)
    for m in range(6):
        way[m] /= size
        flown = np.sqrt(1.5) * step * way[m]
        plastic[m] += flown
        stress[m] -= 2.0 * mu * flown
    return step, slope, size


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: that of the elastic strain and of kinematic hardening."""
    spectral = principal_strains(work)
    c, strain, stress, way, plastic = np.empty(3), np.empty(3), np.empty(6), np.empty(6), np.empty(6)
    frame = np.empty((3, 3))
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        _respond(work, k, constants, frame, strain, stress, way, plastic)
        put_stress(work, k, c, frame, stress)
        if wanted:
            energy = 0.5 * constants[constants.size - 1] * (strain[0] + strain[1] + strain[2]) ** 2
            for m in range(6):
                elastic = (strain[FIRST[m]] if FIRST[m] == SECOND[m] else 0.0) - plastic[m]
                energy += TWICE[m] * (constants[0] * elastic**2 + constants[1] / 3.0 * plastic[m] ** 2)
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral = principal_strains(work)
    c, strain, stress, way, plastic = np.empty(3), np.empty(3), np.empty(6), np.empty(6), np.empty(6)
    frame, moduli = np.empty((3, 3)), np.empty((6, 6))
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        step, slope, size = _respond(work, k, constants, frame, strain, stress, way, plastic)
        back, along = 0.0, 0.0
        if step > 0.0:
            back = 2.0 * mu * np.sqrt(1.5) * step / size
            along = 3.0 * mu / (3.0 * mu + kinematic + slope) - back
        for m in range(6):
            for n in range(6):
                own = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * (1.0 - back) * own + (lame + 2.0 * mu * back / 3.0) * both
                if step > 0.0:
                    moduli[m, n] -= 2.0 * mu * along * way[m] * way[n]
        add_moduli(work, k, c, frame, stress, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Replace the state by that at the end of the step."""
    spectral = principal_strains(work)
    c, strain, stress, way, plastic = np.empty(3), np.empty(3), np.empty(6), np.empty(6), np.empty(6)
    frame, after = np.empty((3, 3)), np.empty(6)
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        step, _, _ = _respond(work, k, constants, frame, strain, stress, way, plastic)
        # What does not flow keeps its digits.
        if step > 0.0:
            turn_back(plastic, frame, after)
            for m in range(6):
                work[np.uint64(POINTS * (FIBRE + m)) + k] = after[m]
            work[ROWS[FIBRE + 6] + k] += step
