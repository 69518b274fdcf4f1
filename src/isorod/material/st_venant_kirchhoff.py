"""The law of St. Venant and Kirchhoff: linear in Green's strain, for large rotations and small strains."""

from dataclasses import dataclass

import numpy as np

from isorod.arrays import Array
from isorod.compiled import STRICT, njit
from isorod.material.law import Isotropic
from isorod.material.points import POINT, Compiled
from isorod.tensors import determinant


@njit(POINT, **STRICT)
def _point(F: Array, constants: Array, fibre: Array, activation: float, stress: Array) -> tuple[float, float]:
    mu, lame = constants[0], constants[1]
    strain = 0.5 * (F.T @ F - np.eye(3))
    trace = strain[0, 0] + strain[1, 1] + strain[2, 2]
    det = np.linalg.det(F)
    valid = 1.0 if det > 0.0 else np.nan
    stress[:] = valid * (F @ (2.0 * mu * strain + lame * trace * np.eye(3)))
    return valid * (mu * np.sum(strain * strain) + 0.5 * lame * trace * trace), 0.0


@dataclass(frozen=True)
class StVenantKirchhoff(Isotropic):
    """``W = mu E:E + lame/2 (tr E)^2``, ``E = (F^T F - 1)/2``.

    It softens in compression: a bar with ``nu = 0`` bears no more at the stretch ``1/sqrt 3``.
    """

    compiled = Compiled(_point)

    def tangent(self, F: Array) -> Array:
        """Return ``d_ab S_AB + lame F_aA F_bB + mu (F_aB F_bA + (F F^T)_ab d_AB)``, shape ``F.shape + (3, 3)``."""
        eye = np.eye(3)
        strain = 0.5 * (np.swapaxes(F, -1, -2) @ F - eye)
        S = 2.0 * self.mu * strain + self.lame * np.trace(strain, axis1=-2, axis2=-1)[..., None, None] * eye
        moduli = np.einsum("ab,...AB->...aAbB", eye, S) + self.lame * np.einsum("...aA,...bB->...aAbB", F, F)
        moduli += self.mu * np.einsum("...aB,...bA->...aAbB", F, F)
        moduli += self.mu * np.einsum("...ab,AB->...aAbB", F @ np.swapaxes(F, -1, -2), eye)
        moduli[~(determinant(F) > 0.0)] = np.nan
        return moduli
