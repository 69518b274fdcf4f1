"""The law of Yeoh."""

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

    from isorod.material.symbols import I1bar

    c10, c20, c30 = symbols("c10 c20 c30", real=True)
    x = I1bar - 3
    return with_volume(c10 * x + c20 * x**2 + c30 * x**3, (c10, c20, c30))


@dataclass(frozen=True)
class Yeoh(Isochoric):
    """``W = c10 x + c20 x^2 + c30 x^3 + bulk/2 (ln J)^2``, ``x = I1bar - 3``: filled rubber, which stiffens.

    Yeoh, Rubber Chem. Technol. 66 (1993) 754-771.

    Parameters
    ----------
    c10, c20, c30
        Coefficients, force / area; the first, half of the shear modulus, is positive.
    bulk
        Bulk modulus, force / area; infinite for an incompressible law, which takes the mixed formulation.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    c10: float
    c20: float
    c30: float
    bulk: float

    recipe = (_energy,)

    def _check(self) -> None:
        modulus("c10", self.c10)
        finite("c20", self.c20, "a finite stress")
        finite("c30", self.c30, "a finite stress")

    @property
    def values(self) -> tuple[float, ...]:
        """``c10, c20, c30``."""
        return self.c10, self.c20, self.c30
