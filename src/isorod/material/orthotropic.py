"""Orthotropic and transversely isotropic linear elasticity: wood, laminates, fibres in a matrix."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, modulus
from isorod.material.fibre import Fibre
from isorod.material.law import Material

if TYPE_CHECKING:
    import sympy as sp

    from isorod.material.energy import Energy

# Angle, in radians, below which two axes count as parallel.
_PARALLEL = 1e-6


@cache
def quadratic(small: bool, free: tuple["sp.Expr", ...] = (0, 0, 0)) -> "Energy":
    """Return the energy ``E:C E / 2`` of Green's strain, or of small strain, along three orthogonal axes.

    ``free`` are free strains along the axes, which are subtracted.
    """
    import sympy as sp

    from isorod.material import symbols as s
    from isorod.material.energy import Energy

    first, second = sp.Matrix(s.a), sp.Matrix(s.b)
    axes, strain = (first, second, first.cross(second)), (s.C - sp.eye(3)) / 2
    along = [(axes[i].T * strain * axes[j])[0] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    if small:
        along[:3] = [one - own for one, own in zip(along, free, strict=False)]
    else:
        g = [1 + one for one in free]
        along = [
            (one - (g[i] ** 2 - 1) / 2 if i == j else one) / (g[i] * g[j])
            for one, (i, j) in zip(along, ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True)
        ]
    c = sp.symbols("c11 c12 c13 c22 c23 c33 g12 g13 g23", real=True)
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    energy = sum(
        one * along[i] * along[j] / (2 if i == j else 1) for one, (i, j) in zip(c[:6], pairs, strict=True)
    ) + sum(2 * one * e**2 for one, e in zip(c[6:], along[3:], strict=True))
    return Energy(energy, c, small=small)


class Directed(Material):
    """Linear elasticity in small strains along orthogonal axes 1 and 2 of the material and their normal."""

    objective: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    splits: ClassVar[bool] = False
    families: ClassVar[int] = 2
    recipe = (quadratic, True)

    @property
    @abstractmethod
    def engineering(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """``E_1, E_2, E_3``, ``nu_12, nu_13, nu_23`` and ``G_12, G_13, G_23``."""

    @property
    def values(self) -> tuple[float, ...]:
        """``C_11, C_12, C_13, C_22, C_23, C_33`` and ``G_12, G_13, G_23`` along the axes, force / area."""
        E, nu, G = self.engineering
        along = np.linalg.inv(_compliance(E, nu))
        return *along[np.triu_indices(3)].tolist(), *G


@dataclass(frozen=True, eq=False)
class Orthotropic(Directed):
    """Linear elasticity in small strains with three axes: ``W = e:C e / 2``, ``e = sym(F) - 1``.

    Parameters
    ----------
    E
        Young's moduli ``E_1, E_2, E_3`` along the axes, force/area.
    nu
        Poisson's ratios ``nu_12, nu_13, nu_23``: ``nu_12`` is the contraction along axis 2 in tension along axis 1,
        ``nu_12 / E_1 = nu_21 / E_2``.
    G
        Shear moduli ``G_12, G_13, G_23`` in the planes of two axes, force/area.
    axes
        Directions of axes 1 and 2, each a vector ``(3,)``; one of the rod: ``"tangent"``, ``"normal"``,
        ``"binormal"``, ``"radial"`` or ``"around"``; or a function of places (`isorod.material.fibre`).  The second is
        made orthogonal to the first; axis 3 is orthogonal to both.

    Raises
    ------
    InputError
        If a value is out of its range or not finite, or some strain would store negative energy.
    """

    _NAMES = ("axis 1", "axis 2")

    E: tuple[float, float, float]
    nu: tuple[float, float, float]
    G: tuple[float, float, float]
    axes: Sequence[Fibre] = ("tangent", "normal")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.follows:
            _second(*(np.asarray(one) for one in self.axes))

    def _check(self) -> None:
        for name in ("E", "nu", "G"):
            object.__setattr__(self, name, tuple(float(one) for one in getattr(self, name)))
        _check(self.E, self.nu, self.G)
        if len(self.axes) != 2:
            raise InputError(f"{type(self).__name__}: axes: got {len(self.axes)} directions, need two")

    @property
    def engineering(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """``E_1, E_2, E_3``, ``nu_12, nu_13, nu_23`` and ``G_12, G_13, G_23``."""
        return self.E, self.nu, self.G

    def _fibres(self) -> tuple[Fibre, ...]:
        return tuple(self.axes)

    def _direct(self, axes: list[Fibre]) -> None:
        object.__setattr__(self, "axes", tuple(axes))

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return axes 1 and 2 at points of some shape, shape ``(*shape, 6)``."""
        vectors = super().fibres(shape)
        return np.concatenate([vectors[..., :3], _second(vectors[..., :3], vectors[..., 3:])], axis=-1)


@dataclass(frozen=True, eq=False)
class TransverselyIsotropic(Directed):
    """Linear elasticity in small strains, isotropic across a fibre: ``W = e:C e / 2``.

    Parameters
    ----------
    E, E_across
        Young's moduli along and across the fibre, force/area.
    nu
        Poisson's ratio: contraction across the fibre in tension along it.
    nu_across
        Poisson's ratio in the plane across the fibre.
    G
        Shear modulus in planes along the fibre, force/area; across it is ``E_across / 2(1 + nu_across)``.
    fibre
        Its direction: a vector ``(3,)``; one of the rod: ``"tangent"``, ``"normal"``, ``"binormal"``, ``"radial"`` or
        ``"around"``; or a function of places (`isorod.material.fibre`), such as ``helix(30)``.

    Raises
    ------
    InputError
        If a value is out of its range or not finite, or some strain would store negative energy.
    """

    E: float
    E_across: float
    nu: float
    nu_across: float
    G: float
    fibre: Fibre = "tangent"

    def _check(self) -> None:
        if not -1.0 < self.nu_across < 1.0:
            raise InputError(f"nu_across: got {self.nu_across:g}, need -1 < nu_across < 1")
        _check(*self.engineering, ("E", "E_across", "E_across"), ("nu", "nu", "nu_across"), ("G", "G", "G across"))

    @property
    def engineering(self) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """``E_1, E_2, E_3``, ``nu_12, nu_13, nu_23`` and ``G_12, G_13, G_23``, the fibre axis 1."""
        E, across = self.E, self.E_across
        shear = across / (2.0 * (1.0 + self.nu_across))
        return (E, across, across), (self.nu, self.nu, self.nu_across), (self.G, self.G, shear)

    def _fibres(self) -> tuple[Fibre, ...]:
        return (self.fibre,)

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the fibre and a direction across it at points of some shape, shape ``(*shape, 6)``."""
        along = super().fibres(shape)
        # The coordinate axis at the largest angle to the fibre.
        far = np.eye(3)[np.argmin(np.abs(along), axis=-1)]
        return np.concatenate([along, _second(along, far)], axis=-1)


def _compliance(E: Sequence[float], nu: Sequence[float]) -> Array:
    """Return the compliance of normal stresses along three axes, shape ``(3, 3)``."""
    compliance = np.diag(1.0 / np.array(E))
    for value, (i, j) in zip(nu, ((0, 1), (0, 2), (1, 2)), strict=True):
        compliance[i, j] = compliance[j, i] = -value / E[i]
    return compliance


def _check(
    E: Sequence[float],
    nu: Sequence[float],
    G: Sequence[float],
    names: Sequence[str] = ("E1", "E2", "E3"),
    ratios: Sequence[str] = ("nu12", "nu13", "nu23"),
    shears: Sequence[str] = ("G12", "G13", "G23"),
) -> None:
    """Raise `InputError` if a modulus is not positive, or if a strain would store negative energy."""
    for name, value in zip((*names, *shears), (*E, *G), strict=True):
        modulus(name, value)
    for name, value, (i, j) in zip(ratios, nu, ((0, 1), (0, 2), (1, 2)), strict=True):
        most = np.sqrt(E[i] / E[j])
        if not abs(value) < most:
            raise InputError(
                f"{name}: got {value:g}, need less than sqrt({names[i]} / {names[j]}) = {most:.4g} in size: else some "
                "strain stores negative energy"
            )
    # Scaled to a unit diagonal.
    size = np.sqrt(np.array(E))
    rest = float(np.linalg.det(_compliance(E, nu) * size[:, None] * size))
    if not rest > 1e-12:
        raise InputError(
            f"{', '.join(dict.fromkeys(ratios))}: 1 - nu12 nu21 - nu13 nu31 - nu23 nu32 - 2 nu21 nu32 nu13 is "
            f"{rest:.4g}, need a positive number: else some strain stores negative energy"
        )


def _second(first: Array, second: Array) -> Array:
    """Return the second axes made orthogonal to the first, which are unit vectors, and of unit length."""
    across = second - np.sum(first * second, axis=-1, keepdims=True) * first
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    if not size.min(initial=np.inf) > _PARALLEL:
        raise InputError("axes: axis 2 runs along axis 1; take another")
    return np.asarray(across / size)
