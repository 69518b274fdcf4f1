"""Stress between two states that does exactly the work of any law's energy: a discrete gradient.

Between the states ``C_0`` and ``C_1 = C_0 + D`` the second Piola-Kirchhoff stress of the law is averaged on the
straight way (the mean value discrete gradient, McLachlan, Quispel & Robidoux, Phil. Trans. R. Soc. A 357 (1999)
1021-1045),

    S = int_0^1 S(C_0 + t D) dt + k D,    k = (2 (W_1 - W_0) - S : D) / (D : D),

by Gauss points, so that nothing is divided by ``|D|`` where they are exact to rounding; where not, as with large
changes or where fibres begin to bear on the way, the last term (Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467) makes up
for what they miss beyond rounding.  ``S : D / 2 = W_1 - W_0``, and ``S`` stays the same when both states change places.
With ``P = F_m S``, ``F_m`` the mean of both deformation gradients, internal forces have no resultant and no moment.

Symmetric tensors have six components, 00, 01, 02, 11, 12, 22, and so have triangular ones.
"""

from typing import Any

import numpy as np
from numba import f8, i8, u8, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F5, FAST, cofactors, njit
from isorod.material.points import (
    ACTIVE,
    DETERMINANT,
    ENERGY,
    FIBRE,
    GRADIENT,
    MODULI,
    MODULI_WORK,
    POINTS,
    ROWS,
    call_block,
    call_tangent,
    modulus_row,
)

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_PLACES, _SHARES = tuple((0.5 * (1.0 + _POINTS)).tolist()), tuple((0.5 * _WEIGHTS).tolist())

# Times modulus and energies: more than what rounding makes of twice a difference of energies.
_ROUNDING = 32.0 * float(np.finfo(float).eps)

_W = np.uint64(POINTS)
# Rows of the work space of a block besides the law's: C_0, D, U^-1, S at a place, its mean, the mean of t dS/dE (21 of
# pairs of components, the first not behind the second), P_1, W_0, W_1.
_START, _CHANGE, _INVERSE, _HERE, _MEAN, _VARIED, _LAST, _BEFORE, _AFTER = 0, 6, 12, 18, 24, 30, 51, 60, 61
_OWN = 62


@njit(i8(i8, i8), **FAST)
def _six(A: int, B: int) -> int:
    """Return which of six components of a symmetric tensor this is."""
    low, high = min(A, B), max(A, B)
    return low * (5 - low) // 2 + high


@njit(i8(i8, i8), **FAST)
def _pair(p: int, q: int) -> int:
    """Return which of 21 pairs of six components this is."""
    low, high = min(p, q), max(p, q)
    return low * (11 - low) // 2 + high


@njit(void(F2, F1, f8), **FAST)
def _go(own: Array, work: Array, t: float) -> None:
    """Fill the law's rows of ``F`` with a triangular ``U``, ``U^T U = C_0 + t D``, and others with its inverse.

    Any ``F`` with ``F^T F = C`` does: ``S`` knows no rotation.  It is NaN where rounding leaves none.
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
def _add_stress(own: Array, work: Array, share: float) -> None:
    """Fill in ``S = U^-1 P``, and add its share to the mean."""
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
            own[np.uint64(_MEAN) + c, k] += share * own[np.uint64(_HERE) + c, k]


@njit(void(F2, F1, f8), **FAST)
def _add_moduli(own: Array, work: Array, share: float) -> None:
    """Add a share of ``dS_KJ/dE_LB = V_Ka V_Lb (dP_aJ/dF_bB - d_ab S_JB)``, ``V = U^-1``, to the mean."""
    # Of both indices of a component V takes the larger: it has the fewest that are not zero.
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
                                own[into, k] += share * own[left, k] * own[right, k] * work[row + k]
                            if a == b:
                                own_stress = np.uint64(_HERE + _six(J, B))
                                for k in range(_W):
                                    own[into, k] -= share * own[left, k] * own[right, k] * own[own_stress, k]


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


@njit(void(F3, F3, F2, f8, i8, u8, F3, F2, F3, F5), **FAST)
def _finish(
    start: Array,
    change: Array,
    own: Array,
    modulus: float,
    m: int,
    k: int,
    tensors: Array,
    varied: Array,
    stress: Array,
    moduli: Array,
) -> None:
    """Fill in stress and, if they have points, moduli of one point, ``k`` of its block."""
    D, mean, end, middle, S, bent = tensors[0], tensors[1], tensors[2], tensors[3], tensors[4], tensors[5]
    size = missed = 0.0
    for A in range(3):
        for B in range(3):
            D[A, B], mean[A, B] = own[_CHANGE + _six(A, B), k], own[_MEAN + _six(A, B), k]
            end[A, B] = start[m, A, B] + change[m, A, B]
            middle[A, B] = start[m, A, B] + 0.5 * change[m, A, B]
            size += D[A, B] * D[A, B]
            missed += mean[A, B] * D[A, B]
    before, after = own[_BEFORE, k], own[_AFTER, k]
    missed = 2.0 * (after - before) - missed
    allowed = _ROUNDING * (modulus + abs(before) + abs(after))
    # No jump: what is beyond rounding comes in twice as fast until it is all there.  NaN is beyond.
    near, far = abs(missed) <= allowed, abs(missed) >= 2.0 * allowed
    rate = 1.0 if far else 2.0
    factor = 0.0 if near else (missed if far else 2.0 * (missed - np.copysign(allowed, missed))) / size
    for A in range(3):
        for B in range(3):
            S[A, B] = mean[A, B] + factor * D[A, B]
    for a in range(3):
        for A in range(3):
            stress[m, a, A] = middle[a, 0] * S[0, A] + middle[a, 1] * S[1, A] + middle[a, 2] * S[2, A]
    if moduli.shape[0] == 0:
        return
    # Derivatives of S, of six components each, first without those of the last term.
    for p in range(6):
        for b in range(3):
            for B in range(3):
                value = 0.0
                for L in range(3):
                    value += end[b, L] * own[_VARIED + _pair(p, _six(L, B)), k]
                varied[p, 3 * b + B] = value
    if not near:
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
                    moduli[m, a, A, b, B] = value


@njit(void(u8, u8, F3, F3, F1, F2, F3, F5), **FAST)
def discrete_gradient(
    block: int,
    tangent: int,
    start: Array,
    change: Array,
    constants: Array,
    fibres: Array,
    stress: Array,
    moduli: Array,
) -> None:
    """Fill in the stress between states, and if they have points its moduli, NaN where one of the states cannot be.

    Parameters
    ----------
    block, tangent
        Addresses of the law's functions.
    start, change
        Deformation gradients and their changes, shape ``(points, 3, 3)``.
    constants, fibres
        As those of `isorod.material.points.at_points`.
    stress, moduli
        ``P``, shape ``(points, 3, 3)``, and its derivatives by the end state, shape ``(points, 3, 3, 3, 3)`` or empty.
    """
    work, own = np.zeros(MODULI_WORK * POINTS), np.empty((_OWN, POINTS))
    tensors, varied = np.empty((6, 3, 3)), np.empty((6, 9))
    F, middle, scratch = tensors[0], tensors[1], tensors[2]
    bad = np.zeros(POINTS, dtype=np.bool_)
    count, wanted, modulus = start.shape[0], moduli.shape[0] > 0, 0.0
    for begin in range(0, count, POINTS):
        for k in range(_W):
            # Behind the last point it fills up the block.
            m: Any = min(begin + np.int64(k), count - 1)
            for a in range(3):
                for A in range(3):
                    F[a, A] = start[m, a, A] + change[m, a, A]
                    middle[a, A] = start[m, a, A] + 0.5 * change[m, a, A]
            # States that cannot be have no stress, though the way may seem to pass them by.
            bad[k] = not (cofactors(start[m], scratch) > 0.0 and cofactors(F, scratch) > 0.0)
            for A in range(3):
                for B in range(A, 3):
                    c, d = 0.0, 0.0
                    for a in range(3):
                        c += start[m, a, A] * start[m, a, B]
                        d += middle[a, A] * change[m, a, B] + change[m, a, A] * middle[a, B]
                    own[_START + _six(A, B), k] = (1.0 if A == B else 0.0) if bad[k] else c
                    own[_CHANGE + _six(A, B), k] = 0.0 if bad[k] else d
            for a in range(fibres.shape[1]):
                work[ROWS[FIBRE] + np.uint64(POINTS * a) + k] = fibres[m, a]
        if begin == 0:
            modulus = _modulus(block, tangent, work, constants)
        own[_MEAN:_LAST] = 0.0
        for place in range(len(_PLACES)):
            t, share = _PLACES[place], _SHARES[place]
            _go(own, work, t)
            call_block(block, (work, constants, 1.0, False))
            _add_stress(own, work, share)
            if wanted:
                work[POINTS * MODULI :] = 0.0
                call_tangent(tangent, (work, constants, 1.0))
                _add_moduli(own, work, t * share)
        for last in range(2):
            for k in range(_W):
                m = min(begin + np.int64(k), count - 1)
                for a in range(3):
                    for A in range(3):
                        value = start[m, a, A] + (change[m, a, A] if last else 0.0)
                        F[a, A] = (1.0 if a == A else 0.0) if bad[k] else value
                        work[ROWS[GRADIENT] + np.uint64(POINTS * (3 * a + A)) + k] = F[a, A]
                work[ROWS[DETERMINANT] + k] = cofactors(F, scratch)
            call_block(block, (work, constants, 1.0, True))
            for k in range(_W):
                own[_BEFORE + last, k] = work[ROWS[ENERGY] + k] + work[ROWS[ACTIVE] + k]
        for c in range(np.uint64(9)):
            for k in range(_W):
                own[np.uint64(_LAST) + c, k] = work[ROWS[1] * c + k]
        for k in range(np.uint64(min(POINTS, count - begin))):
            m = begin + np.int64(k)
            if bad[k]:
                stress[m] = np.nan
                if wanted:
                    moduli[m] = np.nan
            else:
                _finish(start, change, own, modulus, m, k, tensors, varied, stress, moduli)
