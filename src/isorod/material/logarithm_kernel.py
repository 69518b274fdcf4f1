"""Laws of small strains extended to large ones by the logarithmic strain, compiled.

With ``X = C - 1`` the strain ``E = ln(C)/2`` is ``X/2`` times the mean of ``A = (1 + s X)^-1`` over ``s`` from 0 to 1,
by Gauss points: right to 1e-14, with as many points as the largest stretch of a block needs.  The second
Piola-Kirchhoff stress and its derivative by Green's strain ``G`` are then sums over the same points,

    S = sum w A T A,    dS = sum w (A dT A - s (A dC A T A + A T A dC A)),    dE = sum w A dG A,

where ``T`` is the stress of the small-strain law for ``E`` (C. Miehe, N. Apel & M. Lambrecht, CMAME 191 (2002)
5383-5425).  Neither principal directions nor a branch for equal principal values are needed: all points of a block are
computed alike.  ``A`` is a polynomial in ``X``, by Cayley and Hamilton.  The stress is NaN for stretches beyond 16 or
1/16, beyond 12 if the others differ.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.points import DETERMINANT, GRADIENT, MODULI, OWN, POINTS, ROWS, SQUARES
from isorod.material.six_kernel import (
    FIRST,
    PLACE,
    SECOND,
    Six,
    at,
    combined,
    double,
    gradient,
    largest,
    product,
    put_first,
    put_six,
    six,
    squares,
    symmetric,
)

# Rows of a block, ``POINTS`` numbers each, before those of the law: X, X^2, the invariants of X, the largest principal
# value of C or of its inverse, sums over Gauss points, the strain and its trace, the stress T, which laws fill in, and
# the second Piola-Kirchhoff stress.
_X, _SQUARE, _INVARIANTS, _LARGEST, _FIRST, _TWO = (OWN + m for m in (0, 6, 12, 15, 16, 19))
STRAIN, TRACE, TENSION, _STRESS, LOGARITHM = (OWN + m for m in (22, 28, 29, 35, 41))

_W = np.uint64(POINTS)

# Numbers of Gauss points, and their relative error, which bounds principal values of C and its inverse (`_REACH`).
_COUNTS, _RIGHT = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128), 1e-14
_RULES = [np.polynomial.legendre.leggauss(count) for count in _COUNTS]
_PLACES = np.concatenate([0.5 * (1.0 + places) for places, _ in _RULES])
_WEIGHTS = np.concatenate([0.5 * weights for _, weights in _RULES])
_BEGIN = np.cumsum([0, *_COUNTS])
_REACH = np.array([((1.0 + r) / (1.0 - r)) ** 2 for r in (_RIGHT ** (0.5 / count) for count in _COUNTS)])
_FARTHEST = float(_REACH[-1])
# The rule up to which a bound of all principal values of a block is enough.
_SIMPLE = 2


@njit(**FAST)
def strains(work: Array) -> int:
    """Fill in the strains of a block and their traces, with `sums`; return the rule of its Gauss points."""
    rule = sums(work)
    for k in range(_W):
        e = strain(work, k)
        put_six(work, STRAIN, k, e)
        work[at(TRACE) + k] = e[0] + e[3] + e[5]
    return rule


@njit(**FAST)
def strain(work: Array, k: Any) -> Six:
    """Return the strain at a point, from the sums."""
    p1, whole = work[at(_FIRST + 1) + k], 0.5 * work[at(_FIRST + 2) + k] * work[at(_INVARIANTS + 2) + k]
    half = 0.5 * (work[at(_FIRST) + k] + p1 * work[at(_INVARIANTS) + k])
    identity = whole, 0.0, 0.0, whole, 0.0, whole
    return combined(1.0, identity, half, six(work, _X, k), -0.5 * p1, six(work, _SQUARE, k))


@njit(**FAST)
def sums(work: Array) -> int:
    """Fill in the sums from which strains of a block follow; return the rule of its Gauss points."""
    for k in range(_W):
        c = squares(gradient(work, k))
        x = c[0] - 1.0, c[1], c[2], c[3] - 1.0, c[4], c[5] - 1.0
        y = symmetric(x, (x[0], x[1], x[2], x[1], x[3], x[4], x[2], x[4], x[5]))
        first = x[3] * x[5] - x[4] * x[4]
        i1, i2 = x[0] + x[3] + x[5], first + x[0] * x[3] - x[1] * x[1] + x[0] * x[5] - x[2] * x[2]
        i3 = x[0] * first - x[1] * (x[1] * x[5] - x[2] * x[4]) + x[2] * (x[1] * x[4] - x[2] * x[3])
        put_six(work, _X, k, x)
        put_six(work, _SQUARE, k, y)
        work[at(_INVARIANTS) + k], work[at(_INVARIANTS + 1) + k], work[at(_INVARIANTS + 2) + k] = i1, i2, i3
        work[at(_FIRST) + k], work[at(_TWO) + k] = i1 * i1, max(i1 * i1 - 3.0 * i2, 0.0)
    # Bound of the distance of principal values from 1, by the largest mean and the largest deviator.
    spread = (np.sqrt(largest(work, _FIRST)) + 2.0 * np.sqrt(largest(work, _TWO))) / 3.0
    reach, rule = 1.0 / (1.0 - spread) if spread < 1.0 else np.inf, 0
    for k in range(_W):
        work[at(_LARGEST) + k] = reach
    if not reach <= _REACH[_SIMPLE]:
        _find_largest(work)
        reach = largest(work, _LARGEST)
    while rule + 1 < _REACH.size and reach > _REACH[rule]:
        rule += 1
    if rule == 0:
        _add_sums(work, 0, 2, True)
    elif rule == 1:
        _add_sums(work, 2, 3, True)
    else:
        for m in range(6):
            for k in range(_W):
                work[at(_FIRST + m) + k] = 0.0
        for q in range(_BEGIN[rule], _BEGIN[rule + 1], 2):
            _add_sums(work, q, 2, False)
    return rule


@njit(**FAST)
def _find_largest(work: Array) -> None:
    """Fill in bounds of the largest principal value of C or of its inverse."""
    for k in range(_W):
        i1, i2, i3 = work[at(_INVARIANTS) + k], work[at(_INVARIANTS + 1) + k], work[at(_INVARIANTS + 2) + k]
        # Bounds of principal values of C and its inverse, by mean and norm of the deviator.
        i3c = 1.0 + i1 + i2 + i3
        j1, j2 = (3.0 + 2.0 * i1 + i2) / i3c, (3.0 + i1) / i3c
        large = 1.0 + i1 / 3.0 + 2.0 / 3.0 * np.sqrt(max(i1 * i1 - 3.0 * i2, 0.0))
        small = j1 / 3.0 + 2.0 / 3.0 * np.sqrt(max(j1 * j1 - 3.0 * j2, 0.0))
        work[at(_LARGEST) + k] = max(large, small) if work[ROWS[DETERMINANT] + k] > 0.0 else 1.0


@njit(**FAST)
def _add_sums(work: Array, begin: int, count: int, first: bool) -> None:
    """Add the terms of some Gauss points to the sums, or start these."""
    for k in range(_W):
        i1, i2, i3 = work[at(_INVARIANTS) + k], work[at(_INVARIANTS + 1) + k], work[at(_INVARIANTS + 2) + k]
        p0 = p1 = p2 = q3 = q4 = q5 = 0.0
        for q in range(begin, begin + count):
            s, w = _PLACES[q], _WEIGHTS[q]
            inverse = 1.0 / (1.0 + s * (i1 + s * (i2 + s * i3)))
            p = w * inverse
            t = (s * s * s) * p * inverse
            p0, p1, p2 = p0 + p, p1 + s * p, p2 + s * s * p
            q3, q4, q5 = q3 + t, q4 + s * t, q5 + s * s * t
        if not first:
            p0, p1, p2 = work[at(_FIRST) + k] + p0, work[at(_FIRST + 1) + k] + p1, work[at(_FIRST + 2) + k] + p2
            q3, q4, q5 = work[at(_TWO) + k] + q3, work[at(_TWO + 1) + k] + q4, work[at(_TWO + 2) + k] + q5
        work[at(_FIRST) + k], work[at(_FIRST + 1) + k], work[at(_FIRST + 2) + k] = p0, p1, p2
        work[at(_TWO) + k], work[at(_TWO + 1) + k], work[at(_TWO + 2) + k] = q3, q4, q5


@njit(**FAST)
def second_stress(work: Array, k: Any, t: Six) -> Six:
    """Return the second Piola-Kirchhoff stress at a point from ``T``."""
    x, y = six(work, _X, k), six(work, _SQUARE, k)
    i1, i2, i3 = work[at(_INVARIANTS) + k], work[at(_INVARIANTS + 1) + k], work[at(_INVARIANTS + 2) + k]
    p0, p1, p2 = work[at(_FIRST) + k], work[at(_FIRST + 1) + k], work[at(_FIRST + 2) + k]
    q3, q4, q5 = work[at(_TWO) + k], work[at(_TWO + 1) + k], work[at(_TWO + 2) + k]
    # E is a0 + a1 X + a2 X^2: slopes of these by the invariants of X, times T : 1, T : X and T : X^2.
    t0, t1, t2 = t[0] + t[3] + t[5], double(t, x), double(t, y)
    last = p2 - i2 * q4 - i3 * q5
    c1 = t1 * (i2 * q3 + i3 * q4) - t0 * i3 * q3 + t2 * (last - i1 * q3)
    c2 = t2 * q3 - t1 * last - t0 * i3 * q4
    c3 = t2 * q4 - t1 * (q3 + i1 * q4) + t0 * (p2 - i3 * q5)
    u = product(t, x)
    both = 2.0 * u[0], u[1] + u[3], u[2] + u[6], 2.0 * u[4], u[5] + u[7], 2.0 * u[8]
    unit, linear = c1 + i1 * c2 + i2 * c3, -(c2 + i1 * c3)
    s = combined(p0 + i1 * p1, t, -p1, both, linear, x)
    return (
        s[0] + unit + c3 * y[0],
        s[1] + c3 * y[1],
        s[2] + c3 * y[2],
        s[3] + unit + c3 * y[3],
        s[4] + c3 * y[4],
        s[5] + unit + c3 * y[5],
    )


@njit(**FAST)
def put_stress(work: Array) -> None:
    """Fill the rows of ``P`` of a block from ``T``."""
    for k in range(_W):
        fits = (work[ROWS[DETERMINANT] + k] > 0.0) & (work[at(_LARGEST) + k] <= _FARTHEST)
        put_first(work, k, second_stress(work, k, six(work, TENSION, k)), 1.0 if fits else np.nan)


@njit(**FAST)
def add_moduli(work: Array, rule: int, moduli: Array) -> None:
    """Add to the moduli of a block from stress and moduli ``dT/dE`` ``(36, POINTS)``, which are overwritten."""
    near, bent, rows = np.zeros(36 * POINTS), np.zeros(36 * POINTS), np.empty(12 * POINTS)
    for k in range(_W):
        put_six(work, _STRESS, k, second_stress(work, k, six(work, TENSION, k)))
    for q in range(_BEGIN[rule], _BEGIN[rule + 1]):
        s, w = _PLACES[q], _WEIGHTS[q]
        for k in range(_W):
            i1, i2, i3 = work[at(_INVARIANTS) + k], work[at(_INVARIANTS + 1) + k], work[at(_INVARIANTS + 2) + k]
            factor = 1.0 / (1.0 + s * (i1 + s * (i2 + s * i3)))
            whole = factor * (1.0 + s * (i1 + s * i2))
            identity = whole, 0.0, 0.0, whole, 0.0, whole
            x, y = six(work, _X, k), six(work, _SQUARE, k)
            a = combined(1.0, identity, -factor * s * (1.0 + s * i1), x, factor * s * s, y)
            put_six(rows, 0, k, a)
            put_six(rows, 6, k, symmetric(a, product(six(work, TENSION, k), a)))
        for m in range(6):
            i, j = FIRST[m], SECOND[m]
            for n in range(m, 6):
                ip, jq, iq, jp = PLACE[i, FIRST[n]], PLACE[j, SECOND[n]], PLACE[i, SECOND[n]], PLACE[j, FIRST[n]]
                place = 6 * m + n
                for k in range(_W):
                    near[at(place) + k] += (
                        0.5 * w * (rows[at(ip) + k] * rows[at(jq) + k] + rows[at(iq) + k] * rows[at(jp) + k])
                    )
                for k in range(_W):
                    bent[at(place) + k] -= (w * s) * (
                        rows[at(ip) + k] * rows[at(6 + jq) + k]
                        + rows[at(jq) + k] * rows[at(6 + ip) + k]
                        + rows[at(iq) + k] * rows[at(6 + jp) + k]
                        + rows[at(jp) + k] * rows[at(6 + iq) + k]
                    )
    _mirror(near)
    products = np.empty(36 * POINTS)
    _multiply(moduli, near, products)
    _multiply(near, products, moduli)
    _mirror(bent)
    for m in range(36):
        for k in range(_W):
            moduli[at(m) + k] += bent[at(m) + k]
    add_second(work, _STRESS, moduli)


@njit(**FAST)
def _mirror(matrix: Array) -> None:
    """Fill in the lower triangle of matrices ``(36, POINTS)``."""
    for m in range(6):
        for n in range(m):
            for k in range(_W):
                matrix[at(6 * m + n) + k] = matrix[at(6 * n + m) + k]


@njit(**FAST)
def _multiply(left: Array, right: Array, products: Array) -> None:
    """Fill in the composition of two maps of symmetric tensors ``(36, POINTS)``, the right one applied first."""
    for m in range(6):
        for n in range(6):
            for k in range(_W):
                products[at(6 * m + n) + k] = (
                    left[at(6 * m) + k] * right[at(n) + k]
                    + 2.0 * left[at(6 * m + 1) + k] * right[at(6 + n) + k]
                    + 2.0 * left[at(6 * m + 2) + k] * right[at(12 + n) + k]
                    + left[at(6 * m + 3) + k] * right[at(18 + n) + k]
                    + 2.0 * left[at(6 * m + 4) + k] * right[at(24 + n) + k]
                    + left[at(6 * m + 5) + k] * right[at(30 + n) + k]
                )


@njit(**FAST)
def add_second(work: Array, stress: int, moduli: Array) -> None:
    """Add to the moduli of a block from ``S``, in rows from ``stress`` on, and symmetric ``dS/dG`` ``(36, POINTS)``."""
    turned = np.empty(18 * POINTS)
    for a in range(3):
        f = np.uint64(POINTS * (GRADIENT + 3 * a))
        for A in range(3):
            p, q, r = 6 * PLACE[A, 0], 6 * PLACE[A, 1], 6 * PLACE[A, 2]
            for n in range(6):
                for k in range(_W):
                    turned[at(6 * A + n) + k] = (
                        work[f + k] * moduli[at(p + n) + k]
                        + work[f + ROWS[1] + k] * moduli[at(q + n) + k]
                        + work[f + ROWS[2] + k] * moduli[at(r + n) + k]
                    )
        for b in range(a, 3):
            g = np.uint64(POINTS * (GRADIENT + 3 * b))
            for A in range(3):
                for B in range(A if a == b else 0, 3):
                    number = SQUARES + 6 * a + PLACE[A, B] if a == b else MODULI + 9 * (a + b - 1) + 3 * A + B
                    row, own = np.uint64(POINTS * number), stress + PLACE[A, B]
                    p, q, r = 6 * A + PLACE[B, 0], 6 * A + PLACE[B, 1], 6 * A + PLACE[B, 2]
                    for k in range(_W):
                        work[row + k] += (
                            work[g + k] * turned[at(p) + k]
                            + work[g + ROWS[1] + k] * turned[at(q) + k]
                            + work[g + ROWS[2] + k] * turned[at(r) + k]
                        )
                    if a == b:
                        for k in range(_W):
                            work[row + k] += work[at(own) + k]
