"""St. Venant's and Kirchhoff's law with axes: material with directions in large rotations."""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, ClassVar

from isorod.material.orthotropic import Orthotropic, quadratic
from isorod.material.points import Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@cache
def _energy() -> "Energy":
    from sympy import eye

    from isorod.material.symbols import C

    return quadratic((C - eye(3)) / 2)


@dataclass(frozen=True, eq=False)
class OrthotropicKirchhoff(Orthotropic):
    """Linear in Green's strain with three axes, for large rotations: ``W = E:C E / 2``, ``E = (F^T F - 1) / 2``.

    Where strains are small and nothing turns, it is `isorod.material.orthotropic.Orthotropic`.  Strains are to be small
    as for the law of St. Venant and Kirchhoff: pressed together by much, it gives way.

    Parameters
    ----------
    E, nu, G, axes
        Moduli, ratios and axes, those of `isorod.material.orthotropic.Orthotropic`.

    Raises
    ------
    InputError
        If a value is out of its range or not finite, or some strain would store negative energy.
    """

    objective: ClassVar[bool] = True
    linear: ClassVar[bool] = False

    @cached_property
    def stored(self) -> "Energy":
        """Its energy as an expression of ``C = F^T F`` and the first two axes."""
        return _energy()

    @property
    def compiled(self) -> Compiled:  # type: ignore[override]
        """The addresses of its compiled functions."""
        from isorod.material.written import compiled

        return compiled(self.stored)
