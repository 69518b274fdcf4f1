"""Solids that relax at large strains, compiled: neo-Hooke beside branches of neo-Hooke and a damper each.

With ``C`` free of volume the strain ``Ci`` of a branch's damper follows ``Ci' = (C - tr(C Ci^-1)/3 Ci)/tau`` (S. Reese
& S. Govindjee, Int. J. Solids Struct. 35 (1998) 3455-3482).  So ``g Ci`` is the integral of ``g C / tau``: where ``C``
goes straight from ``C0`` to ``C1`` in a step, its size free, ``Ci`` is

    Ci(0) exp(-y) + C0 (1 - exp(-y) - c) + C1 c,

made free of volume: two numbers, ``y' = r`` and ``c' = r (s - c)``, ``s`` the share of the step and ``r`` near 1.  They
follow in parts of the step, in each of which ``r`` is that of its middle: an error of second order,
and none of small strains, or of what part of the stress is left where nothing moves.

Constants: shear modulus, time of the step, number of branches, of each its share of that modulus and ``tau``, Lame's
first parameter.  State: ``C - 1`` free of volume at the start of the step, then ``Ci - 1`` of each branch, and what was
dissipated.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import exp, expm1, log
from isorod.material.logarithm_kernel import FIRST, PLACE, SECOND, TWICE, add_second
from isorod.material.points import ACTIVE, BLOCK, DETERMINANT, ENERGY, FIBRE, GRADIENT, LOST, POINTS, ROWS, TANGENT

# Parts of a step of one tau, and of any step at most: one step to anywhere, held at a stretch of 1.5, is then off by
# 4e-5 at the most, measured.
_PARTS, _MOST = 4, 8

# Share of a time of relaxation below which a step is told by a series.
_SHORT = 1e-3


@njit(**FAST)
def _inverse(a: Array, inverse: Array) -> float:
    """Fill in the inverse of a symmetric tensor and return its determinant."""
    inverse[0], inverse[1] = a[3] * a[5] - a[4] * a[4], a[2] * a[4] - a[1] * a[5]
    inverse[2], inverse[3] = a[1] * a[4] - a[2] * a[3], a[0] * a[5] - a[2] * a[2]
    inverse[4], inverse[5] = a[1] * a[2] - a[0] * a[4], a[0] * a[3] - a[1] * a[1]
    det = a[0] * inverse[0] + a[1] * inverse[1] + a[2] * inverse[2]
    for m in range(6):
        inverse[m] /= det
    return det


@njit(**FAST)
def _double(a: Array, b: Array) -> float:
    """Return ``a : b``."""
    total = 0.0
    for m in range(6):
        total += TWICE[m] * a[m] * b[m]
    return total


@njit(**FAST)
def _strains(work: Array, k: Any, c: Array, now: Array, before: Array) -> float:
    """Fill in ``C``, the same free of volume, and that at the start of the step; return ``J^(-2/3)``."""
    for m in range(6):
        A, B, total = FIRST[m], SECOND[m], 0.0
        for a in range(3):
            row = GRADIENT + 3 * a
            total += work[np.uint64(POINTS * (row + A)) + k] * work[np.uint64(POINTS * (row + B)) + k]
        c[m] = total
        before[m] = work[np.uint64(POINTS * (FIBRE + m)) + k] + (1.0 if A == B else 0.0)
    size = exp(-2.0 / 3.0 * log(work[ROWS[DETERMINANT] + k]))
    for m in range(6):
        now[m] = size * c[m]
    return size


@njit(**FAST)
def _mixed(w: float, c: float, old: Array, before: Array, now: Array, mixed: Array, inverse: Array) -> float:
    """Return the cube root of the determinant of what ``Ci`` is but for its size; fill in that and its inverse."""
    for m in range(6):
        mixed[m] = w * old[m] + (1.0 - w - c) * before[m] + c * now[m]
    return np.cbrt(_inverse(mixed, inverse))


@njit(**FAST)
def _rate(s: float, y: float, c: float, old: Array, before: Array, now: Array, room: Array, slopes: Array) -> float:
    """Return ``r``, and fill in its slopes by ``y``, by ``c``, and by the six of ``C1``, ``(8,)``."""
    path, mixed, inverse = room[0], room[1], room[2]
    for m in range(6):
        path[m] = (1.0 - s) * before[m] + s * now[m]
    size = np.cbrt(_inverse(path, inverse))
    for m in range(6):
        slopes[2 + m] = -s / 3.0 * inverse[m]
    w = exp(-y)
    rate = _mixed(w, c, old, before, now, mixed, inverse) / size
    slopes[0], slopes[1] = 0.0, 0.0
    for m in range(6):
        slopes[0] -= TWICE[m] * inverse[m] * w * (old[m] - before[m]) / 3.0
        slopes[1] += TWICE[m] * inverse[m] * (now[m] - before[m]) / 3.0
        slopes[2 + m] += c / 3.0 * inverse[m]
    for m in range(8):
        slopes[m] *= rate
    return rate


@njit(**FAST)
def _lagged(c: float, s: float, part: float, rho: float) -> tuple[float, float]:
    """Return what ``c`` is after ``c' = s - c`` over ``rho``, while ``s`` grows by a part, and its slope by ``rho``."""
    kept = exp(-rho)
    if rho > 1e-3:
        mean = -expm1(-rho) / rho
        slope = (kept - mean) / rho
    else:
        mean = 1.0 - rho * (0.5 - rho * (1.0 / 6.0 - rho / 24.0))
        slope = -0.5 + rho * (1.0 / 3.0 - rho * (0.125 - rho / 30.0))
    return kept * c + s + part - s * kept - part * mean, kept * (s - c) - part * slope


@njit(**FAST)
def _follow(
    h: float, old: Array, before: Array, now: Array, room: Array, slopes: Array, ways: Array, wanted: bool
) -> tuple[float, float]:
    """Return ``y`` and ``c`` at the end of a step of ``h`` times ``tau``; fill in, if wanted, slopes by ``C1``."""
    count = 1 + int(min(_PARTS * h, _MOST - 1.0))
    y, c, part, half = 0.0, 0.0, 1.0 / count, room[3:]
    ways[:] = 0.0
    for k in range(count):
        s = k * part
        rho = 0.5 * part * h * _rate(s, y, c, old, before, now, room, slopes)
        middle, slope = _lagged(c, s, 0.5 * part, rho)
        if wanted:
            kept = exp(-rho)
            for m in range(6):
                change = 0.5 * part * h * (slopes[0] * ways[0, m] + slopes[1] * ways[1, m] + slopes[2 + m])
                half[0, m], half[1, m] = ways[0, m] + change, kept * ways[1, m] + slope * change
        rho = part * h * _rate(s + 0.5 * part, y + rho, middle, old, before, now, room, slopes)
        new, slope = _lagged(c, s, part, rho)
        if wanted:
            kept = exp(-rho)
            for m in range(6):
                change = part * h * (slopes[0] * half[0, m] + slopes[1] * half[1, m] + slopes[2 + m])
                ways[0, m] += change
                ways[1, m] = kept * ways[1, m] + slope * change
        y, c = y + rho, new
    return y, c


@njit(**FAST)
def _branch(
    work: Array,
    k: Any,
    constants: Array,
    which: int,
    before: Array,
    now: Array,
    old: Array,
    mixed: Array,
    inverse: Array,
    room: Array,
    slopes: Array,
    ways: Array,
    wanted: bool,
) -> tuple[float, float, float]:
    """Fill in ``Ci`` at the start of the step, at its end but for its size, and the inverse of this.

    Returns
    -------
    y, c, size
        Of the step, and what the inverse has to be multiplied by to be free of volume.
    """
    for m in range(6):
        row = FIBRE + 6 + 6 * which + m
        old[m] = work[np.uint64(POINTS * row) + k] + (1.0 if FIRST[m] == SECOND[m] else 0.0)
    y, c = _follow(constants[1] / constants[4 + 2 * which], old, before, now, room, slopes, ways, wanted)
    return y, c, _mixed(exp(-y), c, old, before, now, mixed, inverse)


@njit(**FAST)
def _second(pressure: float, size: float, c: Array, stress: Array, other: Array, second: Array) -> float:
    """Fill in ``C^-1`` and ``S`` of a stress for ``C`` free of volume; return a third of this ``: C``."""
    _inverse(c, other)
    third = size * _double(stress, c) / 3.0
    for m in range(6):
        second[m] = size * stress[m] + (pressure - third) * other[m]
    return third


@njit(**FAST)
def _product(one: Array, other: Array, product: Array) -> None:
    """Fill in the product ``(3, 3)`` of two symmetric tensors."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += one[PLACE[i, k]] * other[PLACE[k, j]]
            product[i, j] = total


@njit(**FAST)
def _twofold(one: Array, other: Array, share: float) -> float:
    """Return ``tr(one other) - share tr(one) tr(other)``."""
    total, left, right = 0.0, 0.0, 0.0
    for i in range(3):
        left, right = left + one[i, i], right + other[i, i]
        for j in range(3):
            total += one[i, j] * other[j, i]
    return total - share * left * right


@njit(**FAST)
def shares(x: float) -> tuple[float, float, float]:
    """Return what a time ``x``, in times of relaxation, leaves, by how much the strain adds, and a share lost."""
    kept, share = np.exp(-x), -np.expm1(-x) / x if x > 1e-8 else 1.0 - 0.5 * x
    # Digits cancel in short steps.
    rest = x / 3.0 - x**2 / 4.0 + 7.0 / 60.0 * x**3 if x < _SHORT else (1.0 - share) / x - 0.5 * share**2
    return kept, share, rest


@njit(**FAST)
def _lost(x: float, root: float, before: Array, now: Array, old: Array, mixed: Array, inverse: Array) -> float:
    """Return what a branch of shear modulus 1 dissipates in a step of ``x`` times ``tau``.

    It is what the spring would lose if the damper went its way at the middle of the strain's, and what is wrong with
    that in small strains: exact there, and where nothing moves.
    """
    start, change, first, second = np.empty(6), np.empty(6), np.empty((3, 3)), np.empty((3, 3))
    _inverse(old, start)
    for m in range(6):
        change[m] = mixed[m] / root - old[m]
    # The trace of Ci(0)^-1 Ci - 1, from its other invariants: of determinants that are 1 digits would cancel.
    _product(start, change, first)
    det = first[0, 0] * (first[1, 1] * first[2, 2] - first[1, 2] * first[2, 1])
    det -= first[0, 1] * (first[1, 0] * first[2, 2] - first[1, 2] * first[2, 0])
    det += first[0, 2] * (first[1, 0] * first[2, 1] - first[1, 1] * first[2, 0])
    lost = 0.25 * _twofold(first, first, 1.0) - 0.5 * det
    for m in range(6):
        change[m] = root * (0.5 * (before[m] + now[m]) - mixed[m] / root)
    # Ci(0)^-1 - Ci^-1 is Ci(0)^-1 (Ci - Ci(0)) Ci^-1.
    _product(inverse, change, second)
    lost += 0.5 * _twofold(first, second, 0.0)
    for m in range(6):
        start[m], change[m] = 0.5 * root * (before[m] - old[m]), 0.5 * root * (now[m] - before[m])
    _product(inverse, start, first)
    _product(inverse, change, second)
    kept, share, rest = shares(x)
    lost -= (1.0 + kept - 2.0 * share) * _twofold(first, second, 1.0 / 3.0)
    return lost - (share * (1.0 - share) - 2.0 * rest) * _twofold(second, second, 1.0 / 3.0)


@njit(**FAST)
def _put(work: Array, k: Any, second: Array) -> None:
    """Fill the rows of ``P`` at a point from the second Piola-Kirchhoff stress."""
    valid = 1.0 if work[ROWS[DETERMINANT] + k] > 0.0 else np.nan
    for a in range(3):
        for A in range(3):
            total = 0.0
            for B in range(3):
                total += work[np.uint64(POINTS * (GRADIENT + 3 * a + B)) + k] * second[PLACE[B, A]]
            work[np.uint64(POINTS * (3 * a + A)) + k] = valid * total


@njit(**FAST)
def _go(work: Array, constants: Array, wanted: bool, goes_on: bool) -> None:
    """Fill in the stress, if wanted the energy, what springs store, and the loss; or let the state go on."""
    c, now, before, old, mixed, inverse = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    stress, second = np.empty(6), np.empty(6)
    room, slopes, ways = np.empty((5, 6)), np.empty(8), np.empty((2, 6))
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    dissipated = np.uint64(POINTS * (FIBRE + 6 + 6 * count))
    for k in range(np.uint64(POINTS)):
        size = _strains(work, k, c, now, before)
        stored, rest, lost = 0.0, 1.0, work[dissipated + k]
        stress[:] = 0.0
        for i in range(count):
            share = constants[3 + 2 * i]
            _, _, root = _branch(work, k, constants, i, before, now, old, mixed, inverse, room, slopes, ways, False)
            for m in range(6):
                stress[m] += share * mu * root * inverse[m]
            if wanted or goes_on:
                lost += share * mu * _lost(constants[1] / constants[4 + 2 * i], root, before, now, old, mixed, inverse)
            stored += 0.5 * share * mu * (root * _double(inverse, now) - 3.0)
            rest -= share
            if goes_on:
                for m in range(6):
                    one = 1.0 if FIRST[m] == SECOND[m] else 0.0
                    work[np.uint64(POINTS * (FIBRE + 6 + 6 * i + m)) + k] = mixed[m] / root - one
        stored += 0.5 * rest * mu * (now[0] + now[3] + now[5] - 3.0)
        for m in range(6):
            stress[m] += rest * mu if FIRST[m] == SECOND[m] else 0.0
        volume = log(work[ROWS[DETERMINANT] + k])
        bulk = lame + 2.0 / 3.0 * mu
        _second(bulk * volume, size, c, stress, inverse, second)
        _put(work, k, second)
        if wanted:
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = stored + 0.5 * bulk * volume**2, 0.0
            work[ROWS[LOST] + k] = lost
        if goes_on:
            work[dissipated + k] = lost
            for m in range(6):
                work[np.uint64(POINTS * (FIBRE + m)) + k] = now[m] - (1.0 if FIRST[m] == SECOND[m] else 0.0)


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and if wanted the energy: what springs store."""
    _go(work, constants, wanted, False)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the symmetric part of the derivative of the stress at the end of the step."""
    c, now, before, old, mixed, inverse = np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    stress, second, frame = np.empty(6), np.empty(6), np.eye(3)
    room, slopes, ways = np.empty((5, 6)), np.empty(8), np.empty((2, 6))
    bent, moduli, way, turned = np.empty((6, 6)), np.empty((6, 6)), np.empty((2, 6)), np.empty((2, 6))
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    for k in range(np.uint64(POINTS)):
        size = _strains(work, k, c, now, before)
        bent[:], stress[:] = 0.0, 0.0
        rest = 1.0
        for i in range(count):
            share = constants[3 + 2 * i] * mu
            rest -= constants[3 + 2 * i]
            y, lag, root = _branch(work, k, constants, i, before, now, old, mixed, inverse, room, slopes, ways, True)
            w = exp(-y)
            # What grows with y and with c, and that between two inverses.
            for m in range(6):
                stress[m] += share * root * inverse[m]
                way[0, m], way[1, m] = -w * (old[m] - before[m]), now[m] - before[m]
            for j in range(2):
                _between(inverse, way[j], turned[j])
                trace = _double(inverse, way[j]) / 3.0
                for m in range(6):
                    turned[j, m] = trace * inverse[m] - turned[j, m]
            for m in range(6):
                a, b = FIRST[m], SECOND[m]
                for n in range(6):
                    p, q = FIRST[n], SECOND[n]
                    crossed = inverse[PLACE[a, p]] * inverse[PLACE[b, q]]
                    crossed += inverse[PLACE[a, q]] * inverse[PLACE[b, p]]
                    change = lag * (inverse[m] * inverse[n] / 3.0 - 0.5 * crossed)
                    change += turned[0, m] * ways[0, n] + turned[1, m] * ways[1, n]
                    bent[m, n] += share * root * change
        for m in range(6):
            stress[m] += rest * mu if FIRST[m] == SECOND[m] else 0.0
        bulk = lame + 2.0 / 3.0 * mu
        pressure = bulk * log(work[ROWS[DETERMINANT] + k])
        third = _second(pressure, size, c, stress, inverse, second)
        _isochoric(size, bulk, pressure, third, c, inverse, second, bent, moduli)
        add_second(work, k, frame, second, moduli)


@njit(**FAST)
def _between(inverse: Array, one: Array, found: Array) -> None:
    """Fill in ``inverse one inverse``."""
    for m in range(6):
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += inverse[PLACE[FIRST[m], i]] * one[PLACE[i, j]] * inverse[PLACE[j, SECOND[m]]]
        found[m] = total


@njit(**FAST)
def _isochoric(
    size: float,
    bulk: float,
    pressure: float,
    third: float,
    c: Array,
    inverse: Array,
    second: Array,
    bent: Array,
    moduli: Array,
) -> None:
    """Fill in ``dS/dG`` from the slopes ``bent`` of the stress by ``C`` free of volume (Holzapfel 2000, 6.4)."""
    by_rows, whole = np.empty(6), 0.0
    for m in range(6):
        for n in range(m + 1, 6):
            bent[m, n] = 0.5 * (bent[m, n] + bent[n, m])
            bent[n, m] = bent[m, n]
    for m in range(6):
        by_rows[m] = _double(bent[m], c) / 3.0
        whole += TWICE[m] * by_rows[m] * c[m] / 3.0
    for m in range(6):
        a, b = FIRST[m], SECOND[m]
        for n in range(6):
            p, q = FIRST[n], SECOND[n]
            crossed = 0.5 * inverse[PLACE[a, p]] * inverse[PLACE[b, q]]
            crossed += 0.5 * inverse[PLACE[a, q]] * inverse[PLACE[b, p]]
            both = inverse[m] * inverse[n]
            left, right = second[m] - pressure * inverse[m], second[n] - pressure * inverse[n]
            shape = bent[m, n] - by_rows[m] * inverse[n] - inverse[m] * by_rows[n] + whole * both
            value = 2.0 * size * size * shape + 2.0 * third * (crossed - both / 3.0)
            value -= 2.0 / 3.0 * (inverse[m] * right + left * inverse[n])
            moduli[m, n] = value + bulk * both - 2.0 * pressure * crossed


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    _go(work, constants, False, True)
