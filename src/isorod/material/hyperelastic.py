"""A law from a user-defined stored energy."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.material.fibre import Fibre
from isorod.material.isochoric import Isochoric, check_written
from isorod.material.law import Material
from isorod.material.points import Compiled

if TYPE_CHECKING:
    from isorod.material.energy import Energy


@dataclass(frozen=True, eq=False)
class Hyperelastic(Isochoric):
    """A law from its stored energy per reference volume.

    Stress, tangent, the split of the mixed formulation and the functions of explicit steps are derived from this
    definition, and checked when the law is made (`isorod.material.proof`).

    Parameters
    ----------
    definition
        A SymPy expression of the symbols in `isorod.material.symbols` and of constants: of ``I1``, ``I2``, ``J``,
        principal stretches, fibre stretches, or components of ``F`` or ``C``.
    parameters
        Value of each constant, by its symbol or name.
    bulk
        If given, ``- p ln J + bulk/2 (ln J)^2`` is added to the energy, ``p`` such that there is no pressure at rest;
        force / area, infinite for an incompressible law.  If not, the energy is complete.
    prestressed
        Whether a stress at rest is intended.
    fibre
        Direction of the fibres ``a`` at rest, if the energy has some: a vector, a word or a function of places
        (`isorod.material.fibre`); a tuple of two if it has ``b`` too.

    Raises
    ------
    InputError
        If a symbol is not known, a constant has no value, or a check fails.
    """

    definition: Any
    parameters: Mapping[Any, float] = field(default_factory=dict)
    bulk: float | None = None  # type: ignore[assignment]
    prestressed: bool = False
    fibre: Fibre | tuple[Fibre, Fibre] = "tangent"

    def __post_init__(self) -> None:
        check_written(self.parameters, self.bulk)
        from isorod.material.proof import prove

        Material.__post_init__(self)
        prove(self, self.prestressed)

    def _check(self) -> None:
        """Accept all constants: the energy is checked."""

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        from sympy import Symbol

        named = {str(one): one for one in getattr(self.definition, "free_symbols", ())}
        return tuple(named.get(str(one), Symbol(str(one))) for one in self.parameters)

    @cached_property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        from isorod.material.energy import completed, split

        return (split if self.bulk is None else completed)(self.definition, self._symbols)

    @property
    def families(self) -> int:  # type: ignore[override]
        """Number of fibre directions that its energy depends on."""
        return self.stored.families

    @property
    def splits(self) -> bool:  # type: ignore[override]
        """Whether it has a volumetric energy."""
        return self.stored.volume is not None

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        from isorod.material.written import compiled

        return compiled(self.stored)

    @property
    def identity(self) -> str:
        """Its name and energy."""
        return f"{type(self).__name__} {self.stored} {self.constants.tolist()}"

    def complementary(self, p: Array) -> tuple[Array, Array, Array]:
        """Return the volumetric energy's Legendre transform and its derivatives (`isorod.material.law.Material`)."""
        if self.stored.quadratic or not np.isfinite(self.lame):
            return super().complementary(p)
        from isorod.material.legendre import transform

        return transform(self.stored.volume, p / self.lame, self.lame)

    @cached_property
    def values(self) -> tuple[float, ...]:
        """The constants of the energy."""
        return tuple(float(value) for value in self.parameters.values())

    @cached_property
    def lame(self) -> float:
        """Factor of the volumetric energy ``bulk/2 theta^2``, force / area."""
        if self.bulk is not None:
            return self.bulk
        from isorod.material.energy import factor_of

        factor = factor_of(self.stored, self.definition)
        return float(factor.subs(dict(zip(self._symbols, self.values, strict=True))))
