"""The neo-Hookean law."""

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from isorod.arrays import Array
from isorod.compiled import flat
from isorod.material.law import Isotropic
from isorod.material.logarithm_kernel import discrete

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

    # The bulk term's theta is ln J.
    logarithmic: ClassVar[bool] = True
    recipe = (matrix_energy,)

    def discrete(self, F: Array, change: Array, wanted: bool = True) -> tuple[Array, Array | None]:
        """Return a stress that does the work of the energy, without a division by ``|D|``, and its moduli.

        See `isorod.material.logarithm_kernel`.
        """
        stress = np.empty(F.shape)
        moduli = np.empty((*F.shape, 3, 3) if wanted else (0, 3, 3, 3, 3))
        ends = flat(F), flat(change)
        discrete(*ends, self.mu, self.lame, 0.0, stress.reshape(-1, 3, 3), moduli.reshape(-1, 3, 3, 3, 3))
        return stress, moduli if wanted else None
