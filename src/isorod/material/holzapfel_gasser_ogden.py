"""The law of Holzapfel, Gasser and Ogden: fibres that stiffen, of one family or two, in a neo-Hookean matrix."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError, modulus
from isorod.material.fibre import Fibre
from isorod.material.isochoric import Isochoric, with_volume

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy(families: int, dispersed: bool) -> "Energy":
    from sympy import Max, Rational, exp, symbols

    from isorod.material.symbols import I1, I1bar, I4a, I4b

    c, k1, k2 = symbols("c k1 k2", positive=True)
    kappa = symbols("dispersion", nonnegative=True)
    shape = c / 2 * (I1bar - 3)
    for along in (I4a, I4b)[:families]:
        # The mean squared stretch of fibres about the direction, minus 1.
        longer = kappa * (I1 - 3) + (1 - 3 * kappa) * (along - 1) if dispersed else along - 1
        shape += k1 * Rational(1, 2) / k2 * (exp(k2 * Max(longer, 0) ** 2) - 1)
    return with_volume(shape, (c, k1, k2, *([kappa] if dispersed else [])))


@dataclass(frozen=True, eq=False)
class HolzapfelGasserOgden(Isochoric):
    """``W = c/2 (I1bar - 3) + sum k1/(2 k2) (exp(k2 E^2) - 1) + bulk/2 (ln J)^2``: walls of arteries, tendons.

    ``E = max(0, kappa (I1 - 3) + (1 - 3 kappa) (I4 - 1))`` of each family of fibres, ``I4`` the square of its stretch:
    tension-only fibres (Holzapfel, Gasser & Ogden, J. Elasticity 61 (2000) 1-48; with dispersion, J. R. Soc. Interface
    3 (2006) 15-35).  They depend on the full deformation, not on its isochoric part: with that alone a swollen body
    would stay a sphere (Nolan et al., J. Mech. Behav. Biomed. Mater. 39 (2014) 48-60).

    Parameters
    ----------
    c
        Shear modulus of the matrix, force / area.
    k1, k2
        Fibres: stress factor, force / area, and exponent.
    bulk
        Bulk modulus, force / area; infinite for an incompressible law, which takes the mixed formulation.
    dispersion
        ``kappa``: 0 where fibres are parallel, 1/3 where they point in all directions alike.
    fibre
        Direction of the fibres at rest: a vector, a word or a function of places (`isorod.material.fibre`), such as
        ``helix(30)``; a tuple or list of two for two families, as ``(helix(30), helix(-30))``.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    c: float
    k1: float
    k2: float
    bulk: float
    dispersion: float = 0.0
    fibre: Fibre | tuple[Fibre, Fibre] = "tangent"

    def _check(self) -> None:
        modulus("c", self.c)
        modulus("k1", self.k1)
        modulus("k2", self.k2, "a positive exponent")
        if not 0.0 <= self.dispersion <= 1.0 / 3.0:
            raise InputError(f"dispersion: got {self.dispersion:g}, need 0 (parallel fibres) to 1/3 (isotropic)")

    @property
    def families(self) -> int:  # type: ignore[override]
        """Number of families of fibres."""
        return 2 if isinstance(self.fibre, tuple | list) and len(self.fibre) == 2 else 1

    @property
    def recipe(self) -> tuple[Any, ...]:  # type: ignore[override]
        """Its energy, of one family of fibres or two, parallel or not."""
        return _energy, self.families, self.dispersion > 0.0

    @property
    def values(self) -> tuple[float, ...]:
        """``c, k1, k2`` and, if it is not zero, the dispersion."""
        return self.c, self.k1, self.k2, *([self.dispersion] if self.dispersion > 0.0 else [])
