"""Skeletal muscle: a neo-Hookean matrix with active and passive fibres (Lu & Zhou 2011, eqs. 16-19)."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numba import f8, njit, types, void
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F5, STRICT, cofactors, flat
from isorod.errors import InputError
from isorod.material.neo_hookean import NeoHookean

# Fibres shortened or stretched by more than this have no active force.
ACTIVE_RANGE = 0.5


@dataclass(frozen=True, eq=False)
class Muscle(NeoHookean):
    """``W = W_matrix + W_active(lambda) + W_passive(lambda)``, ``lambda = |F f|`` the stretch of a fibre along ``f``.

    ``dW_active/dlambda = activation sigma_max max(0, 1 - 4 (1 - lambda)^2)`` and ``dW_passive/dlambda = m1 lambda
    (exp(m2 (lambda^2 - 1)) - 1)`` for ``lambda >
    1``, else 0 (Lu & Zhou 2011, eqs. 16-19).  Both energies are measured from ``lambda =
    1``; the active one is that of the fibre at a fixed activation.

    Parameters
    ----------
    E, nu
        Young's modulus [force/area] and Poisson's ratio of the matrix.
    sigma_max
        Largest active fibre stress, force per reference area.
    m1, m2
        Passive fibre: stress factor [force/area] and exponent, neither negative.
    activation
        From 0 (at rest) to 1.
    fibre
        Reference direction of the fibres: a vector of any length ``(3,)``, one a point (anything that broadcasts to
        ``F.shape[:-1]``), or ``"tangent"``: along the rod's centre line, which the body the law is given to knows.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    sigma_max: float = 0.0
    m1: float = 0.0
    m2: float = 0.0
    activation: float = 0.0
    fibre: ArrayLike | str = "tangent"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.activation <= 1.0:
            raise InputError(f"activation: got {self.activation:g}, need 0 (at rest) to 1 (fully active)")
        for name, what in (("sigma_max", "a stress"), ("m1", "a stress"), ("m2", "an exponent")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name}: got {value:g}, need {what}, not negative")
        if isinstance(self.fibre, str):
            if self.fibre != "tangent":
                raise InputError(f"fibre direction: got {self.fibre!r}, need a vector (x, y, z) or 'tangent'")
            return
        fibre = np.array(self.fibre, dtype=float)
        if fibre.ndim == 0 or fibre.shape[-1] != 3:
            raise InputError(f"fibre direction: got shape {fibre.shape}, need (3,) or one a point (..., 3)")
        length = np.sqrt(np.sum(fibre**2, axis=-1, keepdims=True))
        if not (np.isfinite(length) & (length > 0.0)).all():
            bad = fibre.reshape(-1, 3)[np.argmin((np.isfinite(length) & (length > 0.0)).ravel())]
            raise InputError(
                f"fibre direction: got ({bad[0]:g}, {bad[1]:g}, {bad[2]:g}), need a finite vector, not zero"
            )
        object.__setattr__(self, "fibre", fibre / length)

    @property
    def parameters(self) -> Array:
        """``mu, lame, sigma_max, m1, m2`` as `point_stress` takes them, shape ``(5,)``."""
        return np.array([self.mu, self.lame, self.sigma_max, self.m1, self.m2])

    def at(self, factor: float) -> Self:
        """Return the law at a load factor: ``factor`` times the activation."""
        return replace(self, activation=factor * self.activation)

    @property
    def follows(self) -> bool:
        """Whether the fibres run along the rod."""
        return isinstance(self.fibre, str)

    def along(self, tangent: Array) -> Self:
        """Return the law with the rod's tangents ``(..., 3)`` for fibres, if that is what ``fibre`` asks for."""
        return replace(self, fibre=tangent) if self.follows else self

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        stretch = np.sqrt(np.sum(np.einsum("...aA,...A->...a", F, self._fibres(F)) ** 2, axis=-1))
        short = np.clip(stretch - 1.0, -ACTIVE_RANGE, ACTIVE_RANGE)
        active = self.activation * self.sigma_max * (short - 4.0 / 3.0 * short**3)
        squared = np.maximum(stretch, 1.0) ** 2 - 1.0
        # m1/2 times the integral of exp(m2 x) - 1 over x.
        growth = np.expm1(self.m2 * squared) / self.m2 if self.m2 > 0.0 else squared
        return super().energy(F) + active + 0.5 * self.m1 * (growth - squared)

    def stress(self, F: Array) -> Array:
        """Return ``P = P_matrix + T(lambda) n f^T``, ``n = F f / lambda``, ``T = dW/dlambda``; shape of ``F``."""
        return _stress(flat(F), self.parameters, self._fibres(F).reshape(-1, 3), self.activation).reshape(F.shape)

    def tangent(self, F: Array) -> Array:
        """Return ``A_matrix + (T' n_a n_b + T/lambda (d_ab - n_a n_b)) f_A f_B``, shape ``F.shape + (3, 3)``."""
        moduli = super().tangent(F)
        _add_fibres(
            moduli.reshape(-1, 3, 3, 3, 3), flat(F), self.parameters, self._fibres(F).reshape(-1, 3), self.activation
        )
        return moduli

    def _fibres(self, F: Array) -> Array:
        if isinstance(self.fibre, str):
            raise InputError("fibre direction 'tangent': only a body knows its rod's centre line; give the law to one")
        return np.array(np.broadcast_to(np.asarray(self.fibre), F.shape[:-1]), order="C")


@njit(types.UniTuple(f8, 2)(f8, F1, f8), **STRICT)
def fibre_tension(stretch: float, parameters: Array, activation: float) -> tuple[float, float]:
    """Return ``T = dW/dlambda`` of active and passive fibres (eqs. 18, 19) and ``dT/dlambda``."""
    tension = 0.0
    slope = 0.0
    short = stretch - 1.0
    if abs(short) < ACTIVE_RANGE:
        active = activation * parameters[2]
        tension = active * (1.0 - 4.0 * short * short)
        slope = -8.0 * active * short
    if short > 0.0 and parameters[3] > 0.0:
        m1, m2 = parameters[3], parameters[4]
        growth = np.expm1(m2 * (stretch * stretch - 1.0))
        tension += m1 * stretch * growth
        slope += m1 * (growth + 2.0 * m2 * stretch * stretch * (growth + 1.0))
    return tension, slope


@njit(f8(F2, F1, F1, f8, F2), **STRICT)
def point_stress(F: Array, parameters: Array, fibre: Array, activation: float, out: Array) -> float:
    """Write the first Piola-Kirchhoff stress at one point into ``out`` and return ``det F``.

    Parameters
    ----------
    F, out
        Shape ``(3, 3)``; ``out`` is NaN where ``det F <= 0``.
    parameters
        ``mu, lame, sigma_max, m1, m2``; without fibres (neo-Hookean) ``sigma_max = m1 = 0``.
    fibre
        Unit vector; not read without fibres.
    """
    det = cofactors(F, out)
    mu, lame = parameters[0], parameters[1]
    factor = (lame * np.log(det) - mu) / det if det > 0.0 else np.nan
    for a in range(3):
        for A in range(3):
            out[a, A] = mu * F[a, A] + factor * out[a, A]
    if parameters[2] > 0.0 or parameters[3] > 0.0:
        f0, f1, f2 = fibre[0], fibre[1], fibre[2]
        n0 = F[0, 0] * f0 + F[0, 1] * f1 + F[0, 2] * f2
        n1 = F[1, 0] * f0 + F[1, 1] * f1 + F[1, 2] * f2
        n2 = F[2, 0] * f0 + F[2, 1] * f1 + F[2, 2] * f2
        stretch = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        tension, _ = fibre_tension(stretch, parameters, activation)
        n0 *= tension / stretch
        n1 *= tension / stretch
        n2 *= tension / stretch
        for A in range(3):
            out[0, A] += n0 * fibre[A]
            out[1, A] += n1 * fibre[A]
            out[2, A] += n2 * fibre[A]
    return det


@njit(F3(F3, F1, F2, f8), **STRICT)
def _stress(F: Array, parameters: Array, fibres: Array, activation: float) -> Array:
    result = np.empty_like(F)
    for m in range(F.shape[0]):
        point_stress(F[m], parameters, fibres[m], activation, result[m])
    return result


@njit(void(F5, F3, F1, F2, f8), **STRICT)
def _add_fibres(moduli: Array, F: Array, parameters: Array, fibres: Array, activation: float) -> None:
    n = np.empty(3)
    for m in range(F.shape[0]):
        square = 0.0
        for a in range(3):
            n[a] = F[m, a, 0] * fibres[m, 0] + F[m, a, 1] * fibres[m, 1] + F[m, a, 2] * fibres[m, 2]
            square += n[a] * n[a]
        stretch = np.sqrt(square)
        tension, slope = fibre_tension(stretch, parameters, activation)
        across = tension / stretch
        along = (slope - across) / square
        for a in range(3):
            for b in range(3):
                x = along * n[a] * n[b]
                if a == b:
                    x += across
                for A in range(3):
                    for B in range(3):
                        moduli[m, a, A, b, B] += x * fibres[m, A] * fibres[m, B]
