"""The neo-Hookean law."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numba import f8, void

from isorod.arrays import Array
from isorod.compiled import F3, F5, FAST, STRICT, cofactors, flat, njit
from isorod.material.law import Isotropic
from isorod.material.points import (
    BLOCK,
    DETERMINANT,
    ENERGY,
    FREE,
    GRADIENT,
    POINT,
    POINTS,
    ROWS,
    SQUARES,
    TANGENT,
    Compiled,
    add_identity,
    add_products,
)

if TYPE_CHECKING:
    from isorod.material.energy import Energy

# Below this a difference quotient's derivative is taken from its power series.
SERIES = 1e-3

_W = np.uint64(POINTS)
_F, _LOG = GRADIENT, ROWS[FREE]


@njit(POINT, **STRICT)
def point(F: Array, constants: Array, fibre: Array, activation: float, stress: Array) -> tuple[float, float]:
    """Fill in ``P = mu F + (lame ln J - mu) F^-T`` and return the energy (`isorod.material.points.POINT`)."""
    mu, lame = constants[0], constants[1]
    det = cofactors(F, stress)
    log = np.log(det) if det > 0.0 else np.nan
    factor = (lame * log - mu) / det
    trace = 0.0
    for a in range(3):
        for A in range(3):
            trace += F[a, A] * F[a, A]
            stress[a, A] = mu * F[a, A] + factor * stress[a, A]
    return 0.5 * mu * (trace - 2.0 * log - 3.0) + 0.5 * lame * log * log, 0.0


@njit(**FAST)
def logarithms(work: Array) -> None:
    """Fill a row with ``ln det F``: by a series that is exact to rounding in [1/2, 2], or anywhere by the library."""
    far = 0.0
    for k in range(_W):
        det = work[ROWS[DETERMINANT] + k]
        # NaN fails the comparisons.
        far += 0.0 if (det >= 0.5) & (det <= 2.0) else 1.0
    if far > 0.0:
        for k in range(_W):
            work[_LOG + k] = np.log(work[ROWS[DETERMINANT] + k])
        return
    for k in range(_W):
        det = work[ROWS[DETERMINANT] + k]
        z = (det - 1.0) / (det + 1.0)
        x = z * z
        # 2 atanh z, |z| <= 1/3
        y = 1.0 / 29.0 + x * (1.0 / 31.0)
        y = 1.0 / 25.0 + x * (1.0 / 27.0 + x * y)
        y = 1.0 / 21.0 + x * (1.0 / 23.0 + x * y)
        y = 1.0 / 17.0 + x * (1.0 / 19.0 + x * y)
        y = 1.0 / 13.0 + x * (1.0 / 15.0 + x * y)
        y = 1.0 / 9.0 + x * (1.0 / 11.0 + x * y)
        y = 1.0 / 5.0 + x * (1.0 / 7.0 + x * y)
        work[_LOG + k] = 2.0 * z * (1.0 + x * (1.0 / 3.0 + x * y))


@njit(**FAST)
def stress_in_block(work: Array, mu: float, lame: float, k: int) -> tuple[float, ...]:
    """Return the nine components of ``P`` at a point of a block that has its ``ln det F``."""
    f00, f01, f02 = work[ROWS[_F] + k], work[ROWS[_F + 1] + k], work[ROWS[_F + 2] + k]
    f10, f11, f12 = work[ROWS[_F + 3] + k], work[ROWS[_F + 4] + k], work[ROWS[_F + 5] + k]
    f20, f21, f22 = work[ROWS[_F + 6] + k], work[ROWS[_F + 7] + k], work[ROWS[_F + 8] + k]
    q = (lame * work[_LOG + k] - mu) / work[ROWS[DETERMINANT] + k]
    return (
        mu * f00 + q * (f11 * f22 - f12 * f21),
        mu * f01 + q * (f12 * f20 - f10 * f22),
        mu * f02 + q * (f10 * f21 - f11 * f20),
        mu * f10 + q * (f21 * f02 - f22 * f01),
        mu * f11 + q * (f22 * f00 - f20 * f02),
        mu * f12 + q * (f20 * f01 - f21 * f00),
        mu * f20 + q * (f01 * f12 - f02 * f11),
        mu * f21 + q * (f02 * f10 - f00 * f12),
        mu * f22 + q * (f00 * f11 - f01 * f10),
    )


@njit(**FAST)
def energies_in_block(work: Array, mu: float, lame: float) -> None:
    """Fill in the energies at the points of a block that has its ``ln det F``."""
    for k in range(_W):
        trace = 0.0
        for r in range(np.uint64(9)):
            trace += work[ROWS[_F] + r * _W + k] ** 2
        log = work[_LOG + k]
        work[ROWS[ENERGY] + k] = 0.5 * mu * (trace - 3.0 - 2.0 * log) + 0.5 * lame * log * log
        work[ROWS[ENERGY + 1] + k] = 0.0


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Do what `point` does at the points of a block (`isorod.material.points.BLOCK`)."""
    mu, lame = constants[0], constants[1]
    logarithms(work)
    for k in range(_W):
        p = stress_in_block(work, mu, lame, k)
        work[k], work[ROWS[1] + k], work[ROWS[2] + k] = p[0], p[1], p[2]
        work[ROWS[3] + k], work[ROWS[4] + k], work[ROWS[5] + k] = p[3], p[4], p[5]
        work[ROWS[6] + k], work[ROWS[7] + k], work[ROWS[8] + k] = p[6], p[7], p[8]
    if wanted:
        energies_in_block(work, mu, lame)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add ``mu d_ab d_AB + lame G_aA G_bB + (mu - lame ln J) G_aB G_bA``, ``G = F^-T``, to the moduli."""
    mu, lame = constants[0], constants[1]
    for k in range(_W):
        f00, f01, f02 = work[ROWS[_F] + k], work[ROWS[_F + 1] + k], work[ROWS[_F + 2] + k]
        f10, f11, f12 = work[ROWS[_F + 3] + k], work[ROWS[_F + 4] + k], work[ROWS[_F + 5] + k]
        f20, f21, f22 = work[ROWS[_F + 6] + k], work[ROWS[_F + 7] + k], work[ROWS[_F + 8] + k]
        square = 1.0 / (work[ROWS[DETERMINANT] + k] * work[ROWS[DETERMINANT] + k])
        add_products(
            work,
            k,
            lame * square,
            (mu - lame * work[_LOG + k]) * square,
            (f11 * f22 - f12 * f21, f12 * f20 - f10 * f22, f10 * f21 - f11 * f20),
            (f21 * f02 - f22 * f01, f22 * f00 - f20 * f02, f20 * f01 - f21 * f00),
            (f01 * f12 - f02 * f11, f02 * f10 - f00 * f12, f00 * f11 - f01 * f10),
        )
        add_identity(work, k, ROWS[SQUARES], mu)
        add_identity(work, k, ROWS[SQUARES + 6], mu)
        add_identity(work, k, ROWS[SQUARES + 12], mu)


@cache
def matrix_energy() -> "Energy":
    """Return the energy of the law as an expression."""
    from sympy import log, symbols

    from isorod.material.energy import LOGARITHMIC, Energy
    from isorod.material.symbols import I1, J

    mu, lame = symbols("mu lame", nonnegative=True)
    return Energy(mu / 2 * (I1 - 2 * log(J) - 3), (mu, lame), LOGARITHMIC)


@dataclass(frozen=True)
class NeoHookean(Isotropic):
    """``W = mu/2 (I1 - 2 ln J - 3) + kappa/2 (ln J)^2``, ``kappa`` Lame's first parameter (Lu & Zhou 2011, eq. 15)."""

    compiled = Compiled(point, block, tangent)

    # The bulk term's theta is ln J.
    logarithmic: ClassVar[bool] = True

    @property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        return matrix_energy()

    def discrete(self, F: Array, change: Array, wanted: bool = True) -> tuple[Array, Array | None]:
        """Return a stress that does the work of the energy, without a division by ``|D|``, and its moduli.

        For ``W(C) = mu/2 (tr C - 3) + g(det C)`` between ``C_0`` and ``C_1 = C_0 + D``,

            S = mu 1 + 2 (dg / d det C) G,    G = cof(C_m) + cof(D) / 12,    C_m = C_0 + D/2,

        with a difference quotient in the bracket: ``G : D = det C_1 - det C_0`` exactly.  For the rest see
        `isorod.material.discrete_gradient`.
        """
        stress = np.empty(F.shape)
        moduli = np.empty((*F.shape, 3, 3) if wanted else (0, 3, 3, 3, 3))
        _discrete(flat(F), flat(change), self.mu, self.lame, stress.reshape(-1, 3, 3), moduli.reshape(-1, 3, 3, 3, 3))
        return stress, moduli if wanted else None


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
    """Fill in the derivatives of ``F_m S`` at one point, which `_discrete` left the work space for."""
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


@njit(void(F3, F3, f8, f8, F3, F5), **STRICT)
def _discrete(start: Array, change: Array, mu: float, lame: float, stress: Array, moduli: Array) -> None:
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
        pressure = -0.5 * mu + 0.125 * lame * logs
        q = pressure * quotient / d0
        for A in range(3):
            for B in range(3):
                S[A, B] = 2.0 * q * mean[A, B]
            S[A, A] += mu
        for a in range(3):
            for A in range(3):
                stress[m, a, A] = middle[a, 0] * S[0, A] + middle[a, 1] * S[1, A] + middle[a, 2] * S[2, A]
        if moduli.shape[0] == 0:
            continue
        slope = (0.125 * lame / (det1 * det1) * quotient + pressure * bend / d0) / d0
        for A in range(3):
            for B in range(3):
                C[A, B] += D[A, B]
                # What cofactors of ``mean``'s parts vary with, half of each.
                E[A, B] = 0.5 * E[A, B] + D[A, B] / 12.0
        # The derivative of det C_1.
        cofactors(C, cofactor)
        _vary(q, slope, work, moduli[m])
