"""Quadrature on disk x axis, written ``n x r x s x t`` (Lu & Zhou 2011, eq. 14).

The disk is cut in ``n`` slices, one an arc; each has ``r`` radial and ``s`` angular Gauss points, and each element
``t`` along the axis.  The paper's rule is ``r = 2, s = 1, t = p + 1``; it under-integrates, and the published numbers
depend on it.
"""

import re
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError, whole_number
from isorod.geometry.axis import Axis


@dataclass(frozen=True)
class Rule:
    """Numbers of radial and angular Gauss points in a slice of the disk, and of Gauss points along an element."""

    radial: int
    angular: int
    axial: int

    def __post_init__(self) -> None:
        for name in ("radial", "angular", "axial"):
            whole_number(f"quadrature: {name} points", getattr(self, name), 1, 64)

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

        ``auto`` and ``full`` are for the section functions to say (`isorod.space.basis.SectionBasis`).
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
                f"quadrature: got {text!r}; one radial point sees half of the bending stiffness, need 2 or more"
            )
        return cls(int(radial), int(angular), degree + 1 if axial is None else int(axial))

    def __str__(self) -> str:
        return f"{self.radial}x{self.angular}x{self.axial}"


@lru_cache(maxsize=32)
def section_points(n: int, rule: Rule, turn: float = 0.0) -> tuple[Array, Array]:
    """Return points ``(n r s, 2)`` and weights ``(n r s,)``, whose sum is pi, on the unit disk, not to be written to.

    The slices are the arcs of ``n`` control points of which the first stands at the angle ``turn``.
    """
    r, wr = _gauss(rule.radial)
    s, ws = _gauss(rule.angular)
    theta = turn + 2.0 * np.pi / n * (np.arange(n)[:, None] + s - 0.5)
    radius = np.broadcast_to(r[None, :, None], (n, r.size, s.size))
    angle = np.broadcast_to(theta[:, None, :], radius.shape)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    weights = np.broadcast_to(2.0 * np.pi / n * (r * wr)[:, None] * ws, radius.shape)
    found = points.reshape(-1, 2), weights.reshape(-1).copy()
    for array in found:
        array.flags.writeable = False
    return found


def axis_points(axis: Axis, count: int) -> tuple[Array, Array]:
    """Return Gauss points and weights on every element of the axis, both of shape ``(elements, count)``."""
    s, w = _gauss(count)
    length = np.diff(axis.breaks)[:, None]
    return axis.breaks[:-1, None] + length * s, length * w


@cache
def _gauss(count: int) -> tuple[Array, Array]:
    """Return the Gauss rule on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * w
