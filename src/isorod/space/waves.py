"""Polynomials of a section's coordinates, and waves round it times polynomials of the disk's radius.

Polynomials alone suffice for solid sections without corners.  The waves are complete in a section of any shape, with a
hole or in layers: with a degree of 10 along the radius, 32 of them give the shear stiffness of a hollow airfoil to
0.1 %, where polynomials of the coordinates and of the radius (`isorod.space.ringed`) of degree 12 are off by 3 %.
"""

from math import ceil, pi

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpstrf

from isorod.arrays import Array, Index
from isorod.geometry.disk import harmonic_functions
from isorod.geometry.quadrature import Rule, ring_of, section_points
from isorod.geometry.rod import Rod
from isorod.space.polynomial import MAX_DEGREE, polynomials

# Least squared norm of a function's gradients of norm one, after orthogonalisation to all others, for it to be
# independent: in a round section all waves of low order are already polynomials of the coordinates.
_NEW = 1e-10


class Waves:
    """Polynomials of degree 8, and ``cos m theta`` and ``sin m theta`` times functions of the disk's radius.

    Functions of the radius are, for each edge of a ring, one that decreases linearly to zero at the next edges, and for
    each ring integrals of Legendre polynomials, zero at its edges (the hierarchic functions of B. Szabo and I. Babuska,
    Finite Element Analysis, 1991); at the centre of a section without a hole all are zero.  Products with dependent
    gradients are left out.

    Parameters
    ----------
    rod
        The geometry, of one section.
    waves
        The highest ``m``.
    degree
        Degree of the polynomials of the radius.
    """

    def __init__(self, rod: Rod, waves: int, degree: int) -> None:
        self._polynomials = polynomials(rod, MAX_DEGREE)
        self._rings, self._waves, self._radial = rod.rings, waves, degree
        self._taken: Index | slice = slice(None)
        xi, area = section_points(rod.section_points, self.rule, rings=rod.rings)
        gradients = self.functions(xi)[1][:, 1:]
        turn = np.einsum("qib,ic->qbc", harmonic_functions(rod.section_points, xi)[1], self._polynomials.polygon)
        root = np.sqrt(area * np.abs(np.linalg.det(turn)))
        slopes = gradients @ (np.swapaxes(np.linalg.inv(turn), 1, 2) * root[:, None, None])
        table = np.vstack([*np.moveaxis(slopes, 2, 0)])
        table /= np.linalg.norm(table, axis=0)
        products, smooth = table.T @ table, self._polynomials.count - 1
        mixed = products[:smooth, smooth:]
        rest = products[smooth:, smooth:] - mixed.T @ cho_solve(cho_factor(products[:smooth, :smooth]), mixed)
        _, order, rank, _ = dpstrf(rest, tol=_NEW)
        self._taken = np.sort(order[:rank] - 1)
        self.count: int = self._polynomials.count + rank

    @property
    def is_control_point(self) -> NDArray[np.bool_]:
        """Whether a function is of a control point: only the first is, shape ``(count,)``."""
        return np.arange(self.count) == 0

    @property
    def rule(self) -> Rule:
        """Points for products of these functions."""
        # The phase of the square of a wave changes by 4 pi m / n over a slice.
        around = ceil(2.0 * pi * max(self._waves, MAX_DEGREE) / len(self._polynomials.polygon))
        return Rule(self._radial + 4, min(64, 4 + around), 1)

    def positions(self, polygons: Array) -> Array:
        """Return the coefficients ``(layers, count, 3)`` of affine images ``(layers, n, 3)`` of the outline."""
        result = self._polynomials.positions(polygons)
        return np.concatenate([result, np.zeros((len(polygons), self.count - result.shape[1], 3))], axis=1)

    def functions(self, xi: ArrayLike) -> tuple[Array, Array]:
        """Return values ``(q, count)`` and gradients ``(q, count, 2)`` at disk points ``(q, 2)`` off the centre."""
        xi = np.asarray(xi, dtype=float).reshape(-1, 2)
        values, gradients = self._polynomials.functions(xi)
        radius, angle = np.hypot(*xi.T), np.arctan2(xi[:, 1], xi[:, 0])
        m = np.arange(self._waves + 1)
        cos, sin = np.cos(np.outer(angle, m)), np.sin(np.outer(angle, m))
        angular = np.concatenate([cos, sin[:, 1:]], axis=1)
        turned = np.concatenate([-m * sin, (m * cos)[:, 1:]], axis=1) / radius[:, None]
        across, rise = self._across(radius)

        def products(radial: Array, circular: Array) -> Array:
            return np.asarray((radial[:, :, None] * circular[:, None, :]).reshape(len(xi), -1)[:, self._taken])

        outward, around = products(rise, angular), products(across, turned)
        c, s = xi.T[:, :, None] / radius[:, None]
        waves = np.stack([c * outward - s * around, s * outward + c * around], axis=2)
        values = np.concatenate([values, products(across, angular)], axis=1)
        return values, np.concatenate([gradients, waves], axis=1)

    def _across(self, radius: Array) -> tuple[Array, Array]:
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
        for k in range(1, self._radial):
            polynomial = np.eye(k + 1)[k]
            integral = legendre.legval(2.0 * t - 1.0, legendre.legint(polynomial, lbnd=-1.0))
            slope = legendre.legval(2.0 * t - 1.0, polynomial) * 2.0 / width
            for r in range(len(edges) - 1):
                values.append(np.where(ring == r, integral, 0.0))
                slopes.append(np.where(ring == r, slope, 0.0))
        return np.stack(values, axis=1), np.stack(slopes, axis=1)
