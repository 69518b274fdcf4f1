"""Linear elasticity in small strains."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

from isorod.material.law import Isotropic

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy() -> "Energy":
    from sympy import eye, symbols

    from isorod.material.energy import Energy
    from isorod.material.symbols import C

    mu, lame = symbols("mu lame", nonnegative=True)
    strain = (C - eye(3)) / 2
    return Energy(mu * sum(one**2 for one in strain), (mu, lame), strain.trace() ** 2 / 2, small=True)


@dataclass(frozen=True)
class LinearElastic(Isotropic):
    """Isotropic linear elasticity in small strains: ``W = mu e:e + lame/2 (tr e)^2``, ``e = sym(F) - 1``."""

    objective: ClassVar[bool] = False
    linear: ClassVar[bool] = True

    # The bulk term's theta is tr e.
    logarithmic: ClassVar[bool] = False
    recipe = (_energy,)
