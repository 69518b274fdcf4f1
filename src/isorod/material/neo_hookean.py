"""The neo-Hookean law."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, flat, njit
from isorod.material.law import Isotropic
from isorod.material.logarithm_kernel import discrete
from isorod.material.points import (
    BLOCK,
    DETERMINANT,
    ENERGY,
    FREE,
    GRADIENT,
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

_W = np.uint64(POINTS)
_F, _LOG = GRADIENT, ROWS[FREE]


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
            det = work[ROWS[DETERMINANT] + k]
            work[_LOG + k] = np.log(det) if det > 0.0 else np.nan
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
    """Fill in the stress at the points of a block (`isorod.material.points.BLOCK`)."""
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

    compiled = Compiled(block, tangent)

    # The bulk term's theta is ln J.
    logarithmic: ClassVar[bool] = True

    @property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        return matrix_energy()

    def discrete(self, F: Array, change: Array, wanted: bool = True) -> tuple[Array, Array | None]:
        """Return a stress that does the work of the energy, without a division by ``|D|``, and its moduli.

        See `isorod.material.logarithm_kernel`.
        """
        stress = np.empty(F.shape)
        moduli = np.empty((*F.shape, 3, 3) if wanted else (0, 3, 3, 3, 3))
        ends = flat(F), flat(change)
        discrete(*ends, self.mu, self.lame, 0.0, stress.reshape(-1, 3, 3), moduli.reshape(-1, 3, 3, 3, 3))
        return stress, moduli if wanted else None
