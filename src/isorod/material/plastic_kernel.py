"""Von Mises plasticity by logarithmic strain, compiled: return mapping, in closed form if possible.

For a constant direction of flow, the back stress ``a`` with ``a' = 2/3 H e' - gamma a p'`` (P. J. Armstrong & C. O.
Frederick 1966; J. L. Chaboche, Int. J. Plasticity 5 (1989) 247-302) has the solution ``a(d) = exp(-gamma d) a +
sqrt(2/3) H (1 - exp(-gamma d))/gamma n`` of a plastic strain ``d``: the error of a step is that of taking the direction
``n`` at its end.  Since ``n`` turns with ``exp(-gamma d) a``, the derivative of the stress is not symmetric: the moduli
are its symmetric part.  With time the yield stress is multiplied by ``1 + (d / (A t))^(1/n)`` (Perzyna).

Constants: shear modulus, kinematic modulus ``H``, ``gamma``, time ``t`` of the step, ``A`` (0 without rate), ``1/n``,
number of points of the table, its plastic strains and yield stresses in turn, Lame's first parameter.  State: plastic
strain, six numbers, accumulated plastic strain, the back stress unless ``H`` is 0, and the dissipated energy.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import expm1, power, ramp_fractions
from isorod.material.logarithm_kernel import LOGARITHM, TENSION, TRACE, add_moduli, put_stress, strain, sums
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, LOST, POINTS, ROWS, TANGENT
from isorod.material.six_kernel import FIRST, SECOND, TWICE, at, combined, double, largest, least, put_six, six

_W = np.uint64(POINTS)

# Rows of a block: the direction of flow, before the return the trial deviator; its norm; accumulated plastic strain of
# the step, and the slope of `_excess` at its end; dissipation of the step; the recovered fraction of the back stress,
# and that over ``gamma``.
_DIR, _SIZE, _FLOWN, _SLOPE, _LOSS, _GONE, _GROWN = LOGARITHM, *(LOGARITHM + 6 + m for m in range(6))
# Of the return: the unknown, and its bounds; von Mises stress, yield stress and its slope by plastic strain; ``s : s``,
# ``s : a`` and ``a : a`` of deviator and back stress before the return; the excess; the last change of the unknown.
_ROOT, _HIGH, _LOW, _MISES, _YIELD, _HARD, _SS, _SA, _AA, _VALUE, _PAST, _ROWS = (_GROWN + 1 + m for m in range(12))

# Place of the table in the constants, and of accumulated plastic strain and back stress in the state.
_COUNT, _PLASTIC, _BACK = 6, 6, 7

# Excess over the yield stress, relative to it, that is rounding.
_ROUNDING = 1e-12

# Newton steps or bisections at most; relative change of the root by the last one, whose square is rounding.
_STEPS, _NEAR, _SMALL = 100, 1e-9, 1e-17


@njit(**FAST)
def _segments(low: float, high: float, constants: Array) -> tuple[int, int]:
    """Return the first segment of the table between two plastic strains, and the one after the last."""
    begin, count = 1, int(constants[_COUNT])
    while begin < count and not low < constants[_COUNT + 1 + 2 * begin]:
        begin += 1
    end = begin
    while end < count and constants[_COUNT - 1 + 2 * end] <= high:
        end += 1
    return begin, end


@njit(**FAST)
def _segment(i: int, constants: Array) -> tuple[float, float, float, float]:
    """Return plastic strain and yield stress at the start of a segment of the table, its slope, and its end."""
    i = _COUNT - 1 + 2 * i
    p0, s0, p1, s1 = constants[i], constants[i + 1], constants[i + 2], constants[i + 3]
    return p0, s0, (s1 - s0) / (p1 - p0), p1


@njit(**FAST)
def _harden(work: Array, constants: Array, begin: int, end: int) -> None:
    """Fill in yield stresses and slopes at the end of the step, of plastic strains in some segments or after them."""
    last = constants[_COUNT + 2 * int(constants[_COUNT])]
    plastic = at(FIBRE + _PLASTIC)
    for k in range(_W):
        work[at(_YIELD) + k], work[at(_HARD) + k] = last, 0.0
    for i in range(end - 1, begin - 1, -1):
        p0, s0, slope, p1 = _segment(i, constants)
        for k in range(_W):
            p = work[plastic + k] + work[at(_FLOWN) + k]
            work[at(_YIELD) + k] = s0 + (p - p0) * slope if p < p1 else work[at(_YIELD) + k]
            work[at(_HARD) + k] = slope if p < p1 else work[at(_HARD) + k]


@njit(**FAST)
def _excess(work: Array, constants: Array, begin: int, end: int) -> None:
    """Fill in the excess of the von Mises stress over the yield stress, and its slope by plastic strain: negative.

    The unknown is plastic strain, or with time the relative overstress.
    """
    mu, kinematic, recovery = constants[0], constants[1], constants[2]
    pace, exponent = constants[4] * constants[3], 1.0 / constants[5]
    for k in range(_W):
        work[at(_FLOWN) + k] = work[at(_ROOT) + k]
    if pace > 0.0:
        for k in range(_W):
            flown = pace * power(max(work[at(_ROOT) + k], 1e-300), exponent)
            work[at(_FLOWN) + k] = flown if work[at(_ROOT) + k] > 0.0 else 0.0
    _harden(work, constants, begin, end)
    if recovery > 0.0:
        for k in range(_W):
            gone = -expm1(-recovery * work[at(_FLOWN) + k])
            kept, ss, sa, aa = 1.0 - gone, work[at(_SS) + k], work[at(_SA) + k], work[at(_AA) + k]
            size = np.sqrt(max(ss - 2.0 * kept * sa + kept * kept * aa, 1e-300))
            work[at(_GONE) + k] = gone
            work[at(_VALUE) + k] = np.sqrt(1.5) * size - kinematic / recovery * gone
            work[at(_SLOPE) + k] = np.sqrt(1.5) * recovery * kept * (sa - kept * aa) / size - kinematic * kept
    else:
        for k in range(_W):
            work[at(_VALUE) + k] = work[at(_MISES) + k] - kinematic * work[at(_FLOWN) + k]
            work[at(_SLOPE) + k] = -kinematic
    if pace > 0.0:
        for k in range(_W):
            root, flown, limit = work[at(_ROOT) + k], work[at(_FLOWN) + k], work[at(_YIELD) + k]
            work[at(_YIELD) + k] = limit * (1.0 + root)
            more = limit * root / (exponent * flown) if flown > 0.0 else 0.0
            work[at(_HARD) + k] = work[at(_HARD) + k] * (1.0 + root) + more
    for k in range(_W):
        work[at(_VALUE) + k] -= 3.0 * mu * work[at(_FLOWN) + k] + work[at(_YIELD) + k]
        work[at(_SLOPE) + k] -= 3.0 * mu + work[at(_HARD) + k]


@njit(**FAST)
def _begin(work: Array, constants: Array) -> float:
    """Fill in initial values and bounds of roots, and bounds of plastic strain; return the number of flowing points."""
    mu, kinematic, recovery = constants[0], constants[1], constants[2]
    pace, flowing = constants[4] * constants[3], 0.0
    if recovery > 0.0:
        for k in range(_W):
            dev, back = six(work, _DIR, k), six(work, FIBRE + _BACK, k)
            sa, aa = double(dev, back), double(back, back)
            work[at(_SS) + k], work[at(_SA) + k], work[at(_AA) + k] = (
                work[at(_SIZE) + k] ** 2 + 2.0 * sa + aa,
                sa + aa,
                aa,
            )
    for k in range(_W):
        q, limit, stiff = work[at(_MISES) + k], work[at(_YIELD) + k], 3.0 * mu + kinematic + work[at(_HARD) + k]
        flows = q > limit * (1.0 + _ROUNDING)
        work[at(_ROOT) + k] = (q - limit) / stiff if flows else 0.0
        # The back stress is below its saturation, so that the slope is below -3 mu.
        high = (q - limit) / (3.0 * mu) if flows else 0.0
        work[at(_HIGH) + k], work[at(_LOW) + k], work[at(_PAST) + k] = high, 0.0, work[at(_ROOT) + k]
        work[at(_VALUE) + k] += high
        flowing += 1.0 if flows else 0.0
    if pace > 0.0:
        for k in range(_W):
            # Upper bounds of the root, close if either part of the stress is small.
            whole = power(max(work[at(_HIGH) + k] / pace, 1e-300), constants[5])
            high = min(whole, work[at(_MISES) + k] / work[at(_YIELD) + k] - 1.0) if work[at(_HIGH) + k] > 0.0 else 0.0
            work[at(_HIGH) + k], work[at(_ROOT) + k], work[at(_PAST) + k] = high, high, 0.0
    return flowing


@njit(**FAST)
def _return(work: Array, constants: Array) -> bool:
    """Fill in plastic strains of the step, recovered fractions of back stress, and slopes; return whether any flow."""
    recovery, plastic = constants[2], at(FIBRE + _PLASTIC)
    pace, exponent = constants[4] * constants[3], 1.0 / constants[5]
    for k in range(_W):
        work[at(_FLOWN) + k], work[at(_MISES) + k] = 0.0, np.sqrt(1.5) * work[at(_SIZE) + k]
        work[at(_VALUE) + k] = work[plastic + k]
    low, high = least(work, _VALUE), largest(work, _VALUE)
    begin, end = _segments(low, high, constants)
    _harden(work, constants, begin, end)
    if _begin(work, constants) == 0.0:
        return False
    high = largest(work, _VALUE)
    begin, end = _segments(low, high, constants)
    smooth = end == begin or (end == begin + 1 and high <= constants[_COUNT + 1 + 2 * begin])
    if smooth and recovery == 0.0 and pace == 0.0:
        # The initial value is the root.
        for k in range(_W):
            work[at(_FLOWN) + k] = work[at(_ROOT) + k]
            work[at(_SLOPE) + k] = -3.0 * constants[0] - constants[1] - work[at(_HARD) + k]
        return True
    for _ in range(_STEPS):
        _excess(work, constants, begin, end)
        moved = 0.0
        for k in range(_W):
            root, value = work[at(_ROOT) + k], work[at(_VALUE) + k]
            slope, past = work[at(_SLOPE) + k], work[at(_PAST) + k]
            by_root = 1.0
            if pace > 0.0:
                by_root = exponent * work[at(_FLOWN) + k] / max(root, 1e-300)
                slope *= by_root
                # The power law is the most nonlinear term: with its curvature steps are of third order (Halley).
                bent = (slope + work[at(_YIELD) + k] / (1.0 + root)) * (exponent - 1.0) / max(root, 1e-300)
                slope -= 0.5 * value * bent / slope
            change = -value / slope if root > 0.0 else 0.0
            near = abs(change) <= _NEAR * root
            if smooth:
                # The change by the next step follows from this one and the one before.
                near = near | (abs(change) ** 3 <= _SMALL * root * past * past)
            low = root if value > 0.0 else work[at(_LOW) + k]
            high = work[at(_HIGH) + k] if value > 0.0 else root
            new = root + change
            new = new if near | ((low < new) & (new < high)) else 0.5 * (low + high)
            moved += 0.0 if near else 1.0
            work[at(_ROOT) + k], work[at(_LOW) + k], work[at(_HIGH) + k] = new, low, high
            work[at(_PAST) + k] = abs(new - root)
            # To first order: the square of a converged step is rounding.
            work[at(_FLOWN) + k] += by_root * (new - root)
            work[at(_GONE) + k] += recovery * (1.0 - work[at(_GONE) + k]) * by_root * (new - root)
        if moved == 0.0:
            break
    return True


@njit(**FAST)
def _lose(work: Array, constants: Array) -> None:
    """Fill in the dissipation of the step: work of the yield stress, and recovery of the back stress.

    The latter is the integral of ``3 gamma/(2 H) a : a``.
    """
    kinematic, recovery, pace = constants[1], constants[2], constants[4] * constants[3]
    plastic, count = at(FIBRE + _PLASTIC), int(constants[_COUNT])
    for k in range(_W):
        work[at(_LOW) + k], work[at(_HIGH) + k] = work[plastic + k], work[plastic + k] + work[at(_FLOWN) + k]
        work[at(_LOSS) + k] = 0.0
    begin, end = _segments(least(work, _LOW), largest(work, _HIGH), constants)
    for i in range(begin, end):
        p0, s0, slope, p1 = _segment(i, constants)
        for k in range(_W):
            low, high = max(work[at(_LOW) + k], p0), min(work[at(_HIGH) + k], p1)
            work[at(_LOSS) + k] += max(high - low, 0.0) * (s0 + slope * (0.5 * (low + high) - p0))
    if end == count:
        p0, s0 = constants[_COUNT - 1 + 2 * count], constants[_COUNT + 2 * count]
        for k in range(_W):
            work[at(_LOSS) + k] += max(work[at(_HIGH) + k] - max(work[at(_LOW) + k], p0), 0.0) * s0
    if pace > 0.0:
        for k in range(_W):
            work[at(_LOSS) + k] *= 1.0 + work[at(_ROOT) + k]
    if recovery > 0.0:
        for k in range(_W):
            flown, aa = work[at(_FLOWN) + k], work[at(_AA) + k]
            gone = work[at(_GONE) + k]
            kept, rest = ramp_fractions(recovery * flown, gone)
            forth = (work[at(_SA) + k] - (1.0 - gone) * aa) / work[at(_SIZE) + k]
            lost = 0.5 * gone * (2.0 - gone) * aa
            lost += np.sqrt(2.0 / 3.0) * kinematic * recovery * (kept * flown) ** 2 * forth
            work[at(_LOSS) + k] += 1.5 / kinematic * (lost + 2.0 / 3.0 * (kinematic * flown) ** 2 * rest)


@njit(**FAST)
def _try(work: Array, constants: Array) -> float:
    """Fill in the trial stress, and its deviator relative to the back stress with its norm.

    Returns the number of points beyond the first yield stress.
    """
    mu, lame, first, beyond = constants[0], constants[constants.size - 1], constants[_COUNT + 2], 0.0
    for k in range(_W):
        e = strain(work, k)
        trace = e[0] + e[3] + e[5]
        third, bulk = trace / 3.0, (lame + 2.0 / 3.0 * mu) * trace
        e = e[0] - third, e[1], e[2], e[3] - third, e[4], e[5] - third
        dev = combined(2.0 * mu, e, -2.0 * mu, six(work, FIBRE, k), 0.0, e)
        put_six(work, TENSION, k, (dev[0] + bulk, dev[1], dev[2], dev[3] + bulk, dev[4], dev[5] + bulk))
        put_six(work, _DIR, k, dev)
        work[at(TRACE) + k], work[at(_SIZE) + k] = trace, np.sqrt(double(dev, dev))
    if constants[1] > 0.0:
        for k in range(_W):
            dev = combined(1.0, six(work, _DIR, k), -1.0, six(work, FIBRE + _BACK, k), 0.0, six(work, _DIR, k))
            put_six(work, _DIR, k, dev)
            work[at(_SIZE) + k] = np.sqrt(double(dev, dev))
    for k in range(_W):
        # Tables do not decrease: the first stress settles most points.
        beyond += 1.0 if np.sqrt(1.5) * work[at(_SIZE) + k] > first else 0.0
    return beyond


@njit(**FAST)
def _respond(work: Array, constants: Array, with_slopes: bool) -> tuple[int, bool]:
    """Fill in stress, direction of flow and the other rows at the end of the step.

    Returns the rule of Gauss points, and whether any point flows.  If none does the direction is not of length 1
    (`_try`).
    """
    mu, recovery = constants[0], constants[2]
    rule = sums(work)
    beyond = _try(work, constants)
    if beyond == 0.0 or (constants[4] > 0.0 and not constants[3] > 0.0) or not _return(work, constants):
        if with_slopes:
            for k in range(_W):
                work[at(_FLOWN) + k], work[at(_SLOPE) + k], work[at(_LOSS) + k] = 0.0, -1.0, 0.0
                work[at(_GONE) + k], work[at(_GROWN) + k] = 0.0, 0.0
        return rule, False
    if recovery > 0.0:
        for k in range(_W):
            gone = work[at(_GONE) + k]
            dev = combined(1.0, six(work, _DIR, k), gone, six(work, FIBRE + _BACK, k), 0.0, six(work, _DIR, k))
            put_six(work, _DIR, k, dev)
            work[at(_SIZE) + k], work[at(_GROWN) + k] = np.sqrt(double(dev, dev)), gone / recovery
    else:
        for k in range(_W):
            work[at(_GONE) + k], work[at(_GROWN) + k] = 0.0, work[at(_FLOWN) + k]
    for k in range(_W):
        size, flown = work[at(_SIZE) + k], work[at(_FLOWN) + k]
        size = size if flown > 0.0 else 1.0
        n = combined(1.0 / size, six(work, _DIR, k), 0.0, six(work, _DIR, k), 0.0, six(work, _DIR, k))
        put_six(work, _DIR, k, n)
        put_six(work, TENSION, k, combined(1.0, six(work, TENSION, k), -2.0 * mu * np.sqrt(1.5) * flown, n, 0.0, n))
        work[at(_SIZE) + k] = size
    _lose(work, constants)
    return rule, True


@njit(**FAST)
def _dissipated(constants: Array) -> Any:
    """Return the offset of the row of dissipated energy."""
    return ROWS[FIBRE + _BACK + 6] if constants[1] > 0.0 else ROWS[FIBRE + _BACK]


@njit(**FAST)
def _back(work: Array, k: Any, constants: Array, m: int) -> float:
    """Return a component of the back stress at the end of the step."""
    left = (1.0 - work[at(_GONE) + k]) * work[at(FIBRE + _BACK + m) + k]
    return left + np.sqrt(2.0 / 3.0) * constants[1] * work[at(_GROWN) + k] * work[at(_DIR + m) + k]


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and on demand the energy: that of the elastic strain and of kinematic hardening."""
    _respond(work, constants, with_energy)
    put_stress(work)
    if not with_energy:
        return
    mu, kinematic, lame = constants[0], constants[1], constants[constants.size - 1]
    dissipated = _dissipated(constants)
    for k in range(_W):
        work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = 0.5 * lame * work[at(TRACE) + k] ** 2, 0.0
        work[ROWS[LOST] + k] = work[dissipated + k] + work[at(_LOSS) + k]
    for m in range(6):
        square = 1.0 if FIRST[m] == SECOND[m] else 0.0
        for k in range(_W):
            elastic = work[at(TENSION + m) + k] - square * lame * work[at(TRACE) + k]
            work[ROWS[ENERGY] + k] += TWICE[m] * 0.25 / mu * elastic * elastic
        if kinematic > 0.0:
            for k in range(_W):
                work[ROWS[ENERGY] + k] += TWICE[m] * 0.75 / kinematic * _back(work, k, constants, m) ** 2


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the symmetric part of the derivative of the stress at the end of the step."""
    moduli, across = np.empty(36 * POINTS), np.zeros(6 * POINTS)
    mu, recovery, lame = constants[0], constants[2], constants[constants.size - 1]
    rule, _ = _respond(work, constants, True)
    for k in range(_W):
        step, slope = work[at(_FLOWN) + k], work[at(_SLOPE) + k]
        # Relative reduction of the deviator's growth across the flow, and along it.
        work[at(_LOSS) + k] = 2.0 * mu * np.sqrt(1.5) * step / work[at(_SIZE) + k] if step > 0.0 else 0.0
        work[at(_SLOPE) + k] = -3.0 * mu / slope - work[at(_LOSS) + k] if step > 0.0 else 0.0
        if recovery > 0.0 and step > 0.0:
            _aside(work, k, constants, work[at(_LOSS) + k], slope, across)
    for m in range(6):
        for n in range(6):
            same = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == n else 0.0
            both = 1.0 if FIRST[m] == SECOND[m] and FIRST[n] == SECOND[n] else 0.0
            for k in range(_W):
                less = work[at(_LOSS) + k]
                value = 2.0 * mu * (1.0 - less) * same + (lame + 2.0 * mu * less / 3.0) * both
                value -= 2.0 * mu * work[at(_SLOPE) + k] * work[at(_DIR + m) + k] * work[at(_DIR + n) + k]
                value -= mu * (across[at(m) + k] * work[at(_DIR + n) + k] + work[at(_DIR + m) + k] * across[at(n) + k])
                moduli[at(6 * m + n) + k] = value
    add_moduli(work, rule, moduli)


@njit(**FAST)
def _aside(work: Array, k: Any, constants: Array, less: float, slope: float, across: Array) -> None:
    """Fill in the rotation of the flow as it grows: towards the part of the remaining back stress across it."""
    recovery, forth = constants[2], 0.0
    factor = -less * recovery * np.sqrt(1.5) / slope * np.exp(-recovery * work[at(_FLOWN) + k])
    for m in range(6):
        across[at(m) + k] = factor * work[np.uint64(POINTS * (FIBRE + _BACK + m)) + k]
        forth += TWICE[m] * across[at(m) + k] * work[at(_DIR + m) + k]
    for m in range(6):
        across[at(m) + k] -= forth * work[at(_DIR + m) + k]


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    _, flows = _respond(work, constants, False)
    put_stress(work)
    if not flows:
        return
    for k in range(_W):
        n, old = six(work, _DIR, k), six(work, FIBRE, k)
        put_six(work, FIBRE, k, combined(1.0, old, np.sqrt(1.5) * work[at(_FLOWN) + k], n, 0.0, n))
        work[at(FIBRE + _PLASTIC) + k] += work[at(_FLOWN) + k]
    dissipated = _dissipated(constants)
    for k in range(_W):
        work[dissipated + k] += work[at(_LOSS) + k]
    if constants[1] > 0.0:
        grows = np.sqrt(2.0 / 3.0) * constants[1]
        for k in range(_W):
            back = six(work, FIBRE + _BACK, k)
            back = combined(
                1.0 - work[at(_GONE) + k], back, grows * work[at(_GROWN) + k], six(work, _DIR, k), 0.0, back
            )
            put_six(work, FIBRE + _BACK, k, back)
