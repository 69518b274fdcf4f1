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
    return neo_hookean_of(*lame(young, poisson))


def neo_hookean_of(mu: Any, kappa: Any) -> Energy:
    """Return `neo_hookean` of moduli: numbers, or scalars in UFL."""

    def energy(F: Any) -> Any:
        log = ufl.ln(ufl.det(F))
        return 0.5 * mu * (ufl.inner(F, F) - 2.0 * log - 3.0) + 0.5 * kappa * log**2

    return energy


def linear(young: float, poisson: float) -> Energy:
    """Return ``W = mu e:e + kappa/2 (tr e)^2`` with ``e = sym F - I``: linear isotropic elasticity."""
    return linear_of(*lame(young, poisson))


def linear_of(mu: Any, kappa: Any) -> Energy:
    """Return `linear` of moduli: numbers, or scalars in UFL."""
    return lambda F: _quadratic(mu, kappa, ufl.sym(F) - ufl.Identity(3))


def st_venant_kirchhoff_of(mu: Any, kappa: Any) -> Energy:
    """Return ``W = mu E:E + kappa/2 (tr E)^2`` with Green's strain ``E = (F^T F - I)/2``, of moduli."""
    return lambda F: _quadratic(mu, kappa, 0.5 * (F.T * F - ufl.Identity(3)))


def _quadratic(mu: Any, kappa: Any, strain: Any) -> Any:
    return mu * ufl.inner(strain, strain) + 0.5 * kappa * ufl.tr(strain) ** 2


def muscle(young: float, poisson: float, sigma_max: float, m1: float, m2: float, activation: Any, fibre: Any) -> Energy:
    """Return the neo-Hookean matrix with active and passive fibres (Lu & Zhou 2011, eqs. 16-19).

    ``dW/dlambda = activation sigma_max max(0, 1 - 4 (1 - lambda)^2)``, and where the fibre is stretched
    ``m1 lambda (exp(m2 (lambda^2 - 1)) - 1)`` more, ``lambda = |F f|``.

    Parameters
    ----------
    young, poisson
        Matrix.
    sigma_max, m1, m2
        Largest active stress, factor and exponent of the passive fibres, as in `isorod.material.muscle.Muscle`.
    activation
        From 0 to 1: a UFL scalar such as a dolfinx Constant.
    fibre
        Unit vector in UFL, constant or a field.
    """
    matrix = neo_hookean(young, poisson)
    if m1 == 0.0 or m2 == 0.0:
        return lambda F: matrix(F) + activation * sigma_max * active_of(F, fibre)
    return lambda F: matrix(F) + activation * sigma_max * active_of(F, fibre) + passive_of(m1, m2, F, fibre)


def active_of(F: Any, fibre: Any) -> Any:
    """Return the work of active fibres of unit stress, per volume."""
    along = ufl.dot(F, fibre)
    short = ufl.sqrt(ufl.inner(along, along)) - 1.0
    # No force beyond half the length; the energy is then constant.
    limit = 1.0 / 3.0
    inside = short - 4.0 / 3.0 * short**3
    return ufl.conditional(ufl.gt(short, 0.5), limit, ufl.conditional(ufl.lt(short, -0.5), -limit, inside))


def passive_of(m1: Any, m2: Any, F: Any, fibre: Any) -> Any:
    """Return the energy of passive fibres, per volume; neither constant may be zero."""
    along = ufl.dot(F, fibre)
    squared = ufl.inner(along, along)
    growth = (ufl.exp(m2 * (squared - 1.0)) - 1.0) / m2 - (squared - 1.0)
    return ufl.conditional(ufl.gt(squared, 1.0), 0.5 * m1 * growth, 0.0)
