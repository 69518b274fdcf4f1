"""Stress between two states that does exactly the work of the stored energy: a discrete gradient, point by point, with its tangent.

For ``W(C) = mu/2 (tr C - 3) + g(det C) + w(f.C f)``, neo-Hookean with fibres, between ``C_0`` and ``C_1 = C_0 + D``,

    S = mu 1 + 2 (dg / d det C) G + 2 (dw / d lambda^2) f f^T,    G = cof(C_m) + cof(D) / 12,    C_m = C_0 + D/2,

with difference quotients in the brackets.  As ``G : D = det C_1 - det C_0``, ``S : D / 2 = W(C_1) - W(C_0)`` exactly,
which is what makes a discrete gradient (Gonzalez, CMAME 190 (2000) 1763-1783).  ``S`` stays the same when both states
change places, so that it is of second order, and nothing is divided by ``|D|``.  With ``P = F_m S``, ``F_m`` the mean
of both deformation gradients, internal forces have no resultant and no moment.
"""

import numpy as np
from numba import f8, njit, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F4, F5, FAST, STRICT, cofactors
from isorod.material.muscle import ACTIVE_RANGE

# Below this a difference quotient's derivative is taken from its power series.
_SERIES = 1e-3


@njit(types.UniTuple(f8, 2)(f8), **STRICT)
def _log_quotient(x: float) -> tuple[float, float]:
    """Return ``log(1 + x) / x`` and its derivative."""
    if abs(x) < _SERIES:
        value = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 3.0 - x * (1.0 / 4.0 - x * (1.0 / 5.0 - x / 6.0))))
        return value, -1.0 / 2.0 + x * (2.0 / 3.0 - x * (3.0 / 4.0 - x * (4.0 / 5.0 - x * 5.0 / 6.0)))
    value = np.log1p(x) / x
    return value, (1.0 / (1.0 + x) - value) / x


@njit(types.UniTuple(f8, 2)(f8), **STRICT)
def _exp_quotient(y: float) -> tuple[float, float]:
    """Return ``(exp(y) - 1) / y`` and its derivative."""
    if abs(y) < _SERIES:
        value = 1.0 + y * (1.0 / 2.0 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y / 120.0)))
        return value, 1.0 / 2.0 + y * (1.0 / 3.0 + y * (1.0 / 8.0 + y * (1.0 / 30.0 + y / 144.0)))
    value = np.expm1(y) / y
    return value, (np.exp(y) - value) / y


@njit(types.UniTuple(f8, 2)(f8, f8, F1, f8), **STRICT)
def fibre_quotient(before: float, change: float, parameters: Array, activation: float) -> tuple[float, float]:
    """Return the fibre energy's difference quotient over ``c = lambda^2``, and its derivative by the ``c`` at the end.

    Parameters
    ----------
    before, change
        ``c`` at the start, and how much it grows.
    parameters, activation
        As for `isorod.material.muscle.point_stress`.
    """
    after = before + change
    first, last = np.sqrt(before), np.sqrt(after)
    total = first + last
    stretched = change / total
    low, high = -ACTIVE_RANGE, ACTIVE_RANGE
    s0, s1 = first - 1.0, last - 1.0
    k0, k1 = min(max(s0, low), high), min(max(s1, low), high)
    inside = 1.0 if k1 == s1 else 0.0
    # Share of the way within the active range; the force's slope jumps at its ends.
    share, turn = inside, 0.0
    if (k0 != s0 or k1 != s1) and stretched != 0.0:
        share = (k1 - k0) / stretched
        turn = (inside - share) / stretched
    mean = 1.0 - 4.0 / 3.0 * (k1 * k1 + k1 * k0 + k0 * k0)
    active = activation * parameters[2]
    value = active * share * mean / total
    slope = active * (turn * mean - share * 4.0 / 3.0 * (2.0 * k1 + k0) * inside - share * mean / total) / total
    slope *= 0.5 / last
    m1, m2 = parameters[3], parameters[4]
    if m1 > 0.0 and m2 > 0.0 and max(before, after) > 1.0:
        q0, q1 = max(before - 1.0, 0.0), max(after - 1.0, 0.0)
        inside = 1.0 if after > 1.0 else 0.0
        share, turn = 1.0, 0.0
        grown = change
        if before < 1.0 or after < 1.0:
            grown = q1 - q0
            share = grown / change
            turn = (inside - share) / change
        phi, dphi = _exp_quotient(m2 * grown)
        scale = np.exp(m2 * q0)
        bracket = scale * phi - 1.0
        value += 0.5 * m1 * share * bracket
        slope += 0.5 * m1 * (turn * bracket + share * scale * dphi * m2 * inside)
    return value, slope


@njit(void(F3, F3, F1, F2, f8, F3, F5), **STRICT)
def evaluate(
    start: Array, change: Array, parameters: Array, fibres: Array, activation: float, stress: Array, moduli: Array
) -> None:
    """Fill ``stress`` with ``F_m S``, and ``moduli`` with its derivatives by the deformation gradient at the end.

    Parameters
    ----------
    start, change
        Deformation gradients at the start, and their change, shape ``(points, 3, 3)``.
    parameters, activation
        As for `isorod.material.muscle.point_stress`.
    fibres
        Unit vectors, shape ``(points, 3)``.
    stress
        Shape ``(points, 3, 3)``; NaN where either state is inverted.
    moduli
        Shape ``(points, 3, 3, 3, 3)``, or of no points where they are not wanted.
    """
    mu, lame = parameters[0], parameters[1]
    has_fibres = parameters[2] > 0.0 or parameters[3] > 0.0
    work = np.empty((11, 3, 3))
    C, D, E, S, end, middle = work[0], work[1], work[2], work[3], work[4], work[5]
    cofactor, mean, turned, varied, slope = work[6], work[7], work[8], work[9], work[10]
    for m in range(start.shape[0]):
        F, H = start[m], change[m]
        for a in range(3):
            for A in range(3):
                end[a, A] = F[a, A] + H[a, A]
                middle[a, A] = F[a, A] + 0.5 * H[a, A]
        det0, det1 = cofactors(F, cofactor), cofactors(end, cofactor)
        if not (det0 > 0.0 and det1 > 0.0):
            stress[m] = np.nan
            if moduli.shape[0]:
                moduli[m] = np.nan
            continue
        for A in range(3):
            for B in range(3):
                C[A, B] = 0.0
                D[A, B] = 0.0
                for a in range(3):
                    C[A, B] += F[a, A] * F[a, B]
                    D[A, B] += middle[a, A] * H[a, B] + H[a, A] * middle[a, B]
        for A in range(3):
            for B in range(3):
                E[A, B] = C[A, B] + 0.5 * D[A, B]
        cofactors(E, mean)
        cofactors(D, cofactor)
        grown = 0.0
        for A in range(3):
            for B in range(3):
                mean[A, B] += cofactor[A, B] / 12.0
                grown += mean[A, B] * D[A, B]
        d0 = det0 * det0
        quotient, bend = _log_quotient(grown / d0)
        # Their sum: ln det C_0 + ln det C_1.
        logs = 2.0 * (np.log(det0) + np.log(det1))
        pressure = -0.5 * mu + 0.125 * lame * logs
        q = pressure * quotient / d0
        for A in range(3):
            for B in range(3):
                S[A, B] = 2.0 * q * mean[A, B]
            S[A, A] += mu
        tension = tension_slope = 0.0
        f = fibres[m]
        if has_fibres:
            before = length = 0.0
            for A in range(3):
                for B in range(3):
                    before += f[A] * C[A, B] * f[B]
                    length += f[A] * D[A, B] * f[B]
            tension, tension_slope = fibre_quotient(before, length, parameters, activation)
            for A in range(3):
                for B in range(3):
                    S[A, B] += 2.0 * tension * f[A] * f[B]
        for a in range(3):
            for A in range(3):
                stress[m, a, A] = middle[a, 0] * S[0, A] + middle[a, 1] * S[1, A] + middle[a, 2] * S[2, A]
        if moduli.shape[0] == 0:
            continue
        q_slope = (0.125 * lame / (det1 * det1) * quotient + pressure * bend / d0) / d0
        for A in range(3):
            for B in range(3):
                C[A, B] += D[A, B]
                E[A, B] = 0.5 * E[A, B] + D[A, B] / 12.0
        # The derivative of det C_1.
        cofactors(C, slope)
        for b in range(3):
            for B in range(3):
                # dD for a unit change of the component b, B.
                for A in range(3):
                    for K in range(3):
                        turned[A, K] = 0.0
                for A in range(3):
                    turned[A, B] += end[b, A]
                    turned[B, A] += end[b, A]
                opened = stretched = 0.0
                for A in range(3):
                    for K in range(3):
                        opened += slope[A, K] * turned[A, K]
                        stretched += f[A] * turned[A, K] * f[K]
                opened *= 2.0 * q_slope
                stretched *= 2.0 * tension_slope
                for A in range(3):
                    A1, A2 = (A + 1) % 3, (A + 2) % 3
                    for K in range(3):
                        K1, K2 = (K + 1) % 3, (K + 2) % 3
                        # The derivative of a cofactor, bilinear in both.
                        cross = E[A1, K1] * turned[A2, K2] + turned[A1, K1] * E[A2, K2]
                        cross -= E[A1, K2] * turned[A2, K1] + turned[A1, K2] * E[A2, K1]
                        varied[A, K] = 2.0 * q * cross + opened * mean[A, K]
                        if has_fibres:
                            varied[A, K] += stretched * f[A] * f[K]
                for a in range(3):
                    for A in range(3):
                        value = 0.5 * S[B, A] if a == b else 0.0
                        for K in range(3):
                            value += middle[a, K] * varied[K, A]
                        moduli[m, a, A, b, B] = value


@njit(void(F1, F5, F3, F4), **FAST)
def contract(weights: Array, moduli: Array, gradient: Array, out: Array) -> None:
    """Fill ``out`` ``(points, 3, 9, n)``, index ``A, (a, b), k``, with weighted moduli times the gradients of functions ``k``.

    Parameters
    ----------
    weights, moduli
        Shapes ``(points,)`` and ``(points, 3, 3, 3, 3)``.
    gradient
        Gradients of the functions by place, shape ``(points, 3, n)``.
    """
    points, _, functions = gradient.shape
    for m in range(points):
        for A in range(3):
            for a in range(3):
                for b in range(3):
                    x, y, z = (
                        weights[m] * moduli[m, a, A, b, 0],
                        weights[m] * moduli[m, a, A, b, 1],
                        weights[m] * moduli[m, a, A, b, 2],
                    )
                    for k in range(functions):
                        out[m, A, 3 * a + b, k] = x * gradient[m, 0, k] + y * gradient[m, 1, k] + z * gradient[m, 2, k]
