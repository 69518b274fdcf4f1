"""The base class of laws: energy, stress and tangent by two functions compiled from the energy.

A new law is one file: a class with the ``recipe`` of its energy and the ``values`` of its constants.  Statics, modes
and both integrators of dynamics then take it.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np

from isorod.arrays import Array, Index
from isorod.compiled import flat
from isorod.errors import Checked, InputError, modulus
from isorod.material import fibre as directions
from isorod.material.discrete_gradient_kernel import discrete_gradient
from isorod.material.fibre import Fibre
from isorod.material.places import Places, alone
from isorod.material.points import Compiled, at_points, moduli_at_points

if TYPE_CHECKING:
    from collections.abc import Callable

    from isorod.material.energy import Energy


# Strain at which fibres are taut, and a bulk modulus, relative to the other moduli, that stands for an infinite one.
_TAUT, _STIFF = 1e-6, 1e3

# Volumetric stretch, minus 1, at which moduli at rest are evaluated, so that tension-only fibres are taut.
_SWOLLEN = 1e-9


class Material(Checked, ABC):
    """A law: arrays of deformation gradients ``F`` have any leading axes, the last two are ``(3, 3)``.

    The stress is the first Piola-Kirchhoff stress ``P = dW/dF``, the tangent ``A_aAbB = dP_aA/dF_bB``; for
    ``det F <= 0`` a nonlinear law returns NaN.  The mixed formulation (`isorod.assembly.mixed`) takes laws that split,
    ``W = psi + U(theta)``.

    Attributes
    ----------
    recipe
        A function of the law's module that returns the energy (`isorod.material.energy.Energy`), and its arguments.
    objective
        Whether it is frame-invariant; dynamics takes no others.
    linear
        Whether its stress is linear in the deformation gradient, with the same tangent in all states.
    families
        Number of material directions at a point, such as families of fibres: 0, 1 or 2 (`fibres`).
    remembers, timed, kinks, states
        Whether its stress depends on the history (`isorod.material.memory`), on time, and is not smooth in the strain;
        and the number of components of each state variable by its name, in order.
    clock
        Number of the constant that is the time of a step (`isorod.material.memory`); negative if none is.
    splits
        Whether there is a volumetric energy ``U``, or one of the trace of small strains.
    logarithmic
        Whether ``theta`` is ``ln J``; the trace of the strain if not.
    fibre
        Direction of its fibres (`isorod.material.fibre`), or those of two families in a tuple; only read if the energy
        has fibres.
    """

    recipe: tuple[Any, ...]
    objective: ClassVar[bool] = True
    linear: ClassVar[bool] = False
    families: ClassVar[int] = 0
    remembers: ClassVar[bool] = False
    timed: ClassVar[bool] = False
    kinks: ClassVar[bool] = False
    clock: ClassVar[int] = -1
    states: ClassVar[Mapping[str, int]] = {}
    splits: ClassVar[bool] = True
    logarithmic: ClassVar[bool] = True
    fibre: Fibre | tuple[Fibre, Fibre] = "tangent"

    # Names of the directions in errors.
    _NAMES: ClassVar[tuple[str, ...]] = ("fibre direction", "fibre direction")

    # Function of the load factor by which it grows over time, instead of the load factor itself.
    grows: ClassVar[Any] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check()
        self._direct([directions.checked(*one) for one in self._named_fibres()])

    @abstractmethod
    def _check(self) -> None:
        """Raise `InputError` if a constant is invalid."""

    @property
    @abstractmethod
    def values(self) -> tuple[float, ...]:
        """The constants of its energy without the factor of the volumetric energy."""

    @cached_property
    def lame(self) -> float:
        """The modulus of ``U`` at rest, ``lame/2 theta^2`` if quadratic, force / area; may be infinite; 0 without."""
        return 0.0

    @cached_property
    def constants(self) -> Array:
        """The values of the symbols of its energy's constants, shape ``(c,)``."""
        return np.array([*self.values, *([self.lame] if self.splits else [])], dtype=float)

    @property
    def stored(self) -> "Energy":
        """Its energy as an expression."""
        make, *given = self.recipe
        return make(*given)  # type: ignore[no-any-return]

    @property
    def compiled(self) -> Compiled:
        """The addresses of its compiled functions."""
        from isorod.material.written import named

        return named(*self.recipe)

    @property
    def identity(self) -> str:
        """A text that identifies the law in any process."""
        return f"{type(self).__name__}{self.recipe[1:]} {self.constants.tolist()}"

    @property
    def shear(self) -> Self:
        """The law ``psi``: without its volumetric energy."""
        return self._with(lame=0.0) if self.splits else self

    def complementary(self, p: Array) -> tuple[Array, Array, Array]:
        """Return the Legendre transform ``U*(p) = p theta - U``, and its first and second derivatives; shapes of ``p``.

        The first derivative is the ``theta`` of a pressure ``p``.
        """
        each = np.full_like(p, 1.0 / self.lame)
        return 0.5 * each * p**2, each * p, each

    def tangent(self, F: Array) -> Array:
        """Return ``dP/dF``, shape ``F.shape + (3, 3)``."""
        moduli, compiled = np.empty((*F.shape, 3, 3)), self.compiled
        given = flat(F), self.constants, self._flat_known(F.shape[:-2])
        moduli_at_points(compiled.block, compiled.tangent, *given, moduli.reshape(-1, 3, 3, 3, 3))
        return moduli

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        return self._evaluate(F)[0].sum(axis=-1)

    def stress(self, F: Array) -> Array:
        """Return ``P``, shape of ``F``."""
        return self._evaluate(F)[1]

    def _evaluate(self, F: Array) -> tuple[Array, Array]:
        energy, stress = np.empty((*F.shape[:-2], 2)), np.empty(F.shape)
        given = flat(F), self.constants, self._flat_known(F.shape[:-2])
        at_points(self.compiled.block, *given, energy.reshape(-1, 2), stress.reshape(-1, 3, 3))
        return energy, stress

    def _flat_known(self, shape: tuple[int, ...]) -> Array:
        return np.array(self.known(shape), order="C").reshape(math.prod(shape), self.width)

    def discrete(self, F: Array, change: Array, with_moduli: bool = True) -> tuple[Array, Array | None]:
        """Return a stress between ``F`` and ``F + change`` whose work is the change of the energy, and its moduli.

        Parameters
        ----------
        F, change
            Deformation gradient at the start, and its change, shape ``(..., 3, 3)``.
        with_moduli
            Whether to return moduli: the derivatives of the stress by ``F + change``, shape ``F.shape + (3, 3)``.
        """
        if self.linear:
            middle = F + 0.5 * change
            return self.stress(middle), 0.5 * self.tangent(middle) if with_moduli else None
        stress, moduli = np.empty(F.shape), np.empty((*F.shape, 3, 3) if with_moduli else (0, 3, 3, 3, 3))
        compiled, given = self.compiled, (flat(F), flat(change), self.constants, self._flat_known(F.shape[:-2]))
        out = stress.reshape(-1, 3, 3), moduli.reshape(-1, 3, 3, 3, 3)
        discrete_gradient(compiled.block, compiled.tangent, self.remembers, self.clock, *given, *out)
        return stress, moduli if with_moduli else None

    def at(self, factor: float) -> Self:
        """Return the law at a load factor: itself, unless a constant grows with it, as a muscle's activation."""
        return self

    def growing(self, over: "Callable[[Any], Callable[[float], float]]") -> Self:
        """Return the law with growth by a table instead of the load factor, if it grows.

        ``over`` returns the value of a history, or of none, by load factor (`isorod.model.times.until`).
        """
        return self if self.at(0.5) is self else self._with(grows=over(None))

    def reached(self, factor: float) -> Self:
        """Return the law at a load factor, by its table if it has one."""
        return self.at(factor if self.grows is None else self.grows(factor))

    def advanced(self, F: Array, factor: float) -> Self:
        """Return the law with its state at the end of a step, of ``F`` and load factor there: itself without memory."""
        return self

    @property
    def follows(self) -> bool:
        """Whether the law depends on the rod's places and lacks them (`placed`)."""
        return any(directions.follows(one) for one in self._fibres())

    def placed(self, places: Places) -> Self:
        """Return the law at places of a rod, the leading axes of arrays of deformation gradients."""
        if not self.follows:
            return self
        placed = [(directions.placed(one, places, name), name) for one, name in self._named_fibres()]
        return self._directed([directions.checked(*one) for one in placed])

    def some(self, places: Index) -> Self:
        """Return the law at some of its places (`placed`), along the first axis."""
        return self._directed([directions.some(one, places) for one in self._fibres()]) if self.families else self

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the unit vectors along its fibres at points, by family, shape ``(*shape, 3 families)``."""
        vectors = [directions.vectors(one, shape, name) for one, name in self._named_fibres()]
        return np.concatenate([np.zeros((*shape, 0)), *vectors], axis=-1)

    @property
    def width(self) -> int:
        """Number of values that it has for each point (`known`)."""
        return 3 * self.families

    def known(self, shape: tuple[int, ...]) -> Array:
        """Return its values at points of some shape, ``(*shape, width)``: its fibres."""
        return self.fibres(shape)

    def _fibres(self) -> tuple[Fibre, ...]:
        """Return the definitions of its material directions."""
        if self.families < 2:
            return (cast(Fibre, self.fibre),)[: self.families]
        if not (isinstance(self.fibre, tuple | list) and len(self.fibre) == 2):
            raise InputError("fibre direction: the energy has two families of fibres, need a tuple of two directions")
        return tuple(self.fibre)

    def _named_fibres(self) -> list[tuple[Fibre, str]]:
        return list(zip(self._fibres(), self._NAMES, strict=False))

    def _directed(self, fibres: list[Fibre]) -> Self:
        law = copy(self)
        law._direct(fibres)
        return law

    def _direct(self, fibres: list[Fibre]) -> None:
        if fibres:
            object.__setattr__(self, "fibre", fibres[0] if len(fibres) == 1 else tuple(fibres))

    def _with(self, **changed: Any) -> Self:
        """Return the law with other values, without checks."""
        law = copy(self)
        law.__dict__.pop("constants", None)
        for name, value in changed.items():
            object.__setattr__(law, name, value)
        return law

    @cached_property
    def _waves(self) -> tuple[float, float]:
        """The smallest and largest modulus of plane waves at rest without the volumetric energy, force / area."""
        taut = plane_waves(self.shear, 1.0 + _SWOLLEN) if self.families else plane_waves(self.shear)
        return float(plane_waves(self.shear).min()), float(taut.max())

    @property
    def shear_modulus(self) -> float:
        """The smallest modulus of plane waves at rest, force / area: the shear modulus, if isotropic."""
        return self._waves[0]

    @property
    def modulus(self) -> float:
        """Modulus of pressure waves at rest, force / area; with fibres just taut."""
        return self.lame + self._waves[1]

    @property
    def surface_modulus(self) -> float:
        """Stiffness of a surface against waves of pressure at rest: ``E / (1 - nu^2)`` if isotropic, force / area.

        For any law ``4 mu (1 - mu / M)``, ``mu`` and ``M`` its smallest and largest modulus of plane waves.  It stays
        finite near incompressibility, where ``M`` does not.
        """
        return 4.0 * self.shear_modulus * (1.0 - self.shear_modulus / self.modulus)

    @property
    def activation_work(self) -> float:
        """The maximum work of activation per reference volume, force / area."""
        return 0.0


def plane_waves(law: Material, swollen: float = 1.0) -> Array:
    """Return the moduli of plane waves at rest in several directions, force / area, shape ``(13, 3)``.

    Parameters
    ----------
    law
        The law.
    swollen
        Stretch in all directions, for laws that are softer in compression.
    """
    n = _directions()
    moduli = law.placed(alone()).tangent(swollen * np.eye(3)[None])[0]
    return np.linalg.eigvalsh(np.einsum("aAbB,nA,nB->nab", moduli, n, n))


def reach(law: Material, places: Places) -> float:
    """Return ``sqrt(E / G)`` along a rod at rest, the largest at some of its places; 0 if none is stable at rest.

    It is the decay length of end effects in radii (C. O. Horgan, Saint-Venant end effects in composites, J. Composite
    Materials 16 (1982) 411-422).

    Parameters
    ----------
    law
        A law that has fibres.
    places
        Where they are evaluated: ``E`` is Young's modulus along the tangent, ``G`` the smallest shear modulus of planes
        across it.
    """
    n = np.broadcast_to(places.tangent, (*places.shape, 3))
    # Fibres may carry tension alone.
    F, placed = np.eye(3) + _TAUT * n[..., :, None] * n[..., None, :], law.placed(places)
    if placed.splits:
        # Deviatoric moduli with a large bulk modulus, since that of the law may be infinite.
        moduli = placed.shear.tangent(F)
        moduli = moduli + _STIFF * np.abs(moduli).max() * np.einsum("aA,bB->aAbB", np.eye(3), np.eye(3))
    else:
        moduli = placed.tangent(F)
    strains = np.array([np.eye(3)[[a]].T * np.eye(3)[b] for a in range(3) for b in range(a, 3)])
    strains = strains + np.swapaxes(strains, 1, 2)
    strains = strains / np.linalg.norm(strains, axis=(1, 2))[:, None, None]
    if not np.isfinite(moduli).all():
        return 0.0
    # User-defined laws may have a direction without stiffness.
    soft = np.linalg.pinv(np.einsum("iaA,...aAbB,jbB->...ij", strains, moduli, strains))
    along = np.einsum("iaA,...a,...A->...i", strains, n, n)
    softness = np.einsum("...i,...ij,...j->...", along, soft, along)
    shear = np.linalg.eigvalsh(np.einsum("...aAbB,...A,...B->...ab", moduli, n, n))[..., 0]
    # Without stability at rest there is no such length.
    stable = (softness > 0.0) & (shear > 0.0)
    return float(np.sqrt(np.where(stable, 1.0 / np.where(stable, softness * shear, 1.0), 0.0).max()))


def _directions() -> Array:
    """Return unit vectors along three axes and between them, shape ``(13, 3)``."""
    n = np.array([(x, y, z) for x in (0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])
    return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))


@dataclass(frozen=True)
class Isotropic(Material):
    """Young's modulus ``E`` [force/area] and Poisson's ratio ``nu`` of a law that has these at rest."""

    E: float
    nu: float

    def _check(self) -> None:
        modulus("Young's modulus E", self.E)
        if not -1.0 < self.nu <= 0.5:
            raise InputError(f"Poisson's ratio nu: got {self.nu:g}, need -1 < nu <= 0.5")

    @property
    def mu(self) -> float:
        """Shear modulus, force / area."""
        return self.E / (2.0 * (1.0 + self.nu))

    @cached_property
    def lame(self) -> float:
        """Lame's first parameter, force / area (the paper's kappa); infinite where ``nu`` is 0.5."""
        if self.nu == 0.5:
            return np.inf
        return self.E * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))

    @property
    def values(self) -> tuple[float, ...]:
        """``mu``."""
        return (self.mu,)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus, force / area."""
        return self.mu

    @property
    def modulus(self) -> float:
        """Modulus of pressure waves at rest, force / area."""
        return self.lame + 2.0 * self.mu

    @property
    def surface_modulus(self) -> float:
        """``E / (1 - nu^2)``, force / area."""
        return self.E / (1.0 - self.nu**2)
