"""The law of St. Venant and Kirchhoff: linear in Green's strain, for large rotations and small strains."""

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
    # By components of C: with invariants small strains would be lost to rounding.
    strain = (C - eye(3)) / 2
    return Energy(mu * sum(one**2 for one in strain) + lame / 2 * strain.trace() ** 2, (mu, lame))


@dataclass(frozen=True)
class StVenantKirchhoff(Isotropic):
    """``W = mu E:E + lame/2 (tr E)^2``, ``E = (F^T F - 1)/2``.

    It softens in compression: the force in a bar with ``nu = 0`` is largest at the stretch ``1/sqrt 3``.
    """

    # The trace of E is not a function of the volume.
    splits: ClassVar[bool] = False
    recipe = (_energy,)

    @property
    def values(self) -> tuple[float, ...]:
        """``mu, lame``."""
        return self.mu, self.lame
