"""What laws have in common that store what changes shape in invariants free of volume, and ``bulk/2 (ln J)^2``."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

from isorod.errors import InputError, representable
from isorod.material.law import Material

if TYPE_CHECKING:
    import sympy as sp

    from isorod.material.energy import Energy


class Isochoric(Material):
    """A law that stores ``bulk/2 (ln J)^2`` besides; ``bulk`` [force/area] may be infinite."""

    bulk: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.bulk > 0.0:
            raise InputError(f"bulk: got {self.bulk:g}, need a positive stress, infinite for an incompressible law")
        if math.isfinite(self.bulk):
            representable("bulk", self.bulk)

    @cached_property
    def lame(self) -> float:
        """Factor of the volumetric energy: the bulk modulus at rest, force / area."""
        return self.bulk

    @property
    def nu(self) -> float:
        """Poisson's ratio at rest, if isotropic; else that of the moduli of plane waves."""
        ratio = self.shear_modulus / self.modulus
        return 0.5 * (1.0 - 2.0 * ratio) / (1.0 - ratio)


def with_volume(shape: "sp.Expr", constants: Sequence["sp.Symbol"]) -> "Energy":
    """Return the energy with ``bulk/2 (ln J)^2`` besides what it stores otherwise."""
    from isorod.material.energy import LOGARITHMIC, Energy
    from isorod.material.symbols import bulk

    return Energy(shape, (*constants, bulk), LOGARITHMIC)


def positive(name: str, value: float, what: str = "a positive stress") -> None:
    """Raise `InputError` if a constant is not positive and finite."""
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{name}: got {value:g}, need {what}")
    representable(name, value)


def finite(name: str, value: float, what: str = "a finite stress") -> None:
    """Raise `InputError` if a constant is not finite."""
    if not math.isfinite(value):
        raise InputError(f"{name}: got {value:g}, need {what}")
