"""The law of Mooney and Rivlin."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from isorod.errors import finite, modulus
from isorod.material.isochoric import Isochoric, with_volume

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy() -> "Energy":
    from sympy import symbols

    from isorod.material.symbols import I1bar, I2bar

    c10, c01 = symbols("c10 c01", real=True)
    return with_volume(c10 * (I1bar - 3) + c01 * (I2bar - 3), (c10, c01))


@dataclass(frozen=True)
class MooneyRivlin(Isochoric):
    """``W = c10 (I1bar - 3) + c01 (I2bar - 3) + bulk/2 (ln J)^2``, of rubber up to strains of about 100 %.

    Parameters
    ----------
    c10, c01
        Half of what each adds to the shear modulus ``2 (c10 + c01)``, which is positive, force / area.
    bulk
        Bulk modulus, force / area; infinite for an incompressible law, which takes the mixed formulation.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    c10: float
    c01: float
    bulk: float

    recipe = (_energy,)

    def _check(self) -> None:
        finite("c10", self.c10, "a finite stress")
        finite("c01", self.c01, "a finite stress")
        modulus("c10 + c01", self.c10 + self.c01)

    @property
    def values(self) -> tuple[float, ...]:
        """``c10, c01``."""
        return self.c10, self.c01
