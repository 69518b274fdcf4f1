"""Von Mises' plasticity by logarithmic strain, compiled: the return to the yield surface, in closed form if it can be.

Where the direction of flow stays, the back stress ``a`` with ``a' = 2/3 H e' - gamma a p'`` (P. J. Armstrong & C. O.
Frederick 1966; J. L. Chaboche, Int. J. Plasticity 5 (1989) 247-302) has the solution ``a(d) = exp(-gamma d) a +
sqrt(2/3) H (1 - exp(-gamma d))/gamma n`` of a plastic strain ``d``: a step is as exact as the direction ``n`` of its
end.  That ``n`` turns with ``exp(-gamma d) a`` makes the derivative of the stress not symmetric: the moduli are its
symmetric part.  With time the yield stress is ``1 + (d / (A t))^(1/n)`` times itself (Perzyna), at the end of the step.

Constants: shear modulus, kinematic modulus ``H``, ``gamma``, time ``t`` of the step, ``A`` (0 without such), ``1/n``,
number of points of the table, its plastic strains and yield stresses in turn, Lame's first parameter.  State: plastic
strain, six numbers, accumulated plastic strain, back stress, six numbers.
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

# Where the table stands, and in the state the back stress.
_COUNT, _BACK = 6, 7

# Of the yield stress, above which a stress has to be to flow: the rest is rounding.
_ROUNDING = 1e-12

# Newton's steps to the root, or halvings of where it lies, at most, and the share of it that is rounding.
_STEPS, _NEAR = 100, 1e-15


@njit(**FAST)
def _yield_stress(p: float, constants: Array) -> tuple[float, float]:
    """Return yield stress and slope at an accumulated plastic strain: behind the last point its stress, and 0."""
    count = int(constants[_COUNT])
    for k in range(1, count):
        i = _COUNT - 1 + 2 * k
        p0, s0, p1, s1 = constants[i], constants[i + 1], constants[i + 2], constants[i + 3]
        if p < p1:
            slope = (s1 - s0) / (p1 - p0)
            return s0 + (p - p0) * slope, slope
    return constants[_COUNT + 2 * count], 0.0


@njit(**FAST)
def _flow(q: float, p: float, stiffness: float, constants: Array) -> tuple[float, float]:
    """Return the plastic strain of a step and the slope of the yield stress at its end.

    It is the root ``d`` of ``q - stiffness d - yield_stress(p + d)``, piece by piece of the table.
    """
    count = int(constants[_COUNT])
    for k in range(1, count):
        i = _COUNT - 1 + 2 * k
        p0, s0, p1, s1 = constants[i], constants[i + 1], constants[i + 2], constants[i + 3]
        if p < p1 and q - stiffness * (p1 - p) < s1:
            slope = (s1 - s0) / (p1 - p0)
            return (q - s0 - (p - p0) * slope) / (stiffness + slope), slope
    return (q - constants[_COUNT + 2 * count]) / stiffness, 0.0


@njit(**FAST)
def _excess(d: float, p: float, squares: tuple[float, float, float], constants: Array) -> tuple[float, float]:
    """Return by how much von Mises' stress exceeds the yield stress after a plastic strain, and its slope: negative.

    ``squares`` are ``s : s``, ``s : a`` and ``a : a`` of the deviator and the back stress before the return.
    """
    mu, kinematic, recovery = constants[0], constants[1], constants[2]
    ss, sa, aa = squares
    kept = np.exp(-recovery * d)
    grown = -np.expm1(-recovery * d) / recovery if recovery > 0.0 else d
    size = np.sqrt(max(ss - 2.0 * kept * sa + kept * kept * aa, 1e-300))
    stress, slope = _yield_stress(p + d, constants)
    if constants[4] > 0.0:
        over = (d / (constants[4] * constants[3])) ** constants[5]
        slope = slope * (1.0 + over) + (stress * constants[5] * over / d if d > 0.0 else 0.0)
        stress *= 1.0 + over
    value = np.sqrt(1.5) * size - 3.0 * mu * d - kinematic * grown - stress
    return value, np.sqrt(1.5) * recovery * kept * (sa - kept * aa) / size - 3.0 * mu - kinematic * kept - slope


@njit(**FAST)
def _root(q: float, p: float, squares: tuple[float, float, float], constants: Array) -> tuple[float, float]:
    """Return the plastic strain of a step, and the slope of `_excess` there."""
    if constants[2] == 0.0 and constants[4] == 0.0:
        stiffness = 3.0 * constants[0] + constants[1]
        step, slope = _flow(q, p, stiffness, constants)
        return step, -stiffness - slope
    # No back stress is larger than what it saturates at, so that the slope is below -3 mu.
    low, high = 0.0, q / (3.0 * constants[0])
    d = 0.5 * high
    for _ in range(_STEPS):
        value, slope = _excess(d, p, squares, constants)
        low, high = (d, high) if value > 0.0 else (low, d)
        new = d - value / slope
        new = new if low < new < high else 0.5 * (low + high)
        if abs(new - d) <= _NEAR * d:
            break
        d = new
    return d, _excess(d, p, squares, constants)[1]


@njit(**FAST)
def _respond(
    work: Array,
    k: Any,
    constants: Array,
    frame: Array,
    strain: Array,
    stress: Array,
    way: Array,
    plastic: Array,
    back: Array,
) -> tuple[float, float, float]:
    """Fill in stress, direction of flow, plastic strain and back stress at the end of the step, in the frame.

    Returns
    -------
    step, slope, size
        Accumulated plastic strain of the step, slope of `_excess` at its end, and norm of the deviator that returns.
    """
    mu, kinematic, recovery, lame = constants[0], constants[1], constants[2], constants[constants.size - 1]
    before = np.empty(6)
    for m in range(6):
        before[m] = work[np.uint64(POINTS * (FIBRE + m)) + k]
    turn(before, frame, plastic)
    back[:] = 0.0
    if kinematic > 0.0:
        for m in range(6):
            before[m] = work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        turn(before, frame, back)
    p = work[ROWS[FIBRE + 6] + k]
    trace = strain[0] + strain[1] + strain[2]
    ss, sa, aa = 0.0, 0.0, 0.0
    for m in range(6):
        square = FIRST[m] == SECOND[m]
        elastic = (strain[FIRST[m]] if square else 0.0) - plastic[m]
        stress[m] = 2.0 * mu * elastic + (lame * trace if square else 0.0)
        way[m] = 2.0 * mu * (elastic - (trace / 3.0 if square else 0.0))
        ss, sa, aa = ss + TWICE[m] * way[m] ** 2, sa + TWICE[m] * way[m] * back[m], aa + TWICE[m] * back[m] ** 2
    size = np.sqrt(max(ss - 2.0 * sa + aa, 0.0))
    q = np.sqrt(1.5) * size
    rests = constants[4] > 0.0 and not constants[3] > 0.0
    if rests or not q > _yield_stress(p, constants)[0] * (1.0 + _ROUNDING):
        return 0.0, -1.0, size
    step, slope = _root(q, p, (ss, sa, aa), constants)
    kept = np.exp(-recovery * step)
    grown = -np.expm1(-recovery * step) / recovery if recovery > 0.0 else step
    size = 0.0
    for m in range(6):
        back[m] *= kept
        way[m] -= back[m]
        size += TWICE[m] * way[m] ** 2
    size = np.sqrt(size)
    for m in range(6):
        way[m] /= size
        flown = np.sqrt(1.5) * step * way[m]
        plastic[m] += flown
        stress[m] -= 2.0 * mu * flown
        back[m] += np.sqrt(2.0 / 3.0) * kinematic * grown * way[m]
    return step, slope, size


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: that of the elastic strain and of kinematic hardening."""
    spectral = principal_strains(work)
    c, strain, stress, way, plastic = np.empty(3), np.empty(3), np.empty(6), np.empty(6), np.empty(6)
    frame, back, kinematic = np.empty((3, 3)), np.empty(6), constants[1]
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        _respond(work, k, constants, frame, strain, stress, way, plastic, back)
        put_stress(work, k, c, frame, stress)
        if wanted:
            energy = 0.5 * constants[constants.size - 1] * (strain[0] + strain[1] + strain[2]) ** 2
            for m in range(6):
                elastic = (strain[FIRST[m]] if FIRST[m] == SECOND[m] else 0.0) - plastic[m]
                energy += TWICE[m] * constants[0] * elastic**2
                energy += TWICE[m] * 0.75 * back[m] ** 2 / kinematic if kinematic > 0.0 else 0.0
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the symmetric part of the derivative of the stress at the end of the step."""
    spectral = principal_strains(work)
    c, strain, stress, way, plastic = np.empty(3), np.empty(3), np.empty(6), np.empty(6), np.empty(6)
    frame, moduli, back, across = np.empty((3, 3)), np.empty((6, 6)), np.empty(6), np.zeros(6)
    mu, kinematic, recovery, lame = constants[0], constants[1], constants[2], constants[constants.size - 1]
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        step, slope, size = _respond(work, k, constants, frame, strain, stress, way, plastic, back)
        less, along = 0.0, 0.0
        if step > 0.0:
            less = 2.0 * mu * np.sqrt(1.5) * step / size
            along = -3.0 * mu / slope - less
            if recovery > 0.0:
                # What is left of the back stress before, across the flow, turns the flow.
                grown = -np.expm1(-recovery * step) / recovery
                before, turned = 0.0, -less * recovery * np.sqrt(1.5) / slope
                for m in range(6):
                    across[m] = back[m] - np.sqrt(2.0 / 3.0) * kinematic * grown * way[m]
                    before += TWICE[m] * across[m] * way[m]
                for m in range(6):
                    across[m] = turned * (across[m] - before * way[m])
        for m in range(6):
            for n in range(6):
                own = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * (1.0 - less) * own + (lame + 2.0 * mu * less / 3.0) * both
                if step > 0.0:
                    moduli[m, n] -= 2.0 * mu * along * way[m] * way[n]
                    moduli[m, n] -= mu * (across[m] * way[n] + way[m] * across[n])
        add_moduli(work, k, c, frame, stress, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Replace the state by that at the end of the step."""
    spectral = principal_strains(work)
    c, strain, stress, way, plastic = np.empty(3), np.empty(3), np.empty(6), np.empty(6), np.empty(6)
    frame, back, after = np.empty((3, 3)), np.empty(6), np.empty(6)
    for k in range(np.uint64(POINTS)):
        take_frame(spectral, k, c, frame, strain)
        step, _, _ = _respond(work, k, constants, frame, strain, stress, way, plastic, back)
        # What does not flow keeps its digits.
        if step > 0.0:
            turn_back(plastic, frame, after)
            for m in range(6):
                work[np.uint64(POINTS * (FIBRE + m)) + k] = after[m]
            turn_back(back, frame, after)
            for m in range(6):
                work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k] = after[m]
            work[ROWS[FIBRE + 6] + k] += step
