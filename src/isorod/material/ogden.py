"""The law of Ogden."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError, finite, modulus
from isorod.material.isochoric import Isochoric, with_volume

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy(terms: int) -> "Energy":
    from sympy import Integer, Rational, symbols

    from isorod.material.symbols import J, stretches

    mu, alpha = (symbols(f"{name}1:{terms + 1}", real=True) for name in ("mu", "alpha"))
    shape = Integer(0)
    for m, a in zip(mu, alpha, strict=True):
        shape += m / a * (J ** (-a * Rational(1, 3)) * sum(one**a for one in stretches) - 3)
    return with_volume(shape, (*mu, *alpha))


@dataclass(frozen=True)
class Ogden(Isochoric):
    """``W = sum_p mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3) + bulk/2 (ln J)^2``.

    ``l1, l2, l3`` are the principal stretches divided by ``J^(1/3)``: Ogden, Proc. R. Soc. A 326 (1972) 565-584.  Some
    programs take ``2 mu_p/alpha_p^2`` for the factor: their ``mu_p`` are ``alpha_p/2`` times these.

    Parameters
    ----------
    mu
        Factor of each term, force / area.
    alpha
        Exponent of each, not zero; half the sum of ``mu_p alpha_p`` is the shear modulus, which is positive.
    bulk
        Bulk modulus, force / area; infinite for an incompressible law, which takes the mixed formulation.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    mu: Sequence[float]
    alpha: Sequence[float]
    bulk: float

    def _check(self) -> None:
        for name in ("mu", "alpha"):
            object.__setattr__(self, name, tuple(float(one) for one in getattr(self, name)))
        if len(self.mu) != len(self.alpha) or not self.mu:
            raise InputError(f"alpha: got {len(self.alpha)} exponents for {len(self.mu)} factors mu, need one for each")
        for k, (mu, alpha) in enumerate(zip(self.mu, self.alpha, strict=True)):
            finite(f"mu[{k}]", mu, "a finite stress")
            finite(f"alpha[{k}]", alpha, "a finite exponent")
            if alpha == 0.0:
                raise InputError(f"alpha[{k}]: got 0, need an exponent that is not zero")
        modulus("sum of mu alpha / 2", 0.5 * sum(m * a for m, a in zip(self.mu, self.alpha, strict=True)))

    @property
    def recipe(self) -> tuple[Any, ...]:  # type: ignore[override]
        """Its energy, of as many terms as there are."""
        return _energy, len(self.mu)

    @property
    def values(self) -> tuple[float, ...]:
        """All ``mu``, then all ``alpha``."""
        return (*self.mu, *self.alpha)
