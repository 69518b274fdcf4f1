"""Von Mises' plasticity by logarithmic strain, compiled: the return to the yield surface, in closed form if it can be.

Where the direction of flow stays, the back stress ``a`` with ``a' = 2/3 H e' - gamma a p'`` (P. J. Armstrong & C. O.
Frederick 1966; J. L. Chaboche, Int. J. Plasticity 5 (1989) 247-302) has the solution ``a(d) = exp(-gamma d) a +
sqrt(2/3) H (1 - exp(-gamma d))/gamma n`` of a plastic strain ``d``: a step is as exact as the direction ``n`` of its
end.  That ``n`` turns with ``exp(-gamma d) a`` makes the derivative of the stress not symmetric: the moduli are its
symmetric part.  With time the yield stress is ``1 + (d / (A t))^(1/n)`` times itself (Perzyna), at the end of the step.

Constants: shear modulus, kinematic modulus ``H``, ``gamma``, time ``t`` of the step, ``A`` (0 without such), ``1/n``,
number of points of the table, its plastic strains and yield stresses in turn, Lame's first parameter.  State: plastic
strain, six numbers, accumulated plastic strain, back stress, six numbers, and what was dissipated.
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
from isorod.material.relaxing_kernel import shares

_W = np.uint64(POINTS)

# Where the table stands, and in the state the back stress and what was dissipated.
_COUNT, _BACK, _DISSIPATED = 6, 7, 13

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
def _work(p: float, constants: Array) -> float:
    """Return the work of the yield stress up to an accumulated plastic strain."""
    count, work = int(constants[_COUNT]), 0.0
    for k in range(1, count):
        i = _COUNT - 1 + 2 * k
        p0, s0, p1, s1 = constants[i], constants[i + 1], constants[i + 2], constants[i + 3]
        along = min(max(p - p0, 0.0), p1 - p0)
        work += along * (s0 + 0.5 * along * (s1 - s0) / (p1 - p0))
    return work + max(p - constants[_COUNT - 1 + 2 * count], 0.0) * constants[_COUNT + 2 * count]


@njit(**FAST)
def _lost(d: float, p: float, forth: float, aa: float, constants: Array) -> float:
    """Return what a step of plastic strain ``d`` dissipates: work of the yield stress, and what the back stress loses.

    That is the integral of ``3 gamma/(2 H) a : a``; ``forth`` is ``n : a``, and ``aa`` is ``a : a``, before the return.
    """
    kinematic, recovery = constants[1], constants[2]
    lost = _work(p + d, constants) - _work(p, constants)
    if constants[4] > 0.0:
        lost *= 1.0 + (d / (constants[4] * constants[3])) ** constants[5]
    if recovery > 0.0:
        kept, share, rest = shares(recovery * d)
        back = 0.5 * (1.0 - kept * kept) * aa + np.sqrt(2.0 / 3.0) * kinematic * recovery * (share * d) ** 2 * forth
        lost += 1.5 / kinematic * (back + 2.0 / 3.0 * (kinematic * d) ** 2 * rest)
    return lost


@njit(**FAST)
def _try(work: Array, constants: Array, strain: Array, trace: Array, stress: Array, way: Array, size: Array) -> None:
    """Fill in stress and relative deviator of a step without flow, ``(6, POINTS)``, and the norm of the latter."""
    mu, lame = constants[0], constants[constants.size - 1]
    for k in range(_W):
        size[k] = 0.0
    # Short loops: the compiler sees which arrays lie apart.
    for m in range(6):
        row, square = np.uint64(POINTS * (FIBRE + m)), 1.0 if FIRST[m] == SECOND[m] else 0.0
        back = np.uint64(POINTS * (FIBRE + _BACK + m))
        for k in range(_W):
            stress[m, k] = 2.0 * mu * (strain[m, k] - work[row + k])
        for k in range(_W):
            way[m, k] = stress[m, k] - work[back + k] - 2.0 / 3.0 * square * mu * trace[k]
        for k in range(_W):
            stress[m, k] += square * lame * trace[k]
        for k in range(_W):
            size[k] += TWICE[m] * way[m, k] * way[m, k]
    for k in range(_W):
        size[k] = np.sqrt(size[k])


@njit(**FAST)
def _respond(
    work: Array, k: Any, constants: Array, stress: Array, way: Array, size: Array, after: Array
) -> tuple[float, float]:
    """Let a point flow whose stress is beyond the yield surface (`_try`).

    Parameters
    ----------
    stress, way, size
        To be replaced: stress and direction of flow at the end of the step, and norm of the deviator that returns;
        columns are points.
    after
        Where it flows to be filled with the state at the end.

    Returns
    -------
    step, slope
        Accumulated plastic strain of the step, and slope of `_excess` at its end.
    """
    mu, kinematic, recovery = constants[0], constants[1], constants[2]
    p, q = work[ROWS[FIBRE + 6] + k], np.sqrt(1.5) * size[k]
    # Tables do not fall: most points are done with their first stress.
    if not q > constants[_COUNT + 2]:
        return 0.0, -1.0
    rests = constants[4] > 0.0 and not constants[3] > 0.0
    if rests or not q > _yield_stress(p, constants)[0] * (1.0 + _ROUNDING):
        return 0.0, -1.0
    ss, sa, aa, forth, whole = 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(6):
        back = work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        before = way[m, k] + back
        ss, sa, aa = ss + TWICE[m] * before * before, sa + TWICE[m] * before * back, aa + TWICE[m] * back * back
    step, slope = _root(q, p, (ss, sa, aa), constants)
    kept, grown = np.exp(-recovery * step), -np.expm1(-recovery * step) / recovery if recovery > 0.0 else step
    for m in range(6):
        back = work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        way[m, k] += (1.0 - kept) * back
        whole += TWICE[m] * way[m, k] ** 2
    size[k] = np.sqrt(whole)
    for m in range(6):
        back = work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        way[m, k] /= size[k]
        forth += TWICE[m] * way[m, k] * back
        flown = np.sqrt(1.5) * step * way[m, k]
        stress[m, k] -= 2.0 * mu * flown
        after[m] = work[np.uint64(POINTS * (FIBRE + m)) + k] + flown
        after[_BACK + m] = kept * back + np.sqrt(2.0 / 3.0) * kinematic * grown * way[m, k]
    after[6] = p + step
    after[_DISSIPATED] = work[ROWS[FIBRE + _DISSIPATED] + k] + _lost(step, p, forth, aa, constants)
    return step, slope


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: that of the elastic strain and of kinematic hardening."""
    spectral, principal, strain = principal_strains(work), np.empty((3, POINTS)), np.empty((6, POINTS))
    stress, way, trace, size = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS), np.empty(POINTS)
    after = np.empty(_DISSIPATED + 1)
    take_strains(spectral, principal, strain, trace)
    _try(work, constants, strain, trace, stress, way, size)
    for k in range(_W):
        step, _ = _respond(work, k, constants, stress, way, size, after)
        if wanted:
            if not step > 0.0:
                for m in range(after.size):
                    after[m] = work[np.uint64(POINTS * (FIBRE + m)) + k]
            energy = 0.5 * constants[constants.size - 1] * trace[k] ** 2
            for m in range(6):
                energy += TWICE[m] * constants[0] * (strain[m, k] - after[m]) ** 2
                energy += TWICE[m] * 0.75 * after[_BACK + m] ** 2 / constants[1] if constants[1] > 0.0 else 0.0
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = energy, 0.0
            work[ROWS[LOST] + k] = after[_DISSIPATED]
    put_stress(work, spectral, principal, stress)


@njit(**FAST)
def _aside(
    work: Array, k: Any, constants: Array, way: Array, step: float, slope: float, less: float, across: Array
) -> None:
    """Fill in how the flow turns as its size grows: to what is left of the back stress before, across the flow."""
    recovery, forth = constants[2], 0.0
    factor = -less * recovery * np.sqrt(1.5) / slope * np.exp(-recovery * step)
    for m in range(6):
        across[m, k] = factor * work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        forth += TWICE[m] * across[m, k] * way[m, k]
    for m in range(6):
        across[m, k] -= forth * way[m, k]


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the symmetric part of the derivative of the stress at the end of the step."""
    spectral, principal, strain = principal_strains(work), np.empty((3, POINTS)), np.empty((6, POINTS))
    stress, way, trace, size = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS), np.empty(POINTS)
    turned, along = np.empty((6, POINTS)), np.empty((6, POINTS))
    across, crossed, after = np.zeros((6, POINTS)), np.zeros((6, POINTS)), np.empty(_DISSIPATED + 1)
    steps, slopes, less = np.empty(POINTS), np.empty(POINTS), np.zeros(POINTS)
    c, frame, own, moduli = np.empty(3), np.empty((3, 3)), np.empty(6), np.empty((6, 6))
    mu, recovery, lame = constants[0], constants[2], constants[constants.size - 1]
    take_strains(spectral, principal, strain, trace)
    _try(work, constants, strain, trace, stress, way, size)
    for k in range(_W):
        steps[k], slopes[k] = _respond(work, k, constants, stress, way, size, after)
        if steps[k] > 0.0:
            less[k] = 2.0 * mu * np.sqrt(1.5) * steps[k] / size[k]
            if recovery > 0.0:
                _aside(work, k, constants, way, steps[k], slopes[k], less[k], across)
    turn(stress, spectral, turned)
    turn(way, spectral, along)
    if recovery > 0.0:
        turn(across, spectral, crossed)
    for k in range(_W):
        take_frame(spectral, k, c, frame)
        back, forth = less[k], -3.0 * mu / slopes[k] - less[k]
        for m in range(6):
            own[m] = turned[m, k]
            for n in range(6):
                same = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
                both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
                moduli[m, n] = 2.0 * mu * (1.0 - back) * same + (lame + 2.0 * mu * back / 3.0) * both
                if steps[k] > 0.0:
                    moduli[m, n] -= 2.0 * mu * forth * along[m, k] * along[n, k]
                    moduli[m, n] -= mu * (crossed[m, k] * along[n, k] + along[m, k] * crossed[n, k])
        add_moduli(work, k, c, frame, own, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    spectral, principal, strain = principal_strains(work), np.empty((3, POINTS)), np.empty((6, POINTS))
    stress, way, trace, size = np.empty((6, POINTS)), np.empty((6, POINTS)), np.empty(POINTS), np.empty(POINTS)
    after = np.empty(_DISSIPATED + 1)
    take_strains(spectral, principal, strain, trace)
    _try(work, constants, strain, trace, stress, way, size)
    for k in range(_W):
        step, _ = _respond(work, k, constants, stress, way, size, after)
        if step > 0.0:
            for m in range(after.size):
                work[np.uint64(POINTS * (FIBRE + m)) + k] = after[m]
    put_stress(work, spectral, principal, stress)
