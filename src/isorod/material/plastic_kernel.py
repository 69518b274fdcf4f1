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
from isorod.material.functions import expm1
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
from isorod.material.relaxing_kernel import shares

_W = np.uint64(POINTS)

# Rows of a block: the direction of flow, or before that is known the deviator that returns; its norm; accumulated
# plastic strain of the step, and the slope of `_excess` at its end; what the step dissipates; which share of the back
# stress goes, and that over ``gamma``.
_WAY, _SIZE, _FLOWN, _SLOPE, _LOSS, _GONE, _GROWN, _ROWS = LOGARITHM, *(LOGARITHM + 6 + m for m in range(7))

# Where the table stands, and in the state the back stress and what was dissipated.
_COUNT, _BACK, _DISSIPATED = 6, 7, 13

# Of the yield stress, above which a stress has to be to flow: the rest is rounding.
_ROUNDING = 1e-12

# Newton's steps to the root, or halvings of where it lies, at most, and by which share of it the last one may move: the
# square of that is rounding.
_STEPS, _NEAR = 100, 1e-9


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
        if abs(new - d) <= _NEAR * d:
            d = new
            break
        d = new if low < new < high else 0.5 * (low + high)
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
def _try(work: Array, constants: Array, rows: Array) -> None:
    """Fill in the stress of a step without flow, and its deviator about the back stress with its norm."""
    mu, lame = constants[0], constants[constants.size - 1]
    for k in range(_W):
        rows[at(_SIZE) + k] = 0.0
    # Short loops: the compiler sees which rows lie apart.
    for m in range(6):
        row, square = np.uint64(POINTS * (FIBRE + m)), 1.0 if FIRST[m] == SECOND[m] else 0.0
        back = np.uint64(POINTS * (FIBRE + _BACK + m))
        for k in range(_W):
            deviator = 2.0 * mu * (rows[at(STRAIN + m) + k] - work[row + k])
            rows[at(TENSION + m) + k] = deviator + square * lame * rows[at(TRACE) + k]
            rows[at(_WAY + m) + k] = deviator - work[back + k] - 2.0 / 3.0 * square * mu * rows[at(TRACE) + k]
        for k in range(_W):
            rows[at(_SIZE) + k] += TWICE[m] * rows[at(_WAY + m) + k] * rows[at(_WAY + m) + k]
    for k in range(_W):
        rows[at(_SIZE) + k] = np.sqrt(rows[at(_SIZE) + k])


@njit(**FAST)
def _step(work: Array, k: Any, constants: Array, rows: Array) -> bool:
    """Fill in the plastic strain of a step at a point, and what comes with it; return whether it flows."""
    p, q = work[ROWS[FIBRE + 6] + k], np.sqrt(1.5) * rows[at(_SIZE) + k]
    if not q > _yield_stress(p, constants)[0] * (1.0 + _ROUNDING):
        return False
    aa, sa, ss = 0.0, 0.0, rows[at(_SIZE) + k] ** 2
    if constants[2] > 0.0:
        for m in range(6):
            back = work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
            sa, aa = sa + TWICE[m] * rows[at(_WAY + m) + k] * back, aa + TWICE[m] * back * back
        ss, sa = ss + 2.0 * sa + aa, sa + aa
    step, slope = _root(q, p, (ss, sa, aa), constants)
    # The deviator that returns is s - kept a, and this of it along a.
    kept = np.exp(-constants[2] * step) if constants[2] > 0.0 else 1.0
    forth = (sa - kept * aa) / np.sqrt(max(ss - 2.0 * kept * sa + kept * kept * aa, 1e-300))
    rows[at(_FLOWN) + k], rows[at(_SLOPE) + k], rows[at(_LOSS) + k] = step, slope, _lost(step, p, forth, aa, constants)
    return True


@njit(**FAST)
def _respond(work: Array, constants: Array, rows: Array) -> int:
    """Fill in stress, direction of flow and what else there is at the end of the step; return the Gauss points' rule.

    Where nothing flows the direction is not of length 1 (`_try`).
    """
    mu, recovery = constants[0], constants[2]
    rule, beyond, flows = strains(work, rows), 0.0, False
    _try(work, constants, rows)
    for k in range(_W):
        rows[at(_FLOWN) + k], rows[at(_SLOPE) + k], rows[at(_LOSS) + k] = 0.0, -1.0, 0.0
        rows[at(_GONE) + k], rows[at(_GROWN) + k] = 0.0, 0.0
        # Tables do not fall: most points are done with their first stress.
        beyond += 1.0 if np.sqrt(1.5) * rows[at(_SIZE) + k] > constants[_COUNT + 2] else 0.0
    if beyond == 0.0 or (constants[4] > 0.0 and not constants[3] > 0.0):
        return rule
    for k in range(_W):
        flows = _step(work, k, constants, rows) or flows
    if not flows:
        return rule
    for k in range(_W):
        gone = -expm1(-recovery * rows[at(_FLOWN) + k])
        rows[at(_GONE) + k] = gone
        rows[at(_GROWN) + k] = gone / recovery if recovery > 0.0 else rows[at(_FLOWN) + k]
        rows[at(_SIZE) + k] = 0.0
    for m in range(6):
        way, back = at(_WAY + m), at(FIBRE + _BACK + m)
        for k in range(_W):
            rows[way + k] += rows[at(_GONE) + k] * work[back + k]
        for k in range(_W):
            rows[at(_SIZE) + k] += TWICE[m] * rows[way + k] * rows[way + k]
    for k in range(_W):
        size, flown = np.sqrt(rows[at(_SIZE) + k]), rows[at(_FLOWN) + k]
        rows[at(_SIZE) + k] = size if flown > 0.0 else 1.0
    for m in range(6):
        way, stress = at(_WAY + m), at(TENSION + m)
        for k in range(_W):
            rows[way + k] /= rows[at(_SIZE) + k]
        for k in range(_W):
            rows[stress + k] -= 2.0 * mu * np.sqrt(1.5) * rows[at(_FLOWN) + k] * rows[way + k]
    return rule


@njit(**FAST)
def _back(work: Array, k: Any, constants: Array, rows: Array, m: int) -> float:
    """Return a component of the back stress at the end of the step."""
    left = (1.0 - rows[at(_GONE) + k]) * work[at(FIBRE + _BACK + m) + k]
    return left + np.sqrt(2.0 / 3.0) * constants[1] * rows[at(_GROWN) + k] * rows[at(_WAY + m) + k]


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: that of the elastic strain and of kinematic hardening."""
    rows = np.empty(_ROWS * POINTS)
    _respond(work, constants, rows)
    put_stress(work, rows)
    if not wanted:
        return
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    for k in range(_W):
        work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = 0.5 * lame * rows[at(TRACE) + k] ** 2, 0.0
        work[ROWS[LOST] + k] = work[ROWS[FIBRE + _DISSIPATED] + k] + rows[at(_LOSS) + k]
    for m in range(6):
        square = 1.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            elastic = rows[at(TENSION + m) + k] - square * lame * rows[at(TRACE) + k]
            work[ROWS[ENERGY] + k] += TWICE[m] * 0.25 / mu * elastic * elastic
        if kinematic > 0.0:
            for k in range(_W):
                work[ROWS[ENERGY] + k] += TWICE[m] * 0.75 / kinematic * _back(work, k, constants, rows, m) ** 2


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the symmetric part of the derivative of the stress at the end of the step."""
    rows, moduli, across = np.empty(_ROWS * POINTS), np.empty(36 * POINTS), np.zeros(6 * POINTS)
    mu, recovery, lame = constants[0], constants[2], constants[constants.size - 1]
    rule = _respond(work, constants, rows)
    for k in range(_W):
        step, slope = rows[at(_FLOWN) + k], rows[at(_SLOPE) + k]
        # By how much less the deviator grows across the flow, and along it.
        rows[at(_LOSS) + k] = 2.0 * mu * np.sqrt(1.5) * step / rows[at(_SIZE) + k] if step > 0.0 else 0.0
        rows[at(_SLOPE) + k] = -3.0 * mu / slope - rows[at(_LOSS) + k] if step > 0.0 else 0.0
        if recovery > 0.0 and step > 0.0:
            _aside(work, k, constants, rows, rows[at(_LOSS) + k], slope, across)
    for m in range(6):
        for n in range(6):
            same = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
            both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
            for k in range(_W):
                less = rows[at(_LOSS) + k]
                value = 2.0 * mu * (1.0 - less) * same + (lame + 2.0 * mu * less / 3.0) * both
                value -= 2.0 * mu * rows[at(_SLOPE) + k] * rows[at(_WAY + m) + k] * rows[at(_WAY + n) + k]
                value -= mu * (across[at(m) + k] * rows[at(_WAY + n) + k] + rows[at(_WAY + m) + k] * across[at(n) + k])
                moduli[at(6 * m + n) + k] = value
    add_moduli(work, rows, rule, moduli)


@njit(**FAST)
def _aside(work: Array, k: Any, constants: Array, rows: Array, less: float, slope: float, across: Array) -> None:
    """Fill in how the flow turns as its size grows: to what is left of the back stress before, across the flow."""
    recovery, forth = constants[2], 0.0
    factor = -less * recovery * np.sqrt(1.5) / slope * np.exp(-recovery * rows[at(_FLOWN) + k])
    for m in range(6):
        across[at(m) + k] = factor * work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        forth += TWICE[m] * across[at(m) + k] * rows[at(_WAY + m) + k]
    for m in range(6):
        across[at(m) + k] -= forth * rows[at(_WAY + m) + k]


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    rows, flown = np.empty(_ROWS * POINTS), 0.0
    _respond(work, constants, rows)
    put_stress(work, rows)
    for k in range(_W):
        flown += rows[at(_FLOWN) + k]
    if not flown > 0.0:
        return
    for m in range(6):
        row, back = np.uint64(POINTS * (FIBRE + m)), np.uint64(POINTS * (FIBRE + _BACK + m))
        for k in range(_W):
            work[row + k] += np.sqrt(1.5) * rows[at(_FLOWN) + k] * rows[at(_WAY + m) + k]
        if constants[1] > 0.0:
            for k in range(_W):
                work[back + k] = _back(work, k, constants, rows, m)
    for k in range(_W):
        work[ROWS[FIBRE + 6] + k] += rows[at(_FLOWN) + k]
        work[ROWS[FIBRE + _DISSIPATED] + k] += rows[at(_LOSS) + k]
