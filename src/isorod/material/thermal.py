"""Thermal expansion of any law: the stress follows what strain is left when the free expansion is taken off."""

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, Self

from isorod.arrays import Array, Index
from isorod.errors import InputError, finite
from isorod.material.fibre import Fibre
from isorod.material.law import Material
from isorod.material.places import Places
from isorod.material.points import Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy

# Strains beyond these are no thermal expansion of a solid: a mistaken unit.
_MOST = 0.2

# Laws stiffer than this against changes of volume, in shear moduli, lock in displacements alone: nu = 0.49.
_STIFF = 50.0


def expanded(energy: "Energy") -> "Energy":
    """Return the energy of a solid that has no stress when it is stretched by ``1 + e`` in all directions.

    ``(1 + e)^3 W(F / (1 + e))``, of small strains ``W`` of the strain less ``e``; ``e`` is the last of its constants.
    """
    from isorod.material import symbols as s
    from isorod.material.energy import Energy

    free = s.thermal
    constants = *energy.constants, free
    if energy.small:
        shifted = {s.C[A, A]: s.C[A, A] - 2 * free for A in range(3)}
        return Energy(energy.whole.xreplace(shifted), constants, small=True)
    stretch = 1 + free
    powers = dict.fromkeys((s.I1, s.I4a, s.I4b, s.I8, *s.STRAINS), 2) | {s.I2: 4, s.J: 3}
    powers |= dict.fromkeys((*s.stretches, *s.F), 1)
    return Energy(stretch**3 * energy.whole.xreplace({one: one / stretch**p for one, p in powers.items()}), constants)


def _named(module: str, name: str, *given: Any) -> "Energy":
    """Return the expanded energy that a function of a module returns, which has one name in all processes."""
    found: Energy = getattr(import_module(module), name)(*given)
    return expanded(found)


def bare(law: Material) -> Material:
    """Return a law without its thermal expansion."""
    return law.law if isinstance(law, Thermal) else law


@dataclass(frozen=True, eq=False)
class Thermal(Material):
    """A law with thermal expansion, the same in all directions.

    Parameters
    ----------
    law
        Of the stress at rest temperature.
    expansion
        Coefficient of linear expansion, 1 / temperature.
    temperature
        Change of temperature from that without stress, reached at the full load: it grows with the load factor.

    Raises
    ------
    InputError
        If a value is not finite, the free strain ``expansion temperature`` is above 0.2, or the law is nearly
        incompressible, of which the displacement formulation locks.
    """

    law: Material
    expansion: float
    temperature: float

    def _check(self) -> None:
        if isinstance(self.law, Thermal):
            raise InputError("law: got one that expands already")
        finite("expansion", self.expansion)
        finite("temperature", self.temperature)
        if not abs(self.strain) <= _MOST:
            raise InputError(
                f"temperature: expansion times temperature is {self.strain:g}, need a strain up to {_MOST:g}"
            )
        if self.law.splits and not self.law.lame <= _STIFF * self.law.shear_modulus:
            raise InputError("law: nearly incompressible; thermal expansion goes with Poisson's ratios up to 0.49")

    @property
    def strain(self) -> float:
        """Free strain at the full load."""
        return self.expansion * self.temperature

    @property
    def values(self) -> tuple[float, ...]:
        """The law's constants, and the free strain."""
        return (*self.law.constants, self.strain)

    @cached_property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        return expanded(self.law.stored)

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        from isorod.material.written import compiled, named

        if not hasattr(self.law, "recipe"):
            return compiled(self.stored)
        make, *given = self.law.recipe
        return named(_named, make.__module__, make.__qualname__, *given)

    @property
    def identity(self) -> str:
        """What tells the law from others, but for its constants."""
        return f"{type(self).__name__} {self.law.identity}"

    @property
    def objective(self) -> bool:  # type: ignore[override]
        """Whether the law is."""
        return self.law.objective

    @property
    def linear(self) -> bool:  # type: ignore[override]
        """Whether its tangent is the same in all states."""
        return self.law.linear

    @property
    def families(self) -> int:  # type: ignore[override]
        """How many directions the law asks for."""
        return self.law.families

    @property
    def splits(self) -> bool:  # type: ignore[override]
        """False: the mixed formulation does not take it."""
        return False

    @property
    def follows(self) -> bool:
        """Whether the law depends on the rod's places and has not been told them."""
        return self.law.follows

    def placed(self, places: Places) -> Self:
        """Return the law at places of a rod."""
        return self._with(law=self.law.placed(places))

    def some(self, places: Index) -> Self:
        """Return the law at some of the places that it was told."""
        return self._with(law=self.law.some(places))

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the unit vectors along the law's fibres at points."""
        return self.law.fibres(shape)

    def _fibres(self) -> tuple[Fibre, ...]:
        # They are the law's, which has checked them.
        return ()

    def at(self, factor: float) -> Self:
        """Return the law at a load factor: ``factor`` times the change of temperature."""
        return self._with(law=self.law.at(factor), temperature=factor * self.temperature)

    @property
    def shear_modulus(self) -> float:
        """That of the law."""
        return self.law.shear_modulus

    @property
    def modulus(self) -> float:
        """That of the law."""
        return self.law.modulus

    @property
    def surface_modulus(self) -> float:
        """That of the law."""
        return self.law.surface_modulus

    @property
    def activation_work(self) -> float:
        """That of the law."""
        return self.law.activation_work
