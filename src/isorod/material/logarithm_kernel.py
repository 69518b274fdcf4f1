"""The discrete gradient of an energy of the trace of ``C`` and of ``ln J``, without a division by ``|D|``.

For ``W(C) = mu/2 (tr C - 3) + g(det C)``, ``g = -mu ln J + lame/2 (ln J)^2 + pressure ln J``, between ``C_0`` and
``C_1 = C_0 + D``,

    S = mu 1 + 2 (dg / d det C) G,    G = cof(C_m) + cof(D) / 12,    C_m = C_0 + D/2,

with a difference quotient in the bracket: ``G : D = det C_1 - det C_0`` exactly.  For the rest see
`isorod.material.discrete_gradient_kernel`.
"""

import numpy as np
from numba import f8, void

from isorod.arrays import Array
from isorod.compiled import F3, F5, STRICT, cofactors, njit

# Below this a difference quotient's derivative is taken from its power series.
SERIES = 1e-3


@njit(**STRICT)
def _log_quotient(x: float) -> tuple[float, float]:
    """Return ``log(1 + x) / x`` and its derivative."""
    if abs(x) < SERIES:
        value = 1.0 - x * (1.0 / 2.0 - x * (1.0 / 3.0 - x * (1.0 / 4.0 - x * (1.0 / 5.0 - x / 6.0))))
        return value, -1.0 / 2.0 + x * (2.0 / 3.0 - x * (3.0 / 4.0 - x * (4.0 / 5.0 - x * 5.0 / 6.0)))
    value = np.log1p(x) / x
    return value, (1.0 / (1.0 + x) - value) / x


@njit(**STRICT)
def _vary(q: float, q_slope: float, work: Array, moduli: Array) -> None:
    """Fill in the derivatives of ``F_m S`` at one point, which `discrete` left the work space for."""
    E, S, end, middle, slope, mean = work[2], work[3], work[4], work[5], work[6], work[7]
    turned, varied = work[8], work[9]
    for b in range(3):
        for B in range(3):
            # dD for a unit change of the component b, B.
            for A in range(3):
                for K in range(3):
                    turned[A, K] = 0.0
            for A in range(3):
                turned[A, B] += end[b, A]
                turned[B, A] += end[b, A]
            opened = 0.0
            for A in range(3):
                for K in range(3):
                    opened += slope[A, K] * turned[A, K]
            opened *= 2.0 * q_slope
            for A in range(3):
                A1, A2 = (A + 1) % 3, (A + 2) % 3
                for K in range(3):
                    K1, K2 = (K + 1) % 3, (K + 2) % 3
                    # The derivative of a cofactor, bilinear in both.
                    cross = E[A1, K1] * turned[A2, K2] + turned[A1, K1] * E[A2, K2]
                    cross -= E[A1, K2] * turned[A2, K1] + turned[A1, K2] * E[A2, K1]
                    varied[A, K] = 2.0 * q * cross + opened * mean[A, K]
            for a in range(3):
                for A in range(3):
                    value = 0.5 * S[B, A] if a == b else 0.0
                    for K in range(3):
                        value += middle[a, K] * varied[K, A]
                    moduli[a, A, b, B] = value


@njit(void(F3, F3, f8, f8, f8, F3, F5), **STRICT)
def discrete(
    start: Array, change: Array, mu: float, lame: float, pressure: float, stress: Array, moduli: Array
) -> None:
    """Fill ``stress`` with ``F_m S``, and ``moduli``, if it has points, with its derivatives by ``F`` at the end."""
    work = np.empty((10, 3, 3))
    C, D, E, S, end, middle = work[0], work[1], work[2], work[3], work[4], work[5]
    cofactor, mean = work[6], work[7]
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
        push = 0.5 * (pressure - mu) + 0.125 * lame * logs
        q = push * quotient / d0
        for A in range(3):
            for B in range(3):
                S[A, B] = 2.0 * q * mean[A, B]
            S[A, A] += mu
        for a in range(3):
            for A in range(3):
                stress[m, a, A] = middle[a, 0] * S[0, A] + middle[a, 1] * S[1, A] + middle[a, 2] * S[2, A]
        if moduli.shape[0] == 0:
            continue
        slope = (0.125 * lame / (det1 * det1) * quotient + push * bend / d0) / d0
        for A in range(3):
            for B in range(3):
                C[A, B] += D[A, B]
                # What cofactors of ``mean``'s parts vary with, half of each.
                E[A, B] = 0.5 * E[A, B] + D[A, B] / 12.0
        # The derivative of det C_1.
        cofactors(C, cofactor)
        _vary(q, slope, work, moduli[m])
