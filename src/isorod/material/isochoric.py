"""Common base of laws with an isochoric energy and the volumetric energy ``bulk/2 (ln J)^2``."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

from isorod.errors import InputError, finite, representable
from isorod.material.law import Material

if TYPE_CHECKING:
    import sympy as sp

    from isorod.material.energy import Energy


class Isochoric(Material):
    """A law with the volumetric energy ``bulk/2 (ln J)^2``; ``bulk`` [force/area] may be infinite."""

    bulk: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_bulk(self.bulk)
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


def check_bulk(bulk: float) -> None:
    """Raise `InputError` if a bulk modulus is not positive."""
    if not bulk > 0.0:
        raise InputError(f"bulk: got {bulk:g}, need a positive stress, infinite for an incompressible law")


def check_written(parameters: Mapping[Any, float], bulk: float | None) -> None:
    """Raise `InputError` if a constant of a user-defined law is not finite, or `bulk` not positive."""
    for name, value in parameters.items():
        finite(f"constant {name}", value, "a finite number")
    if bulk is not None:
        check_bulk(bulk)


def with_volume(shape: "sp.Expr", constants: Sequence["sp.Symbol"]) -> "Energy":
    """Return the energy ``shape`` plus ``bulk/2 (ln J)^2``."""
    from isorod.material.energy import LOGARITHMIC, Energy
    from isorod.material.symbols import bulk

    return Energy(shape, (*constants, bulk), LOGARITHMIC)
