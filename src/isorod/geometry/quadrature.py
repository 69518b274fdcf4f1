"""Quadrature on disk x axis, written ``n x r x s x t`` (Lu & Zhou 2011, eq. 14).

The disk is cut in ``n`` slices, one an arc; each has ``r`` radial (in each of the rod's rings) and ``s`` angular Gauss
points, and each element ``t`` along the axis.  The paper's rule is ``r = 2, s = 1, t = p + 1``; it under-integrates,
and the published numbers depend on it.
"""

import re
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array, Index
from isorod.errors import InputError, whole_number
from isorod.geometry.axis import Axis

# Radii of the rings of a solid section: a single one.
WHOLE = (0.0, 1.0)

# Most points in one direction of a slice, or along an element.
MAX_POINTS = 64

# Largest depth of graded rings below the surface.
_DEEPEST = 0.7

# A point this near to the radius between two rings, relative, lies on it.
_ON_RADIUS = 1e-12


@dataclass(frozen=True)
class Rule:
    """Numbers of radial and angular Gauss points in a slice of a ring, and of Gauss points along an element."""

    radial: int
    angular: int
    axial: int

    def __post_init__(self) -> None:
        for name in ("radial", "angular", "axial"):
            whole_number(f"quadrature: {name} points", getattr(self, name), 1, MAX_POINTS)

    @classmethod
    def paper(cls, degree: int) -> "Rule":
        """Return the rule of the paper, ``2 x 1 x (p + 1)``."""
        return cls(2, 1, degree + 1)

    @classmethod
    def full(cls, section_points: int, degree: int, radial: int = 0) -> "Rule":
        """Return a rule of at least 6 radial points whose error is small, thin sections included.

        Measured on blade and spring: below 4e-5 and 3e-7 (p + 1 points along the axis: 4e-4 on the blade).
        """
        return cls(max(6, radial), 4 if section_points >= 8 else 6, degree + 2)

    @classmethod
    def parse(cls, text: str, degree: int) -> "Rule":
        """Return the rule a user names: ``paper``, ``RxSxT`` such as ``2x1x4``, or ``RxS`` with ``T = degree + 1``.

        ``auto`` and ``full`` are resolved by the section functions (`isorod.space.basis.SectionBasis`).
        """
        if text == "paper":
            return cls.paper(degree)
        numbers = re.fullmatch(r"(\d{1,3})x(\d{1,3})(?:x(\d{1,3}))?", text)
        if not numbers:
            raise InputError(
                f"quadrature: got {text!r}, need 'auto', 'paper', 'full' or RxSxT such as 2x1x4 (RxS: T = degree + 1)"
            )
        radial, angular, axial = numbers.groups()
        if int(radial) == 1:
            raise InputError(
                f"quadrature: got {text!r}; one radial point integrates half the bending stiffness, need 2 or more"
            )
        return cls(int(radial), int(angular), degree + 1 if axial is None else int(axial))

    def __str__(self) -> str:
        return f"{self.radial}x{self.angular}x{self.axial}"


@lru_cache(maxsize=32)
def section_points(n: int, rule: Rule, turn: float = 0.0, rings: tuple[float, ...] = WHOLE) -> tuple[Array, Array]:
    """Return points ``(rings n r s, 2)`` of the unit disk ring by ring, and weights; both are read-only.

    The slices are the arcs of ``n`` control points, the first at the angle ``turn``; the rings are between the radii
    given, and the weights add up to their area on the disk.
    """
    s, _ = _gauss(rule.angular)
    return _in_slices(
        turn + 2.0 * np.pi / n * (np.arange(n)[:, None] + s - 0.5), np.full(n, 2.0 * np.pi / n), rule, rings
    )


def graded_points(joints: Array, rule: Rule) -> tuple[Array, Array]:
    """Return points ``(q, 2)`` of the unit disk, in slices from each angle ``joints`` to the next, and weights.

    A harmonic function that varies over an arc decays within the width of the arc, and below that varies over lengths
    equal to the depth.  So a slice has rings of its own, the outermost to a depth of two of its widths and each next
    one to three times the depth of the last, with the rule's radial points in each.
    """
    s, _ = _gauss(rule.angular)
    points, weights = [], []
    for begin, width in zip(joints, np.diff(joints), strict=False):
        depths = [2.0 * width]
        while depths[-1] < _DEEPEST:
            depths.append(3.0 * depths[-1])
        del depths[-1]
        rings = (0.0, *(1.0 - depth for depth in reversed(depths)), 1.0)
        part = _in_slices(begin + width * s[None, :], np.array([width]), rule, rings)
        points.append(part[0])
        weights.append(part[1])
    return _kept(np.concatenate(points), np.concatenate(weights))


def _in_slices(theta: Array, widths: Array, rule: Rule, rings: tuple[float, ...]) -> tuple[Array, Array]:
    """Return points and weights of slices of so many radians, at angles ``(slices, s)``."""
    fraction, wr = _gauss(rule.radial)
    _, ws = _gauss(rule.angular)
    points, weights = [], []
    for inner, outer in pairwise(rings):
        r = inner + (outer - inner) * fraction
        angle = np.broadcast_to(theta[:, None, :], (len(widths), r.size, ws.size))
        radius = np.broadcast_to(r[None, :, None], angle.shape)
        points.append(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 2))
        area = widths[:, None, None] * (r * ((outer - inner) * wr))[:, None] * ws
        weights.append(area.ravel())
    return _kept(np.concatenate(points), np.concatenate(weights))


def _kept(points: Array, weights: Array) -> tuple[Array, Array]:
    """Return both, read-only."""
    for array in (points, weights):
        array.flags.writeable = False
    return points, weights


def circle_points(n: int, angular: int, radius: float, turn: float = 0.0) -> tuple[Array, Array]:
    """Return points ``(n s, 2)`` of a circle on the disk, and weights by the angle, whose sum is 2 pi."""
    s, ws = _gauss(angular)
    theta = (turn + 2.0 * np.pi / n * (np.arange(n)[:, None] + s - 0.5)).ravel()
    return radius * np.stack([np.cos(theta), np.sin(theta)], axis=1), np.tile(2.0 * np.pi / n * ws, n)


def ring_of(rings: tuple[float, ...], xi: ArrayLike) -> Index:
    """Return the ring of each disk point ``(q, 2)``; where two meet, the outer one."""
    points = np.asarray(xi, dtype=float)
    inner = np.array(rings[1:-1]) * (1.0 - _ON_RADIUS)
    return np.searchsorted(inner, np.hypot(points[:, 0], points[:, 1]), side="right")


def axis_points(axis: Axis, count: int) -> tuple[Array, Array]:
    """Return Gauss points and weights on every element of the axis, both of shape ``(elements, count)``."""
    s, w = _gauss(count)
    return axis.within(s), np.diff(axis.breaks)[:, None] * w


@cache
def _gauss(count: int) -> tuple[Array, Array]:
    """Return the Gauss rule on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * w
