"""Viscoelasticity at large strains, compiled: a neo-Hookean spring in parallel with Maxwell branches.

With ``C`` free of volume the strain ``Ci`` of a branch's damper follows ``Ci' = (C - tr(C Ci^-1)/3 Ci)/tau`` (S. Reese
& S. Govindjee, Int. J. Solids Struct. 35 (1998) 3455-3482).  So ``g Ci`` is the integral of ``g C / tau``: if ``C``
goes straight from ``C0`` to ``C1`` in a step, up to its size, ``Ci`` is

    Ci(0) exp(-y) + C0 (1 - exp(-y) - c) + C1 c,

made isochoric: two numbers, ``y' = r`` and ``c' = r (s - c)``, ``s`` the fraction of the step and ``r`` near 1.  They
are integrated over substeps with ``r`` at midpoints: an error of second order, and none in small strains or in
relaxation at constant strain.

Constants: shear modulus, time of the step, number of branches, of each its fraction of that modulus and ``tau``, Lame's
first parameter.  State: isochoric ``C - 1`` at the start of the step, ``Ci - 1`` of each branch, the dissipated energy.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import exp, expm1, log, power, ramp_fractions
from isorod.material.logarithm_kernel import add_second
from isorod.material.points import ACTIVE, BLOCK, DETERMINANT, ENERGY, FIBRE, LOST, OWN, POINTS, ROWS, TANGENT
from isorod.material.six_kernel import (
    FIRST,
    PLACE,
    SECOND,
    TWICE,
    Six,
    at,
    combined,
    double,
    gradient,
    inverted,
    product,
    put_first,
    put_six,
    six,
    squares,
    symmetric,
    trace_of,
)

# Substeps of a step of one tau, and of any step at most: the error of one step to a stretch of 1.5, held, is then at
# most 4e-5, measured.
_PARTS, _MOST = 4, 8

# Distance of cubes from 1, and times in relaxation times, up to which a few terms of a series are right to rounding.
_SHORT, _NEAR = 1e-3, 5e-3

_W = np.uint64(POINTS)
_ONE = (1.0, 0.0, 0.0, 1.0, 0.0, 1.0)

# Rows of a block: C, isochoric C, that at the start of the step, the stress conjugate to isochoric C, the second
# Piola-Kirchhoff stress, a third of the former stress : C, J^(-2/3), ln J, energy and loss.
_C, _NOW, _BEFORE, _STRESS, _SECOND = (OWN + 6 * m for m in range(5))
_THIRD, _SIZE, _VOLUME, _STORED, _LOSS, _BRANCH = (OWN + 30 + m for m in range(6))
# Of a branch: Ci at the start of the step and at its end, the inverse of the latter before it is made isochoric, and
# the cube root of its determinant; 1 - exp(-y) and c, the same at the middle of a substep, r, and the results of
# `_lag`.
_OLD, _NEW, _INVERSE, _ROOT, _Y, _MIDDLE = (_BRANCH + m for m in (0, 6, 12, 18, 19, 21))
_RATE, _GONE, _MEAN, _SLOPE, _SLOPES = (_BRANCH + 23 + m for m in range(5))
# For moduli: slopes of r by y, by c and by C1, those of y and c by C1, also at the middle of a substep, and derivatives
# of the inverse by y and c.
_BY_C, _HALF, _TURNED = _SLOPES + 8, _SLOPES + 20, _SLOPES + 32


@njit(**FAST)
def _begin(work: Array, constants: Array) -> None:
    """Fill in ``C``, isochoric ``C``, that at the start of the step, and stress and energy without branches."""
    rest, mu = 1.0, constants[0]
    for i in range(int(constants[2])):
        rest -= constants[3 + 2 * i]
    for k in range(_W):
        c, volume = squares(gradient(work, k)), log(work[ROWS[DETERMINANT] + k])
        size = exp(-2.0 / 3.0 * volume)
        now = combined(size, c, 0.0, c, 0.0, c)
        put_six(work, _C, k, c)
        put_six(work, _NOW, k, now)
        put_six(work, _STRESS, k, combined(rest * mu, _ONE, 0.0, _ONE, 0.0, _ONE))
        work[at(_SIZE) + k], work[at(_VOLUME) + k] = size, volume
        work[at(_STORED) + k] = 0.5 * rest * mu * (now[0] + now[3] + now[5] - 3.0)
    _read_tensor(work, FIBRE, _BEFORE)


@njit(**FAST)
def _read_tensor(work: Array, first: int, to: int) -> None:
    """Fill in a tensor from rows of the state, from ``first`` on, which hold it minus the identity."""
    for m in range(6):
        row, unit = np.uint64(POINTS * (first + m)), 1.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            work[at(to + m) + k] = work[row + k] + unit


@njit(**FAST)
def _mixed(work: Array, k: Any, gone: float, c: float) -> Six:
    """Return ``Ci`` at a point before it is made isochoric."""
    return combined(1.0 - gone, six(work, _OLD, k), gone - c, six(work, _BEFORE, k), c, six(work, _NOW, k))


@njit(**FAST)
def _take_root(work: Array, row: int) -> None:
    """Replace a row by its cube roots, by a series in short steps, where all are near 1."""
    far = 0.0
    for k in range(_W):
        far += 0.0 if abs(work[at(row) + k] - 1.0) < _SHORT else 1.0
    if far > 0.0:
        for k in range(_W):
            work[at(row) + k] = power(work[at(row) + k], 1.0 / 3.0)
    else:
        for k in range(_W):
            x = work[at(row) + k] - 1.0
            rest = 5.0 / 81.0 - x * (10.0 / 243.0 - x * (22.0 / 729.0))
            work[at(row) + k] = 1.0 + x * (1.0 / 3.0 - x * (1.0 / 9.0 - x * rest))


@njit(**FAST)
def _lag(time: float, work: Array) -> None:
    """Fill in ``1 - exp(-x)``, that over ``x``, and the quotient's slope by ``x``; ``x`` is ``r`` times a time."""
    far = 0.0
    for k in range(_W):
        x = time * work[at(_RATE) + k]
        mean = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x * (1.0 / 120.0 - x * (1.0 / 720.0)))))
        slope = -0.5 + x * (1.0 / 3.0 - x * (0.125 - x * (1.0 / 30.0 - x * (1.0 / 144.0 - x * (1.0 / 840.0)))))
        work[at(_GONE) + k], work[at(_MEAN) + k], work[at(_SLOPE) + k] = x * mean, mean, slope
        far += 0.0 if x < _NEAR else 1.0
    if far > 0.0:
        for k in range(_W):
            x = time * work[at(_RATE) + k]
            gone, over = -expm1(-x), max(x, _NEAR)
            mean = gone / over if x >= _NEAR else work[at(_MEAN) + k]
            work[at(_SLOPE) + k] = (1.0 - gone - mean) / over if x >= _NEAR else work[at(_SLOPE) + k]
            work[at(_GONE) + k], work[at(_MEAN) + k] = gone, mean


@njit(**FAST)
def _rate(s: float, work: Array, where: int, with_slopes: bool) -> None:
    """Fill in ``r`` of the ``y`` and ``c`` in two rows, and on demand its slopes by these and by the six of ``C1``."""
    for k in range(_W):
        now = six(work, _NOW, k)
        _, path = inverted(combined(1.0 - s, six(work, _BEFORE, k), s, now, 0.0, now))
        _, det = inverted(_mixed(work, k, work[at(where) + k], work[at(where + 1) + k]))
        work[at(_RATE) + k] = det / path
    _take_root(work, _RATE)
    if not with_slopes:
        return
    for k in range(_W):
        old, before, now = six(work, _OLD, k), six(work, _BEFORE, k), six(work, _NOW, k)
        gone, c, rate = work[at(where) + k], work[at(where + 1) + k], work[at(_RATE) + k] / 3.0
        path, _ = inverted(combined(1.0 - s, before, s, now, 0.0, now))
        inverse, _ = inverted(_mixed(work, k, gone, c))
        work[at(_SLOPES) + k] = -rate * (1.0 - gone) * double(inverse, combined(1.0, old, -1.0, before, 0.0, now))
        work[at(_SLOPES + 1) + k] = rate * double(inverse, combined(1.0, now, -1.0, before, 0.0, old))
        put_six(work, _SLOPES + 2, k, combined(rate * c, inverse, -rate * s, path, 0.0, now))


@njit(**FAST)
def _go_on(time: float, s: float, part: float, work: Array, to: int) -> None:
    """Fill in ``1 - exp(-y)`` and ``c`` after a time at the rate ``r``, and the slope of ``c`` by ``y``.

    ``c' = s - c``, while ``s`` grows by ``part``.
    """
    _lag(time, work)
    for k in range(_W):
        y, c, gone, mean = work[at(_Y) + k], work[at(_Y + 1) + k], work[at(_GONE) + k], work[at(_MEAN) + k]
        work[at(to) + k] = y + (1.0 - y) * gone
        work[at(to + 1) + k] = c + (s - c) * gone + part * (1.0 - mean)
        work[at(_SLOPE) + k] = (1.0 - gone) * (s - c) - part * work[at(_SLOPE) + k]


@njit(**FAST)
def _carry(work: Array, time: float, start: int, to: int) -> None:
    """Fill in the slopes of ``y`` and ``c`` by ``C1`` after a time, from those where the rate is evaluated."""
    for m in range(6):
        for k in range(_W):
            first, second = (
                work[at(_SLOPES) + k] * work[at(start + m) + k],
                work[at(_SLOPES + 1) + k] * work[at(start + 6 + m) + k],
            )
            change = time * (first + second + work[at(_SLOPES + 2 + m) + k])
            kept = 1.0 - work[at(_GONE) + k]
            work[at(to + 6 + m) + k] = kept * work[at(_BY_C + 6 + m) + k] + work[at(_SLOPE) + k] * change
            work[at(to + m) + k] = work[at(_BY_C + m) + k] + change


@njit(**FAST)
def _follow(h: float, work: Array, with_slopes: bool) -> None:
    """Fill in ``y`` and ``c`` at the end of a step of ``h`` times ``tau``, and on demand their slopes by ``C1``."""
    count = 1 + int(min(_PARTS * h, _MOST - 1.0))
    part = 1.0 / count
    # At the start all tensors are isochoric.
    for k in range(_W):
        work[at(_Y) + k], work[at(_Y + 1) + k], work[at(_RATE) + k] = 0.0, 0.0, 1.0
    if with_slopes:
        for m in range(24):
            for k in range(_W):
                work[at(_BY_C + m) + k] = 0.0
    for p in range(count):
        s = p * part
        if p > 0:
            _rate(s, work, _Y, with_slopes)
        _go_on(0.5 * part * h, s, 0.5 * part, work, _MIDDLE)
        if with_slopes and p > 0:
            _carry(work, 0.5 * part * h, _BY_C, _HALF)
        _rate(s + 0.5 * part, work, _MIDDLE, with_slopes)
        _go_on(part * h, s, part, work, _Y)
        if with_slopes:
            _carry(work, part * h, _HALF, _BY_C)


@njit(**FAST)
def _branch(work: Array, constants: Array, which: int, with_slopes: bool) -> None:
    """Fill in the rows of a branch, and add its stress; on demand with slopes by ``C1``."""
    _read_tensor(work, FIBRE + 6 + 6 * which, _OLD)
    _follow(constants[1] / constants[4 + 2 * which], work, with_slopes)
    modulus = constants[0] * constants[3 + 2 * which]
    for k in range(_W):
        mixed = _mixed(work, k, work[at(_Y) + k], work[at(_Y + 1) + k])
        inverse, det = inverted(mixed)
        put_six(work, _NEW, k, mixed)
        put_six(work, _INVERSE, k, inverse)
        work[at(_ROOT) + k] = det
    _take_root(work, _ROOT)
    for k in range(_W):
        mixed, inverse, root = six(work, _NEW, k), six(work, _INVERSE, k), work[at(_ROOT) + k]
        put_six(work, _NEW, k, combined(1.0 / root, mixed, 0.0, mixed, 0.0, mixed))
        put_six(work, _STRESS, k, combined(1.0, six(work, _STRESS, k), modulus * root, inverse, 0.0, mixed))
        work[at(_STORED) + k] += 0.5 * modulus * (root * double(inverse, six(work, _NOW, k)) - 3.0)


@njit(**FAST)
def _second(work: Array, constants: Array) -> None:
    """Fill in ``S``, and the inverse of ``C`` in the rows of a branch's inverse."""
    bulk = constants[constants.size - 1] + 2.0 / 3.0 * constants[0]
    for k in range(_W):
        c, stress, size = six(work, _C, k), six(work, _STRESS, k), work[at(_SIZE) + k]
        inverse, _ = inverted(c)
        third, pressure = size * double(stress, c) / 3.0, bulk * work[at(_VOLUME) + k]
        put_six(work, _INVERSE, k, inverse)
        put_six(work, _SECOND, k, combined(size, stress, pressure - third, inverse, 0.0, c))
        work[at(_THIRD) + k] = third


@njit(**FAST)
def _add_loss(x: float, modulus: float, work: Array) -> None:
    """Add the dissipation of a branch in a step of ``x`` times ``tau``.

    It is the spring's loss if the damper moved at the middle of the strain path, corrected by the error of that in
    small strains: exact there, and at constant strain.
    """
    gone = -expm1(-x)
    kept, rest = ramp_fractions(x, gone)
    one, two = 2.0 - gone - 2.0 * kept, kept * (1.0 - kept) - 2.0 * rest
    for k in range(_W):
        old, before, now = six(work, _OLD, k), six(work, _BEFORE, k), six(work, _NOW, k)
        new, inverse, root = six(work, _NEW, k), six(work, _INVERSE, k), work[at(_ROOT) + k]
        start, _ = inverted(old)
        # The trace of Ci(0)^-1 Ci - 1, from its other invariants to avoid cancellation, since determinants are 1.
        u = product(start, combined(1.0, new, -1.0, old, 0.0, now))
        det = u[0] * (u[4] * u[8] - u[5] * u[7]) - u[1] * (u[3] * u[8] - u[5] * u[6])
        det += u[2] * (u[3] * u[7] - u[4] * u[6])
        lost = 0.25 * (trace_of(u, u) - (u[0] + u[4] + u[8]) ** 2) - 0.5 * det
        # Ci(0)^-1 - Ci^-1 is Ci(0)^-1 (Ci - Ci(0)) Ci^-1.
        middle = combined(0.5 * root, before, 0.5 * root, now, -root, new)
        lost += 0.5 * trace_of(u, product(inverse, middle))
        u = product(inverse, combined(0.5 * root, before, -0.5 * root, old, 0.0, now))
        v = product(inverse, combined(0.5 * root, now, -0.5 * root, before, 0.0, old))
        left, right = (u[0] + u[4] + u[8]) / 3.0, v[0] + v[4] + v[8]
        lost -= one * (trace_of(u, v) - left * right) + two * (trace_of(v, v) - right * right / 3.0)
        work[at(_LOSS) + k] += modulus * lost


@njit(**FAST)
def _go(work: Array, constants: Array, with_energy: bool, goes_on: bool) -> None:
    """Fill in the stress, on demand the energy of springs and the dissipation; or advance the state."""
    mu, count, lame = constants[0], int(constants[2]), constants[constants.size - 1]
    dissipated = np.uint64(POINTS * (FIBRE + 6 + 6 * count))
    _begin(work, constants)
    for k in range(_W):
        work[at(_LOSS) + k] = work[dissipated + k]
    for i in range(count):
        _branch(work, constants, i, False)
        if with_energy or goes_on:
            _add_loss(constants[1] / constants[4 + 2 * i], mu * constants[3 + 2 * i], work)
        if goes_on:
            for m in range(6):
                row, unit = np.uint64(POINTS * (FIBRE + 6 + 6 * i + m)), 1.0 if FIRST[m] == SECOND[m] else 0.0
                for k in range(_W):
                    work[row + k] = work[at(_NEW + m) + k] - unit
    _second(work, constants)
    for k in range(_W):
        put_first(work, k, six(work, _SECOND, k), 1.0 if work[ROWS[DETERMINANT] + k] > 0.0 else np.nan)
    if with_energy:
        for k in range(_W):
            volume = work[at(_VOLUME) + k]
            work[ROWS[ENERGY] + k] = work[at(_STORED) + k] + 0.5 * (lame + 2.0 / 3.0 * mu) * volume * volume
            work[ROWS[ACTIVE] + k], work[ROWS[LOST] + k] = 0.0, work[at(_LOSS) + k]
    if goes_on:
        for k in range(_W):
            work[dissipated + k] = work[at(_LOSS) + k]
        for m in range(6):
            row, unit = np.uint64(POINTS * (FIBRE + m)), 1.0 if FIRST[m] == SECOND[m] else 0.0
            for k in range(_W):
                work[row + k] = work[at(_NOW + m) + k] - unit


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and on demand the energy of springs."""
    _go(work, constants, with_energy, False)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the symmetric part of the derivative of the stress at the end of the step."""
    bent, moduli = np.zeros(36 * POINTS), np.empty(36 * POINTS)
    _begin(work, constants)
    for i in range(int(constants[2])):
        _branch(work, constants, i, True)
        for k in range(_W):
            # Derivatives by y and by c, multiplied by the inverse from both sides.
            old, before, now = six(work, _OLD, k), six(work, _BEFORE, k), six(work, _NOW, k)
            w, inverse = 1.0 - work[at(_Y) + k], six(work, _INVERSE, k)
            put_six(work, _TURNED, k, _between(inverse, combined(w, before, -w, old, 0.0, now)))
            put_six(work, _TURNED + 6, k, _between(inverse, combined(1.0, now, -1.0, before, 0.0, old)))
            work[at(_ROOT) + k] *= constants[0] * constants[3 + 2 * i]
        for m in range(6):
            for n in range(6):
                ap, bq, aq, bp = _crossed(m, n)
                one, other, first, second = _INVERSE + m, _INVERSE + n, _BY_C + n, _BY_C + 6 + n
                for k in range(_W):
                    crossed = work[at(ap) + k] * work[at(bq) + k] + work[at(aq) + k] * work[at(bp) + k]
                    change = work[at(_Y + 1) + k] * (work[at(one) + k] * work[at(other) + k] / 3.0 - 0.5 * crossed)
                    change += work[at(_TURNED + m) + k] * work[at(first) + k]
                    change += work[at(_TURNED + 6 + m) + k] * work[at(second) + k]
                    bent[at(6 * m + n) + k] += work[at(_ROOT) + k] * change
    _second(work, constants)
    _isochoric(work, constants, bent, moduli)
    add_second(work, _SECOND, moduli)


@njit(**FAST)
def _crossed(m: int, n: int) -> tuple[int, int, int, int]:
    """Return rows of the inverse, of components ``ab`` and ``pq`` those of ``ap, bq, aq, bp``."""
    a, b, p, q = FIRST[m], SECOND[m], FIRST[n], SECOND[n]
    return _INVERSE + PLACE[a, p], _INVERSE + PLACE[b, q], _INVERSE + PLACE[a, q], _INVERSE + PLACE[b, p]


@njit(**FAST)
def _between(inverse: Six, one: Six) -> Six:
    """Return ``(inverse : one)/3 inverse - inverse one inverse``."""
    turned = symmetric(inverse, product(one, inverse))
    return combined(double(inverse, one) / 3.0, inverse, -1.0, turned, 0.0, one)


@njit(**FAST)
def _isochoric(work: Array, constants: Array, bent: Array, moduli: Array) -> None:
    """Fill in ``dS/dG`` from the slopes ``bent`` of the stress by isochoric ``C`` (Holzapfel 2000, 6.4)."""
    bulk = constants[constants.size - 1] + 2.0 / 3.0 * constants[0]
    whole = np.zeros(POINTS)
    for m in range(6):
        for n in range(m + 1, 6):
            for k in range(_W):
                bent[at(6 * m + n) + k] = 0.5 * (bent[at(6 * m + n) + k] + bent[at(6 * n + m) + k])
            for k in range(_W):
                bent[at(6 * n + m) + k] = bent[at(6 * m + n) + k]
    for m in range(6):
        for k in range(_W):
            by_row = double(six(bent, 6 * m, k), six(work, _C, k)) / 3.0
            work[at(_TURNED + m) + k] = by_row
            whole[k] += TWICE[m] * by_row * work[at(_C + m) + k] / 3.0
    for m in range(6):
        for n in range(6):
            ap, bq, aq, bp = _crossed(m, n)
            for k in range(_W):
                size, third, one, other = (
                    work[at(_SIZE) + k],
                    work[at(_THIRD) + k],
                    work[at(_INVERSE + m) + k],
                    work[at(_INVERSE + n) + k],
                )
                pressure = bulk * work[at(_VOLUME) + k]
                crossed = 0.5 * (work[at(ap) + k] * work[at(bq) + k] + work[at(aq) + k] * work[at(bp) + k])
                left, right = work[at(_SECOND + m) + k] - pressure * one, work[at(_SECOND + n) + k] - pressure * other
                shape = bent[at(6 * m + n) + k] - work[at(_TURNED + m) + k] * other - one * work[at(_TURNED + n) + k]
                value = 2.0 * size * size * (shape + whole[k] * one * other)
                value += 2.0 * third * (crossed - one * other / 3.0) - 2.0 / 3.0 * (one * right + left * other)
                moduli[at(6 * m + n) + k] = value + bulk * one * other - 2.0 * pressure * crossed


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    _go(work, constants, False, True)
