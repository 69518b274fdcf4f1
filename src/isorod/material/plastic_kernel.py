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
    turn_back,
)
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, LOST, POINTS, ROWS, TANGENT

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
def _respond(
    work: Array, k: Any, constants: Array, strain: Array, stress: Array, way: Array, plastic: Array
) -> tuple[float, float, float]:
    """Fill in stress, direction of flow and plastic strain at the end of the step at a point, in the principal frame.

    Parameters
    ----------
    plastic
        That at the start, to be replaced; columns of all are points.

    Returns
    -------
    step, slope, size
        Accumulated plastic strain of the step, slope of the yield stress at its end, and norm of the deviator that
        returns.
    """
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    p = work[ROWS[FIBRE + 6] + k]
    trace = strain[0, k] + strain[1, k] + strain[2, k]
    size = 0.0
    for m in range(6):
        square = FIRST[m] == SECOND[m]
        elastic = (strain[FIRST[m], k] if square else 0.0) - plastic[m, k]
        stress[m, k] = 2.0 * mu * elastic + (lame * trace if square else 0.0)
        way[m, k] = 2.0 * mu * (elastic - (trace / 3.0 if square else 0.0)) - 2.0 / 3.0 * kinematic * plastic[m, k]
        size += TWICE[m] * way[m, k] * way[m, k]
    size = np.sqrt(size)
    q = np.sqrt(1.5) * size
    if not q > _yield_stress(p, constants) * (1.0 + _ROUNDING):
        return 0.0, 0.0, size
    step, slope = _flow(q, p, 3.0 * mu + kinematic, constants)
    for m in range(6):
        way[m, k] /= size
        flown = np.sqrt(1.5) * step * way[m, k]
        plastic[m, k] += flown
        stress[m, k] -= 2.0 * mu * flown
    return step, slope, size


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: that of the elastic strain and of kinematic hardening."""
    spectral, strain = principal_strains(work), np.empty((3, POINTS))
    stress, way, plastic = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    take_strains(spectral, strain)
    turn(work, FIBRE, spectral, plastic)
    for k in range(np.uint64(POINTS)):
        step, _, _ = _respond(work, k, constants, strain, stress, way, plastic)
        if wanted:
            energy = 0.5 * constants[constants.size - 1] * (strain[0, k] + strain[1, k] + strain[2, k]) ** 2
            for m in range(6):
                elastic = (strain[FIRST[m], k] if FIRST[m] == SECOND[m] else 0.0) - plastic[m, k]
                energy += TWICE[m] * (constants[0] * elastic**2 + constants[1] / 3.0 * plastic[m, k] ** 2)
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0
            work[ROWS[LOST] + k] = _dissipated(work[ROWS[FIBRE + 6] + k] + step, constants)
    put_stress(work, spectral, strain, stress)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    spectral, strain = principal_strains(work), np.empty((3, POINTS))
    stress, way, plastic = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    c, frame, own, moduli = np.empty(3), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    take_strains(spectral, strain)
    turn(work, FIBRE, spectral, plastic)
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame)
        step, slope, size = _respond(work, k, constants, strain, stress, way, plastic)
        back, along = 0.0, 0.0
        if step > 0.0:
            back = 2.0 * mu * np.sqrt(1.5) * step / size
            along = 3.0 * mu / (3.0 * mu + kinematic + slope) - back
        for m in range(6):
            own[m] = stress[m, k]
            for n in range(6):
                same = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * (1.0 - back) * same + (lame + 2.0 * mu * back / 3.0) * both
                if step > 0.0:
                    moduli[m, n] -= 2.0 * mu * along * way[m, k] * way[n, k]
        add_moduli(work, k, c, frame, own, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    spectral, strain = principal_strains(work), np.empty((3, POINTS))
    stress, way, plastic = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty((6, POINTS))
    before, flows = work[POINTS * FIBRE : POINTS * (FIBRE + 6)].copy(), False
    steps = np.empty(POINTS)
    take_strains(spectral, strain)
    turn(work, FIBRE, spectral, plastic)
    for k in range(np.uint64(POINTS)):
        steps[k], _, _ = _respond(work, k, constants, strain, stress, way, plastic)
        if steps[k] > 0.0:
            flows = True
            work[ROWS[FIBRE + 6] + k] += steps[k]
            work[ROWS[FIBRE + 7] + k] = _dissipated(work[ROWS[FIBRE + 6] + k], constants)
    put_stress(work, spectral, strain, stress)
    if not flows:
        return
    turn_back(plastic, spectral, work, FIBRE)
    # What does not flow keeps its digits.
    for k in range(np.uint64(POINTS)):
        if not steps[k] > 0.0:
            for m in range(6):
                row = np.uint64(POINTS * m) + k
                work[ROWS[FIBRE] + row] = before[row]
