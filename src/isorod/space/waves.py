"""Waves round a section times polynomials of the disk's radius, piecewise in its rings.

They are complete in a section of any shape, with a hole or in layers, where polynomials of its coordinates and of the
radius (`isorod.space.ringed`) converge slowly if it is far from round: a hollow airfoil's shear stiffness is off by 2 %
with polynomials of degree 12, by 0.1 % with 32 waves times degree 10.  In return there are many of them.
"""

from math import ceil, pi

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule, ring_of, section_points
from isorod.space.ringed import orthogonalised


class Waves:
    """The coordinates of a section, and ``cos m theta`` and ``sin m theta`` times functions of the radius.

    Of these each edge of a ring has one that falls to zero linearly up to the next edges, and each ring integrals of
    Legendre polynomials that are zero at its edges (the hierarchic functions of B. Szabo & I. Babuska, Finite Element
    Analysis, 1991); at the centre of a section without a hole all are zero.  The first functions are 1 and the two
    coordinates, and the gradients of all are orthogonal over the section.

    Parameters
    ----------
    outline
        Control points of the section, shape ``(n, 2)``.
    rings
        Radii of its rings on the disk (`isorod.geometry.rod.Rod.rings`).
    waves
        The highest ``m``.
    degree
        Of the polynomials of the radius.
    """

    def __init__(self, outline: Array, rings: tuple[float, ...], waves: int, degree: int) -> None:
        self._outline, self._rings, self._waves, self._degree = outline, rings, waves, degree
        xi, area = section_points(len(outline), self.rule, rings=rings)
        turn = np.einsum("qib,ia->qba", harmonic_functions(len(outline), xi)[1], outline)
        self._mix, self._taken = orthogonalised(*self._candidates(xi), turn, area)

    @property
    def rule(self) -> Rule:
        """Points for products of these functions."""
        # In a slice the square of a wave runs through 4 pi m / n.
        return Rule(self._degree + 4, min(64, 4 + ceil(2.0 * pi * self._waves / len(self._outline))), 1)

    @property
    def count(self) -> int:
        """Number of functions."""
        return self._taken.size

    @property
    def is_carrier(self) -> NDArray[np.bool_]:
        """Whether a function is a carrier: the first alone is, shape ``(count,)``."""
        return np.arange(self.count) == 0

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(q, count)`` and gradients ``(q, count, 2)`` at disk points ``(q, 2)`` off the centre."""
        values, gradients = self._candidates(np.asarray(xi, dtype=float).reshape(-1, 2))
        mixed = np.swapaxes(gradients[:, self._taken], 1, 2) @ self._mix
        return values[:, self._taken] @ self._mix, np.swapaxes(mixed, 1, 2)

    def positions(self, polygons: Array) -> Array:
        """Return the coefficients ``(layers, count, 3)`` of affine images ``(layers, n, 3)`` of the outline."""
        plane = np.concatenate([np.ones((len(self._outline), 1)), self._outline], axis=1)
        result = np.zeros((len(polygons), self.count, 3))
        result[:, :3] = np.linalg.inv(self._mix[:3, :3]) @ (np.linalg.pinv(plane) @ polygons)
        return result

    def _candidates(self, xi: Array) -> tuple[Array, Array]:
        """Return values ``(q, c)`` and gradients ``(q, c, 2)`` of 1, coordinates and waves at disk points."""
        harmonic, slopes = harmonic_functions(len(self._outline), xi)
        radius, angle = np.hypot(*xi.T), np.arctan2(xi[:, 1], xi[:, 0])
        m = np.arange(self._waves + 1)
        cos, sin = np.cos(np.outer(angle, m)), np.sin(np.outer(angle, m))
        round_it = np.concatenate([cos, sin[:, 1:]], axis=1)
        turned = np.concatenate([-m * sin, (m * cos)[:, 1:]], axis=1) / radius[:, None]
        across, rise = self._radial(radius)

        def products(one: Array, other: Array) -> Array:
            return np.asarray((one[:, :, None] * other[:, None, :]).reshape(len(xi), -1))

        outward, around = products(rise, round_it), products(across, turned)
        c, s = xi.T[:, :, None] / radius[:, None]
        waves = np.stack([c * outward - s * around, s * outward + c * around], axis=2)
        place = np.concatenate([np.ones((len(xi), 1)), harmonic @ self._outline], axis=1)
        growth = np.zeros((len(xi), 3, 2))
        growth[:, 1:] = np.einsum("qib,ia->qab", slopes, self._outline)
        values = np.concatenate([place, products(across, round_it)], axis=1)
        return values, np.concatenate([growth, waves], axis=1)

    def _radial(self, radius: Array) -> tuple[Array, Array]:
        """Return the functions of the radius and their derivatives ``(q, f)``."""
        points = np.stack([radius, np.zeros(len(radius))], axis=1)
        ring, edges = ring_of(self._rings, points), np.array(self._rings)
        begin, width = edges[ring], np.diff(edges)[ring]
        t = (radius - begin) / width
        values, slopes = [], []
        for edge in range(1 if edges[0] == 0.0 else 0, len(edges)):
            before, behind = ring == edge - 1, ring == edge
            values.append(before * t + behind * (1.0 - t))
            slopes.append((before * 1.0 - behind) / width)
        for k in range(1, self._degree):
            polynomial = np.eye(k + 1)[k]
            whole = legendre.legval(2.0 * t - 1.0, legendre.legint(polynomial, lbnd=-1.0))
            slope = legendre.legval(2.0 * t - 1.0, polynomial) * 2.0 / width
            for r in range(len(edges) - 1):
                values.append(np.where(ring == r, whole, 0.0))
                slopes.append(np.where(ring == r, slope, 0.0))
        return np.stack(values, axis=1), np.stack(slopes, axis=1)
