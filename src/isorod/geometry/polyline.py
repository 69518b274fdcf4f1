"""Smooth curves near given points: C2 cubic splines with as few elements as a tolerance allows."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.geometry import bspline
from isorod.geometry.axis import Axis
from isorod.geometry.fitting import evaluate, interpolate, least_squares, nearest
from isorod.geometry.reading import chord_lengths

DEGREE = 3

# Iterations that move the points' parameters to the closest points of the curve.
_PROJECTIONS = 3

# Least distance of parameters, relative to a chord.
_APART = 1e-6

# Samples of the curve between two points, and its largest distance from the polyline there, relative to a chord. Cubic
# splines through random walks with chords of very unequal length, natural at the ends, deviate by 0.34 at most.
_BETWEEN = 7
_STRAYS = 0.5


class Curve(NamedTuple):
    """A spline, and the parameters ``(m,)`` at which it is nearest to points."""

    axis: Axis
    centers: Array
    parameters: Array


def through(points: Array, tolerance: float, closed: bool) -> Curve:
    """Return a cubic spline near points, C2, with the fewest elements that were found to suffice.

    A least-squares curve (Piegl & Tiller, The NURBS Book, 2nd ed., section 9.4) whose knots follow the points, so that
    each element has at least one; the points' parameters, at first chord lengths, are moved to the closest points of
    the curve (Hoschek, CAGD 5, 1988, 27-31).  Between points the curve must also be within the tolerance plus half the
    longest of the three adjacent chords of the polyline.  Without such a curve it is the cubic spline through all
    points.

    Parameters
    ----------
    points
        Shape ``(m, 3)``, ``m >= 2`` (closed: 4), neighbours apart; of a closed curve the last is the first again.
    tolerance
        Largest distance of points from the curve; an open curve passes through the first and the last.
    """
    degree = DEGREE if closed else min(DEGREE, len(points) - 1)
    fewest, most = (3, len(points) - 1) if closed else (1, len(points) - degree)
    low, high, best = fewest - 1, fewest, None
    # Increased by a quarter until the tolerance is met, then bisected.
    while (best := _near(points, tolerance, high, degree, closed)) is None and high < most:
        low, high = high, min(high + 1 + high // 4, most)
    if best is None:
        return _interpolating(points, closed)
    while high - low > 1:
        middle = (low + high) // 2
        curve = _near(points, tolerance, middle, degree, closed)
        low, high, best = (middle, high, best) if curve is None else (low, middle, curve)
    axis = best.axis.refine(1, DEGREE)
    return Curve(axis, best.axis.transfer(axis, best.centers), best.parameters)


def _near(points: Array, tolerance: float, elements: int, degree: int, closed: bool) -> Curve | None:
    """Return the curve of so many elements, None if points are farther from it than the tolerance."""
    chords = chord_lengths(points)
    breaks = np.interp(np.linspace(0.0, len(points) - 1.0, elements + 1), np.arange(len(points)), chords)
    t = chords.copy()
    for _ in range(_PROJECTIONS):
        try:
            axis, centers = (_periodic if closed else _clamped)(points, t, breaks, degree)
        except np.linalg.LinAlgError:
            return None
        where, slope = evaluate(axis, centers, t)
        t[1:-1] += (np.einsum("ta,ta->t", points - where, slope) / np.einsum("ta,ta->t", slope, slope))[1:-1]
        # The projections of points nearer to each other than to the curve may be in another order.
        t = np.maximum.accumulate(np.clip(t, chords[0], chords[-1])) * (1.0 - _APART) + chords * _APART
        where, _ = evaluate(axis, centers, t)
        if np.linalg.norm(points - where, axis=1).max() <= tolerance:
            return Curve(axis, centers, t) if _keeps_to(points, tolerance, axis, centers, t) else None
    return None


def _keeps_to(points: Array, tolerance: float, axis: Axis, centers: Array, t: Array) -> bool:
    """Return whether the curve is near the polyline between the points, whose parameters are ``t``."""
    fraction = np.arange(1.0, _BETWEEN + 1.0) / (_BETWEEN + 1.0)
    x, _ = evaluate(axis, centers, (t[:-1, None] + np.diff(t)[:, None] * fraction).ravel())
    arm = x.reshape(len(t) - 1, _BETWEEN, 3) - points[:-1, None]
    chord = np.diff(points, axis=0)
    square = np.einsum("ta,ta->t", chord, chord)
    along = np.clip(np.einsum("tsa,ta->ts", arm, chord) / square[:, None], 0.0, 1.0)
    off = np.linalg.norm(arm - along[:, :, None] * chord[:, None], axis=2).max(axis=1)
    length = np.pad(np.sqrt(square), 1, mode="edge")
    longest = np.maximum(np.maximum(length[:-2], length[2:]), length[1:-1])
    return bool((off <= tolerance + _STRAYS * longest).all())


def _interpolating(points: Array, closed: bool) -> Curve:
    """Return the cubic spline with knots at all points; an open one is natural at its ends."""
    # Imported late: only such rough polylines need it.
    from scipy.interpolate import CubicSpline

    t = chord_lengths(points)
    spline = CubicSpline(t, points, bc_type="periodic" if closed else "natural")
    axis = _axis(t, DEGREE)
    centers = interpolate(axis, spline)
    centers[0], centers[-1] = points[0], points[-1]
    return Curve(axis, centers, t)


def _axis(breaks: Array, degree: int) -> Axis:
    knots = np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])
    return Axis(degree, knots, np.ones(knots.size - degree - 1))


def _clamped(points: Array, t: Array, breaks: Array, degree: int) -> tuple[Axis, Array]:
    """Return the spline on ``breaks`` nearest to points at ``t``."""
    axis = _axis(breaks, degree)
    return axis, nearest(axis, t, points)


def _periodic(points: Array, t: Array, breaks: Array, degree: int) -> tuple[Axis, Array]:
    """Return the periodic spline on ``breaks`` nearest to points at ``t``, on a clamped axis."""
    count, length = breaks.size - 1, breaks[-1] - breaks[0]
    turns, place = np.divmod(np.arange(-degree, count + degree + 1), count)
    knots = breaks[place] + turns * length

    def functions(u: Array) -> tuple[Index, Array]:
        first, values, _ = bspline.table(knots, degree, u)
        return (first[:, None] + np.arange(degree + 1)) % count, values

    coefficients = least_squares(*functions(t[:-1]), points[:-1], count)
    axis = _axis(breaks, degree)

    def field(u: Array) -> Array:
        which, values = functions(np.where(u < breaks[-1], u, breaks[0]))
        return np.einsum("tj,tjc->tc", values, coefficients[which])

    centers = interpolate(axis, field)
    centers[-1] = centers[0]
    return axis, centers
