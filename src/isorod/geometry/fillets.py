"""Straight lines from point to point with a fillet at each corner: exact, as rational quadratic arcs."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry.axis import Axis
from isorod.geometry.reading import turns
from isorod.geometry.segments import Segment, joined

# Turns below this, radians, need no fillet; segments below this fraction of the longest chord are left out.
_STRAIGHT = 1e-9
_NOTHING = 1e-12


class Path(NamedTuple):
    """A filleted line: axis, control points ``(axis.count, 3)``, segments, and parameters ``(m,)`` of the points."""

    axis: Axis
    centers: Array
    segments: list[Segment]
    stations: Array


def path(points: Array, radius: float, closed: bool) -> Path:
    """Return lines from point to point and arcs of one radius between them, tangent to both.

    An arc has two elements, which meet at its middle, the station of its point; a closed line begins there.

    Parameters
    ----------
    points
        Shape ``(m, 3)``; of a closed line the first is not repeated.
    radius
        Of the centre line, units of length.

    Raises
    ------
    InputError
        If a side is too short for the fillets at its ends.
    """
    count = len(points)
    after = np.roll(points, -1, axis=0) - points
    length = np.linalg.norm(after, axis=1)
    along = after / length[:, None]
    turn = np.radians(turns(points, closed))
    turn[turn < _STRAIGHT] = 0.0
    slope = np.tan(0.5 * np.minimum(turn, np.pi - _STRAIGHT))
    sides = np.arange(count if closed else count - 1)
    needed = slope[sides] + slope[(sides + 1) % count]
    room = length[sides] - radius * needed
    if room.min() < -_NOTHING * length.max():
        k = int(np.argmin(room))
        raise InputError(
            f"polyline: fillet: got {radius:g}, need {length[k] / needed[k]:.4g} at most for the side from point {k} "
            f"to point {(k + 1) % count}"
        )
    # Ends of the fillets at points.
    trim = radius * slope[:, None]
    before = np.roll(along, 1, axis=0)
    starts, ends = points - trim * before, points + trim * along
    halves = [_halves(*corner, radius) for corner in zip(starts, before, along, turn, strict=True)]
    segments, places = [], []
    for k in range(count + closed):
        first, second = halves[k % count]
        if k:
            side = np.array([ends[k - 1], 0.5 * (ends[k - 1] + starts[k % count]), starts[k % count]])
            if room[k - 1] > _NOTHING * length.max():
                segments.append(Segment(side, float(room[k - 1])))
            segments += first
        places.append(len(segments))
        if k < count:
            segments += second
    axis, centers = joined(segments)
    return Path(axis, centers, segments, axis.breaks[places])


def _halves(start: Array, before: Array, after: Array, turn: float, radius: float) -> tuple[list[Segment], ...]:
    """Return the two halves of the arc from one direction to another, none where they are equal."""
    if not turn:
        return [], []
    about = np.cross(before, after)
    about /= np.linalg.norm(about)
    middle = (before + after) / np.linalg.norm(before + after)
    reach, length = radius * np.tan(0.25 * turn), 0.5 * radius * turn
    points = start + reach * np.cumsum([0.0 * before, before, middle, middle, after], axis=0)
    return [Segment(points[:3], length, 0.5 * turn, about)], [Segment(points[2:], length, 0.5 * turn, about)]
