"""Reconstruction of curves and outlines from points, smooth between sharp corners, and deviations from that."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index

# A point is a sharp corner where the polyline turns by so much, degrees ...
_SHARP = 60.0
# ... or by so much and more than twice as far as at one of its neighbours, more than half as far as at the other ...
_TURNED = 30.0
# ... or by so much and more than four times as far as at both: no samples of a smooth curve do that.
_ALONE = 2.0

# Samples of a curve.
_DENSE = 4096

# Deviation above which there is a warning, relative to the radius.
LARGE = 0.01


class Deviation(NamedTuple):
    """Largest deviations of a rod from the input.

    Attributes
    ----------
    line, section, sweep
        Largest deviation of the centre line, of the section's outline, and of sections from their exact places by
        frames, scale and twist, units of length.
    relative
        The largest of the three, relative to half the diameter: of the smallest section for the centre line.
    """

    line: float = 0.0
    section: float = 0.0
    sweep: float = 0.0
    relative: float = 0.0


EXACT = Deviation()


def turns(points: Array, closed: bool) -> Array:
    """Return the angles by which a polyline turns at its points, degrees ``(m,)``; 0 at the ends of an open one."""
    ring = np.concatenate([points[-1:], points, points[:1]]) if closed else points
    chords = np.diff(ring, axis=0)
    chords = chords / np.linalg.norm(chords, axis=1, keepdims=True)
    # Accurate for small angles and for large ones.
    half = np.arctan2(
        np.linalg.norm(chords[1:] - chords[:-1], axis=1), np.linalg.norm(chords[1:] + chords[:-1], axis=1)
    )
    angles: Array = 2.0 * np.degrees(half)
    return angles if closed else np.pad(angles, 1)


def chord_lengths(points: Array) -> Array:
    """Return the arc lengths of a polyline at its points, ``(m,)``."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def corners(points: Array, closed: bool) -> Index:
    """Return which points are sharp corners, not samples of a smooth curve.

    Along a smooth curve a polyline turns by about as much at a point as at the next.
    """
    turn = turns(points, closed)
    before, after = np.roll(turn, 1), np.roll(turn, -1)
    least, most = np.minimum(before, after), np.maximum(before, after)
    alone = (turn > _ALONE) & (most < 0.25 * turn)
    sharp = (turn > _TURNED) & (least < 0.5 * turn) & (most < 2.0 * turn)
    result: Index = np.flatnonzero(alone | sharp | (turn > _SHARP - 1e-6))
    return result


def outline_corners(points: Array) -> tuple[Index, Index]:
    """Return which points of an outline are sharp corners, and which of these are in doubt.

    A point next to a corner that turns by more than 30 degrees is a corner too.  These are in doubt, and so are corners
    whose neighbours are no corners but turn by more than a quarter as far, if the sagitta exceeds a hundredth of half
    the width.
    """
    sure, turn = corners(points, closed=True), turns(points, closed=True)
    sharp = np.zeros(len(points), dtype=bool)
    sharp[sure] = True
    far, count = turn > _TURNED, 0
    while count < sharp.sum():
        count = int(sharp.sum())
        sharp |= far & (np.roll(sharp, 1) | np.roll(sharp, -1))
    before, after = np.roll(turn, 1), np.roll(turn, -1)
    alone = ~(np.roll(sharp, 1) | np.roll(sharp, -1))
    doubt = sharp & alone & (np.minimum(before, after) > 0.25 * turn)
    doubt |= sharp & ~np.isin(np.arange(len(points)), sure)
    chords = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    sagitta = 0.5 * np.minimum(chords, np.roll(chords, 1)) * np.tan(0.25 * np.radians(turn))
    return np.flatnonzero(sharp), np.flatnonzero(doubt & (sagitta > 0.5 * LARGE * np.ptp(points, axis=0).min()))


def coarse(points: Array, closed: bool) -> Index:
    """Return which points are sharp corners, or cannot be distinguished from these because points are too sparse."""
    return np.union1d(corners(points, closed), np.flatnonzero(turns(points, closed) > _TURNED))


def between(points: Array, sharp: Index, closed: bool) -> tuple[Array, Index]:
    """Return samples of the curve through points, ``(k, d)``, and which of these are the points.

    Cubic splines over the chords' lengths (C2) through the points from one sharp corner to the next: straight between
    two corners that follow each other.

    Parameters
    ----------
    points
        Shape ``(m, d)``; of a closed curve the first is not repeated.
    sharp
        Numbers of the sharp corners.
    closed
        Whether the last point is followed by the first, which is then also the last sample.
    """
    # Imported late: only points need it.
    from scipy.interpolate import CubicSpline

    start = int(sharp[0]) if closed and sharp.size else 0
    ring = np.roll(points, -start, axis=0)
    ring = np.concatenate([ring, ring[:1]]) if closed else ring
    arc_length = chord_lengths(ring)
    parts = np.maximum(1, np.ceil(_DENSE * np.diff(arc_length) / arc_length[-1])).astype(int)
    ends = np.unique(np.concatenate([[0], sharp - start, [len(ring) - 1]]))
    smooth = "periodic" if closed and not sharp.size else "not-a-knot"
    which = np.concatenate([[0], np.cumsum(parts)])
    along = np.interp(np.arange(which[-1]), which, arc_length)
    places = np.stack([np.interp(along, arc_length, column) for column in ring.T], axis=1)
    for a, b in pairwise(ends):
        if b > a + 1:
            spline = CubicSpline(arc_length[a : b + 1], ring[a : b + 1], bc_type=smooth)
            places[which[a] : which[b]] = spline(along[which[a] : which[b]])
    if not closed:
        return np.concatenate([places, ring[-1:]]), which
    places = np.roll(places, which[-1] - which[len(points) - start], axis=0)
    which = (np.roll(which[:-1], start) - which[len(points) - start]) % which[-1]
    return np.concatenate([places, places[:1]]), which


def filled(ring: Array) -> Array:
    """Return samples of a polyline, its points included, ``(k, d)``."""
    arc_length = chord_lengths(ring)
    place = np.union1d(arc_length, np.linspace(0.0, arc_length[-1], _DENSE))
    return np.stack([np.interp(place, arc_length, column) for column in ring.T], axis=1)


def distance(curve: Array, other_curve: Array) -> float:
    """Return the largest distance of either of two curves from the other, given by samples ``(k, d)``."""
    return max(farthest(curve, other_curve), farthest(other_curve, curve))


def farthest(places: Array, curve: Array) -> float:
    """Return the largest distance of places ``(t, d)`` from a curve given by samples."""
    from scipy.spatial import cKDTree

    _, near = cKDTree(curve).query(places)
    distances = np.full(len(places), np.inf)
    for first in (np.maximum(near - 1, 0), np.minimum(near, len(curve) - 2)):
        chord = curve[first + 1] - curve[first]
        square = np.einsum("ta,ta->t", chord, chord)
        arm = places - curve[first]
        fraction = np.clip(np.einsum("ta,ta->t", arm, chord) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        distances = np.minimum(distances, np.linalg.norm(arm - fraction[:, None] * chord, axis=1))
    return float(distances.max())


def moments(ring: Array) -> tuple[float, Array]:
    """Return area and second moments ``(2, 2)`` about the centroid, of a closed polyline ``(k, 2)``."""
    after = np.roll(ring, -1, axis=0)
    cross = ring[:, 0] * after[:, 1] - ring[:, 1] * after[:, 0]
    area = 0.5 * float(cross.sum())
    centre = np.einsum("k,ka->a", cross, ring + after) / (6.0 * area)
    a, both = ring - centre, ring + after - 2.0 * centre
    b = both - a
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    second: Array = sum(np.einsum("k,ka,kb->ab", cross, one, one) for one in (a, b, both)) / 24.0
    return area, second


def mismatch(outline: Array, target: Array) -> float:
    """Return the largest relative error, with its sign, of area and second moments about any axis of an outline."""
    (area, second), (target_area, target_second) = moments(outline), moments(target)
    errors = np.append(np.linalg.eigvals(np.linalg.solve(target_second, second)).real, area / target_area) - 1.0
    return float(errors[np.argmax(np.abs(errors))])
