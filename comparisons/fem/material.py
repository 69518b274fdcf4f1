"""Stored-energy laws in UFL: functions of the deformation gradient ``F``."""

from collections.abc import Callable
from typing import Any

import ufl

from isorod.errors import InputError

Energy = Callable[[Any], Any]


def lame(young: float, poisson: float) -> tuple[float, float]:
    """Return ``mu = E / 2(1 + nu)`` and ``kappa = E nu / ((1 + nu)(1 - 2 nu))``, units of ``young``."""
    if not young > 0.0:
        raise InputError(f"Young's modulus: got {young:g}, need a positive stress")
    if not -1.0 < poisson < 0.5:
        raise InputError(f"Poisson's ratio: got {poisson:g}, need a number between -1 and 0.5")
    return young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))


def neo_hookean(young: float, poisson: float) -> Energy:
    """Return ``W = mu/2 (I1 - 2 ln J - 3) + kappa/2 (ln J)^2`` (Lu & Zhou 2011, eq. 15)."""
    mu, kappa = lame(young, poisson)

    def energy(F: Any) -> Any:
        log = ufl.ln(ufl.det(F))
        return 0.5 * mu * (ufl.inner(F, F) - 2.0 * log - 3.0) + 0.5 * kappa * log**2

    return energy


def linear(young: float, poisson: float) -> Energy:
    """Return ``W = mu e:e + kappa/2 (tr e)^2`` with ``e = sym F - I``: linear isotropic elasticity."""
    mu, kappa = lame(young, poisson)

    def energy(F: Any) -> Any:
        strain = ufl.sym(F) - ufl.Identity(3)
        return mu * ufl.inner(strain, strain) + 0.5 * kappa * ufl.tr(strain) ** 2

    return energy
