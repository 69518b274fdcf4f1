"""The neo-Hookean law."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import f8, njit

from isorod.arrays import Array
from isorod.compiled import F3, F5, STRICT, cofactors, flat
from isorod.material.law import _Isotropic
from isorod.tensors import determinant


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


@njit(F3(F3, f8, f8), **STRICT)
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


@njit(F5(F3, f8, f8), **STRICT)
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
