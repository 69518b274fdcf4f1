"""St. Venant's and Kirchhoff's law with axes: material with directions in large rotations."""

from dataclasses import dataclass
from typing import ClassVar

from isorod.material.orthotropic import Orthotropic, quadratic


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
    recipe = (quadratic, False)
