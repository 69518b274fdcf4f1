"""Exact solutions of a round rod that is welded in a round hole, by the equations they solve.

A rod of radius ``a`` is in a sleeve from ``a`` to ``b``, or in an infinite plate; ``E`` and ``nu`` are Young's modulus
and Poisson's ratio, ``z`` runs along the axis.  Displacements are functions of positions ``(n, 3)``, shape ``(n, 3)``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import i0, i1, iv, j1, jv, k0, k1, kn, y1, yn

Array = NDArray[np.float64]
Field = Callable[[Array], Array]


def lame(E: float, nu: float) -> tuple[float, float]:
    """Return Lamé's constants."""
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), E / (2.0 * (1.0 + nu))


def polar(x: Array) -> tuple[Array, Array, Array]:
    """Return the radii ``(n,)`` of positions, and the radial and tangential directions there ``(n, 3)``."""
    x = np.atleast_2d(x)
    r = np.hypot(x[:, 0], x[:, 1])
    unit = np.zeros((len(x), 3))
    unit[:, :2] = x[:, :2] / np.where(r > 0.0, r, 1.0)[:, None]
    return r, unit, np.stack([-unit[:, 1], unit[:, 0], np.zeros(len(x))], axis=1)


@dataclass(frozen=True)
class Torsion:
    """Torsional transfer: ``u_theta = V(r) sin(k z)``, ``k = pi / length``, with ``V(b) = 1`` and ends that are held.

    ``V = A I1(kr)`` in the rod, ``B I1(kr) + C K1(kr)`` in the sleeve; ``slip`` is the bond stiffness, shear over slip.
    """

    G: tuple[float, float]
    a: float
    b: float
    length: float
    slip: float = np.inf

    @property
    def k(self) -> float:
        """Wave number."""
        return np.pi / self.length

    @property
    def coefficients(self) -> Array:
        """``A, B, C``."""
        k, (rod, sleeve), a, b = self.k, self.G, self.a, self.b
        shear = rod * k * iv(2, k * a)
        return np.linalg.solve(
            [
                [i1(k * a) + shear / self.slip, -i1(k * a), -k1(k * a)],
                [shear, -sleeve * k * iv(2, k * a), sleeve * k * kn(2, k * a)],
                [0.0, i1(k * b), k1(k * b)],
            ],
            [0.0, 0.0, 1.0],
        )

    def amplitude(self, r: Array, body: int) -> Array:
        """Return ``V`` in the rod (0) or the sleeve (1)."""
        A, B, C = self.coefficients
        return A * i1(self.k * r) if body == 0 else B * i1(self.k * r) + C * k1(self.k * r)

    def shear(self, r: float, body: int) -> float:
        """Return the amplitude of the shear stress ``G r d(V/r)/dr``."""
        A, B, C = self.coefficients
        first, second = (A, 0.0) if body == 0 else (B, C)
        return float(self.G[body] * self.k * (first * iv(2, self.k * r) - second * kn(2, self.k * r)))

    def displacement(self, x: Array, body: int) -> Array:
        """Return the displacement."""
        r, _, tangent = polar(x)
        return (self.amplitude(r, body) * np.sin(self.k * x[:, 2]))[:, None] * tangent

    def traction(self, x: Array) -> Array:
        """Return the traction of the rod on its surface."""
        return self.shear(self.a, 0) * np.sin(self.k * x[:, 2])[:, None] * polar(x)[2]

    def load(self, x: Array) -> Array:
        """Return the traction that the sleeve needs on its outer surface."""
        return self.shear(self.b, 1) * np.sin(self.k * x[:, 2])[:, None] * polar(x)[2]

    @property
    def torque(self) -> float:
        """The rod's torque at ``z = 0``."""
        return 2.0 * np.pi * self.a**2 * self.shear(self.a, 0) / self.k

    @property
    def energy(self) -> float:
        """Stored energy: half the work on the outer surface."""
        return 0.5 * np.pi * self.b * self.length * self.shear(self.b, 1)


class Axial:
    """Axial transfer: ``u_r = U(r) cos(k z)``, ``u_z = W(r) sin(k z)``; ends are planes of symmetry.

    Of the potentials ``I0 cos kz`` and Papkovich's ``I1 cos kz`` along ``r``, and of ``K0`` and ``K1`` in the sleeve.

    Parameters
    ----------
    E, nu
        Of rod and sleeve.
    loaded
        Whether the outer surface carries ``s_rz = sin kz`` and no ``s_rr``; else ``u = (0, 0, sin kz)`` there.
    """

    def __init__(
        self, E: Sequence[float], nu: Sequence[float], a: float, b: float, length: float, loaded: bool = False
    ) -> None:
        self.a, self.b, self.length, self.loaded = a, b, length, loaded
        self._constants = [lame(*pair) for pair in zip(E, nu, strict=True)]
        self._nu = nu
        rod, sleeve = self._columns(a, 0), self._columns(a, 1)
        outer = self._columns(b, 1)[2:4] if loaded else self._columns(b, 1)[:2]
        matrix = np.block([[rod[:4], -sleeve[:4]], [np.zeros((2, 2)), outer]])
        coefficients = np.linalg.solve(matrix, [0.0] * 5 + [1.0])
        self._coefficients = coefficients[:2], coefficients[2:]

    @property
    def k(self) -> float:
        """Wave number."""
        return np.pi / self.length

    def _columns(self, r: float, body: int) -> Array:
        """Return amplitudes of u_r, u_z, s_rr, s_rz, s_zz, s_tt of each function, shape ``(6, 2 or 4)``."""
        k, c = self.k, 4.0 * (1.0 - self._nu[body])
        z = k * r
        parts = []
        for zero, one, sign in ((i0(z), i1(z), 1.0), (k0(z), k1(z), -1.0))[: body + 1]:
            slope = sign * k * zero - one / r
            parts.append([sign * k * one, sign * k * slope, -k * zero, -sign * k * k * one])
            U, W = sign * z * zero - c * one, -z * one
            grown = sign * k * zero + k * z * one - c * slope
            parts.append([U, grown, W, -sign * k * z * zero])
        U, dU, W, dW = np.array(parts).T
        lam, mu = self._constants[body]
        volume = lam * (dU + U / r + k * W)
        return np.array(
            [U, W, volume + 2 * mu * dU, mu * (dW - k * U), volume + 2 * mu * k * W, volume + 2 * mu * U / r]
        )

    def at(self, r: float, body: int) -> Array:
        """Return amplitudes of ``u_r, u_z, s_rr, s_rz, s_zz, s_tt`` at a radius."""
        return self._columns(r, body) @ self._coefficients[body]

    def displacement(self, x: Array, body: int) -> Array:
        """Return the displacement."""
        r, unit, _ = polar(x)
        u = np.array([self.at(max(one, 1e-12), body)[:2] for one in r])
        result = (u[:, 0] * np.cos(self.k * x[:, 2]))[:, None] * unit
        result[:, 2] = u[:, 1] * np.sin(self.k * x[:, 2])
        return result

    def _traction(self, x: Array, r: float, body: int) -> Array:
        _, _, s_rr, s_rz, _, _ = self.at(r, body)
        result = s_rr * np.cos(self.k * x[:, 2])[:, None] * polar(x)[1]
        result[:, 2] = s_rz * np.sin(self.k * x[:, 2])
        return result

    def traction(self, x: Array) -> Array:
        """Return the traction of the rod on its surface."""
        return self._traction(x, self.a, 0)

    def load(self, x: Array) -> Array:
        """Return the traction that the sleeve needs on its outer surface."""
        return self._traction(x, self.b, 1)

    @property
    def force(self) -> float:
        """The rod's force at ``z = 0``."""
        return float(2.0 * np.pi * self.a * self.at(self.a, 0)[3] / self.k)

    @property
    def energy(self) -> float:
        """Stored energy: half the work on the outer surface."""
        u_r, u_z, s_rr, s_rz = self.at(self.b, 1)[:4]
        return float(0.5 * np.pi * self.b * self.length * (s_rr * u_r + s_rz * u_z))


class Inclusion:
    """A rod in a plate under ``s_xx = S`` far away, plane strain (Muskhelishvili); indices are matrix, rod.

    Stresses in the rod are constant; outside ``2 mu u = kappa phi - z conj(phi') - conj(psi)``.
    """

    def __init__(self, E: Sequence[float], nu: Sequence[float], a: float = 1.0, S: float = 1.0) -> None:
        self.a, self.S = a, S
        (self._lam, self._mu), (_, mu) = (lame(*pair) for pair in zip(E, nu, strict=True))
        self._kappa, kappa = (3.0 - 4.0 * one for one in nu)
        self._h = mu * (self._kappa + 1.0) / (2.0 * mu + (kappa - 1.0) * self._mu)
        self._d = mu * (self._kappa + 1.0) / (self._mu + self._kappa * mu)
        self._E, self._nu = E[1], nu[1]

    @property
    def stress(self) -> Array:
        """``s_xx, s_yy, s_zz`` in the rod."""
        x, y = 0.5 * self.S * np.array([self._h + self._d, self._h - self._d])
        return np.array([x, y, self._nu * (x + y)])

    @property
    def strain(self) -> Array:
        """``e_xx, e_yy`` in the rod."""
        s = self.stress
        return ((1.0 + self._nu) * s[:2] - self._nu * s.sum()) / self._E

    def displacement(self, x: Array, body: int) -> Array:
        """Return the displacement in the rod (0) or outside of it (1)."""
        result = np.zeros((len(x), 3))
        if body == 0:
            result[:, :2] = x[:, :2] * self.strain
            return result
        z, S, a, d, h = x[:, 0] + 1j * x[:, 1], self.S, self.a, self._d, self._h
        phi = S / 4 * (z + 2 * (1 - d) * a**2 / z)
        slope = S / 4 * (1 - 2 * (1 - d) * a**2 / z**2)
        psi = -S / 2 * (z + (1 - h) * a**2 / z - (1 - d) * a**4 / z**3)
        u = (self._kappa * phi - z * slope.conj() - psi.conj()) / (2 * self._mu)
        result[:, 0], result[:, 1] = u.real, u.imag
        return result

    def traction(self, x: Array) -> Array:
        """Return the traction of the rod on its surface."""
        return polar(x)[1] * np.array([*self.stress[:2], 0.0])

    def box(self, half: float) -> float:
        """Return the energy stored, per length, in a square of that half side round the rod: half the work on it.

        Stresses outside are those of Kolosov's formulas, ``s_xx + s_yy = 4 Re phi'`` and
        ``s_yy - s_xx + 2i s_xy = 2 (conj(z) phi'' + psi')``.
        """
        S, a, d, h = self.S, self.a, self._d, self._h
        points, weights = np.polynomial.legendre.leggauss(60)
        energy = 0.0
        for normal, x in (
            ((1.0, 0.0), np.stack([np.full(60, half), half * points], axis=1)),
            ((0.0, 1.0), np.stack([half * points, np.full(60, half)], axis=1)),
        ):
            z = x[:, 0] + 1j * x[:, 1]
            slope = S / 4 * (1 - 2 * (1 - d) * a**2 / z**2)
            bend = S * (1 - d) * a**2 / z**3
            psi = -S / 2 * (1 - (1 - h) * a**2 / z**2 + 3 * (1 - d) * a**4 / z**4)
            total, rest = 4 * slope.real, 2 * (z.conj() * bend + psi)
            s_xx, s_yy, s_xy = (total - rest.real) / 2, (total + rest.real) / 2, rest.imag / 2
            t = np.stack([s_xx * normal[0] + s_xy * normal[1], s_xy * normal[0] + s_yy * normal[1]], axis=1)
            # Both sides of a pair do the same work.
            energy += half * weights @ (t * self.displacement(x, 1)[:, :2]).sum(axis=1)
        return float(energy)


class Composite:
    """A rod in a sleeve under an axial strain, free outside (Hill): ``u_r = C r`` inside, ``C r + D / r`` outside."""

    def __init__(self, E: Sequence[float], nu: Sequence[float], a: float, b: float, strain: float = 1.0) -> None:
        self.a, self.b, self.strain = a, b, strain
        (lf, mf), (lm, mm) = self._constants = [lame(*pair) for pair in zip(E, nu, strict=True)]
        self._coefficients = np.linalg.solve(
            [
                [a, -a, -1 / a],
                [2 * (lf + mf), -2 * (lm + mm), 2 * mm / a**2],
                [0.0, 2 * (lm + mm), -2 * mm / b**2],
            ],
            [0.0, (lm - lf) * strain, -lm * strain],
        )

    def displacement(self, x: Array, body: int) -> Array:
        """Return the displacement."""
        inner, outer, rest = self._coefficients
        r, unit, _ = polar(x)
        result = ((inner * r) if body == 0 else outer * r + rest / r)[:, None] * unit
        result[:, 2] = self.strain * x[:, 2]
        return result

    @property
    def pressure(self) -> float:
        """``-s_rr`` at ``a``."""
        lam, mu = self._constants[0]
        return float(-2 * (lam + mu) * self._coefficients[0] - lam * self.strain)

    @property
    def axial(self) -> Array:
        """``s_zz`` in rod and sleeve."""
        return np.array(
            [
                2 * lam * C + (lam + 2 * mu) * self.strain
                for (lam, mu), C in zip(self._constants, self._coefficients[:2], strict=True)
            ]
        )

    @property
    def force(self) -> float:
        """Axial force."""
        return float(np.pi * self.axial @ [self.a**2, self.b**2 - self.a**2])

    def radial(self, r: float) -> float:
        """Return ``u_r`` at ``a`` or outside of it."""
        _, outer, rest = self._coefficients
        return float(outer * r + rest / r)

    def traction(self, x: Array) -> Array:
        """Return the traction of the rod on its surface."""
        return -self.pressure * polar(x)[1]


def end_to_end(G: Sequence[float], density: Sequence[float], length: Sequence[float], count: int) -> list[float]:
    """Return the lowest torsional angular frequencies of two bars welded end to end, the first one held, the last free.

    They solve ``Z1 cot(w L1 / c1) = Z2 tan(w L2 / c2)``, ``Z = sqrt(G rho)``, here without poles.
    """
    (Z1, Z2), (t1, t2) = (
        np.sqrt(np.multiply(G, density)),
        np.multiply(length, np.sqrt(np.divide(density, G))),
    )
    return roots(
        lambda w: Z1 * np.cos(w * t1) * np.cos(w * t2) - Z2 * np.sin(w * t1) * np.sin(w * t2),
        np.pi / (2 * (t1 + t2)),
        count,
    )


def in_sleeve(
    G: Sequence[float], density: Sequence[float], a: float, b: float, length: float, waves: int, count: int
) -> list[float]:
    """Return the lowest angular frequencies of a free rod in a free sleeve: ``u_theta = V(r) cos(n pi z / L)``."""
    k = waves * np.pi / length

    def shape(q: float, r: float) -> tuple[Array, Array]:
        """Return two solutions of ``V'' + V'/r - V/r^2 + q V = 0`` and their ``r d(V/r)/dr``."""
        s = np.sqrt(abs(q))
        if q > 0.0:
            return np.array([j1(s * r), y1(s * r)]), -s * np.array([jv(2, s * r), yn(2, s * r)])
        return np.array([i1(s * r), k1(s * r)]), s * np.array([iv(2, s * r), -kn(2, s * r)])

    def determinant(w: float) -> float:
        inner, outer = (w**2 * rho / one - k**2 for rho, one in zip(density, G, strict=True))
        (u, t), (v, s), (_, free) = shape(inner, a), shape(outer, a), shape(outer, b)
        # Signs and sizes of the functions are taken out, so that it does not jump where waves begin.
        return float(
            np.linalg.det([[u[0], -v[0], -v[1]], [G[0] * t[0], -G[1] * s[0], -G[1] * s[1]], [0.0, free[0], free[1]]])
            / (np.sqrt(abs(inner)) * (1.0 if outer > 0.0 else -np.pi / 2))
        )

    return roots(determinant, 0.05 * k * min(np.sqrt(np.divide(G, density))), count)


def roots(function: Callable[[float], float], step: float, count: int) -> list[float]:
    """Return the lowest positive roots of a function, at least a step apart."""
    roots: list[float] = []
    low = 1e-3 * step
    while len(roots) < count:
        high = low + 0.2 * step
        if function(low) * function(high) < 0.0:
            roots.append(float(brentq(function, low, high, xtol=1e-15, rtol=1e-14)))
        low = high
    return roots


class Uniform:
    """A constant strain, the same in both bodies of one law: ``u = gradient x``."""

    def __init__(self, E: float, nu: float, gradient: Array) -> None:
        self.gradient = np.asarray(gradient, dtype=float)
        lam, mu = lame(E, nu)
        strain = 0.5 * (self.gradient + self.gradient.T)
        self.stress = lam * np.trace(strain) * np.eye(3) + 2.0 * mu * strain
        self.density = 0.5 * float((self.stress * strain).sum())

    def displacement(self, x: Array, body: int) -> Array:
        """Return the displacement."""
        return x @ self.gradient.T

    def traction(self, x: Array) -> Array:
        """Return the traction of the rod on its surface."""
        return polar(x)[1] @ self.stress
