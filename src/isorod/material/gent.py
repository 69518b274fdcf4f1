"""The law of Gent."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from isorod.errors import modulus
from isorod.material.isochoric import Isochoric, with_volume

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy() -> "Energy":
    from sympy import log, symbols

    from isorod.material.symbols import I1bar

    mu, limit = symbols("mu limit", positive=True)
    return with_volume(-mu * limit / 2 * log(1 - (I1bar - 3) / limit), (mu, limit))


@dataclass(frozen=True)
class Gent(Isochoric):
    """``W = - mu Jm/2 ln(1 - (I1bar - 3)/Jm) + bulk/2 (ln J)^2``: chains that can be stretched so far, not further.

    Gent, Rubber Chem. Technol. 69 (1996) 59-61.  Where ``I1bar - 3`` reaches ``Jm`` there is no stress that a step of
    Newton's method could go on from: load steps that pass it are cut.

    Parameters
    ----------
    mu
        Shear modulus, force / area.
    limit
        ``Jm``, the value that ``I1bar - 3`` does not reach; of rubber 30 to 100.
    bulk
        Bulk modulus, force / area; infinite for an incompressible law, which takes the mixed formulation.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    mu: float
    limit: float
    bulk: float

    recipe = (_energy,)

    def _check(self) -> None:
        modulus("mu", self.mu)
        modulus("limit", self.limit, "a positive number that I1bar - 3 does not reach")

    @property
    def values(self) -> tuple[float, ...]:
        """``mu, limit``."""
        return self.mu, self.limit
