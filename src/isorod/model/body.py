"""A body: a space with a law, a density and a formulation."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array
from isorod.errors import Checked, InputError, representable
from isorod.material.along_rod import Laws
from isorod.material.law import Material
from isorod.material.linear_elastic import LinearElastic
from isorod.space.space import Space, Table

if TYPE_CHECKING:
    from isorod.space.pressure import Pressures


# How a body's equilibrium is stated.
FORMULATIONS = ("displacement", "mixed")

# Ratio of moduli from which a smooth joint is warned of: bars in series err by 4 % at 10, by 13 % at 100 (p = 3, four
# elements each).
_JUMP = 10.0


@dataclass(frozen=True, eq=False)
class Body(Checked):
    """A rod with its displacement space and material.

    Parameters
    ----------
    space
        The displacement space.
    material
        One law for the whole rod, or one for each element of the space, shape ``(elements,)``.
    density
        Mass per reference volume, one for the whole rod or one for each element of the space.
    formulation
        ``"displacement"``, or ``"mixed"``: displacement and pressure (`isorod.assembly.mixed`), which does not lock
        near incompressibility and takes a Poisson's ratio of 0.5; statics alone knows it.

    Raises
    ------
    InputError
        If the number of laws or densities is not that of the elements, a density is negative or not finite, or the
        formulation is not known or not one for the material.
    """

    space: Space
    material: Material | Sequence[Material]
    density: float | Sequence[float] = 0.0
    formulation: str = "displacement"

    def __post_init__(self) -> None:
        super().__post_init__()
        given = np.asarray(self.density, dtype=float)
        if given.shape not in ((), (self.space.axis.elements,)):
            raise InputError(
                f"density: got shape {given.shape}, need one or one for each of the {self.space.axis.elements} elements"
            )
        bad = ~(np.isfinite(given) & (given >= 0.0))
        if bad.any():
            raise InputError(f"density: got {given[bad].flat[0]:g}, need a finite mass per volume, not negative")
        if given.any():
            representable("density", float(given[given > 0.0].min()))
            representable("density", float(given.max()))
        if isinstance(self.material, Sequence) and len(self.material) != self.space.axis.elements:
            raise InputError(
                f"material: got {len(self.material)} laws for {self.space.axis.elements} elements, "
                "need one law or one an element"
            )

        if self.formulation not in FORMULATIONS:
            raise InputError(f"formulation: got {self.formulation!r}, need one of {', '.join(FORMULATIONS)}")
        for e, law in enumerate(self.laws):
            if self.formulation == "displacement" and not np.isfinite(getattr(law, "lame", 0.0)):
                raise InputError(f"material of element {e}: incompressible (nu = 0.5); that takes formulation 'mixed'")
        self._warn_of_smooth_joints()

    @cached_property
    def pressures(self) -> "Pressures | None":
        """The pressure space of the mixed formulation.

        Raises
        ------
        InputError
            If the space has none, or a law is not split for it or has ``nu <= 0``.
        """
        if self.formulation != "mixed":
            return None
        from isorod.space.pressure import Pressures

        for e, law in enumerate(self.laws):
            if not getattr(law, "nu", 0.0) > 0.0:
                raise InputError(f"material of element {e}: the mixed formulation needs an isotropic law with nu > 0")
        return Pressures(self.space)

    @cached_property
    def pressure_unit(self) -> float:
        """What the unknown pressures of the mixed formulation are counted in: the middle shear modulus, force/area."""
        return float(np.median([getattr(law, "mu", 1.0) for law in self.laws]))

    def _warn_of_smooth_joints(self) -> None:
        """Warn where stiffness jumps at a knot at which displacements are smooth: strains cannot follow."""
        if not isinstance(self.material, Sequence):
            return
        axis = self.space.axis
        moduli = np.array([getattr(law, "E", np.nan) for law in self.laws])
        jumps = np.exp(np.abs(np.diff(np.log(moduli)))) * (1.0 - 1e-9)
        times = np.searchsorted(axis.knots, axis.breaks[1:-1], "right") - np.searchsorted(axis.knots, axis.breaks[1:-1])
        smooth = (jumps > _JUMP) & (times < axis.degree)
        if smooth.any():
            k = int(np.argmax(np.where(smooth, jumps, 0.0)))
            warnings.warn(
                f"stiffness jumps by {jumps[k]:.3g} at u = {axis.breaks[k + 1]:.4g}, where displacements are smooth: "
                "errors of a tenth and more; take continuity 0, or a rod with that knot repeated (Rod.insert)",
                stacklevel=4,
            )

    @cached_property
    def densities(self) -> Array:
        """The mass per reference volume of each element, shape ``(elements,)``."""
        return np.broadcast_to(np.asarray(self.density, dtype=float), (self.space.axis.elements,))

    @cached_property
    def laws(self) -> tuple[Material, ...]:
        """The law of each element, shape ``(elements,)``."""
        if isinstance(self.material, Sequence):
            return tuple(self.material)
        return (self.material,) * self.space.axis.elements

    @cached_property
    def linear(self) -> bool:
        """Whether its stiffness is the same in all states."""
        return self.formulation == "displacement" and all(isinstance(law, LinearElastic) for law in self.laws)

    def laws_at(self, u: Array) -> Laws:
        """Return the laws at axis parameters, for deformation gradients of shape ``u.shape + (q, 3, 3)``.

        Parameters
        ----------
        u
            Shape ``(E,)`` or ``(E, t)``, each row within one element; at a knot the element above it is meant.
        """
        breaks = self.space.axis.breaks
        elements = np.searchsorted(breaks[1:-1], u.reshape(u.shape[0], -1)[:, 0], side="right")
        laws = Laws.of([self.laws[e] for e in elements])
        return laws.along(self._tangents(u)[..., None, :]) if laws.follow else laws

    def _tangents(self, u: Array) -> Array:
        return self.space.rod.tangents(u.ravel()).reshape(*u.shape, 3)

    def fibres(self, table: Table) -> Array:
        """Return the unit fibre directions at the quadrature points, ``(E, t, q, 3)``; zero where the law has none."""
        result = np.zeros((*table.weights.shape, 3))
        for law, first, last in self.laws_at(table.u).pieces:
            result[first:last] = law.fibres(result[first:last].shape[:-1])
        return result
