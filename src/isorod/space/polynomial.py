"""Polynomials of the section's own coordinates, in place of functions of control points.

Where all sections of a rod are affine images of one, ``x = c(u) + A(u) X(xi)``, the coordinates ``X = (X_1, X_2)`` of
that section are functions on the disk, and so are their polynomials: a Taylor expansion across the rod, as higher-order
beam theories use it (Carrera, Cinefra, Petrolo & Zappino, Finite Element Analysis of Structures through Unified
Formulation, 2014).  Displacements of a slender body are smooth across it, so that ten polynomials replace a
hundred functions of control points; they do not resolve a corner, a point load or a contact patch.
"""

from functools import cached_property, lru_cache
from math import ceil, pi
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array, Index
from isorod.errors import InputError, representable, whole_number
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule, section_points
from isorod.geometry.rod import Rod
from isorod.space.basis import POLYNOMIALS, monomials

MAX_DEGREE = 8

# Largest distance of layers from affine images of the widest, relative to its size.
_TOLERANCE = 1e-9

# Principal directions are undetermined where moments of inertia differ by less than this, relative.
_ROUND = 1e-9

# Least thickness over width of a section.
_FLAT = 1e-12

# Number of cached tables of functions, and their largest size.
_KEPT, _KEPT_SIZE = 4, 20_000

# Half the range of an orthonormal linear function over a round section.
_REACH = 2.0


class Polynomials:
    """Polynomials of total degree ``N`` in the principal coordinates of a rod's section.

    The first function is 1, the others are orthogonal to it and to each other over the section.  In the thinner
    direction the degree is limited to ``max(2, N t)``, ``t`` the ratio of the section's extents but at least one half:
    bending strains the thickness quadratically, and terms of higher degree there are small.

    Parameters
    ----------
    rod
        The geometry.
    degree
        Total degree ``N``, 1 to 8.
    like
        Polynomials of a similar rod, whose layer and directions are used in place of its own.

    Attributes
    ----------
    across
        Degree in the thinner direction.
    layer
        The layer of control points whose section defines the coordinates: the widest.

    Raises
    ------
    InputError
        If the degree is out of range, or the rod's sections are not affine images of each other.
    """

    family: ClassVar[str] = POLYNOMIALS
    on_surface: ClassVar[bool] = False
    most: ClassVar[int] = MAX_DEGREE

    def __init__(self, rod: Rod, degree: int, like: "Polynomials | None" = None) -> None:
        self._kept: dict[bytes, tuple[Array, Array]] = {}
        self.degree = degree = whole_number("section degree", degree, 1, self.most)
        points = rod.control_points
        arms = points - points.mean(axis=1, keepdims=True)
        representable("section's extent", float(np.abs(arms).max()))
        self.layer: int = int(np.argmax(np.einsum("jia,jia->j", arms, arms))) if like is None else like.layer
        widest = arms[self.layer]
        images, sizes, directions = np.linalg.svd(widest, full_matrices=False)
        if not sizes[1] > _FLAT * sizes[0]:
            raise InputError("section degree: the rod's sections have no area; polynomials need some")
        self._polygon = widest @ directions[:2].T
        onto = images[:, :2]
        gap = arms - onto @ (onto.T @ arms)
        worst = int(np.argmax(np.abs(gap).max(axis=(1, 2))))
        if not np.abs(gap[worst]).max() <= _TOLERANCE * sizes[0]:
            raise InputError(
                f"section degree: layer {worst} of the rod's control points is not an affine image of the others; "
                "polynomials need sections of one shape"
            )
        area, values, first, second = _points(rod.section_points, degree, rod.rings)
        self._polygon, self._extents, fractions = _principal_frame(self._polygon, area, values, first, second)
        if like is not None:
            # The rotation or reflection of the principal frame nearest to theirs.
            across = self.frame
            left, _, right = np.linalg.svd(across.T @ like.frame)
            turned = across @ left @ right
            self._extents = 0.5 * np.ptp(values @ turned, axis=0)
            self._polygon = turned / self._extents
        self.across = max(2, ceil(degree * max(0.5, _roundness(arms)) - 1e-9))
        self._powers = monomials(degree, self.across)
        self._mix = _orthogonalised(self._values(values)[0] * np.sqrt(fractions))

    def __str__(self) -> str:
        return f"{self.family}, section degree {self.degree}"

    @property
    def count(self) -> int:
        """Number of functions."""
        return self._powers.shape[0]

    @property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a function is of a control point: only the first is, shape ``(count,)``."""
        return np.arange(self.count) == 0

    @property
    def frame(self) -> Array:
        """Control points of the section by its own directions, units of length, ``(n, 2)``."""
        return self._polygon * self._extents

    @property
    def polygon(self) -> Array:
        """Control points of the section in its own coordinates: principal ones from its centroid, ``(n, 2)``."""
        return self._polygon

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(m, count)`` and gradients ``(m, count, 2)`` at disk points ``(m, 2)``, read-only."""
        points = np.ascontiguousarray(xi, dtype=float).reshape(-1, 2)
        if self.count * points.shape[0] > _KEPT_SIZE:
            return self._functions(points)
        key = points.tobytes()
        if key not in self._kept:
            while len(self._kept) >= _KEPT:
                self._kept.pop(next(iter(self._kept)))
            self._kept[key] = self._functions(points)
            for array in self._kept[key]:
                array.flags.writeable = False
        return self._kept[key]

    def _functions(self, xi: Array) -> tuple[Array, Array]:
        """Do `functions`, without the cache."""
        harmonic, slopes = harmonic_functions(self._polygon.shape[0], xi)
        values, (first, second) = self._values(harmonic)
        a, b = self._powers.T
        by_first = self._mix.T @ (a[:, None] * first[np.maximum(a - 1, 0)] * second[b])
        by_second = self._mix.T @ (b[:, None] * first[a] * second[np.maximum(b - 1, 0)])
        gradients = np.empty((harmonic.shape[0], self.count, 2))
        for k in range(2):
            # Derivatives of the section's coordinates by one of the disk's.
            turn = self._polygon.T @ slopes[:, :, k].T
            gradients[:, :, k] = (by_first * turn[0] + by_second * turn[1]).T
        return values.T @ self._mix, gradients

    def _values(self, harmonic: Array) -> tuple[Array, Array]:
        """Return monomials ``(count, m)`` and both coordinates' powers where harmonic functions are ``(m, n)``."""
        return self._monomials(self._polygon.T @ harmonic.T)

    def _monomials(self, place: Array) -> tuple[Array, Array]:
        """Return monomials ``(count, m)`` and both coordinates' powers at places ``(2, m)``."""
        powers = np.ones((2, self._powers.max() + 1, place.shape[1]))
        for k in range(1, powers.shape[1]):
            powers[:, k] = powers[:, k - 1] * place
        return powers[0, self._powers[:, 0]] * powers[1, self._powers[:, 1]], powers

    def positions(self, polygons: Array) -> Array:
        """Return the coefficients ``(layers, count, 3)`` of layers of the rod's control points ``(layers, n, 3)``."""
        plane = np.concatenate([np.ones((self._polygon.shape[0], 1)), self._polygon], axis=1)
        affine = np.linalg.solve(plane.T @ plane, plane.T @ polygons)
        linear = np.flatnonzero(self._powers.sum(axis=1) <= 1)
        order = [0, *(1 if self._powers[k, 0] else 2 for k in linear[1:])]
        result = np.zeros((polygons.shape[0], self.count, 3))
        # monomials = functions @ inverse(mix); those of degree 0 and 1 come first.
        result[:, :3] = np.linalg.inv(self._mix[:3, :3]) @ affine[:, order]
        return result

    def auto(self, degree: int) -> Rule:
        """Return ``max(3, N) x S x (p + 1)``, S = 1 for N <= 3, 2 for N = 4, 3 above.

        On the blade its error is 8e-4, 2e-4 and 1e-5 where the next N changes 3e-3, 1e-3 and 1e-4.
        """
        around = 1 if self.degree <= 3 else 2 if self.degree == 4 else 3
        # The phase of the square of a polynomial changes by 4 pi N / n over a slice.
        around = max(around, round(2.0 * pi * self.degree / self._polygon.shape[0]))
        return Rule(max(3, self.degree), around, degree + 1)

    def full(self, degree: int) -> Rule:
        """Return `Rule.full`, with radial points for the degree."""
        return Rule.full(self._polygon.shape[0], degree, self.degree + 2)

    @cached_property
    def _pressure_powers(self) -> Index:
        """Exponents of the polynomials whose products with a coordinate are among these functions."""
        if self.degree == 1:
            raise InputError("section degree: got 1, the mixed formulation needs at least 2")
        return monomials(self.degree - 1, int(self._powers[:, 1].max()) - 1)

    @property
    def pressure_count(self) -> int:
        """Number of section functions of pressures: polynomials of one degree less."""
        return len(self._pressure_powers)

    def pressures(self, xi: ArrayLike) -> Array:
        """Return products of Legendre polynomials of the section's own coordinates, about -1 to 1."""
        powers, place = self._pressure_powers, self.functions(xi)[0][:, 1:3] / _REACH
        tables = [np.polynomial.legendre.legvander(place[:, k], int(powers.max())) for k in range(2)]
        return np.ascontiguousarray(tables[0][:, powers[:, 0]] * tables[1][:, powers[:, 1]])


def fine_rule(n: int, degree: int) -> Rule:
    """Return a rule for moments of a section of ``n`` arcs, and products of polynomials on it."""
    return Rule(degree + 4, 4 + ceil(2.0 * pi * degree / n), 1)


@lru_cache(maxsize=16, typed=True)
def polynomials(rod: Rod, degree: int) -> Polynomials:
    """Return the polynomials of a rod, cached for refinements and error estimates."""
    return Polynomials(rod, degree)


@lru_cache(maxsize=8)
def _points(n: int, degree: int, rings: tuple[float, ...]) -> tuple[Array, Array, Array, Array]:
    """Return weights ``(m,)`` of points of the rings, and the harmonic functions' values and slopes ``(m, n)``."""
    xi, area = section_points(n, fine_rule(n, degree), rings=rings)
    values, gradients = harmonic_functions(n, xi)
    return (
        area.copy(),
        values.copy(),
        np.ascontiguousarray(gradients[:, :, 0]),
        np.ascontiguousarray(gradients[:, :, 1]),
    )


def _principal_frame(
    polygon: Array, area: Array, values: Array, first: Array, second: Array
) -> tuple[Array, Array, Array]:
    """Return a section's polygon in principal coordinates over half the extents, these, and fractions of the area.

    Parameters
    ----------
    polygon
        Control points, shape ``(n, 2)``.
    area
        Weights of points of the disk, shape ``(m,)``.
    values, first, second
        The harmonic functions and their derivatives there, shape ``(m, n)``.
    """
    a, b = first @ polygon, second @ polygon
    fractions = area * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    fractions /= fractions.sum()
    place = values @ polygon
    centroid = fractions @ place
    place -= centroid
    sizes, directions = np.linalg.eigh(place.T @ (fractions[:, None] * place))
    # The wider direction first, towards the first control point; with equal moments of inertia exactly to that point,
    # since round-off would determine the direction.
    arm = polygon[0] - centroid
    if sizes[1] - sizes[0] <= _ROUND * sizes[1]:
        x, y = arm / np.linalg.norm(arm)
    else:
        x, y = directions[:, 1] * np.copysign(1.0, arm @ directions[:, 1])
    axes = np.array([[x, -y], [y, x]])
    extents = 0.5 * np.ptp(place @ axes, axis=0)
    return (polygon - centroid) @ axes / extents, extents, fractions


def _roundness(arms: Array) -> float:
    """Return thickness over width of a section, the largest of layers of control points ``(layers, n, 3)``.

    Where an axis is bent, layers off its curve are wider than its sections.
    """
    sizes = np.linalg.svd(arms, compute_uv=False)
    return float((sizes[:, 1] / np.maximum(sizes[:, 0], np.finfo(float).tiny)).max())


def _orthogonalised(weighted: Array) -> Array:
    """Return the upper triangular matrix that orthogonalises functions of weighted values ``(count, m)``."""
    triangle = np.linalg.qr(weighted.T, mode="r")
    # The inverse of the triangular factor, made positive on the diagonal.
    return np.linalg.inv(triangle * np.sign(np.diag(triangle))[:, None])
