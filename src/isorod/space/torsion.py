"""Saint-Venant's torsion of the section halfway along a rod, a measure of the accuracy of section functions."""

from functools import lru_cache
from math import ceil, pi

import numpy as np

from isorod.arrays import Array
from isorod.geometry.quadrature import WHOLE, Rule, section_points
from isorod.geometry.rod import Rod
from isorod.space.basis import SectionBasis
from isorod.space.polynomial import MAX_DEGREE, polynomials

# Degree of the reference solution for rods with a hole or in layers.
MAX_RINGED = 12


@lru_cache(maxsize=32)
def of_polynomials(rod: Rod, degree: int) -> tuple[float, Array]:
    """Return `torsion` of polynomials, cached."""
    return torsion(rod, polynomials(rod, degree))


def torsion(rod: Rod, basis: SectionBasis) -> tuple[float, Array]:
    """Return the torsion constant of the section halfway along a rod by section functions, over its polar moment.

    Then the stresses there ``(q, 2)`` for unit twist and shear modulus.  The warping function minimises ``integral of
    |grad w + (-y, x)|^2`` (Saint-Venant).
    """
    place, slopes, weights = _section(rod)
    gradients = basis.functions(_points(rod.section_points, rod.rings)[0])[1] @ slopes
    turning = np.stack([-place[:, 1], place[:, 0]], axis=1)
    rows = gradients.swapaxes(1, 2).reshape(-1, basis.count)
    heavy = np.repeat(weights, 2)[:, None] * rows
    pushed = turning.ravel() @ heavy
    moved = np.linalg.lstsq(heavy.T @ rows, pushed, rcond=1e-12)[0]
    polar = float(weights @ (turning**2).sum(axis=1))
    return 1.0 - float(pushed @ moved) / polar, turning - (rows @ moved).reshape(turning.shape)


@lru_cache(maxsize=8)
def _points(n: int, rings: tuple[float, ...]) -> tuple[Array, Array]:
    """Return points and weights on the disk for products of the highest degree."""
    degree = MAX_DEGREE if rings == WHOLE else MAX_RINGED
    return section_points(n, Rule(degree, 1 + ceil(2.0 * pi * degree / n), 1), rings=rings)


def _section(rod: Rod) -> tuple[Array, Array, Array]:
    """Return, of the section halfway along, positions relative to its centroid, ``dxi/dX`` and weights at `_points`."""
    xi, area = _points(rod.section_points, rod.rings)
    middle = 0.5 * (rod.axis.breaks[:-1] + rod.axis.breaks[1:])[rod.axis.elements // 2]
    position, jacobian = (grid[0] for grid in rod.grid(xi, [middle]))
    plane = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)[2][:2]
    slopes = plane @ jacobian[:, :, :2]
    weights = area * np.abs(np.linalg.det(slopes))
    place = position @ plane.T
    return place - weights @ place / weights.sum(), np.linalg.inv(slopes), weights
