"""Skeletal muscle: a neo-Hookean matrix with active and passive fibres (Lu & Zhou 2011, eqs. 16-19)."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numba import f8, types, void

from isorod.arrays import Array
from isorod.compiled import F1, F2, F3, F5, FAST, STRICT, flat, njit
from isorod.errors import InputError
from isorod.material import fibre, neo_hookean
from isorod.material.fibre import Fibre, OneFibre
from isorod.material.logarithm_kernel import SERIES
from isorod.material.neo_hookean import NeoHookean
from isorod.material.points import (
    ACTIVE,
    BLOCK,
    ENERGY,
    FIBRE,
    FREE,
    GRADIENT,
    MODULI,
    POINTS,
    ROWS,
    SQUARES,
    TANGENT,
    Compiled,
    add_pair,
    add_square,
)

if TYPE_CHECKING:
    from isorod.material.energy import Energy

# Fibres shortened or stretched by more than this have no active force.
ACTIVE_RANGE = 0.5

_W = np.uint64(POINTS)
_F = GRADIENT
# Rows of a block that its fibres use: n = F f (3), its length (the stretch), and exp(m2 (stretch^2 - 1)) - 1.
_N, _STRETCH, _GROWTH = ROWS[FREE + 1], ROWS[FREE + 4], ROWS[FREE + 5]


@njit(types.UniTuple(f8, 2)(f8, F1, f8), **STRICT)
def fibre_tension(stretch: float, constants: Array, activation: float) -> tuple[float, float]:
    """Return ``T = dW/dlambda`` of active and passive fibres (eqs. 18, 19) and ``dT/dlambda``."""
    tension = 0.0
    slope = 0.0
    short = stretch - 1.0
    if abs(short) < ACTIVE_RANGE:
        active = activation * constants[2]
        tension = active * (1.0 - 4.0 * short * short)
        slope = -8.0 * active * short
    if short > 0.0 and constants[3] > 0.0:
        m1, m2 = constants[3], constants[4]
        growth = np.expm1(m2 * (stretch * stretch - 1.0))
        tension += m1 * stretch * growth
        slope += m1 * (growth + 2.0 * m2 * stretch * stretch * (growth + 1.0))
    return tension, slope


@njit(void(F1, f8), **FAST)
def _stretches(work: Array, m2: float) -> None:
    """Fill rows with ``n = F f``, its length, and ``exp(m2 (stretch^2 - 1)) - 1`` where that is stretched, else 0."""
    for k in range(_W):
        f0, f1, f2 = work[ROWS[FIBRE] + k], work[ROWS[FIBRE + 1] + k], work[ROWS[FIBRE + 2] + k]
        n0 = work[ROWS[_F] + k] * f0 + work[ROWS[_F + 1] + k] * f1 + work[ROWS[_F + 2] + k] * f2
        n1 = work[ROWS[_F + 3] + k] * f0 + work[ROWS[_F + 4] + k] * f1 + work[ROWS[_F + 5] + k] * f2
        n2 = work[ROWS[_F + 6] + k] * f0 + work[ROWS[_F + 7] + k] * f1 + work[ROWS[_F + 8] + k] * f2
        square = n0 * n0 + n1 * n1 + n2 * n2
        # Points that only fill up a block have no fibre.
        square = square if square > 0.0 else 1.0
        work[_N + k], work[_N + _W + k], work[_N + _W + _W + k] = n0, n1, n2
        work[_STRETCH + k] = np.sqrt(square)
        work[_GROWTH + k] = m2 * (square - 1.0 if square > 1.0 else 0.0)
    large = 0.0
    for k in range(_W):
        large += 1.0 if work[_GROWTH + k] > 1.0 else 0.0
    if large > 0.0:
        for k in range(_W):
            work[_GROWTH + k] = np.expm1(work[_GROWTH + k])
        return
    # The exponential series: to rounding up to 1.
    for k in range(_W):
        x = work[_GROWTH + k]
        y = 1.0 + x * (1.0 / 17.0) * (1.0 + x * (1.0 / 18.0))
        y = 1.0 + x * (1.0 / 15.0) * (1.0 + x * (1.0 / 16.0) * y)
        y = 1.0 + x * (1.0 / 13.0) * (1.0 + x * (1.0 / 14.0) * y)
        y = 1.0 + x * (1.0 / 11.0) * (1.0 + x * (1.0 / 12.0) * y)
        y = 1.0 + x * (1.0 / 9.0) * (1.0 + x * (1.0 / 10.0) * y)
        y = 1.0 + x * (1.0 / 7.0) * (1.0 + x * (1.0 / 8.0) * y)
        y = 1.0 + x * (1.0 / 5.0) * (1.0 + x * (1.0 / 6.0) * y)
        y = 1.0 + x * (1.0 / 3.0) * (1.0 + x * (1.0 / 4.0) * y)
        work[_GROWTH + k] = x * (1.0 + x * 0.5 * y)


@njit(BLOCK, **FAST)
def block(work: Array, constants: Array, activation: float, wanted: bool) -> None:
    """Fill in the stress at the points of a block (`isorod.material.points.BLOCK`)."""
    mu, lame, strongest, m1, m2 = constants[0], constants[1], constants[2], constants[3], constants[4]
    active = activation * strongest
    if not (active > 0.0 or m1 > 0.0 or (wanted and strongest > 0.0)):
        neo_hookean.block(work, constants, activation, wanted)
        return
    neo_hookean.logarithms(work)
    _stretches(work, m2)
    for k in range(_W):
        p = neo_hookean.stress_in_block(work, mu, lame, k)
        stretch = work[_STRETCH + k]
        short = stretch - 1.0
        level = 1.0 - 4.0 * short * short
        level = level if level > 0.0 else 0.0
        factor = active * level / stretch + m1 * work[_GROWTH + k]
        x, y, z = factor * work[_N + k], factor * work[_N + _W + k], factor * work[_N + _W + _W + k]
        f, g, h = work[ROWS[FIBRE] + k], work[ROWS[FIBRE + 1] + k], work[ROWS[FIBRE + 2] + k]
        work[k], work[ROWS[1] + k], work[ROWS[2] + k] = p[0] + x * f, p[1] + x * g, p[2] + x * h
        work[ROWS[3] + k], work[ROWS[4] + k], work[ROWS[5] + k] = p[3] + y * f, p[4] + y * g, p[5] + y * h
        work[ROWS[6] + k], work[ROWS[7] + k], work[ROWS[8] + k] = p[6] + z * f, p[7] + z * g, p[8] + z * h
    if not wanted:
        return
    neo_hookean.energies_in_block(work, mu, lame)
    for k in range(_W):
        stretch = work[_STRETCH + k]
        short = min(max(stretch - 1.0, -ACTIVE_RANGE), ACTIVE_RANGE)
        squared = max(stretch, 1.0) ** 2 - 1.0
        growth = work[_GROWTH + k] / m2 if m2 > 0.0 else squared
        work[ROWS[ENERGY] + k] += 0.5 * m1 * (growth - squared)
        work[ROWS[ACTIVE] + k] = strongest * (short - 4.0 / 3.0 * short**3)


@njit(TANGENT, **FAST)
def tangent(work: Array, constants: Array, activation: float) -> None:
    """Add ``A_matrix + (T' n_a n_b + T/lambda (d_ab - n_a n_b)) f_A f_B`` to the moduli."""
    neo_hookean.tangent(work, constants, activation)
    active, m1, m2 = activation * constants[2], constants[3], constants[4]
    if not (active > 0.0 or m1 > 0.0):
        return
    for k in range(_W):
        stretch = work[_STRETCH + k]
        short = stretch - 1.0
        level = 1.0 - 4.0 * short * short
        growth = work[_GROWTH + k]
        slope = -8.0 * active * short if level > 0.0 else 0.0
        slope += m1 * (growth + 2.0 * m2 * stretch * stretch * (growth + 1.0)) if short > 0.0 else 0.0
        across = active * (level if level > 0.0 else 0.0) / stretch + m1 * growth
        along = (slope - across) / (stretch * stretch)
        x, y, z = work[_N + k], work[_N + _W + k], work[_N + _W + _W + k]
        f = (work[ROWS[FIBRE] + k], work[ROWS[FIBRE + 1] + k], work[ROWS[FIBRE + 2] + k])
        add_pair(work, k, ROWS[MODULI], along * x * y, 0.0, f, f)
        add_pair(work, k, ROWS[MODULI + 9], along * x * z, 0.0, f, f)
        add_pair(work, k, ROWS[MODULI + 18], along * y * z, 0.0, f, f)
        add_square(work, k, ROWS[SQUARES], along * x * x + across, f)
        add_square(work, k, ROWS[SQUARES + 6], along * y * y + across, f)
        add_square(work, k, ROWS[SQUARES + 12], along * z * z + across, f)


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

    compiled = Compiled(block, tangent)
    families: ClassVar[int] = 1

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
    def stored(self) -> "Energy":
        """Its energy as an expression, its activation a constant times that of the step."""
        from isorod.material.muscle_energy import of_the_parabola

        return of_the_parabola()

    @property
    def constants(self) -> Array:
        """``mu, lame``, active stress, ``m1, m2``."""
        return np.array([self.mu, self.lame, self.activation * self.sigma_max, self.m1, self.m2])

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
