"""What points along a curve or an outline mean: smooth between sharp corners, and how far a curve is from that."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index

# A point is a sharp corner where the polyline turns by so much, degrees ...
_SHARP = 60.0
# ... or by so much and more than twice as far as at one of its neighbours, more than half as far as at the other ...
_TURNED = 30.0
# ... or by so much and more than four times as far as at both, as no samples of a smooth curve do.
_ALONE = 2.0

# So many places of the whole curve are looked at.
_DENSE = 4096

# From here on a curve is warned of, as a share of the radius.
LARGE = 0.01


class Deviation(NamedTuple):
    """How far a rod is from what was written, at most.

    Attributes
    ----------
    line, section, sweep
        Largest deviation of the centre line, of the section's outline, and of sections from where frames, scale and
        twist want them, units of length.
    relative
        The largest of the three as shares of half the diameter: of the smallest section for the centre line.
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
    # Exact for small angles and for large ones.
    half = np.arctan2(
        np.linalg.norm(chords[1:] - chords[:-1], axis=1), np.linalg.norm(chords[1:] + chords[:-1], axis=1)
    )
    found: Array = 2.0 * np.degrees(half)
    return found if closed else np.pad(found, 1)


def chord_lengths(points: Array) -> Array:
    """Return the lengths of a polyline up to its points, ``(m,)``."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def corners(points: Array, closed: bool) -> Index:
    """Return which points are sharp corners, and no samples of a smooth curve.

    Along a smooth curve a polyline turns by about as much at a point as at the next.
    """
    turn = turns(points, closed)
    before, after = np.roll(turn, 1), np.roll(turn, -1)
    least, most = np.minimum(before, after), np.maximum(before, after)
    alone = (turn > _ALONE) & (most < 0.25 * turn)
    sharp = (turn > _TURNED) & (least < 0.5 * turn) & (most < 2.0 * turn)
    found: Index = np.flatnonzero(alone | sharp | (turn > _SHARP - 1e-6))
    return found


def outline_corners(points: Array) -> tuple[Index, Index]:
    """Return which points of an outline are sharp corners, and which of these are in doubt.

    Beside a corner another point that turns by more than 30 degrees is one as well; in doubt are these, and corners
    whose neighbours turn by more than a quarter as far but are none, if it matters by a hundredth of half the width.
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
    """Return which points are sharp corners, or so far from the next that they cannot be told from these."""
    return np.union1d(corners(points, closed), np.flatnonzero(turns(points, closed) > _TURNED))


def between(points: Array, sharp: Index, closed: bool) -> tuple[Array, Index]:
    """Return places of the curve that points mean, many and all of them, ``(k, d)``, and which of these are the points.

    Cubic splines over the chords' lengths (C2) through the points from one sharp corner to the next: straight between
    two corners that follow each other.

    Parameters
    ----------
    points
        Shape ``(m, d)``; of a closed curve the first is not repeated.
    sharp
        Numbers of the sharp corners.
    closed
        Whether the last point is followed by the first, which then ends the places too.
    """
    # Loaded where points are given.
    from scipy.interpolate import CubicSpline

    start = int(sharp[0]) if closed and sharp.size else 0
    ring = np.roll(points, -start, axis=0)
    ring = np.concatenate([ring, ring[:1]]) if closed else ring
    way = chord_lengths(ring)
    parts = np.maximum(1, np.ceil(_DENSE * np.diff(way) / way[-1])).astype(int)
    ends = np.unique(np.concatenate([[0], sharp - start, [len(ring) - 1]]))
    smooth = "periodic" if closed and not sharp.size else "not-a-knot"
    which = np.concatenate([[0], np.cumsum(parts)])
    along = np.interp(np.arange(which[-1]), which, way)
    places = np.stack([np.interp(along, way, column) for column in ring.T], axis=1)
    for a, b in pairwise(ends):
        if b > a + 1:
            spline = CubicSpline(way[a : b + 1], ring[a : b + 1], bc_type=smooth)
            places[which[a] : which[b]] = spline(along[which[a] : which[b]])
    if not closed:
        return np.concatenate([places, ring[-1:]]), which
    places = np.roll(places, which[-1] - which[len(points) - start], axis=0)
    which = (np.roll(which[:-1], start) - which[len(points) - start]) % which[-1]
    return np.concatenate([places, places[:1]]), which


def filled(ring: Array) -> Array:
    """Return many places of a polyline, all its points and those in between, ``(k, d)``."""
    way = chord_lengths(ring)
    place = np.union1d(way, np.linspace(0.0, way[-1], _DENSE))
    return np.stack([np.interp(place, way, column) for column in ring.T], axis=1)


def distance(one: Array, other: Array) -> float:
    """Return the largest distance of either of two curves from the other, of many places each, ``(k, d)``."""
    return max(farthest(one, other), farthest(other, one))


def farthest(places: Array, curve: Array) -> float:
    """Return how far places ``(t, d)`` are from a curve of many chords, at most."""
    from scipy.spatial import cKDTree

    _, near = cKDTree(curve).query(places)
    found = np.full(len(places), np.inf)
    for first in (np.maximum(near - 1, 0), np.minimum(near, len(curve) - 2)):
        chord = curve[first + 1] - curve[first]
        square = np.einsum("ta,ta->t", chord, chord)
        arm = places - curve[first]
        share = np.clip(np.einsum("ta,ta->t", arm, chord) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(arm - share[:, None] * chord, axis=1))
    return float(found.max())


def moments(ring: Array) -> tuple[float, Array]:
    """Return area and second moments ``(2, 2)`` about the centroid of what a closed polyline ``(k, 2)`` encloses."""
    after = np.roll(ring, -1, axis=0)
    cross = ring[:, 0] * after[:, 1] - ring[:, 1] * after[:, 0]
    area = 0.5 * float(cross.sum())
    centre = np.einsum("k,ka->a", cross, ring + after) / (6.0 * area)
    a, both = ring - centre, ring + after - 2.0 * centre
    b = both - a
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    second: Array = sum(np.einsum("k,ka,kb->ab", cross, one, one) for one in (a, b, both)) / 24.0
    return area, second


def mismatch(outline: Array, wanted: Array) -> float:
    """Return by which share, with its sign, area or a second moment about any axis of an outline is off at most."""
    (area, second), (area_wanted, second_wanted) = moments(outline), moments(wanted)
    shares = np.append(np.linalg.eigvals(np.linalg.solve(second_wanted, second)).real, area / area_wanted) - 1.0
    return float(shares[np.argmax(np.abs(shares))])
