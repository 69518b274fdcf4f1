"""Stress between two states whose work is exactly the change of any law's energy: a discrete gradient.

Between the states ``C_0`` and ``C_1 = C_0 + D`` the second Piola-Kirchhoff stress of the law is averaged along the
straight path (the mean value discrete gradient, McLachlan, Quispel & Robidoux, Phil. Trans. R. Soc. A 357 (1999)
1021-1045),

    S = int_0^1 S(C_0 + t D) dt + k D,    k = (2 (W_1 - W_0) - S : D) / (D : D),

by Gauss points, so that nothing is divided by ``|D|`` if they are exact to rounding.  If not, as with large changes or
fibres that become taut along the path, the last term (Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467) corrects their
error beyond rounding.  ``S : D / 2 = W_1 - W_0``, and ``S`` is symmetric in both states.  With ``P = F_m S``, ``F_m``
the mean of both deformation gradients, internal forces have no resultant and no moment.

For a law with memory ``W`` is the stored and dissipated energy, whose derivative is its stress in the step.  For a law
that flows with time, time grows along the path as the strain does, and the mean is not corrected.

Symmetric tensors have six components, 00, 01, 02, 11, 12, 22, and so have triangular ones.
"""

from typing import Any

import numpy as np
from numba import b1, f8, i8, u8, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F5, FAST, njit
from isorod.material.points import (
    ACTIVE,
    DETERMINANT,
    ENERGY,
    FIBRE,
    GRADIENT,
    LOST,
    MODULI,
    MODULI_WORK,
    POINTS,
    ROWS,
    call_block,
    call_tangent,
    modulus_row,
)

_ABSCISSAE, _GAUSS = np.polynomial.legendre.leggauss(4)
_PLACES, _WEIGHTS = tuple((0.5 * (1.0 + _ABSCISSAE)).tolist()), tuple((0.5 * _GAUSS).tolist())

# Times modulus and energies: exceeds the rounding error of twice a difference of energies.
_ROUNDING = 32.0 * float(np.finfo(float).eps)

_W = np.uint64(POINTS)
# Rows of the work space of a block besides the law's: C_0, D, U^-1, S at a place, its mean, the mean of t dS/dE (21 of
# pairs of components, the first not behind the second), P_1, W_0, W_1; F_0 and its change, det F_0 and det F_1, and
# whether one of the states is inverted.
_START, _CHANGE, _INVERSE, _HERE, _MEAN, _VARIED, _LAST, _BEFORE, _AFTER = 0, 6, 12, 18, 24, 30, 51, 60, 61
_FIRST, _MOVED, _DETERMINANTS, _BAD, _SIZE, _FACTOR, _RATE = 62, 71, 80, 82, 83, 84, 85
_OWN = 86
_1, _2, _9, _10, _11, _first = np.uint64(1), np.uint64(2), np.uint64(9), np.uint64(10), np.uint64(11), np.uint64(_FIRST)


@njit(i8(i8, i8), **FAST)
def _six(A: int, B: int) -> int:
    """Return the number of a component among six of a symmetric tensor."""
    low, high = min(A, B), max(A, B)
    return low * (5 - low) // 2 + high


@njit(i8(i8, i8), **FAST)
def _pair(p: int, q: int) -> int:
    """Return the number of a pair of components among 21."""
    low, high = min(p, q), max(p, q)
    return low * (11 - low) // 2 + high


@njit(f8(F2, i8, u8, f8), **FAST)
def _determinant(own: Array, row: int, k: int, t: float) -> float:
    """Return ``det(F_0 + t H)`` at one point."""
    f00, f01, f02 = (
        own[row, k] + t * own[row + 9, k],
        own[row + 1, k] + t * own[row + 10, k],
        own[row + 2, k] + t * own[row + 11, k],
    )
    f10, f11, f12 = (
        own[row + 3, k] + t * own[row + 12, k],
        own[row + 4, k] + t * own[row + 13, k],
        own[row + 5, k] + t * own[row + 14, k],
    )
    f20, f21, f22 = (
        own[row + 6, k] + t * own[row + 15, k],
        own[row + 7, k] + t * own[row + 16, k],
        own[row + 8, k] + t * own[row + 17, k],
    )
    return f00 * (f11 * f22 - f12 * f21) + f01 * (f12 * f20 - f10 * f22) + f02 * (f10 * f21 - f11 * f20)


@njit(void(F2), **FAST)
def _begin(own: Array) -> None:
    """Fill in ``C_0``, ``D`` and the marks of inverted states, whose points are evaluated at rest instead."""
    for k in range(_W):
        det0, det1 = _determinant(own, _FIRST, k, 0.0), _determinant(own, _FIRST, k, 1.0)
        # Inverted states have no stress, even if the path of C is regular.
        bad = 0.0 if (det0 > 0.0) & (det1 > 0.0) else 1.0
        own[_DETERMINANTS, k] = det0 if bad == 0.0 else 1.0
        own[_DETERMINANTS + 1, k], own[_BAD, k] = det1 if bad == 0.0 else 1.0, bad
    for c in range(np.uint64(9)):
        for k in range(_W):
            rest = 1.0 if c % np.uint64(4) == np.uint64(0) else 0.0
            own[_first + c, k] = own[_first + c, k] if own[_BAD, k] == 0.0 else rest
            own[_first + _9 + c, k] = own[_first + _9 + c, k] if own[_BAD, k] == 0.0 else 0.0
    for A in range(3):
        for B in range(A, 3):
            p, q, r = np.uint64(_FIRST + A), np.uint64(_FIRST + B), np.uint64(_six(A, B))
            for k in range(_W):
                square = change = 0.0
                for a in range(np.uint64(3)):
                    s = np.uint64(3) * a
                    f, g, h, j = (
                        own[p + s, k],
                        own[q + s, k],
                        own[p + np.uint64(9) + s, k],
                        own[q + np.uint64(9) + s, k],
                    )
                    square += f * g
                    change += (f + 0.5 * h) * j + h * (g + 0.5 * j)
                own[np.uint64(_START) + r, k], own[np.uint64(_CHANGE) + r, k] = square, change


@njit(void(F2, F1, f8), **FAST)
def _go(own: Array, work: Array, t: float) -> None:
    """Fill the law's rows of ``F`` with a triangular ``U``, ``U^T U = C_0 + t D``, and others with its inverse.

    Any ``F`` with ``F^T F = C`` does, since ``S`` does not depend on rotation.  It is NaN if rounding makes ``C``
    indefinite.
    """
    for k in range(_W):
        c00, c01 = own[_START, k] + t * own[_CHANGE, k], own[_START + 1, k] + t * own[_CHANGE + 1, k]
        c02, c11 = own[_START + 2, k] + t * own[_CHANGE + 2, k], own[_START + 3, k] + t * own[_CHANGE + 3, k]
        c12, c22 = own[_START + 4, k] + t * own[_CHANGE + 4, k], own[_START + 5, k] + t * own[_CHANGE + 5, k]
        u00 = np.sqrt(c00)
        v00 = 1.0 / u00
        u01, u02 = c01 * v00, c02 * v00
        u11 = np.sqrt(c11 - u01 * u01)
        v11 = 1.0 / u11
        u12 = (c12 - u01 * u02) * v11
        u22 = np.sqrt(c22 - u02 * u02 - u12 * u12)
        v22 = 1.0 / u22
        work[ROWS[GRADIENT] + k], work[ROWS[GRADIENT + 1] + k], work[ROWS[GRADIENT + 2] + k] = u00, u01, u02
        work[ROWS[GRADIENT + 3] + k], work[ROWS[GRADIENT + 4] + k], work[ROWS[GRADIENT + 5] + k] = 0.0, u11, u12
        work[ROWS[GRADIENT + 6] + k], work[ROWS[GRADIENT + 7] + k], work[ROWS[GRADIENT + 8] + k] = 0.0, 0.0, u22
        work[ROWS[DETERMINANT] + k] = u00 * u11 * u22
        own[_INVERSE, k], own[_INVERSE + 3, k], own[_INVERSE + 5, k] = v00, v11, v22
        own[_INVERSE + 1, k] = -u01 * v00 * v11
        own[_INVERSE + 2, k] = (u01 * u12 * v11 - u02) * v00 * v22
        own[_INVERSE + 4, k] = -u12 * v11 * v22


@njit(void(F2, F1, f8), **FAST)
def _add_stress(own: Array, work: Array, weight: float) -> None:
    """Fill in ``S = U^-1 P``, and add it to the mean with a weight."""
    for k in range(_W):
        v22 = own[_INVERSE + 5, k]
        v11, v12 = own[_INVERSE + 3, k], own[_INVERSE + 4, k]
        p10, p20 = work[ROWS[3] + k], work[ROWS[6] + k]
        own[_HERE, k] = own[_INVERSE, k] * work[k] + own[_INVERSE + 1, k] * p10 + own[_INVERSE + 2, k] * p20
        own[_HERE + 1, k] = v11 * p10 + v12 * p20
        own[_HERE + 2, k] = v22 * p20
        own[_HERE + 3, k] = v11 * work[ROWS[4] + k] + v12 * work[ROWS[7] + k]
        own[_HERE + 4, k] = v22 * work[ROWS[7] + k]
        own[_HERE + 5, k] = v22 * work[ROWS[8] + k]
    for c in range(np.uint64(6)):
        for k in range(_W):
            own[np.uint64(_MEAN) + c, k] += weight * own[np.uint64(_HERE) + c, k]


@njit(void(F2, F1, f8), **FAST)
def _add_moduli(own: Array, work: Array, weight: float) -> None:
    """Add ``dS_KJ/dE_LB = V_Ka V_Lb (dP_aJ/dF_bB - d_ab S_JB)``, ``V = U^-1``, to the mean with a weight."""
    # V takes the larger index of each component: its row has the fewest nonzeros.
    for J in range(3):
        for K in range(J, 3):
            for B in range(3):
                for L in range(B, 3):
                    p, q = _six(K, J), _six(L, B)
                    if p > q:
                        continue
                    into = np.uint64(_VARIED + _pair(p, q))
                    for a in range(K, 3):
                        left = np.uint64(_INVERSE + _six(K, a))
                        for b in range(L, 3):
                            right = np.uint64(_INVERSE + _six(L, b))
                            row: Any = modulus_row(a, J, b, B)
                            for k in range(_W):
                                own[into, k] += weight * own[left, k] * own[right, k] * work[row + k]
                            if a == b:
                                own_stress = np.uint64(_HERE + _six(J, B))
                                for k in range(_W):
                                    own[into, k] -= weight * own[left, k] * own[right, k] * own[own_stress, k]


@njit(f8(u8, u8, F1, F1), **FAST)
def _modulus(block: int, tangent: int, work: Array, constants: Array) -> float:
    """Return the largest of the moduli at rest, of the fibres of a block."""
    work[POINTS * GRADIENT : POINTS * DETERMINANT] = 0.0
    for k in range(_W):
        for a in range(np.uint64(3)):
            work[ROWS[GRADIENT] + a * ROWS[4] + k] = 1.0
        work[ROWS[DETERMINANT] + k] = 1.0
    call_block(block, (work, constants, 1.0, False))
    work[POINTS * MODULI :] = 0.0
    call_tangent(tangent, (work, constants, 1.0))
    return float(np.abs(work[POINTS * MODULI :]).max())


@njit(void(F2, F1, f8, f8), **FAST)
def _finish(own: Array, work: Array, modulus: float, exact: float) -> None:
    """Fill in ``S`` with the last term, or 0 times that, and the rows of stress with ``F_m S``."""
    for k in range(_W):
        d0, d1, d2 = own[_CHANGE, k], own[_CHANGE + 1, k], own[_CHANGE + 2, k]
        d3, d4, d5 = own[_CHANGE + 3, k], own[_CHANGE + 4, k], own[_CHANGE + 5, k]
        m0, m1, m2 = own[_MEAN, k], own[_MEAN + 1, k], own[_MEAN + 2, k]
        m3, m4, m5 = own[_MEAN + 3, k], own[_MEAN + 4, k], own[_MEAN + 5, k]
        size = d0 * d0 + d3 * d3 + d5 * d5 + 2.0 * (d1 * d1 + d2 * d2 + d4 * d4)
        before, after = own[_BEFORE, k], own[_AFTER, k]
        missed = 2.0 * (after - before) - (m0 * d0 + m3 * d3 + m5 * d5 + 2.0 * (m1 * d1 + m2 * d2 + m4 * d4))
        allowed = _ROUNDING * (modulus + abs(before) + abs(after))
        # Continuous: beyond rounding the correction grows twice as fast until it is complete.  NaN counts as beyond.
        far = abs(missed) >= 2.0 * allowed
        beyond = missed if far else 2.0 * (missed - np.copysign(allowed, missed))
        factor = 0.0 if (abs(missed) <= allowed) | (exact == 0.0) else beyond / size
        own[_SIZE, k], own[_FACTOR, k], own[_RATE, k] = size, factor, 1.0 if far else 2.0
        own[_HERE, k], own[_HERE + 1, k], own[_HERE + 2, k] = m0 + factor * d0, m1 + factor * d1, m2 + factor * d2
        own[_HERE + 3, k], own[_HERE + 4, k], own[_HERE + 5, k] = m3 + factor * d3, m4 + factor * d4, m5 + factor * d5
    for a in range(3):
        f = np.uint64(_FIRST + 3 * a)
        for A in range(3):
            s0, s1, s2 = np.uint64(_HERE + A), np.uint64(_HERE + _six(1, A)), np.uint64(_HERE + _six(2, A))
            for k in range(_W):
                x, y = own[f, k] + 0.5 * own[f + _9, k], own[f + _1, k] + 0.5 * own[f + _10, k]
                z = own[f + _2, k] + 0.5 * own[f + _11, k]
                work[np.uint64(POINTS * (3 * a + A)) + k] = x * own[s0, k] + y * own[s1, k] + z * own[s2, k]


@njit(void(F2, u8, F3, F2, i8, F5), **FAST)
def _moduli(own: Array, k: int, tensors: Array, varied: Array, m: int, moduli: Array) -> None:
    """Fill in the moduli of one point, ``k`` of its block."""
    D, mean, end, middle, S, bent = tensors[0], tensors[1], tensors[2], tensors[3], tensors[4], tensors[5]
    size, factor, rate = own[_SIZE, k], own[_FACTOR, k], own[_RATE, k]
    for A in range(3):
        for B in range(3):
            D[A, B], mean[A, B] = own[_CHANGE + _six(A, B), k], own[_MEAN + _six(A, B), k]
            S[A, B], move = own[_HERE + _six(A, B), k], own[_MOVED + 3 * A + B, k]
            end[A, B] = own[_FIRST + 3 * A + B, k] + move
            middle[A, B] = end[A, B] - 0.5 * move
    # Derivatives of S, of six components each, first without those of the last term.
    for p in range(6):
        for b in range(3):
            for B in range(3):
                value = 0.0
                for L in range(3):
                    value += end[b, L] * own[_VARIED + _pair(p, _six(L, B)), k]
                varied[p, 3 * b + B] = value
    if factor != 0.0:
        for b in range(3):
            for B in range(3):
                value, grown = 2.0 * own[_LAST + 3 * b + B, k], 0.0
                for L in range(3):
                    value -= 2.0 * end[b, L] * mean[L, B]
                    grown += 4.0 * end[b, L] * D[L, B]
                for p in range(3):
                    for q in range(3):
                        value -= D[p, q] * varied[_six(p, q), 3 * b + B]
                bent[b, B] = (rate * value - factor * grown) / size
        for p in range(3):
            for q in range(p, 3):
                for b in range(3):
                    for B in range(3):
                        varied[_six(p, q), 3 * b + B] += D[p, q] * bent[b, B]
                        # k dD, dD_pq = d_pB F_bq + F_bp d_qB.
                        if p == B:
                            varied[_six(p, q), 3 * b + B] += factor * end[b, q]
                        if q == B:
                            varied[_six(p, q), 3 * b + B] += factor * end[b, p]
    for a in range(3):
        for A in range(3):
            for b in range(3):
                for B in range(3):
                    value = 0.5 * S[A, B] if a == b else 0.0
                    for p in range(3):
                        value += middle[a, p] * varied[_six(p, A), 3 * b + B]
                    moduli[m, a, A, b, B] = value if own[_BAD, k] == 0.0 else np.nan


@njit(void(u8, u8, b1, i8, F3, F3, F1, F2, F3, F5), **FAST)
def discrete_gradient(
    block: int,
    tangent: int,
    remembers: bool,
    clock: int,
    start: Array,
    change: Array,
    constants: Array,
    fibres: Array,
    stress: Array,
    moduli: Array,
) -> None:
    """Fill in the stress between states, and its moduli if they have points; NaN where one of the states is inverted.

    Parameters
    ----------
    block, tangent
        Addresses of the law's functions.
    remembers, clock
        Whether the law has memory, and which of its constants is the time of the step; none below 0.
    start, change
        Deformation gradients and their changes, shape ``(points, 3, 3)``.
    constants, fibres
        As those of `isorod.material.points.at_points`.
    stress, moduli
        ``P``, shape ``(points, 3, 3)``, and its derivatives by the end state, shape ``(points, 3, 3, 3, 3)`` or empty.
    """
    work, own = np.zeros(MODULI_WORK * POINTS), np.empty((_OWN, POINTS))
    tensors, varied = np.empty((6, 3, 3)), np.empty((6, 9))
    count, with_moduli, modulus = start.shape[0], moduli.shape[0] > 0, 0.0
    own_constants = constants.copy()
    for begin in range(0, count, POINTS):
        for k in range(_W):
            # The last point fills up the block.
            m: Any = min(begin + np.int64(k), count - 1)
            for a in range(3):
                for A in range(3):
                    own[_FIRST + 3 * a + A, k], own[_MOVED + 3 * a + A, k] = start[m, a, A], change[m, a, A]
            for a in range(fibres.shape[1]):
                work[ROWS[FIBRE] + np.uint64(POINTS * a) + k] = fibres[m, a]
        _begin(own)
        if begin == 0:
            modulus = _modulus(block, tangent, work, constants)
        own[_MEAN:_LAST] = 0.0
        for place in range(len(_PLACES)):
            t, weight = _PLACES[place], _WEIGHTS[place]
            _go(own, work, t)
            if clock >= 0:
                own_constants[clock] = t * constants[clock]
            call_block(block, (work, own_constants, 1.0, False))
            _add_stress(own, work, weight)
            if with_moduli:
                work[POINTS * MODULI :] = 0.0
                call_tangent(tangent, (work, own_constants, 1.0))
                _add_moduli(own, work, t * weight)
        for last in range(2):
            for c in range(np.uint64(9)):
                for k in range(_W):
                    work[ROWS[GRADIENT] + c * _W + k] = own[_first + c, k] + float(last) * own[_first + _9 + c, k]
            for k in range(_W):
                work[ROWS[DETERMINANT] + k] = own[_DETERMINANTS + last, k]
            call_block(block, (work, constants, 1.0, True))
            for k in range(_W):
                lost = work[ROWS[LOST] + k] if remembers else 0.0
                own[_BEFORE + last, k] = work[ROWS[ENERGY] + k] + work[ROWS[ACTIVE] + k] + lost
        for c in range(np.uint64(9)):
            for k in range(_W):
                own[np.uint64(_LAST) + c, k] = work[ROWS[1] * c + k]
        _finish(own, work, modulus, 0.0 if clock >= 0 else 1.0)
        for k in range(np.uint64(min(POINTS, count - begin))):
            m = begin + np.int64(k)
            valid = 1.0 if own[_BAD, k] == 0.0 else np.nan
            for a in range(3):
                for A in range(3):
                    stress[m, a, A] = valid * work[np.uint64(POINTS * (3 * a + A)) + k]
            if with_moduli:
                _moduli(own, k, tensors, varied, m, moduli)
