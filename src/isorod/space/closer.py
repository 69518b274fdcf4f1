"""Local refinement at contact patches: elements and arcs grow with the distance from a patch."""

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

# Degree along the axis.
DEGREE = 3

# Growth of elements and arcs per distance from a patch.
_GROWTH = 1.0

# Least number of arcs round a section.
_FEWEST = 16


class Patch(NamedTuple):
    """A patch of contact on a surface.

    Attributes
    ----------
    u, angle
        Axis parameter and angle [rad] of its centre.
    along, around
        Half its length along the axis, and half its angle [rad] round the section.
    size
        Largest length of elements there; that of the rod for contact on a line along it.
    arc
        Largest length of arcs, if that differs; else 0.
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
    if not patches or min(min(patch[2:5]) for patch in patches) <= 0.0:
        raise InputError("patches: name one at least, with extents and a size that are positive")
    if rod.rings != WHOLE:
        raise InputError("patches: hollow and layered rods cannot be refined locally; use section_degree")
    # The elements of the rod without patches.
    rod_elements, least = rod.axis.elements, max(DEGREE, rod.axis.degree)
    lines = all(patch.size >= rod.arc_length.total for patch in patches)
    parts, degree, continuity, _ = choice.axis(rod, None, None if lines else least, None if lines else least - 1)
    refined = rod.refine(parts // rod_elements, degree, continuity)
    length, breaks = rod.arc_length, refined.axis.breaks
    middles = length(np.array([patch.u for patch in patches])).tolist()
    stretches = [(middle, patch.along, patch.size) for middle, patch in zip(middles, patches, strict=True)]
    ends, period = length(breaks), length.total if rod.closed else np.inf
    for k in range(breaks.size - 1):
        count = _evenly(ends[k + 1] - ends[k], stretches)
        cuts = np.cumsum(_cut(ends[k], ends[k + 1], count, stretches, period))[:-1] / count
        for fraction in cuts:
            refined = refined.insert(float(breaks[k] + fraction * (breaks[k + 1] - breaks[k])))
    basis = _section(rod, patches, choice.ORDER if lines else ORDER)
    return Space.paper(refined, continuity=continuity, quadrature="auto", order=1, section_basis=basis)


def _section(rod: Rod, patches: Sequence[Patch], order: int) -> Graded:
    """Return section functions of an order, with arcs that are the same along the rod."""
    n, radius = rod.section_points, float(rod.radii(rod.axis.breaks, 16)[1].max())
    arcs = [(patch.angle, patch.around, (patch.arc or patch.size) / radius) for patch in patches]
    arc = 2.0 * np.pi / n
    count = max(_evenly(arc, arcs), ceil(_FEWEST / n))
    if n * count > MAX_COUNT:
        raise InputError(f"patches: got a size for {n * count} points round the section, need {MAX_COUNT} at most")
    parts: list[int] = []
    for k in range(n):
        parts += _cut((k - 0.5) * arc, (k + 0.5) * arc, count, arcs, 2.0 * np.pi, 2.0 * np.pi / _FEWEST)
    return Graded(n, tuple(parts), order)


def _evenly(length: float, patches: Sequence[tuple[float, float, float]]) -> int:
    """Return the number of equal parts of a length short enough for all patches, a few times a power of two."""
    size = min(patch[2] for patch in patches)
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
    """Return a partition of ``count`` equal parts of an interval: the number of these in each of its parts.

    Parameters
    ----------
    patches
        Centre, half extent and target length of each.
    period
        Period of the coordinate.
    longest
        Largest length of a part.
    """
    allowed = longest
    for middle, reach, size in patches:
        distance = abs(0.5 * (low + high) - middle)
        distance = min(distance, abs(period - distance)) if np.isfinite(period) else distance
        beyond = max(0.0, distance - 0.5 * (high - low) - reach)
        allowed = min(allowed, size + _GROWTH * beyond)
    if count == 1 or high - low <= allowed * (1.0 + 1e-9):
        return [count]
    half = count // 2
    middle = low + (high - low) * half / count
    rest = patches, period, longest
    return _cut(low, middle, half, *rest) + _cut(middle, high, count - half, *rest)
