"""What laws have in common whose compiled functions are made from their energy."""

from abc import abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array, Index
from isorod.material.law import Material, Split, plane_waves
from isorod.material.points import Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy


class FromEnergy(Split):
    """A law of which an energy says everything (`isorod.material.energy.Energy`)."""

    @property
    @abstractmethod
    def stored(self) -> "Energy":
        """Its energy as an expression."""

    @property
    @abstractmethod
    def values(self) -> tuple[float, ...]:
        """The constants of its energy but for the factor of the volumetric one."""

    @property
    @abstractmethod
    def lame(self) -> float:
        """Bulk modulus that is the factor of the volumetric energy, force / area: may be infinite; 0 without one."""

    @cached_property
    def constants(self) -> Array:
        """The values of the symbols of its energy's constants."""
        return np.array([*self.values, *([] if self.stored.volume is None else [self.lame])], dtype=float)

    @property
    def compiled(self) -> Compiled:  # type: ignore[override]
        """The addresses of its compiled functions."""
        from isorod.material.written import compiled

        return compiled(self.stored)

    @property
    def shear(self) -> Material:
        """The law without its volumetric energy, for the mixed formulation (`isorod.assembly.mixed`)."""
        return self if self.stored.volume is None else Shape(self)

    @property
    def splits(self) -> bool:
        """Whether it has a volumetric energy."""
        return self.stored.volume is not None

    def complementary(self, p: Array) -> tuple[Array, Array, Array]:
        """Return the volumetric energy's Legendre transform and its derivatives (`isorod.material.law.Split`)."""
        if self.stored.quadratic or not np.isfinite(self.lame):
            return super().complementary(p)
        from isorod.material.legendre import transform

        return transform(self.stored.volume, p / self.lame, self.lame)

    @cached_property
    def mu(self) -> float:
        """The least modulus of plane waves at rest, force / area: the shear modulus, if isotropic."""
        return float(plane_waves(self.shear).min())

    @cached_property
    def modulus(self) -> float:
        """Modulus of pressure waves at rest, force / area."""
        return self.lame + (super().modulus if self.stored.volume is None else self.shear.modulus)

    @property
    def surface_modulus(self) -> float:
        """How stiff a surface is against waves of pressure at rest (`Material.surface_modulus`)."""
        return 4.0 * self.mu * (1.0 - self.mu / self.modulus)

    @property
    def nu(self) -> float:
        """Poisson's ratio at rest, if isotropic; else that of the moduli of plane waves."""
        ratio = self.mu / self.modulus
        return 0.5 * (1.0 - 2.0 * ratio) / (1.0 - ratio)


class Shape(Material):
    """What a law stores besides the volumetric energy.

    Parameters
    ----------
    law
        A law that splits.
    """

    def __init__(self, law: FromEnergy) -> None:
        self.law = law

    @property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        from isorod.material.energy import Energy

        whole = self.law.stored
        return Energy(whole.shape, whole.constants)

    @property
    def constants(self) -> Array:
        """Those of the law, but for the factor of the volumetric energy."""
        return np.append(self.law.constants[:-1], 0.0)

    @property
    def compiled(self) -> Compiled:  # type: ignore[override]
        """The addresses of the law's functions."""
        return self.law.compiled

    def at(self, factor: float) -> Material:  # type: ignore[override]
        """Return the law at a load factor."""
        law = self.law.at(factor)
        return self if law is self.law else Shape(law)

    def some(self, places: Index) -> Material:  # type: ignore[override]
        """Return the law at some places."""
        law = self.law.some(places)
        return self if law is self.law else Shape(law)
