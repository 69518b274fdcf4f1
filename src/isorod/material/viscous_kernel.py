"""Norton creep by logarithmic strain, compiled: all of the shear stress relaxes.

The von Mises stress falls as ``q' = -c q^n`` at constant strain.  A step relaxes for half of its time, is strained, and
relaxes for the other half, each exactly: an error of second order in the time, and none at constant strain.

Constants: shear modulus, time of the step, ``c``, ``n``, Lame's first parameter.  State: the strain at the start of the
step, the viscous strain, and the dissipated energy, that of both halves at their strains.
"""

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import power
from isorod.material.logarithm_kernel import LOGARITHM, TENSION, TRACE, add_moduli, put_stress, strain, sums
from isorod.material.points import ACTIVE, BLOCK, ENERGY, FIBRE, LOST, POINTS, ROWS, TANGENT
from isorod.material.six_kernel import FIRST, SECOND, Six, at, combined, double, put_six, six

_W = np.uint64(POINTS)

# Offset of the row of dissipated energy.
_DISSIPATED = ROWS[FIBRE + 12]

# Rows of a block: the elastic strain at the end of the step, its norm (first its square), the fraction of it that
# remains after half a step, and the dissipation of the step.
_ELASTIC, _SIZE, _KEPT, _LOSS, _ROWS = LOGARITHM, *(LOGARITHM + 6 + m for m in range(4))


@njit(**FAST)
def _relax(work: Array, constants: Array) -> None:
    """Fill in the remaining fraction of the elastic strain, given its square, after half of the time; add the loss."""
    mu, c, n, half = constants[0], constants[2], constants[3], 0.5 * constants[1]
    if n == 1.0:
        kept = np.exp(-c * half)
        for k in range(_W):
            work[at(_KEPT) + k] = kept
    else:
        rate, scale = (n - 1.0) * c * half, 6.0 * mu * mu
        for k in range(_W):
            # Positive without strain.
            fast = power(max(scale * work[at(_SIZE) + k], 1e-300), 0.5 * (n - 1.0))
            work[at(_KEPT) + k] = power(1.0 + rate * fast, -1.0 / (n - 1.0))
    for k in range(_W):
        size, kept = work[at(_SIZE) + k], work[at(_KEPT) + k]
        work[at(_LOSS) + k] += mu * (1.0 - kept * kept) * size


@njit(**FAST)
def _deviator(a: Six) -> Six:
    """Return the deviator of a symmetric tensor."""
    third = (a[0] + a[3] + a[5]) / 3.0
    return a[0] - third, a[1], a[2], a[3] - third, a[4], a[5] - third


@njit(**FAST)
def _respond(work: Array, constants: Array) -> int:
    """Fill in the stress and the other rows at the end of the step; return the rule of Gauss points."""
    mu = constants[0]
    bulk = constants[constants.size - 1] + 2.0 / 3.0 * mu
    rule = sums(work)
    for k in range(_W):
        old = six(work, FIBRE, k)
        start = combined(1.0, _deviator(old), -1.0, six(work, FIBRE + 6, k), 0.0, old)
        put_six(work, _ELASTIC, k, start)
        work[at(_SIZE) + k], work[at(_LOSS) + k] = double(start, start), 0.0
    _relax(work, constants)
    for k in range(_W):
        e = strain(work, k)
        change = _deviator(combined(1.0, e, -1.0, six(work, FIBRE, k), 0.0, e))
        elastic = combined(work[at(_KEPT) + k], six(work, _ELASTIC, k), 1.0, change, 0.0, e)
        put_six(work, _ELASTIC, k, elastic)
        work[at(_SIZE) + k], work[at(TRACE) + k] = double(elastic, elastic), e[0] + e[3] + e[5]
    _relax(work, constants)
    for k in range(_W):
        kept, pressure = work[at(_KEPT) + k], bulk * work[at(TRACE) + k]
        elastic = six(work, _ELASTIC, k)
        elastic = combined(kept, elastic, 0.0, elastic, 0.0, elastic)
        put_six(work, _ELASTIC, k, elastic)
        t = combined(2.0 * mu, elastic, 0.0, elastic, 0.0, elastic)
        put_six(work, TENSION, k, (t[0] + pressure, t[1], t[2], t[3] + pressure, t[4], t[5] + pressure))
        work[at(_SIZE) + k] = kept * np.sqrt(work[at(_SIZE) + k])
    return rule


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and on demand the energy of the elastic strain."""
    bulk = constants[constants.size - 1] + 2.0 / 3.0 * constants[0]
    _respond(work, constants)
    put_stress(work)
    if with_energy:
        for k in range(_W):
            stored = constants[0] * work[at(_SIZE) + k] ** 2 + 0.5 * bulk * work[at(TRACE) + k] ** 2
            work[ROWS[ENERGY] + k], work[ROWS[ACTIVE] + k] = stored, 0.0
            work[ROWS[LOST] + k] = work[_DISSIPATED + k] + work[at(_LOSS) + k]


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add the moduli: the derivative of the stress at the end of the step, symmetric."""
    moduli = np.empty(36 * POINTS)
    mu, lame, n = constants[0], constants[constants.size - 1], constants[3]
    bulk, rule = lame + 2.0 / 3.0 * mu, _respond(work, constants)
    for k in range(_W):
        # Of a change of strain the second half leaves the fraction kept across the strain, and its power along it.
        size, kept = work[at(_SIZE) + k], work[at(_KEPT) + k]
        work[at(_LOSS) + k] = 2.0 * mu * (power(kept, n) - kept) / (size * size) if size > 0.0 else 0.0
    for m in range(6):
        for p in range(6):
            same = (1.0 if FIRST[m] == SECOND[m] else 0.5) if m == p else 0.0
            both = 1.0 if FIRST[m] == SECOND[m] and FIRST[p] == SECOND[p] else 0.0
            for k in range(_W):
                moduli[at(6 * m + p) + k] = (
                    2.0 * mu * work[at(_KEPT) + k] * (same - both / 3.0)
                    + bulk * both
                    + work[at(_LOSS) + k] * work[at(_ELASTIC + m) + k] * work[at(_ELASTIC + p) + k]
                )
    add_moduli(work, rule, moduli)


@njit(BLOCK, **FAST)
def update(work: Array, constants: Array, activation: float, with_energy: bool) -> None:
    """Fill in the stress, and replace the state by that at the end of the step."""
    _respond(work, constants)
    put_stress(work)
    for k in range(_W):
        e = strain(work, k)
        put_six(work, FIBRE, k, e)
        put_six(work, FIBRE + 6, k, combined(1.0, _deviator(e), -1.0, six(work, _ELASTIC, k), 0.0, e))
        work[_DISSIPATED + k] += work[at(_LOSS) + k]
