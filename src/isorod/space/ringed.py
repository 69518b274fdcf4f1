"""Functions of a section with a hole or in layers: polynomials of its coordinates, and even powers of the radius.

On the disk a section is cut in rings at radii ``r_j`` (`isorod.geometry.rod.Rod.rings`).  To the polynomials of the
section's coordinates ``X`` (`isorod.space.polynomial`) are added, for each inner edge of a ring, ``f_k(r) Re Z^m`` and
``f_k(r) Im Z^m``, ``Z = X_1 + i X_2``.  ``f_k`` is zero inside of the edge; outside of it, it is a polynomial of degree
``k`` that starts from zero, in ``r^-2`` and, where there is a ring inside, in ``r^2``.  So a displacement may have a
kink between two layers; and round a hole, about whose centre the plane elastic states
``r^(-m) exp(i m theta)`` and ``r^(2 - m) exp(i m theta)`` (J. H. Michell, On the direct determination of stress in an
elastic solid, Proc. London Math. Soc. 31 (1899) 100-124) have no Taylor series, each of them is such a product: Lame's
tube is exact.  Sections with a hole and sections in layers differ only in whether there is a ring inside of the
innermost edge.

The ``Re Z^m`` and ``Im Z^m`` are complete on every closed curve round the centre (J. L. Walsh, The approximation of
harmonic functions by harmonic polynomials and by harmonic rational functions, Bull. Amer. Math. Soc. 35 (1929)
499-544), so that all these functions converge with the degree in sections of any shape, more slowly where it is not
round.
"""

from functools import cached_property
from itertools import pairwise
from math import ceil, pi
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag, qr
from scipy.special import eval_jacobi

from isorod.arrays import Array, Index
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule, ring_of, section_points
from isorod.geometry.rod import Rod
from isorod.space.polynomial import Polynomials, fine_rule

# Least norm of a function's gradients of norm one, after orthogonalisation to all others, for it to be independent: in
# a round section the square of the radius is already a polynomial of the coordinates.  The error of an energy is the
# square of what is left out.
_NEW = 1e-5

# Least inf-sup value of a pressure: its product with the divergence of displacements in the plane of a section, where
# their strains and the pressure are of norm one.  In round sections it is 0.8 and more, or 0.
_DETERMINED = 0.4


class Ringed(Polynomials):
    """Polynomials of total degree ``N`` in a section's principal coordinates, and ring functions.

    Ring functions in ``r^2`` have ``2 k + m <= N``, those in ``r^-2`` one more.  The first functions are 1 and the two
    coordinates, and the gradients of all are orthogonal over the section.  A round section with a hole has
    ``(N + 1)^2``, as many as there are polynomials in both coordinates and the radius; dependent ones are left out.

    Parameters
    ----------
    rod
        The geometry, whose section has a hole, or layers.
    degree
        Total degree ``N``, 1 to 12.
    like
        As of `Polynomials`; of dependent functions the same are taken as there, else the most independent ones.

    Raises
    ------
    InputError
        If the degree is out of range, or the rod's sections are not affine images of each other.
    """

    most: ClassVar[int] = 12

    def __init__(self, rod: Rod, degree: int, like: "Ringed | None" = None) -> None:
        super().__init__(rod, degree, like)
        self._rings = rod.rings
        self._kinds = _kinds(rod.rings, degree, self.across)
        xi, area = self._fine_points()
        turn = np.einsum("qib,ic->qbc", harmonic_functions(rod.section_points, xi)[1], self._polygon)
        candidates, taken = self._candidates(xi, self._powers, self._kinds), None if like is None else like.taken
        self.taken: NDArray[np.intp]
        self._mix, self.taken = orthogonalised(*candidates, turn, area, taken)

    def __str__(self) -> str:
        return f"{super().__str__()} in rings {' '.join(f'{radius:g}' for radius in self._rings)}"

    def _fine_points(self) -> tuple[Array, Array]:
        """Return points of the disk and weights that distinguish all functions."""
        n = self._polygon.shape[0]
        rule = Rule(self._radial_points(1e-12), fine_rule(n, self.degree).angular, 1)
        return section_points(n, rule, rings=self._rings)

    @property
    def count(self) -> int:
        """Number of functions."""
        return self.taken.size

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(m, count)`` and gradients ``(m, count, 2)`` at disk points ``(m, 2)``, outside of a hole."""
        points = np.asarray(xi, dtype=float).reshape(-1, 2)
        values, gradients = self._candidates(points, self._powers, self._kinds)
        mixed = np.swapaxes(gradients[:, self.taken], 1, 2) @ self._mix
        return values[:, self.taken] @ self._mix, np.ascontiguousarray(np.swapaxes(mixed, 1, 2))

    def _candidates(self, xi: Array, exponents: Index, kinds: Index) -> tuple[Array, Array]:
        """Return values ``(q, c)`` and gradients ``(q, c, 2)`` of monomials, then of ring functions, at disk points.

        ``exponents`` ``(a, 2)`` are the former's, ``kinds`` ``(b, 5)`` the latter as of `_kinds`.
        """
        harmonic, slopes = harmonic_functions(self._polygon.shape[0], xi)
        place = harmonic @ self._polygon
        # d X_c / d xi_b
        turn = np.einsum("qib,ic->qbc", slopes, self._polygon)
        powers = place[:, None, :] ** np.arange(self.degree + 1)[:, None]
        by = np.concatenate([np.zeros_like(powers[:, :1]), powers[:, :-1]], axis=1)
        by = by * np.arange(self.degree + 1)[:, None]
        a, b = exponents.T
        smooth = powers[:, a, 0] * powers[:, b, 1]
        rise = np.stack([by[:, a, 0] * powers[:, b, 1], powers[:, a, 0] * by[:, b, 1]], axis=2)
        radius = np.hypot(xi[:, 0], xi[:, 1])
        edges, of, degrees, waves, sine = kinds.T
        z = place[:, 0] + 1j * place[:, 1]
        circles = z[:, None] ** np.arange(self.degree + 1)
        wave = circles[:, waves]
        wave_rise = waves * circles[:, np.maximum(waves - 1, 0)]
        grown = turn[:, :, 0] + 1j * turn[:, :, 1]
        value, slope = self._radial(radius, ring_of(self._rings, xi))
        value, slope = value[:, edges, of, degrees], slope[:, edges, of, degrees]
        # ``Re (-i z)`` is ``Im z``.
        turned = np.where(sine == 1, -1j, 1.0)
        outward = xi / np.where(radius > 0.0, radius, 1.0)[:, None]
        ringed = value * (wave * turned).real
        ring_rise = (value * turned * wave_rise)[:, :, None] * grown[:, None, :]
        ring_rise = ring_rise.real + (slope * (wave * turned).real)[:, :, None] * outward[:, None, :]
        return (
            np.concatenate([smooth, ringed], axis=1),
            np.concatenate([rise @ np.swapaxes(turn, 1, 2), ring_rise], axis=1),
        )

    def _radial(self, radius: Array, ring: Index) -> tuple[Array, Array]:
        """Return ``f_k`` of each edge and its derivative, shape ``(q, edges, 2, (N + 1) / 2 + 1)``.

        They are ``t P^(0,2)_{k-1}(2 t - 1)``, Jacobi polynomials that are orthogonal in ``t``, which grows from 0 at
        the edge to 1 at the outline and is linear in ``r^2``, or in ``r^-2``.
        """
        count = (self.degree + 1) // 2 + 1
        value, slope = (np.zeros((radius.size, len(self._rings) - 1, 2, count)) for _ in range(2))
        for j, edge in enumerate(self._rings[:-1]):
            beyond = ring >= j
            for of, power in enumerate((2.0, -2.0)) if edge > 0.0 else ():
                r = radius[beyond]
                t = (r**power - edge**power) / (1.0 - edge**power)
                grows = power * r ** (power - 1.0) / (1.0 - edge**power)
                for k in range(1, count):
                    jacobi = eval_jacobi(k - 1, 0.0, 2.0, 2.0 * t - 1.0)
                    rise = (k + 2.0) * eval_jacobi(k - 2, 1.0, 3.0, 2.0 * t - 1.0) if k > 1 else 0.0
                    value[beyond, j, of, k] = t * jacobi
                    slope[beyond, j, of, k] = (jacobi + t * rise) * grows
        return value, slope

    def auto(self, degree: int) -> Rule:
        """Return a rule whose error is at most 1e-4, with as many radial points as there are radial functions.

        With fewer, the highest radial functions of a thin ring are under-integrated: stresses err by 4 %.
        """
        return Rule(max(self._radial_points(1e-4), self.degree // 2 + self._falling + 1), self._around, degree + 1)

    def full(self, degree: int) -> Rule:
        """Return a rule whose error is small beside that of the functions, with points for the degree throughout."""
        return Rule(max(self._radial_points(1e-12), self.degree + 1), self._around + 2, degree + 2)

    def _radial_points(self, error: float) -> int:
        """Return the radial points that integrate products of two functions in each ring to a relative error.

        A Gauss rule's error decreases by ``rho^2`` per point where a function is analytic in the Bernstein ellipse of
        the ring of parameter ``rho``, times the largest value there; that is bounded by the highest and the lowest
        power of the radius in the products.
        """
        rho = np.exp(np.linspace(0.02, 6.0, 300))
        lowest = -4.0 * self._falling
        most = 1
        for inner, outer in pairwise(self._rings):
            middle, reach = 0.5 * (inner + outer), 0.25 * (outer - inner) * (rho + 1.0 / rho)
            # Up to the pole at the centre.
            inside = reach < middle if inner else reach > 0.0
            nearest = (middle - reach[inside]) / inner if inner else 1.0
            farthest = (middle + reach[inside]) / outer
            larger = np.maximum(farthest ** (2.0 * self.degree), nearest**lowest)
            most = max(most, ceil((np.log(larger / error) / (2.0 * np.log(rho[inside]))).min()))
        return min(64, most)

    @property
    def _falling(self) -> int:
        """Highest power of ``r^-2``."""
        return int(self._kinds[:, 2].max(initial=0))

    @cached_property
    def _around(self) -> int:
        """Angular points in a slice, over which the phase of the square of a polynomial changes by ``4 pi N / n``."""
        return max(3, round(2.0 * pi * self.degree / self._polygon.shape[0]))

    @cached_property
    def _pressure_mix(self) -> Array:
        """Matrix from candidates of pressures in each ring (`_alone`) to pressures, ring by ring, shape ``(c, count)``.

        Pressures are those candidates that the divergence of displacements in the plane of the section determines
        (`_DETERMINED`).  In round sections these are all but one per ring round a hole: ``r^-2`` is not the divergence
        of a power of ``r``.
        """
        xi, area = self._fine_points()
        turn = np.einsum("qib,ic->qbc", harmonic_functions(self._polygon.shape[0], xi)[1], self._polygon)
        weight = np.sqrt(area * np.abs(np.linalg.det(turn)))[:, None]
        alone = [weight * values for values in self._alone(xi)]
        mix = block_diag(*(_orthonormal(rows) for rows in alone))
        # By the coordinates in space, not relative to the section's extents; a constant has no slope.
        slopes = self.functions(xi)[1][:, 1:] @ np.swapaxes(np.linalg.inv(turn), 1, 2) / self._extents
        first, second = weight * slopes[:, :, 0], weight * slopes[:, :, 1]
        none = np.zeros_like(first)
        stretched, shear = np.hstack([first, second]), np.hstack([second, first]) * np.sqrt(0.5)
        strains = np.vstack([np.hstack([first, none]), np.hstack([none, second]), shear])
        sizes, motions = np.linalg.eigh(strains.T @ strains)
        # Without the rotation of the section.
        motions = motions[:, sizes > _NEW * sizes[-1]] / np.sqrt(sizes[sizes > _NEW * sizes[-1]])
        _, determined, right = np.linalg.svd((stretched @ motions).T @ np.hstack(alone) @ mix, full_matrices=False)
        return np.asarray(mix @ right[determined > _DETERMINED].T)

    def _alone(self, xi: Array) -> list[Array]:
        """Return candidates of each ring's pressures: functions of displacements of one degree less, in that ring.

        They are discontinuous between rings, so that pressures jump where laws do.
        """
        kinds, smooth = _kinds(self._rings, self.degree - 1, self.across - 1), len(self._pressure_powers)
        values, ring = self._candidates(xi, self._pressure_powers, kinds)[0], ring_of(self._rings, xi)
        columns = [np.append(np.ones(smooth, dtype=bool), kinds[:, 0] == r) for r in range(len(self._rings) - 1)]
        return [np.where(ring[:, None] == r, values[:, column], 0.0) for r, column in enumerate(columns)]

    @property
    def pressure_count(self) -> int:
        """Number of section functions of pressures, in all rings together."""
        return self._pressure_mix.shape[1]

    def pressures(self, xi: ArrayLike) -> Array:
        """Return values at disk points; where two rings meet the outer one's."""
        return np.hstack(self._alone(np.asarray(xi, dtype=float).reshape(-1, 2))) @ self._pressure_mix


def _orthonormal(rows: Array) -> Array:
    """Return the matrix ``(c, m)`` that makes columns ``(q, c)`` orthonormal; dependent columns are left out."""
    sizes = np.linalg.norm(rows, axis=0)
    _, triangle, order = qr(rows / sizes, mode="economic", pivoting=True)
    count = int(np.count_nonzero(np.abs(np.diag(triangle)) > _NEW))
    result = np.zeros((order.size, count))
    result[order[:count]] = np.linalg.inv(triangle[:count, :count]) / sizes[order[:count], None]
    return result


def _kinds(rings: tuple[float, ...], degree: int, across: int) -> Index:
    """Return ring functions up to a degree, and a degree in the thinner direction, shape ``(count, 5)``.

    Of each: its edge, whether it is a polynomial in ``r^2`` (0) or ``r^-2`` (1), its degree, its wave, and whether that
    is a sine.
    """
    kinds = [
        (j, of, k, m, part)
        for j, edge in enumerate(rings[:-1])
        if edge > 0.0
        for of, total in enumerate((degree, degree + 1))
        # Round a hole polynomials in r^-2 suffice: with those in r^2 there are a third more functions, without gain.
        if of or j
        for k in range(1, min(total, across + 1) // 2 + 1)
        for m in range(total - 2 * k + 1)
        for part in range(1 if m == 0 else 2)
    ]
    return np.array(kinds, dtype=np.int64).reshape(-1, 5)


def orthogonalised(
    values: Array, gradients: Array, turn: Array, area: Array, taken: "NDArray[np.intp] | None" = None
) -> tuple[Array, NDArray[np.intp]]:
    """Return the matrix to functions with orthonormal gradients over a section, and the candidates taken.

    The first three, 1 and the coordinates, stay first; the others have zero mean, and those with dependent gradients
    are left out.  Orthonormal values would not do: in a thin ring nearly equal functions may have different gradients.
    Gradients are by the section's coordinates, times its radius of gyration in them.

    Parameters
    ----------
    values, gradients
        Candidates at points of the disk, gradients by its coordinates, shapes ``(q, c)`` and ``(q, c, 2)``.
    turn
        Derivatives ``(q, 2, 2)`` of the section's coordinates (last) by the disk's.
    area
        Weights of the points on the disk, shape ``(q,)``.
    taken
        Candidates to take; by default independent ones.
    """
    weight = area * np.abs(np.linalg.det(turn))
    weight /= weight.sum()
    means = weight @ values
    radius = np.sqrt(weight @ np.square(values[:, 1:3] - means[1:3]).mean(axis=1))
    slopes = gradients[:, 1:] @ (np.swapaxes(np.linalg.inv(turn), 1, 2) * (radius * np.sqrt(weight))[:, None, None])
    slopes = np.vstack([*np.moveaxis(slopes, 2, 0)])
    taken = _independent(slopes) if taken is None else taken
    # candidates = functions @ factor
    factor = np.zeros((taken.size, taken.size))
    factor[0] = means[taken]
    factor[1:, 1:] = np.linalg.qr(slopes[:, taken[1:] - 1])[1]
    factor *= np.where(np.diag(factor) < 0.0, -1.0, 1.0)[:, None]
    return np.linalg.inv(factor), taken


def _independent(slopes: Array) -> NDArray[np.intp]:
    """Return the functions with independent gradients, columns of ``slopes`` without that of the first function."""
    frame = np.linalg.qr(slopes[:, :2])[0]
    rest = slopes[:, 2:] / np.linalg.norm(slopes[:, 2:], axis=0)
    # Orthogonalising twice is enough.
    for _ in range(2):
        rest = rest - frame @ (frame.T @ rest)
    _, triangle, order = qr(rest, mode="economic", pivoting=True)
    return np.concatenate([[0, 1, 2], 3 + order[np.abs(np.diag(triangle)) > _NEW]])
