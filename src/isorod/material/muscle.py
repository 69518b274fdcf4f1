"""Skeletal muscle: a neo-Hookean matrix with active and passive fibres (Lu & Zhou 2011, eqs. 16-19)."""

from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numba import f8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F5, STRICT, flat, njit
from isorod.errors import InputError
from isorod.material import fibre
from isorod.material.fibre import Fibre, OneFibre
from isorod.material.logarithm_kernel import SERIES
from isorod.material.neo_hookean import NeoHookean

if TYPE_CHECKING:
    from isorod.material.energy import Energy

# Fibres shortened or stretched by more than this have no active force.
ACTIVE_RANGE = 0.5


@cache
def _energy() -> "Energy":
    from isorod.material.muscle_energy import of_the_parabola

    return of_the_parabola()


@dataclass(frozen=True, eq=False)
class Muscle(OneFibre, NeoHookean):
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
        ``F.shape[:-1]``); or what the body that the law is given to knows: a direction of the rod, ``"tangent"`` along
        its centre line, ``"normal"``, ``"binormal"``, ``"radial"`` or ``"around"``, or a function of places
        (`isorod.material.fibre`), such as ``helix(30)``.

    Raises
    ------
    InputError
        If a value is out of its range or not finite.
    """

    families: ClassVar[int] = 1
    recipe = (_energy,)

    sigma_max: float = 0.0
    m1: float = 0.0
    m2: float = 0.0
    activation: float = 0.0
    fibre: Fibre = "tangent"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= self.activation <= 1.0:
            raise InputError(f"activation: got {self.activation:g}, need 0 (at rest) to 1 (fully active)")
        for name, what in (("sigma_max", "a stress"), ("m1", "a stress"), ("m2", "an exponent")):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"{name}: got {value:g}, need {what}, not negative")
        object.__setattr__(self, "fibre", fibre.checked(self.fibre))

    @property
    def constants(self) -> Array:
        """``mu, lame``, active stress, ``m1, m2``."""
        # Without an exponent there is no passive stress.
        passive = (self.m1, self.m2) if self.m2 > 0.0 else (0.0, 1.0)
        return np.array([self.mu, self.lame, self.activation * self.sigma_max, *passive])

    @property
    def modulus(self) -> float:
        """Modulus of pressure waves along passive fibres that are just taut, force / area."""
        return super().modulus + 2.0 * self.m1 * self.m2

    @property
    def activation_work(self) -> float:
        """The work of active fibres over the whole range of their stretch, per volume: 2/3 of their stress."""
        return 2.0 / 3.0 * self.activation * self.sigma_max

    def at(self, factor: float) -> Self:
        """Return the law at a load factor: ``factor`` times the activation."""
        return replace(self, activation=factor * self.activation)

    def fibres(self, shape: tuple[int, ...]) -> Array:
        """Return the unit vectors along the fibres at points of some shape, shape ``(*shape, 3)``."""
        return fibre.vectors(self.fibre, shape)

    def discrete(self, F: Array, change: Array, wanted: bool = True) -> tuple[Array, Array | None]:
        """Add ``2 (dw / d lambda^2) f f^T`` of the fibres, with a difference quotient, to the matrix's ``S``."""
        stress, moduli = super().discrete(F, change, wanted)
        fibres = self._flat_fibres(F.shape[:-2])
        rows = np.empty((0, 3, 3, 3, 3)) if moduli is None else moduli.reshape(-1, 3, 3, 3, 3)
        _add_discrete(flat(F), flat(change), self.constants, fibres, stress.reshape(-1, 3, 3), rows)
        return stress, moduli


@njit(types.UniTuple(f8, 2)(f8), **STRICT)
def _exp_quotient(y: float) -> tuple[float, float]:
    """Return ``(exp(y) - 1) / y`` and its derivative."""
    if abs(y) < SERIES:
        value = 1.0 + y * (1.0 / 2.0 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y / 120.0)))
        return value, 1.0 / 2.0 + y * (1.0 / 3.0 + y * (1.0 / 8.0 + y * (1.0 / 30.0 + y / 144.0)))
    value = np.expm1(y) / y
    return value, (np.exp(y) - value) / y


@njit(types.UniTuple(f8, 2)(f8, f8, F1), **STRICT)
def fibre_quotient(before: float, change: float, constants: Array) -> tuple[float, float]:
    """Return the fibre energy's difference quotient over ``c = lambda^2``, and its derivative by the ``c`` at the end.

    Parameters
    ----------
    before, change
        ``c`` at the start, and how much it grows.
    constants
        The law's.
    """
    after = before + change
    first, last = np.sqrt(before), np.sqrt(after)
    total = first + last
    stretched = change / total
    low, high = -ACTIVE_RANGE, ACTIVE_RANGE
    s0, s1 = first - 1.0, last - 1.0
    k0, k1 = min(max(s0, low), high), min(max(s1, low), high)
    inside = 1.0 if k1 == s1 else 0.0
    # Share of the way within the active range; the force's slope jumps at its ends.
    share, turn = inside, 0.0
    if (k0 != s0 or k1 != s1) and stretched != 0.0:
        share = (k1 - k0) / stretched
        turn = (inside - share) / stretched
    mean = 1.0 - 4.0 / 3.0 * (k1 * k1 + k1 * k0 + k0 * k0)
    active = constants[2]
    value = active * share * mean / total
    slope = active * (turn * mean - share * 4.0 / 3.0 * (2.0 * k1 + k0) * inside - share * mean / total) / total
    slope *= 0.5 / last
    m1, m2 = constants[3], constants[4]
    if m1 > 0.0 and m2 > 0.0 and max(before, after) > 1.0:
        q0, q1 = max(before - 1.0, 0.0), max(after - 1.0, 0.0)
        inside = 1.0 if after > 1.0 else 0.0
        share, turn = 1.0, 0.0
        grown = change
        if before < 1.0 or after < 1.0:
            grown = q1 - q0
            share = grown / change
            turn = (inside - share) / change
        phi, dphi = _exp_quotient(m2 * grown)
        scale = np.exp(m2 * q0)
        bracket = scale * phi - 1.0
        value += 0.5 * m1 * share * bracket
        slope += 0.5 * m1 * (turn * bracket + share * scale * dphi * m2 * inside)
    return value, slope


@njit(void(F3, F3, F1, F2, F3, F5), **STRICT)
def _add_discrete(F: Array, change: Array, constants: Array, fibres: Array, stress: Array, moduli: Array) -> None:
    """Add ``2 q (F_m f) f^T``, and to moduli, if they have points, its derivatives; ``q``: `fibre_quotient`."""
    start, end = np.empty(3), np.empty(3)
    for m in range(F.shape[0]):
        f = fibres[m]
        before = grown = 0.0
        for a in range(3):
            start[a] = F[m, a, 0] * f[0] + F[m, a, 1] * f[1] + F[m, a, 2] * f[2]
            h = change[m, a, 0] * f[0] + change[m, a, 1] * f[1] + change[m, a, 2] * f[2]
            end[a] = start[a] + h
            before += start[a] * start[a]
            grown += (start[a] + end[a]) * h
        value, slope = fibre_quotient(before, grown, constants)
        for a in range(3):
            for A in range(3):
                stress[m, a, A] += value * (start[a] + end[a]) * f[A]
        if moduli.shape[0] == 0:
            continue
        for a in range(3):
            for b in range(3):
                x = 2.0 * slope * (start[a] + end[a]) * end[b]
                if a == b:
                    x += value
                for A in range(3):
                    for B in range(3):
                        moduli[m, a, A, b, B] += x * f[A] * f[B]
