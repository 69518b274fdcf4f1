"""Spaces finer where something small presses on a surface: elements and arcs grow with the distance from there."""

from collections.abc import Sequence
from math import ceil, floor, log2
from typing import NamedTuple

import numpy as np

from isorod.errors import InputError
from isorod.geometry.disk import MAX_COUNT
from isorod.geometry.quadrature import WHOLE
from isorod.geometry.rod import Rod
from isorod.space import choice
from isorod.space.graded import ORDER, Graded
from isorod.space.space import Space

# Along the axis.
DEGREE = 3

# By how much of their distance from a patch elements and arcs may be longer.
_GROWTH = 1.0

# The longest arcs: so many make a circle.
_FEWEST = 16


class Patch(NamedTuple):
    """Where something presses on a surface.

    Attributes
    ----------
    u, angle
        Axis parameter and angle [rad] of its middle.
    along, around
        Half its length along the axis, and half the angle [rad] that it takes round the section.
    size
        Length that elements are to have there, at most; that of the rod where it presses on a line along it.
    arc
        The same of arcs, if that is another; else 0.
    """

    u: float
    angle: float
    along: float
    around: float
    size: float
    arc: float = 0.0


def closer(rod: Rod, patches: Sequence[Patch]) -> Space:
    """Return a space of a rod whose elements and arcs are as short as requested at patches, and longer elsewhere.

    Raises
    ------
    InputError
        If there is no patch, the rod has rings, or more arcs are needed than there may be.
    """
    if not patches or min(min(one[2:5]) for one in patches) <= 0.0:
        raise InputError("patches: name one at least, with extents and a size that are positive")
    if rod.rings != WHOLE:
        raise InputError("patches: hollow and layered rods cannot be refined locally; use section_degree")
    # Where there is no patch the rod is seen as it is without one.
    own, least = rod.axis.elements, max(DEGREE, rod.axis.degree)
    lines = all(one.size >= rod.arc_length.total for one in patches)
    parts, degree, continuity, _ = choice.axis(rod, None, None if lines else least, None if lines else least - 1)
    made = rod.refine(parts // own, degree, continuity)
    length, breaks = rod.arc_length, made.axis.breaks
    middles = length(np.array([one.u for one in patches])).tolist()
    stretches = [(middle, one.along, one.size) for middle, one in zip(middles, patches, strict=True)]
    ends, period = length(breaks), length.total if rod.closed else np.inf
    for k in range(breaks.size - 1):
        count = _evenly(ends[k + 1] - ends[k], stretches)
        cuts = np.cumsum(_cut(ends[k], ends[k + 1], count, stretches, period))[:-1] / count
        for share in cuts:
            made = made.insert(float(breaks[k] + share * (breaks[k + 1] - breaks[k])))
    basis = _section(rod, patches, choice.ORDER if lines else ORDER)
    return Space.paper(made, continuity=continuity, quadrature="auto", order=1, section_basis=basis)


def _section(rod: Rod, patches: Sequence[Patch], order: int) -> Graded:
    """Return section functions of an order, whose arcs are as many everywhere along the rod."""
    n, radius = rod.section_points, float(rod.radii(rod.axis.breaks, 16)[1].max())
    arcs = [(one.angle, one.around, (one.arc or one.size) / radius) for one in patches]
    whole = 2.0 * np.pi / n
    count = max(_evenly(whole, arcs), ceil(_FEWEST / n))
    if n * count > MAX_COUNT:
        raise InputError(f"patches: got a size for {n * count} points round the section, need {MAX_COUNT} at most")
    found: list[int] = []
    for k in range(n):
        found += _cut((k - 0.5) * whole, (k + 0.5) * whole, count, arcs, 2.0 * np.pi, 2.0 * np.pi / _FEWEST)
    return Graded(n, tuple(found), order)


def _evenly(length: float, patches: Sequence[tuple[float, float, float]]) -> int:
    """Return how many equal pieces of a length are as short as any patch wants, made of few by halving."""
    size = min(one[2] for one in patches)
    halvings = max(0, floor(log2(max(1.0, 0.5 * length / size))))
    return ceil(length / size / 2**halvings - 1e-9) * 2**halvings


def _cut(
    low: float,
    high: float,
    count: int,
    patches: Sequence[tuple[float, float, float]],
    period: float,
    longest: float = np.inf,
) -> list[int]:
    """Return how many of ``count`` equal pieces of a stretch each part of it takes.

    Parameters
    ----------
    patches
        Middle, half extent and length wanted of each.
    period
        After which places are the same.
    longest
        Length of a part at most.
    """
    allowed = longest
    for middle, reach, size in patches:
        way = abs(0.5 * (low + high) - middle)
        way = min(way, abs(period - way)) if np.isfinite(period) else way
        beyond = max(0.0, way - 0.5 * (high - low) - reach)
        allowed = min(allowed, size + _GROWTH * beyond)
    if count == 1 or high - low <= allowed * (1.0 + 1e-9):
        return [count]
    half = count // 2
    middle = low + (high - low) * half / count
    rest = patches, period, longest
    return _cut(low, middle, half, *rest) + _cut(middle, high, count - half, *rest)
