"""The neo-Hookean law."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from isorod.material.law import Isotropic

if TYPE_CHECKING:
    from isorod.material.energy import Energy


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

    recipe = (matrix_energy,)
