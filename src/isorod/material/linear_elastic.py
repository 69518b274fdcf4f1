"""Linear elasticity in small strains."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.law import Isotropic
from isorod.material.points import (
    BLOCK,
    ENERGY,
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

_F = GRADIENT


@njit(BLOCK, **FAST)
def _block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    mu, lame = constants[0], constants[1]
    for k in range(np.uint64(POINTS)):
        x, y, z = work[ROWS[_F] + k] - 1.0, work[ROWS[_F + 4] + k] - 1.0, work[ROWS[_F + 8] + k] - 1.0
        xy = work[ROWS[_F + 1] + k] + work[ROWS[_F + 3] + k]
        xz = work[ROWS[_F + 2] + k] + work[ROWS[_F + 6] + k]
        yz = work[ROWS[_F + 5] + k] + work[ROWS[_F + 7] + k]
        trace = x + y + z
        work[k], work[ROWS[1] + k], work[ROWS[2] + k] = 2.0 * mu * x + lame * trace, mu * xy, mu * xz
        work[ROWS[3] + k], work[ROWS[4] + k], work[ROWS[5] + k] = mu * xy, 2.0 * mu * y + lame * trace, mu * yz
        work[ROWS[6] + k], work[ROWS[7] + k], work[ROWS[8] + k] = mu * xz, mu * yz, 2.0 * mu * z + lame * trace
        square = x * x + y * y + z * z + 0.5 * (xy * xy + xz * xz + yz * yz)
        work[ROWS[ENERGY] + k] = mu * square + 0.5 * lame * trace * trace
        work[ROWS[ENERGY + 1] + k] = 0.0


@njit(TANGENT, **FAST)
def _tangent(work: Array, constants: Array, activation: float) -> None:
    mu, lame = constants[0], constants[1]
    for k in range(np.uint64(POINTS)):
        add_products(work, k, lame, mu, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        add_identity(work, k, ROWS[SQUARES], mu)
        add_identity(work, k, ROWS[SQUARES + 6], mu)
        add_identity(work, k, ROWS[SQUARES + 12], mu)


@cache
def _energy() -> "Energy":
    from sympy import eye, symbols

    from isorod.material.energy import Energy
    from isorod.material.symbols import F

    mu, lame = symbols("mu lame", nonnegative=True)
    strain = (F + F.T) / 2 - eye(3)
    return Energy(mu * sum(one**2 for one in strain), (mu, lame), (F.trace() - 3) ** 2 / 2)


@dataclass(frozen=True)
class LinearElastic(Isotropic):
    """Isotropic linear elasticity in small strains: ``W = mu e:e + lame/2 (tr e)^2``, ``e = sym(F) - 1``."""

    compiled = Compiled(_block, _tangent)
    objective: ClassVar[bool] = False
    linear: ClassVar[bool] = True

    # The bulk term's theta is tr e.
    logarithmic: ClassVar[bool] = False

    @property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        return _energy()
