"""Linear elasticity in small strains."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from isorod.arrays import Array
from isorod.material.law import Isotropic


@dataclass(frozen=True)
class LinearElastic(Isotropic):
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
