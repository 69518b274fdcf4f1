"""What laws have in common whose compiled functions are made from their energy."""

from abc import abstractmethod
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self, cast

import numpy as np

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.material import fibre as directions
from isorod.material.fibre import Fibre
from isorod.material.law import Material, Split, plane_waves
from isorod.material.places import Places
from isorod.material.points import Compiled

# Share by which a law is swollen that is asked for its moduli at rest: fibres that bear no compression are taut.
_TAUT = 1e-9

if TYPE_CHECKING:
    from isorod.material.energy import Energy


class FromEnergy(Split):
    """A law of which an energy says everything (`isorod.material.energy.Energy`).

    Attributes
    ----------
    fibre
        Direction of its fibres (`isorod.material.fibre`), or those of two families in a tuple; only read where the
        energy has fibres.
    """

    fibre: Fibre | tuple[Fibre, Fibre] = "tangent"

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
    def identity(self) -> str:
        """Its name and energy."""
        return f"{type(self).__name__} {self.stored}"

    @property
    def compiled(self) -> Compiled:
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

    @property
    def families(self) -> int:  # type: ignore[override]
        """How many directions its energy asks for."""
        return self.stored.families

    @property
    def follows(self) -> bool:
        """Whether a direction of its fibres is one of the rod."""
        return any(directions.follows(one) for one in self._fibres())

    def placed(self, places: Places) -> Self:
        """Return the law with its fibres at places of a rod."""
        if not self.follows:
            return self
        return self._directed([directions.placed(one, places) for one in self._fibres()])

    def some(self, places: Index) -> Self:
        """Return the law with the fibres of some places, if it has some of each."""
        return self._directed([directions.some(one, places) for one in self._fibres()]) if self.families else self

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the unit vectors along the fibres, family by family, shape ``(*shape, 3 families)``."""
        found = [directions.vectors(one, shape) for one in self._fibres()]
        return np.concatenate([np.zeros((*shape, 0)), *found], axis=-1)

    def check_fibres(self) -> None:
        """Make the directions of its fibres what laws keep.

        Raises
        ------
        InputError
            If they are not as many as the energy has families, or no directions.
        """
        if self.families:
            self._direct([directions.checked(one) for one in self._fibres()])

    def _fibres(self) -> tuple[Fibre, ...]:
        """Return the direction of each family."""
        if self.families < 2:
            return (cast(Fibre, self.fibre),)[: self.families]
        if not (isinstance(self.fibre, tuple | list) and len(self.fibre) == 2):
            raise InputError("fibre direction: the energy has two families of fibres, need a tuple of two directions")
        return tuple(self.fibre)

    def _directed(self, found: list[Fibre]) -> Self:
        # Not made anew: what was found of its energy stays.
        law = copy(self)
        law._direct(found)
        return law

    def _direct(self, found: list[Fibre]) -> None:
        object.__setattr__(self, "fibre", found[0] if len(found) == 1 else tuple(found))

    @cached_property
    def shear_modulus(self) -> float:
        """The least modulus of plane waves at rest, force / area: the shear modulus, if isotropic."""
        return float(plane_waves(self.shear).min())

    @cached_property
    def modulus(self) -> float:
        """Modulus of pressure waves at rest, force / area; where there are fibres, when these are just taut."""
        return self.lame + float(plane_waves(self.shear, 1.0 + (_TAUT if self.families else 0.0)).max())

    @property
    def surface_modulus(self) -> float:
        """How stiff a surface is against waves of pressure at rest (`Material.surface_modulus`)."""
        return 4.0 * self.shear_modulus * (1.0 - self.shear_modulus / self.modulus)

    @property
    def nu(self) -> float:
        """Poisson's ratio at rest, if isotropic; else that of the moduli of plane waves."""
        ratio = self.shear_modulus / self.modulus
        return 0.5 * (1.0 - 2.0 * ratio) / (1.0 - ratio)


class Shape(Material):
    """What a law stores besides the volumetric energy.

    Parameters
    ----------
    law
        A law that splits.
    """

    logarithmic: ClassVar[bool] = True

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
    def compiled(self) -> Compiled:
        """The addresses of the law's functions."""
        return self.law.compiled

    @property
    def families(self) -> int:  # type: ignore[override]
        """How many directions the law has at a point."""
        return self.law.families

    @property
    def follows(self) -> bool:
        """Whether the law depends on the rod's places."""
        return self.law.follows

    @property
    def activation_work(self) -> float:
        """The most work per reference volume that activation can do, force / area."""
        return self.law.activation_work

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the unit vectors along the law's fibres, shape ``(*shape, 3 families)``."""
        return self.law.fibres(shape)

    def placed(self, places: Places) -> Material:  # type: ignore[override]
        """Return the law at places of a rod."""
        law = self.law.placed(places)
        return self if law is self.law else Shape(law)

    def at(self, factor: float) -> Material:  # type: ignore[override]
        """Return the law at a load factor."""
        law = self.law.at(factor)
        return self if law is self.law else Shape(law)

    def some(self, places: Index) -> Material:  # type: ignore[override]
        """Return the law at some places."""
        law = self.law.some(places)
        return self if law is self.law else Shape(law)
