"""Stored-energy laws.

A law is a small class with ``energy``, ``stress`` and ``tangent`` of the deformation gradient ``F``, arrays whose last two axes
are ``(3, 3)``; the stress is the first Piola-Kirchhoff stress ``P = dW/dF`` and the tangent ``A_aAbB = dP_aA/dF_bB``.  Where
``det F <= 0`` a nonlinear law returns NaN.
"""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numba import njit

from isorod.arrays import Array
from isorod.errors import InputError, representable
from isorod.tensors import determinant

_OPTIONS: Any = {"cache": True, "error_model": "numpy"}


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


@dataclass(frozen=True)
class NeoHookean(_Isotropic):
    """``W = mu/2 (I1 - 2 ln J - 3) + kappa/2 (ln J)^2`` with ``kappa`` Lame's first parameter (Lu & Zhou 2011, eq. 15)."""

    # The bulk term's theta is ln J.
    logarithmic: ClassVar[bool] = True

    @property
    def parameters(self) -> Array:
        """``mu, lame, 0, 0, 0``: what `isorod.material.muscle.point_stress` takes for a law without fibres, shape ``(5,)``."""
        return np.array([self.mu, self.lame, 0.0, 0.0, 0.0])

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        det = determinant(F)
        log = np.log(np.where(det > 0.0, det, np.nan))
        return 0.5 * self.mu * (np.sum(F * F, axis=(-2, -1)) - 2.0 * log - 3.0) + 0.5 * self.lame * log**2

    def stress(self, F: Array) -> Array:
        """Return ``P = mu F + (kappa ln J - mu) F^-T``, shape of ``F``."""
        return _neo_hookean_stress(flat(F), self.mu, self.lame).reshape(F.shape)

    def tangent(self, F: Array) -> Array:
        """Return ``mu d_ab d_AB + kappa G_aA G_bB + (mu - kappa ln J) G_aB G_bA``, ``G = F^-T``."""
        return _neo_hookean_tangent(flat(F), self.mu, self.lame).reshape(*F.shape, 3, 3)


@dataclass(frozen=True)
class LinearElastic(_Isotropic):
    """Isotropic linear elasticity in small strains: ``W = mu e:e + lame/2 (tr e)^2``, ``e = sym(F) - 1``."""

    # The bulk term's theta is tr e.
    logarithmic: ClassVar[bool] = False

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        strain = 0.5 * (F + np.swapaxes(F, -1, -2)) - np.eye(3)
        trace = np.trace(strain, axis1=-2, axis2=-1)
        return self.mu * np.sum(strain**2, axis=(-2, -1)) + 0.5 * self.lame * trace**2

    def stress(self, F: Array) -> Array:
        """Return the stress, shape of ``F``."""
        strain = 0.5 * (F + np.swapaxes(F, -1, -2)) - np.eye(3)
        trace = np.trace(strain, axis1=-2, axis2=-1)
        return 2.0 * self.mu * strain + self.lame * trace[..., None, None] * np.eye(3)

    def tangent(self, F: Array) -> Array:
        """Return the constant moduli, shape ``F.shape + (3, 3)`` (one set of moduli, seen at every point)."""
        eye = np.eye(3)
        moduli = self.lame * np.einsum("aA,bB->aAbB", eye, eye) + self.mu * (
            np.einsum("ab,AB->aAbB", eye, eye) + np.einsum("aB,bA->aAbB", eye, eye)
        )
        return np.broadcast_to(moduli, (*F.shape, 3, 3))


def flat(F: Array) -> Array:
    """Return ``F`` as one C-ordered array ``(points, 3, 3)``."""
    return np.ascontiguousarray(F, dtype=float).reshape(-1, 3, 3)


@njit("f8(f8[:,::1], f8[:,::1])", **_OPTIONS)
def cofactors(f: Array, g: Array) -> float:
    """Fill ``g`` with the cofactors of ``f`` and return its determinant."""
    for a in range(3):
        a1, a2 = (a + 1) % 3, (a + 2) % 3
        for b in range(3):
            b1, b2 = (b + 1) % 3, (b + 2) % 3
            g[a, b] = f[a1, b1] * f[a2, b2] - f[a1, b2] * f[a2, b1]
    return f[0, 0] * g[0, 0] + f[0, 1] * g[0, 1] + f[0, 2] * g[0, 2]


@njit("f8[:,:,::1](f8[:,:,::1], f8, f8)", **_OPTIONS)
def _neo_hookean_stress(F: Array, mu: float, lame: float) -> Array:
    result = np.empty_like(F)
    g = np.empty((3, 3))
    for m in range(F.shape[0]):
        det = cofactors(F[m], g)
        factor = (lame * np.log(det) - mu) / det if det > 0.0 else np.nan
        for a in range(3):
            for b in range(3):
                result[m, a, b] = mu * F[m, a, b] + factor * g[a, b]
    return result


@njit("f8[:,:,:,:,::1](f8[:,:,::1], f8, f8)", **_OPTIONS)
def _neo_hookean_tangent(F: Array, mu: float, lame: float) -> Array:
    result = np.empty((F.shape[0], 3, 3, 3, 3))
    g = np.empty((3, 3))
    for m in range(F.shape[0]):
        det = cofactors(F[m], g)
        square = 1.0 / (det * det) if det > 0.0 else np.nan
        cross = (mu - lame * np.log(det)) * square if det > 0.0 else np.nan
        for a in range(3):
            for A in range(3):
                for b in range(3):
                    for B in range(3):
                        result[m, a, A, b, B] = lame * square * g[a, A] * g[b, B] + cross * g[a, B] * g[b, A]
                result[m, a, A, a, A] += mu
    return result
