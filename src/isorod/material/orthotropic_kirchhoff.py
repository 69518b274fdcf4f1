"""Orthotropic law of St. Venant and Kirchhoff, for large rotations."""

from dataclasses import dataclass
from typing import ClassVar

from isorod.material.orthotropic import Orthotropic, quadratic


@dataclass(frozen=True, eq=False)
class OrthotropicKirchhoff(Orthotropic):
    """Linear in Green's strain with three axes, for large rotations: ``W = E:C E / 2``, ``E = (F^T F - 1) / 2``.

    For small strains without rotations it is `isorod.material.orthotropic.Orthotropic`.  Strains must be small as for
    the law of St. Venant and Kirchhoff, which softens under large compression.

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
    recipe = (quadratic, False)
