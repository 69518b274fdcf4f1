"""Stored-energy laws.

A law is a small class with ``energy``, ``stress`` and ``tangent`` of the deformation gradient ``F``, arrays whose last
two axes are ``(3, 3)``; the stress is the first Piola-Kirchhoff stress ``P = dW/dF`` and the tangent
``A_aAbB = dP_aA/dF_bB``.  Where ``det F <= 0`` a nonlinear law returns NaN.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol, Self

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, representable


class Material(Protocol):
    """What the assembler asks of a law."""

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""

    def stress(self, F: Array) -> Array:
        """Return ``P``, shape of ``F``."""

    def tangent(self, F: Array) -> Array:
        """Return ``dP/dF``, shape ``F.shape + (3, 3)``."""

    def at(self, factor: float) -> "Material":
        """Return the law at a load factor: itself, unless something in it grows with the load, as a muscle's activation."""

    @property
    def follows(self) -> bool:
        """Whether the law depends on the direction of the rod and has not been told it (`along`)."""

    def along(self, tangent: Array) -> "Material":
        """Return the law where the rod's unit tangent is ``tangent``, shape ``(..., 3)``."""


class Split(Protocol):
    """What the mixed formulation (`isorod.assembly.mixed`) asks of a law besides: ``W = psi + lame/2 theta^2``."""

    logarithmic: ClassVar[bool]
    """Whether ``theta`` is ``ln J``; the trace of the strain if not."""

    @property
    def lame(self) -> float:
        """Lame's first parameter, force / area; may be infinite."""

    @property
    def shear(self) -> Material:
        """The law ``psi``."""


@dataclass(frozen=True)
class _Isotropic:
    E: float  # force / area
    nu: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.E) and self.E > 0.0):
            raise InputError(f"Young's modulus E: got {self.E:g}, need a positive stress")
        representable("Young's modulus E", self.E)
        if not -1.0 < self.nu <= 0.5:
            raise InputError(f"Poisson's ratio nu: got {self.nu:g}, need -1 < nu <= 0.5")

    @property
    def mu(self) -> float:
        """Shear modulus, force / area."""
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def lame(self) -> float:
        """Lame's first parameter, force / area (the paper's kappa); infinite where ``nu`` is 0.5."""
        if self.nu == 0.5:
            return np.inf
        return self.E * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))

    @property
    def shear(self) -> Self:
        """The law without its bulk term ``lame/2 theta^2``, for the mixed formulation (`isorod.assembly.mixed`)."""
        return replace(self, E=2.0 * self.mu, nu=0.0)

    def at(self, factor: float) -> Self:
        """Return the law itself."""
        return self

    @property
    def follows(self) -> bool:
        """No."""
        return False

    def along(self, tangent: Array) -> Self:
        """Return the law itself."""
        return self
