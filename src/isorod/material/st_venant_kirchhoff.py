"""The law of St. Venant and Kirchhoff: linear in Green's strain, for large rotations and small strains."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.law import Isotropic
from isorod.material.points import (
    ACTIVE,
    BLOCK,
    DETERMINANT,
    ENERGY,
    GRADIENT,
    MODULI,
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

_F = GRADIENT


@njit(BLOCK, **FAST)
def _block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress at the points of a block (`isorod.material.points.BLOCK`)."""
    mu, lame = constants[0], constants[1]
    for k in range(np.uint64(POINTS)):
        # NaN fails the comparison.
        valid = 1.0 if work[ROWS[DETERMINANT] + k] > 0.0 else np.nan
        f00, f01, f02 = work[ROWS[_F] + k], work[ROWS[_F + 1] + k], work[ROWS[_F + 2] + k]
        f10, f11, f12 = work[ROWS[_F + 3] + k], work[ROWS[_F + 4] + k], work[ROWS[_F + 5] + k]
        f20, f21, f22 = work[ROWS[_F + 6] + k], work[ROWS[_F + 7] + k], work[ROWS[_F + 8] + k]
        e00, e11, e22 = (
            0.5 * (f00 * f00 + f10 * f10 + f20 * f20 - 1.0),
            0.5 * (f01 * f01 + f11 * f11 + f21 * f21 - 1.0),
            0.5 * (f02 * f02 + f12 * f12 + f22 * f22 - 1.0),
        )
        e01, e02, e12 = (
            0.5 * (f00 * f01 + f10 * f11 + f20 * f21),
            0.5 * (f00 * f02 + f10 * f12 + f20 * f22),
            0.5 * (f01 * f02 + f11 * f12 + f21 * f22),
        )
        trace, twice = e00 + e11 + e22, 2.0 * valid * mu
        bulk = valid * lame * trace
        s00, s11, s22 = twice * e00 + bulk, twice * e11 + bulk, twice * e22 + bulk
        s01, s02, s12 = twice * e01, twice * e02, twice * e12
        work[k] = f00 * s00 + f01 * s01 + f02 * s02
        work[ROWS[1] + k] = f00 * s01 + f01 * s11 + f02 * s12
        work[ROWS[2] + k] = f00 * s02 + f01 * s12 + f02 * s22
        work[ROWS[3] + k] = f10 * s00 + f11 * s01 + f12 * s02
        work[ROWS[4] + k] = f10 * s01 + f11 * s11 + f12 * s12
        work[ROWS[5] + k] = f10 * s02 + f11 * s12 + f12 * s22
        work[ROWS[6] + k] = f20 * s00 + f21 * s01 + f22 * s02
        work[ROWS[7] + k] = f20 * s01 + f21 * s11 + f22 * s12
        work[ROWS[8] + k] = f20 * s02 + f21 * s12 + f22 * s22
        if wanted:
            squares = e00 * e00 + e11 * e11 + e22 * e22 + 2.0 * (e01 * e01 + e02 * e02 + e12 * e12)
            work[ROWS[ENERGY] + k] = valid * (mu * squares + 0.5 * lame * trace * trace)
            work[ROWS[ACTIVE] + k] = 0.0


@njit(TANGENT, **FAST)
def _tangent(work: Array, constants: Array, activation: float) -> None:
    """Add ``d_ab S_AB + lame F_aA F_bB + mu (F_aB F_bA + (F F^T)_ab d_AB)`` to the moduli."""
    mu, lame = constants[0], constants[1]
    for k in range(np.uint64(POINTS)):
        # NaN fails the comparison.
        valid = 1.0 if work[ROWS[DETERMINANT] + k] > 0.0 else np.nan
        f00, f01, f02 = work[ROWS[_F] + k], work[ROWS[_F + 1] + k], work[ROWS[_F + 2] + k]
        f10, f11, f12 = work[ROWS[_F + 3] + k], work[ROWS[_F + 4] + k], work[ROWS[_F + 5] + k]
        f20, f21, f22 = work[ROWS[_F + 6] + k], work[ROWS[_F + 7] + k], work[ROWS[_F + 8] + k]
        p, q, r = (f00, f01, f02), (f10, f11, f12), (f20, f21, f22)
        add_products(work, k, valid * lame, valid * mu, p, q, r)
        c00, c11, c22 = (
            f00 * f00 + f10 * f10 + f20 * f20,
            f01 * f01 + f11 * f11 + f21 * f21,
            f02 * f02 + f12 * f12 + f22 * f22,
        )
        bulk = 0.5 * lame * (c00 + c11 + c22 - 3.0) - mu
        s01, s02, s12 = (
            mu * (f00 * f01 + f10 * f11 + f20 * f21),
            mu * (f00 * f02 + f10 * f12 + f20 * f22),
            mu * (f01 * f02 + f11 * f12 + f21 * f22),
        )
        for a in range(np.uint64(3)):
            row = ROWS[SQUARES] + a * ROWS[6] + k
            work[row] += mu * c00 + bulk
            work[row + ROWS[1]] += s01
            work[row + ROWS[2]] += s02
            work[row + ROWS[3]] += mu * c11 + bulk
            work[row + ROWS[4]] += s12
            work[row + ROWS[5]] += mu * c22 + bulk
        add_identity(work, k, ROWS[SQUARES], mu * (f00 * f00 + f01 * f01 + f02 * f02))
        add_identity(work, k, ROWS[SQUARES + 6], mu * (f10 * f10 + f11 * f11 + f12 * f12))
        add_identity(work, k, ROWS[SQUARES + 12], mu * (f20 * f20 + f21 * f21 + f22 * f22))
        b01, b02, b12 = (
            mu * (f00 * f10 + f01 * f11 + f02 * f12),
            mu * (f00 * f20 + f01 * f21 + f02 * f22),
            mu * (f10 * f20 + f11 * f21 + f12 * f22),
        )
        for A in range(np.uint64(3)):
            row = ROWS[MODULI] + A * ROWS[4] + k
            work[row] += b01
            work[row + ROWS[9]] += b02
            work[row + ROWS[18]] += b12


@cache
def _energy() -> "Energy":
    from sympy import symbols

    from isorod.material.energy import Energy
    from isorod.material.symbols import I1, I2

    mu, lame = symbols("mu lame", nonnegative=True)
    # Of E = (C - 1)/2, with C:C = I1^2 - 2 I2.
    trace, square = (I1 - 3) / 2, (I1**2 - 2 * I2 - 2 * I1 + 3) / 4
    return Energy(mu * square + lame / 2 * trace**2, (mu, lame))


@dataclass(frozen=True)
class StVenantKirchhoff(Isotropic):
    """``W = mu E:E + lame/2 (tr E)^2``, ``E = (F^T F - 1)/2``.

    It softens in compression: a bar with ``nu = 0`` bears no more at the stretch ``1/sqrt 3``.
    """

    compiled = Compiled(_block, _tangent)

    @property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        return _energy()

    @property
    def splits(self) -> bool:
        """Whether it is one for the mixed formulation: the trace of ``E`` is no change of volume."""
        return False
