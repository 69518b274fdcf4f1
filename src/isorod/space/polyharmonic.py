"""Polyharmonic functions of the section: ``T_i`` and, for ``0 < k < K``, ``(1 - s) P_{k-1}(s) W_m``, ``s = |xi|^2``.

The first are the harmonic functions of the paper.  By Almansi's theorem ``(1 - s)^k T_i``, ``k < K``, spans the
polyharmonic functions of order ``K``, and displacements of an elastic body without body force are biharmonic.  The
functions here span the same, but are better conditioned: ``W_m`` is the discrete Fourier wave of order ``m`` over the
``T_i``, and ``P_{k-1}`` the Jacobi polynomial ``P^{(1, m)}_{k-1}(2 s - 1)``.  With the continuous wave ``r^m exp(i m
theta)`` in place of ``W_m`` the gradients of all of them are orthogonal on the disk, to each other and to every
harmonic function (those with another radial factor, the same for all waves, are not: a wave of high order is
concentrated near the circle, where all factors are alike, and the condition number explodes). All but the ``T_i``
vanish on the circle.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import ceil, sqrt
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array
from isorod.errors import InputError, whole_number
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule
from isorod.geometry.section import refine
from isorod.space.basis import family_of

MAX_ORDER = 6

# Radial points needed near the circle, over the root of the number of control points, and the number above which.
_NEAR, _FEW = 0.87, 32


@cache
def _waves(n: int) -> tuple[Array, Array]:
    """Return the orthonormal real Fourier matrix ``(n, n)``, a wave a column, and the order of each wave."""
    angle = 2.0 * np.pi * np.arange(n) / n
    columns = [(m, wave(m * angle)) for m in range(n // 2 + 1) for wave in (np.cos, np.sin)]
    # The sines of order 0 and n / 2 are zero.
    columns = [(m, column) for m, column in columns if np.abs(column).max() > 1e-6]
    matrix = np.stack([column for _, column in columns], axis=1)
    return matrix / np.linalg.norm(matrix, axis=0), np.array([float(m) for m, _ in columns])


def _radial(k: int, m: Array, s: Array) -> tuple[Array, Array]:
    """Return ``(1 - s) P^{(1, m)}_{k-1}(2 s - 1)`` and its derivative by ``s``, shape ``(len(s), len(m))``."""
    # Imported late: functions of order 1 and polynomials do not need it.
    from scipy.special import eval_jacobi

    x = (2.0 * s - 1.0)[:, None]
    value = eval_jacobi(k - 1, 1.0, m, x)
    slope = (k + 1.0 + m) * eval_jacobi(k - 2, 2.0, m + 1.0, x) if k > 1 else 0.0
    rest = (1.0 - s)[:, None]
    return rest * value, rest * slope - value


def zernike(xi: ArrayLike, waves: Sequence[tuple[int, int]]) -> Array:
    """Return Zernike polynomials at disk points, cosine and sine of each wave ``(m, k)``, of degree ``m + 2 k``."""
    x, y = np.asarray(xi, dtype=float).reshape(-1, 2).T
    s, result = x * x + y * y, []
    for m, k in waves:
        wave = (x + 1j * y) ** m
        if k:
            from scipy.special import eval_jacobi

            wave = wave * eval_jacobi(k, 0.0, float(m), 2.0 * s - 1.0)
        result += [wave.real, wave.imag] if m else [wave.real]
    return np.stack(result, axis=1)


@dataclass(frozen=True)
class Polyharmonic:
    """Function ``i`` is ``T_i``, function ``k n + j`` the ``j``-th wave's of that ``k``; ``T_i`` are of control points.

    Parameters
    ----------
    n
        Number of control points round the section, at least 3.
    order
        Polyharmonic order ``K``, 1 to 6.
    turn
        Angle of the first control point, radians.

    Raises
    ------
    InputError
        If the order is out of range.
    """

    n: int
    order: int = 1
    turn: float = 0.0

    on_surface: ClassVar[bool] = True

    def __post_init__(self) -> None:
        whole_number("polyharmonic order", self.order, 1, MAX_ORDER)

    def __str__(self) -> str:
        return f"{self.family}, order {self.order} of {self.n} control points"

    @property
    def family(self) -> str:
        """The family of elements that they make."""
        return family_of(self.order)

    @property
    def count(self) -> int:
        """Number of functions, ``K n``."""
        return self.order * self.n

    @property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a function is of a control point, shape ``(K n,)``."""
        return np.arange(self.count) < self.n

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(m, K n)`` and gradients ``(m, K n, 2)`` at points of the closed disk ``(m, 2)``."""
        points = np.asarray(xi, dtype=float).reshape(-1, 2)
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        back = np.array([[cos, -sin], [sin, cos]])
        harmonic, slopes = harmonic_functions(self.n, points @ back if self.turn else points)
        if self.turn:
            slopes = slopes @ back.T
        if self.order == 1:
            return harmonic, slopes
        matrix, orders = _waves(self.n)
        waves = harmonic @ matrix
        wave_slopes = np.einsum("qib,ij->qjb", slopes, matrix)
        s = np.sum(points**2, axis=1)
        values, gradients = [harmonic], [slopes]
        for k in range(1, self.order):
            radial, derivative = _radial(k, orders, s)
            values.append(radial * waves)
            gradients.append(
                radial[..., None] * wave_slopes + (2.0 * derivative * waves)[..., None] * points[:, None, :]
            )
        return np.concatenate(values, axis=1), np.concatenate(gradients, axis=1)

    def positions(self, polygons: Array) -> Array:
        """Return control points of layers ``(layers, m, 3)``, ``n`` a multiple of ``m``, and zero for other ``k``."""
        result = np.zeros((polygons.shape[0], self.count, 3))
        result[:, : self.n] = refine(polygons.swapaxes(0, 1), self.n // polygons.shape[1]).swapaxes(0, 1)
        return result

    def auto(self, degree: int) -> Rule:
        """Return ``(K + 2) x 2 x (p + 1)``, measured on spring and blade for K = 1 ... 3, n = 8 ... 32, p = 2 ... 5.

        Fewer points leave spurious modes (K + 1 radial ones with K = 1) or cost accuracy.  The functions of more than
        32 points are concentrated near the circle, where the density of Gauss points is of second order in their
        number: ``0.87 sqrt(n)`` radial ones integrate the energy of each to 4 %.
        """
        return Rule(self._radial_points(2), 2, degree + 1)

    def full(self, degree: int) -> Rule:
        """Return `Rule.full`: its error on the blade's fifth frequency, the most sensitive, is 4e-5 for K = 1 ... 6."""
        return Rule.full(self.n, degree, self._radial_points(3))

    def _radial_points(self, more: int) -> int:
        """Return the radial points of a rule with ``more`` than the order, and those needed near the circle."""
        near = ceil(_NEAR * sqrt(self.n)) + more - 2 if self.n > _FEW else 0
        return max(self.order + more, near)

    @cached_property
    def _pressure_waves(self) -> list[tuple[int, int]]:
        """Waves round the section and radial degrees of the functions of pressures, by their degree as polynomials."""
        if self.n < 4:
            raise InputError(f"section points: got {self.n}, the mixed formulation needs at least 4")
        most = (self.n - 1) // 2
        degree = min(self.order, most)
        pairs = [(m, k) for k in range(self.order - 1) for m in range(most - k)]
        pairs += [(m, k) for m in range(degree + 1) for k in range((degree - m) // 2 + 1)]
        return sorted(set(pairs), key=lambda pair: (pair[0] + 2 * pair[1], pair))

    @property
    def pressure_count(self) -> int:
        """Number of section functions of pressures, `pressures`."""
        return sum(2 if m else 1 for m, _ in self._pressure_waves)

    def pressures(self, xi: ArrayLike) -> Array:
        """Return Zernike polynomials of the disk, those of wave ``m`` and degree ``m + 2 k``.

        They are those of ``k < K - 1`` and ``m + k`` less than ``(n - 1) / 2``, the waves of ``n`` points, and all of
        degree ``K``, or ``(n - 1) / 2`` if that is less.  In the plane each is the divergence of
        displacements of the next wave, as large as its gradient: ``U = z^(m + 1) / (m + 1)`` of ``z^m``.
        """
        return zernike(xi, self._pressure_waves)
