"""Centre lines of rods: straight ones, smooth curves near points, and NURBS made elsewhere."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, expect, numbers, positive, whole_number
from isorod.geometry import bspline, fillets, reading
from isorod.geometry import polyline as near_points
from isorod.geometry.axis import MAX_ELEMENTS, Axis
from isorod.geometry.fitting import evaluate, inside
from isorod.geometry.frames import Frames
from isorod.geometry.given import check_length, finite_points
from isorod.geometry.line import CenterLine
from isorod.geometry.segments import tensors

__all__ = ["CenterLine", "nurbs", "polyline", "straight"]

# Samples of a line, and of an element, at which its deviation is measured.
_PLACES, _FEWEST = 4096, 16


# Breaks of a line whose length is given.
_UNIT = 0.0, 1.0


def straight(
    length: float | None = None,
    breaks: Sequence[float] = _UNIT,
    degree: int = 2,
    continuity: int | None = None,
    *,
    start: Numbers = (0.0, 0.0, 0.0),
    end: Numbers | None = None,
) -> CenterLine:
    """Return a straight line, along z or to a point, linear in the axis parameter.

    Its control points are at the Greville abscissae, the means of ``degree`` successive knots.

    Parameters
    ----------
    length
        Units of length; without it and an end the length is the distance from the first break to the last.
    breaks
        Distinct knots, ascending.
    degree
        Of the axis.
    continuity
        At the inner breaks, 0 to ``degree - 1``, the default.
    start, end
        Points ``(3,)``: by default the origin, and ``length`` above it.  A section's x and y are those of space under
        the smallest rotation that takes z to the line.
    """
    if length is not None:
        positive("length", length)
    if len(breaks) < 2:
        raise InputError(f"straight line: got {len(breaks)} breaks, need at least 2")
    if length is None and end is None and tuple(breaks) == _UNIT:
        raise InputError("straight line: the length is missing; need a length, an end, or breaks as far apart as it is")
    smooth = degree - 1 if continuity is None else whole_number("continuity", continuity, 0, degree - 1)
    times = [degree + 1, *[degree - smooth] * (len(breaks) - 2), degree + 1]
    knots = np.repeat(np.array(breaks, dtype=float), times)
    axis = Axis(degree, knots, np.ones(knots.size - degree - 1))
    distance = bspline.greville(knots, degree) - knots[0]
    origin = finite_points("start", start, (3,))
    if end is None:
        if length is not None:
            distance = length * distance / (knots[-1] - knots[0])
        return CenterLine(axis, origin + distance[:, None] * np.array([0.0, 0.0, 1.0]))
    if length is not None:
        raise InputError("straight line: got a length and an end, need one of them")
    chord = finite_points("end", end, (3,)) - origin
    if not np.any(chord):
        raise InputError("straight line: the end is the start")
    centers = origin + (distance / (knots[-1] - knots[0]))[:, None] * chord
    across = Frames(axis, centers)(knots[:1])[0]
    rotation = np.concatenate([across, chord[:, None] / np.linalg.norm(chord)], axis=1)
    return CenterLine(axis, centers, np.broadcast_to(rotation, (axis.count, 3, 3)))


def polyline(
    points: Numbers,
    tolerance: float | None = None,
    closed: bool = False,
    *,
    normal: Numbers | None = None,
    fillet: float | None = None,
) -> CenterLine:
    """Return a smooth line (cubic, C2) from which no point is farther than a tolerance, or one with fillets at corners.

    A smooth line has the fewest elements that suffice; an open one passes through its first and its last point.
    Between points it deviates from the polyline by at most about half the longest chord.  Its frame is rotation
    minimising (`isorod.geometry.frames`); the rotation of a closed one is corrected evenly, so that the last section is
    the first.  Sweeping warns where a corner of more than 30 degrees, or one between straight sides, is rounded by a
    hundredth of the radius or more.

    With a fillet it is straight from point to point, exactly, and an arc of that radius at each.

    Parameters
    ----------
    points
        Shape ``(m, 3)``, ``m >= 2``, at least 3 distinct ones of a closed line, whose first may be repeated.
    tolerance
        Of a smooth line, units of length; 0: it passes through all points.
    closed
        Whether it continues from the last point to the first.
    normal
        Vector ``(3,)`` towards which a section's x points at the start (see `Frames`).
    fillet
        Of straight lines, the radius of the arcs between them, units of length; larger than that of the section.
    """
    given = finite_points("polyline", points, (None, 3))
    if fillet is not None:
        check_length("polyline: fillet", fillet)
        if tolerance is not None:
            raise InputError("polyline: got a fillet and a tolerance, need one of them")
    elif tolerance is None:
        raise InputError("polyline: tolerance: got None, need a number, or a fillet")
    expect("polyline: tolerance", tolerance, float | None)
    if tolerance is not None and not (np.isfinite(tolerance) and tolerance >= 0.0):
        raise InputError(f"polyline: tolerance: got {tolerance:g}, need a length, 0 or more")
    repeated = closed and len(given) > 1 and np.array_equal(given[0], given[-1])
    count, least = len(given) - repeated, 3 if closed else 2
    if count < least:
        raise InputError(f"polyline: got {count} points, need at least {least}")
    if closed and not repeated:
        given = np.concatenate([given, given[:1]])
    if len(given) > MAX_ELEMENTS:
        raise InputError(f"polyline: {len(given)} points are too many; at most {MAX_ELEMENTS}")
    chords = np.linalg.norm(np.diff(given, axis=0), axis=1)
    if not chords.min() > 1e-12 * chords.max():
        raise InputError(f"polyline: point {np.argmin(chords)} coincides with the next one; leave one out")
    if tolerance is None:
        return _filleted(given[:-1] if closed else given, float(fillet or 0.0), normal, closed)
    curve = near_points.through(given, float(tolerance), closed)
    line = _framed(curve.axis, curve.centers, normal, closed, curve.parameters)
    off, cure = _off_points(_places(curve.axis, curve.centers), given[:-1] if closed else given, closed)
    return replace(line, deviation=off, cure=cure)


def _filleted(points: Array, fillet: float, normal: Numbers | None, closed: bool) -> CenterLine:
    """Return the line that is straight from point to point, and an arc at each."""
    axis, centers, pieces, stations = fillets.path(points, fillet, closed)
    frames = Frames(axis, centers, None if normal is None else finite_points("normal", normal, (3,)), closed)
    tangent = centers[1:2] - centers[:1]
    first = np.concatenate([frames(axis.breaks[:1])[0], tangent.T / np.linalg.norm(tangent)], axis=1)
    rotations, stretches = tensors(pieces, first)
    if closed and np.abs(rotations[-1] - first).max() > 1e-9:
        # Round a line that is not plane the frame does not close: its rotation is corrected evenly.
        return CenterLine(axis, centers, frames=frames, closed=True, stations=stations)
    return CenterLine(axis, centers, rotations, stretches, closed=closed, stations=stations)


def _places(axis: Axis, centers: Array) -> Array:
    """Return samples of a curve, enough on each element, ``(t, 3)``."""
    u = np.append(inside(axis, max(_FEWEST, _PLACES // axis.elements)).ravel(), axis.breaks)
    return evaluate(axis, centers, np.sort(u))[0]


def _off_points(places: Array, points: Array, closed: bool) -> tuple[float, str]:
    """Return the deviation of a smooth line from its points and the sides of their corners, and the remedy."""
    off, sharp = reading.farthest(points, places), reading.coarse(points, closed)
    if sharp.size:
        beside = np.union1d(sharp, (sharp - 1) % len(points))
        target, where = reading.between(points, sharp, closed)
        side = np.searchsorted(np.sort(where), np.arange(len(target)), side="right") - 1
        bow = reading.farthest(target[np.isin(side, beside)], places)
        if bow > off:
            turn = reading.turns(points, closed)
            k = sharp[np.argmax(turn[sharp])]
            return bow, (
                f"the points turn by {turn[k]:.0f} degrees at point {k}: give straight lines with a corner a fillet "
                "(its radius) in place of the tolerance, and a smooth curve more points"
            )
    return off, "take a smaller tolerance"


def nurbs(curve: Any, closed: bool = False, *, normal: Numbers | None = None) -> CenterLine:
    """Return the line of a curve object of splinepy or geomdl, with frames as those of `polyline`.

    Parameters
    ----------
    curve
        An object with the attributes of one of them: ``degrees``, ``knot_vectors``, ``control_points`` (splinepy) or
        ``degree``, ``knotvector``, ``ctrlpts`` (geomdl), and ``weights`` if it is rational.  Control points are not
        multiplied by their weights; plane ones lie in the plane of x and y; without knots it is a Bézier curve.
    closed
        Whether its end is its start, with the same tangent.
    normal
        As in `polyline`.
    """
    degree = np.atleast_1d(_numbers_of(curve, "degrees", "degree")).astype(int)
    if degree.size != 1:
        raise InputError(f"nurbs: got a spline of {degree.size} parameters, need a curve, which has one")
    p = int(degree[0])
    points = _numbers_of(curve, "control_points", "ctrlpts")
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise InputError(f"nurbs: got control points of shape {points.shape}, need (m, 3) or (m, 2)")
    centers = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    knots = _knots_of(curve)
    if knots is None:
        knots = np.repeat([0.0, 1.0], p + 1)
    weights = getattr(curve, "weights", None)
    rational = weights is not None and np.size(weights) > 0
    axis = Axis(p, knots, np.asarray(weights, dtype=float).ravel() if rational else np.ones(len(centers)))
    if len(centers) != axis.count:
        raise InputError(f"nurbs: got {len(centers)} control points, need {axis.count} for the degree and the knots")
    finite_points("nurbs", centers, (None, 3))
    return _framed(axis, centers, normal, closed, None)


def _framed(axis: Axis, centers: Array, normal: Numbers | None, closed: bool, stations: Array | None) -> CenterLine:
    """Return the line with rotation-minimising frames; raise where it has a corner."""
    towards = None if normal is None else finite_points("normal", normal, (3,))
    frames = Frames(axis, centers, towards, closed)
    frames.check()
    return CenterLine(axis, centers, frames=frames, closed=closed, stations=stations)


def _numbers_of(curve: Any, *names: str) -> Array:
    """Return the numbers in the first of some attributes that exists."""
    for name in names:
        value = getattr(curve, name, None)
        if value is not None:
            return numbers(f"nurbs: {name}", value)
    raise InputError(
        f"nurbs: got {type(curve).__name__} without {' or '.join(names)}, need a curve of splinepy or geomdl"
    )


def _knots_of(curve: Any) -> Array | None:
    """Return the knot vector, None of a Bézier curve; splinepy has a list of them."""
    several = getattr(curve, "knot_vectors", None)
    knots = getattr(curve, "knotvector", None) if several is None else several[0]
    return None if knots is None else np.array(list(knots), dtype=float)
