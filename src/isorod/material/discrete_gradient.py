"""Stress between two states that does exactly the work of any law's energy: a discrete gradient.

Between the states ``C_0`` and ``C_1 = C_0 + D`` the second Piola-Kirchhoff stress of the law is averaged on the
straight way (the mean value discrete gradient, McLachlan, Quispel & Robidoux, Phil. Trans. R. Soc. A 357 (1999)
1021-1045),

    S = int_0^1 S(C_0 + t D) dt + k D,    k = (2 (W_1 - W_0) - S : D) / (D : D),

by Gauss points, so that nothing is divided by ``|D|`` where they are exact to rounding; where not, the last term
(Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467) makes up for what they miss.  ``S : D / 2 = W_1 - W_0``, and ``S`` stays
the same when both states change places.  With ``P = F_m S``, ``F_m`` the mean of both deformation gradients, internal
forces have no resultant and no moment.
"""

from typing import Protocol

import numpy as np

from isorod.arrays import Array
from isorod.tensors import determinant, inverse

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
# Size of ``D`` up to which the Gauss points are exact to rounding: of smooth energies up to 0.05, but fibres that begin
# to bear on the way make a kink.  Rounding of the energy, divided by it, is 1e-13 of a modulus.
_SMALL = 2e-3


class Law(Protocol):
    """What is asked of a law; see `isorod.material.law.Material`."""

    def energy(self, F: Array) -> Array:
        """Return the stored energy."""

    def stress(self, F: Array) -> Array:
        """Return the first Piola-Kirchhoff stress."""

    def tangent(self, F: Array) -> Array:
        """Return its derivatives."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def discrete_gradient(law: Law, F: Array, change: Array, wanted: bool) -> tuple[Array, Array | None]:
    """Return the stress ``P`` and, if wanted, its derivatives by the end state (`Material.discrete`)."""
    # States that cannot be have no stress, though the way may seem to pass them by.
    bad = ~((determinant(F) > 0.0) & (determinant(F + change) > 0.0))[..., None, None]
    F, change = np.where(bad, np.eye(3), F), np.where(bad, 0.0, change)
    end, middle = F + change, F + 0.5 * change
    D = _transposed(middle) @ change
    D = D + _transposed(D)
    mean, varied = _averages(law, F, D, end, wanted)
    size = np.sum(D * D, axis=(-2, -1))
    far = size > _SMALL**2
    size = np.where(far, size, 1.0)
    missed = 2.0 * (law.energy(end) - law.energy(F)) - np.sum(mean * D, axis=(-2, -1))
    k = np.where(far, missed / size, 0.0)[..., None, None]
    S = mean + k * D
    stress = np.where(bad, np.nan, middle @ S)
    if not wanted:
        return stress, None
    slope = 2.0 * (law.stress(end) - end @ (mean + 2.0 * k * D)) - np.einsum("...IJ,...IJbB->...bB", D, varied)
    slope = np.where(far[..., None, None], slope / size[..., None, None], 0.0)
    varied += D[..., None, None] * slope[..., None, None, :, :]
    moduli = np.einsum("...aI,...IAbB->...aAbB", middle, varied, optimize=True)
    # k dD and dF_m S, with dD_AK = d_AB F_bK + F_bA d_KB.
    moduli += k[..., None, None] * np.einsum("...aB,...bA->...aAbB", middle, end)
    across, S = k * (middle @ _transposed(end)), 0.5 * _transposed(S)
    for a in range(3):
        moduli[..., :, a, :, a] += across
        moduli[..., a, :, a, :] += S
    return stress, np.where(bad[..., None, None], np.nan, moduli)


def _averages(law: Law, F: Array, D: Array, end: Array, wanted: bool) -> tuple[Array, Array]:
    """Return the average of ``S``, shape of ``F``, and its derivatives ``IJbB`` by the components of the end state."""
    C = _transposed(F) @ F
    mean, varied = np.zeros(F.shape), np.zeros((*F.shape, 3, 3) if wanted else 0)
    for t, weight in zip(0.5 * (1.0 + _POINTS), 0.5 * _WEIGHTS, strict=True):
        # Any F with F^T F = C does: S knows no rotation.
        U = _root(C + t * D)
        V = inverse(U)[0]
        S = V @ law.stress(U)
        mean += weight * S
        if not wanted:
            continue
        moduli = law.tangent(U)
        for a in range(3):
            moduli[..., a, :, a, :] -= S
        # dS = (dS/dE) t dD/2, with dS_IJ/dE_LB = V_Ia V_Lb moduli_aJbB.
        lifted = end @ V
        varied += t * weight * np.einsum("...Ia,...nb,...aJbB->...IJnB", V, lifted, moduli, optimize=True)
    return mean, varied


def _root(C: Array) -> Array:
    """Return the upper triangular ``U`` with ``U^T U = C``; NaN, where LAPACK's raises, if rounding leaves none."""
    U = np.zeros_like(C)
    for i in range(3):
        for j in range(i, 3):
            rest = C[..., i, j] - np.sum(U[..., :i, i] * U[..., :i, j], axis=-1)
            U[..., i, j] = np.sqrt(rest) if i == j else rest / U[..., i, i]
    return U


def _transposed(F: Array) -> Array:
    return np.swapaxes(F, -1, -2)
