"""How a rod is discretised where nothing is given: what suits its shape, by rules that were measured.

Across the section polynomials of the lowest degree whose torsion constant is right, or functions of control points
where polynomials do not suit; along the axis elements of degree 5, as many as the rod turns or is long, joined without
continuous slopes, so that stiffness may jump between any two, with as many points as their degree, so that slender ones
do not lock.
"""

from functools import lru_cache
from math import ceil, pi

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry.axis import MAX_DEGREE, Axis
from isorod.geometry.quadrature import WHOLE, Rule, section_points
from isorod.geometry.rod import Rod
from isorod.geometry.section import refinement_turn
from isorod.space.basis import SectionBasis
from isorod.space.polyharmonic import Polyharmonic
from isorod.space.polynomial import MAX_DEGREE as MAX_SECTION_DEGREE
from isorod.space.polynomial import polynomials

DEGREE = 5

# Angle, degrees, that an element may turn by, bent or twisted, and the least elements of a rod, by degree.  Measured on
# the spring, C0 and as many points as the degree: 90 degrees err by 7e-4 with degree 4, by 5e-6 with degree 5.  Four
# elements of degree 5 carry ten modes of the blade within 1.3e-3; a closed rod takes twice as many.
ANGLES = {1: 5.0, 2: 11.25, 3: 30.0, 4: 60.0, 5: 90.0, 6: 120.0}
ELEMENTS = {1: 64, 2: 32, 3: 12, 4: 6, 5: 4, 6: 3}

# A rod this many times as long as wide is not short: what happens at its ends does not make up most of it.
LONG = 3.0

# Share of the torsion constant that a section degree may miss; the least degree, that of a short rod, and the most.
WARPING = 2e-3
LEAST, LEAST_SHORT, MOST = 3, 5, 6

# Rods with a hole or in layers: exact for round ones under pressure from 2 on, in layers that bend from 5.
RINGED = 5

# Functions of control points, where sections are no affine images of each other or have petals: polyharmonic of this
# order, of this many points at least.
ORDER, POINTS = 2, 24

# Rods of more elements were cut so for their shape; points in an element at which its frame is looked at.
_MANY, _LOOKS = 1000, 7


def axis(rod: Rod, elements: int | None, degree: int | None, continuity: int | None) -> tuple[int, int, int]:
    """Return elements, degree and continuity, those that are None chosen.

    Elements that are given are joined as smoothly as they can be, chosen ones without continuous slopes.
    """
    own = rod.axis.elements
    if degree is None:
        degree = max(DEGREE, rod.axis.degree)
    if elements is not None:
        return elements, degree, degree - 1 if continuity is None else continuity
    # What is out of range is for the axis to refuse.
    known = min(max(int(degree), 1), MAX_DEGREE) if np.isfinite(degree) else DEGREE
    angle, _ = _shape(rod)
    least = ELEMENTS[known] * (1 + rod.closed)
    parts = max(ceil(np.degrees(angle) / ANGLES[known] - 0.1), ceil(least / own))
    return parts * own, degree, 0 if continuity is None else continuity


def section(rod: Rod, missed: float = WARPING) -> dict[str, int]:
    """Return the section functions as keyword arguments of `isorod.space.Space`: polynomials where these suit.

    ``missed`` is the share of the torsion constant that they may miss.
    """
    if rod.rings != WHOLE:
        return {"section_degree": RINGED}
    multiple = ceil(POINTS / rod.section_points)
    points = {"order": ORDER, "section_points": multiple * rod.section_points}
    try:
        best = _of_polynomials(rod, MAX_SECTION_DEGREE)
    except InputError:
        return points
    for degree in range(LEAST if _shape(rod)[1] > LONG else LEAST_SHORT, MOST + 1):
        constant = _of_polynomials(rod, degree)
        if constant <= (1.0 + missed) * best:
            return {"section_degree": degree}
    turn = refinement_turn(rod.section_points, multiple)
    harmonic = _torsion_constant(rod, Polyharmonic(points["section_points"], ORDER, turn))
    return points if harmonic * (1.0 + missed) < constant else {"section_degree": MOST}


def rule(basis: SectionBasis, axis: Axis) -> Rule:
    """Return the quadrature rule: ``auto``, but as many points as the degree along elements joined without slopes."""
    found, degree = basis.auto(axis.degree), axis.degree
    sharp = degree > 1 and (axis.multiplicities[1:-1] >= degree).all()
    return Rule(found.radial, found.angular, degree) if sharp else found


@lru_cache(maxsize=32)
def _of_polynomials(rod: Rod, degree: int) -> float:
    """Return the torsion constant of polynomials, kept for who asks again of the same rod."""
    return _torsion_constant(rod, polynomials(rod, degree))


def _torsion_constant(rod: Rod, basis: SectionBasis) -> float:
    """Return the torsion constant that section functions give the section half way along, its polar moment being 1.

    The warping function makes ``integral of |grad w + (-y, x)|^2`` least (Saint-Venant).
    """
    place, slopes, weights = _section(rod, rod.section_points)
    gradients = basis.functions(_points(rod.section_points)[0])[1] @ slopes
    turning = np.stack([-place[:, 1], place[:, 0]], axis=1)
    rows = gradients.swapaxes(1, 2).reshape(-1, basis.count)
    heavy = np.repeat(weights, 2)[:, None] * rows
    pushed = turning.ravel() @ heavy
    moved = np.linalg.lstsq(heavy.T @ rows, pushed, rcond=1e-12)[0]
    polar = float(weights @ (turning**2).sum(axis=1))
    return 1.0 - float(pushed @ moved) / polar


@lru_cache(maxsize=8)
def _points(n: int) -> tuple[Array, Array]:
    """Return points and weights on the disk that see products of the highest degree."""
    return section_points(n, Rule(MAX_SECTION_DEGREE, 1 + ceil(2.0 * pi * MAX_SECTION_DEGREE / n), 1))


def _section(rod: Rod, n: int) -> tuple[Array, Array, Array]:
    """Return, of the section half way along, places about its centroid, ``dxi/dX`` and weights at `_points`."""
    xi, area = _points(n)
    middle = 0.5 * (rod.axis.breaks[:-1] + rod.axis.breaks[1:])[rod.axis.elements // 2]
    position, jacobian = (found[0] for found in rod.grid(xi, [middle]))
    plane = np.linalg.svd(position - position.mean(axis=0), full_matrices=False)[2][:2]
    slopes = plane @ jacobian[:, :, :2]
    weights = area * np.abs(np.linalg.det(slopes))
    place = position @ plane.T
    return place - weights @ place / weights.sum(), np.linalg.inv(slopes), weights


def _shape(rod: Rod) -> tuple[float, float]:
    """Return the largest angle by which an element turns, bent or twisted, radians, and length over width."""
    breaks = rod.axis.breaks
    steps = (np.arange(_LOOKS) + 0.5) / _LOOKS
    count = min(rod.axis.elements, _MANY)
    u = (breaks[:-1, None] + np.diff(breaks)[:, None] * steps)[:count].ravel()
    ring = np.array([[np.cos(t), np.sin(t)] for t in 2.0 * np.pi * np.arange(8) / 8])
    position, jacobian = rod.grid([[0.0, 0.0], *ring], u)
    frames = np.linalg.qr(jacobian[:, 0, :, [2, 0, 1]].transpose(1, 2, 0))[0]
    # Columns that point as the derivatives do.
    frames = frames * np.sign(np.einsum("tab,bta->tb", frames, jacobian[:, 0, :, [2, 0, 1]]))[:, None, :]
    frames = frames.reshape(count, _LOOKS, 3, 3)
    traces = np.einsum("etab,etab->et", frames[:, 1:], frames[:, :-1])
    angles = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0)).sum(axis=1) * _LOOKS / (_LOOKS - 1)
    length = np.linalg.norm(np.diff(position[:, 0], axis=0), axis=1).sum() * _LOOKS * count / (_LOOKS * count - 1)
    width = 2.0 * np.linalg.norm(position[:, 1:] - position[:, :1], axis=2).max()
    return float(angles.max()), float(length / width) * rod.axis.elements / count
