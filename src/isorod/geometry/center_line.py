"""Centre lines of rods: straight ones, arcs, helices, smooth curves near points, and NURBS made elsewhere."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, expect, numbers, positive, representable, whole_number
from isorod.geometry import bspline, fillets, reading
from isorod.geometry import polyline as near_points
from isorod.geometry.axis import MAX_ELEMENTS, Axis
from isorod.geometry.fitting import evaluate, inside, nearest
from isorod.geometry.frames import Frames
from isorod.geometry.line import CenterLine

__all__ = ["CenterLine", "arc", "helix", "nurbs", "polyline", "straight"]

# The helix that is no arcs has so many elements a turn, this degree, and so many points an element for least squares.
HELIX_ELEMENTS = 8
_HELIX_DEGREE = 4
_HELIX_POINTS = 12

# Places of a whole line, and of an element, at which its deviation is measured.
_PLACES, _FEWEST = 4096, 16


def straight(
    length: float | None = None,
    breaks: Sequence[float] = (0.0, 1.0),
    degree: int = 2,
    continuity: int | None = None,
    *,
    start: Numbers = (0.0, 0.0, 0.0),
    end: Numbers | None = None,
) -> CenterLine:
    """Return a straight line, along z or to a point, on which one comes forward linearly with the axis parameter.

    Its control points stand at the Greville abscissae, the means of ``degree`` successive knots.

    Parameters
    ----------
    length
        Units of length; where neither it nor the end is given the height is the way from the first break.
    breaks
        Distinct knots, ascending.
    degree
        Of the axis.
    continuity
        At the inner breaks, 0 to ``degree - 1``; the latter where not given.
    start, end
        Points ``(3,)``: the origin, and ``length`` above it, where not given.  A section's x and y are those of space
        turned as z is turned to the line on the shortest way.
    """
    if length is not None:
        positive("length", length)
    if len(breaks) < 2:
        raise InputError(f"straight line: got {len(breaks)} breaks, need at least 2")
    smooth = degree - 1 if continuity is None else whole_number("continuity", continuity, 0, degree - 1)
    times = [degree + 1, *[degree - smooth] * (len(breaks) - 2), degree + 1]
    knots = np.repeat(np.array(breaks, dtype=float), times)
    axis = Axis(degree, knots, np.ones(knots.size - degree - 1))
    way = bspline.greville(knots, degree) - knots[0]
    foot = _points("start", start, (3,))
    if end is None:
        if length is not None:
            way = length * way / (knots[-1] - knots[0])
        return CenterLine(axis, foot + way[:, None] * np.array([0.0, 0.0, 1.0]))
    if length is not None:
        raise InputError("straight line: got a length and an end, need one of them")
    chord = _points("end", end, (3,)) - foot
    if not np.any(chord):
        raise InputError("straight line: the end is the start")
    centers = foot + (way / (knots[-1] - knots[0]))[:, None] * chord
    across = Frames(axis, centers)(knots[:1])[0]
    rotation = np.concatenate([across, chord[:, None] / np.linalg.norm(chord)], axis=1)
    return CenterLine(axis, centers, np.broadcast_to(rotation, (axis.count, 3, 3)))


def arc(radius: float, angle: float, *, phase: float = 0.0) -> CenterLine:
    """Return an arc of a circle about the z axis in the plane of x and y: exact, and so is the torus swept along it.

    It is a helix without pitch made of equal rational quadratic arcs of at most 90 degrees.

    Parameters
    ----------
    radius
        Units of length.
    angle
        From start to end, degrees, -360 to 360; negative: clockwise seen from above.  A whole turn is closed.
    phase
        Angle of the start, from x towards y, degrees.
    """
    _positive("centre line radius", radius)
    expect("arc: angle", angle, float)
    if not 0.0 < abs(angle) <= 360.0:
        raise InputError(f"arc: angle: got {angle:g} degrees, need -360 to 360 and not 0")
    count = int(np.ceil(abs(angle) / 90.0 - 1e-9))
    return _arcs(radius, 0.0, np.radians(abs(angle)), count, phase, angle < 0.0, closed=abs(angle) == 360.0)


def helix(
    radius: float,
    pitch: float,
    turns: float,
    arcs_per_turn: int | None = None,
    *,
    phase: float = 0.0,
    left: bool = False,
) -> CenterLine:
    """Return a helix about the z axis, the section in the plane of the radial direction and the helix's binormal.

    A quartic spline, C3, with 8 elements a turn, by least squares: its lead angle is within 0.02 degrees of the true
    one everywhere (at the worst pitch, as long as a turn; 0.003 on the spring of Lu & Zhou), the radius within 6e-5,
    3e-7 in the mean.

    With ``arcs_per_turn`` rational quadratic circular arcs, C0 at their joints, as in Lu & Zhou (2011): at the corner
    control point of an arc (weight ``cos(pi / arcs_per_turn)``) the part of every section vector that is normal to z is
    stretched by the inverse weight: with ``pitch = 0`` the swept ring is then an exact torus (their Fig. 4).  With a
    pitch the wire lies on the cylinder, but climbs unevenly: with 4 arcs a turn that spring's at 3.10 to 4.38 degrees
    in place of 3.95, an error that falls with the square of their number only.

    The wobble makes a spring softer by about its mean square: fully converged, the even helix takes 0.0057 % more force
    than 4 arcs (mean square of the wobble 0.0045 %, volumes equal within 1e-6), with a pitch of 3.6 it takes
    0.0105 % more (0.0086 %; the lead angle of the arcs is 4.29 to 6.05 degrees in place of 5.45).

    Parameters
    ----------
    radius, pitch
        Radius and rise per turn, units of length.
    turns
        Their number, positive, not necessarily whole.
    arcs_per_turn
        Number of arcs (elements) in each turn, at least 3; with part of a turn as many as make arcs no longer.
    phase
        Angle of the start, from x towards y, degrees.
    left
        Whether it is left-handed: clockwise, seen from above, while it rises.
    """
    _positive("centre line radius", radius)
    if not np.isfinite(pitch):
        raise InputError(f"pitch: got {pitch}, need a finite length")
    expect("helix: turns", turns, float)
    expect("helix: arcs a turn", arcs_per_turn, int | None)
    if not 0.0 < turns < np.inf:
        raise InputError(f"helix: got {turns:g} turns, need a positive number")
    if arcs_per_turn is not None and arcs_per_turn < 3:
        raise InputError(f"helix: got {arcs_per_turn} arcs a turn, need at least 3")
    each = HELIX_ELEMENTS if arcs_per_turn is None else int(arcs_per_turn)
    if turns * each > MAX_ELEMENTS:
        raise InputError(f"helix: {int(turns * each)!s:.20} arcs are too many; at most {MAX_ELEMENTS}")
    count, angle = max(1, int(np.ceil(turns * each - 1e-9))), 2.0 * np.pi * turns
    if arcs_per_turn is not None:
        return _arcs(radius, pitch, angle, count, phase, left)

    knots = np.repeat(np.arange(count + 1.0), [_HELIX_DEGREE + 1, *[1] * (count - 1), _HELIX_DEGREE + 1])
    axis = Axis(_HELIX_DEGREE, knots, np.ones(count + _HELIX_DEGREE))
    u = np.linspace(0.0, count, _HELIX_POINTS * count + 1)
    turned = angle / count * u
    radial, _ = _around(turned, phase, left)
    rise = pitch / (2.0 * np.pi)
    centers = nearest(axis, u, radius * radial + (rise * turned)[:, None] * np.array([0.0, 0.0, 1.0]))

    def frames(parameters: Array) -> Array:
        return _frenet(*_around(angle / count * parameters, phase, left), np.arctan2(rise, radius))[:, :, :2]

    off = _off_helix(axis, centers, radius, rise)
    return CenterLine(axis, centers, frames=frames, deviation=off)


def _off_helix(axis: Axis, centers: Array, radius: float, rise: float) -> float:
    """Return the largest distance between a curve and the helix that rises by so much a radian, to first order."""
    where = _places(axis, centers, 0)
    angle = np.unwrap(np.arctan2(where[:, 1], where[:, 0]))
    low = where[:, 2] - where[0, 2] - rise * np.abs(angle - angle[0])
    return float(np.hypot(np.hypot(*where[:, :2].T) - radius, low * np.cos(np.arctan2(rise, radius))).max())


def _places(axis: Axis, centers: Array, least: int = _PLACES) -> Array:
    """Return so many places of a curve at least, and so many of each element, ``(t, 3)``."""
    u = np.append(inside(axis, max(_FEWEST, least // axis.elements)).ravel(), axis.breaks)
    return evaluate(axis, centers, np.sort(u))[0]


def _around(turned: Array, phase: float, left: bool) -> tuple[Array, Array]:
    """Return the radial and the tangential direction after so much of a turn, radians, ``(t, 3)`` each."""
    sense = -1.0 if left else 1.0
    angle = np.radians(phase) + sense * turned
    cos, sin, zero = np.cos(angle), np.sin(angle), np.zeros(angle.size)
    return np.stack([cos, sin, zero], axis=1), sense * np.stack([-sin, cos, zero], axis=1)


def _frenet(radial: Array, tangential: Array, slope: float) -> Array:
    """Return the radial direction, the one normal to it and to the tangent, and the tangent, as columns."""
    tangent = np.cos(slope) * tangential + np.sin(slope) * np.array([0.0, 0.0, 1.0])
    (a, b, c), (d, e, f) = tangent.T, radial.T
    across = np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)
    return np.stack([radial, across, tangent], axis=2)


def _arcs(
    radius: float, pitch: float, angle: float, arcs: int, phase: float, left: bool, closed: bool = False
) -> CenterLine:
    """Return a helix of rational quadratic arcs over an angle in radians (see `helix`)."""
    knots = np.concatenate([[0.0], np.repeat(np.arange(arcs + 1.0), 2), [arcs]])
    half = 0.5 * angle / arcs
    turned = half * np.arange(2 * arcs + 1)
    weights = np.where(np.arange(2 * arcs + 1) % 2 == 1, np.cos(half), 1.0)
    radial, tangential = _around(turned, phase, left)
    centers = radius * radial / weights[:, None]
    centers[:, 2] = pitch * turned / (2.0 * np.pi)
    rotations = _frenet(radial, tangential, float(np.arctan2(pitch, 2.0 * np.pi * radius)))
    spread = np.stack([1.0 / weights, 1.0 / weights, np.ones(weights.size)], axis=1)
    stretches = rotations.swapaxes(1, 2) @ (spread[:, :, None] * rotations)
    axis = Axis(2, knots, weights)
    off = _off_helix(axis, centers, radius, pitch / (2.0 * np.pi))
    return CenterLine(axis, centers, rotations, stretches, closed=closed, deviation=off)


def polyline(
    points: Numbers,
    tolerance: float | None = None,
    closed: bool = False,
    *,
    normal: Numbers | None = None,
    fillet: float | None = None,
) -> CenterLine:
    """Return a smooth line (cubic, C2) from which no point is farther than a tolerance, or one with fillets at corners.

    The smooth one has as few elements as will do; an open one passes through its first and its last point.  Between
    points it strays from the polyline by half the longest chord about at most.  Its frame turns about the line as
    little as can be (`isorod.geometry.frames`); that of a closed one is turned back evenly, so that the last section is
    the first.  A rod along it is warned of where a corner of more than 30 degrees, or one among straight sides, is
    rounded by a hundredth of the radius and more.

    With a fillet it is straight from point to point, exactly, and an arc of that radius at each.

    Parameters
    ----------
    points
        Shape ``(m, 3)``, ``m >= 2``, at least 3 distinct ones of a closed line, whose first may be repeated.
    tolerance
        Of a smooth line, units of length; 0: it passes through all points.
    closed
        Whether it goes on from the last point to the first.
    normal
        Vector ``(3,)`` towards which a section's x points at the start (see `Frames`).
    fillet
        Of straight lines, the radius of the arcs between them, units of length; larger than that of the section.
    """
    given = _points("polyline", points, (None, 3))
    if fillet is not None:
        _positive("polyline: fillet", fillet)
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
    frames = Frames(axis, centers, None if normal is None else _points("normal", normal, (3,)), closed)
    tangent = centers[1:2] - centers[:1]
    first = np.concatenate([frames(axis.breaks[:1])[0], tangent.T / np.linalg.norm(tangent)], axis=1)
    rotations, stretches = fillets.tensors(pieces, first)
    if closed and np.abs(rotations[-1] - first).max() > 1e-9:
        # Carried round a line that is not plane, the frame has to be turned back evenly.
        return CenterLine(axis, centers, frames=frames, closed=True, stations=stations)
    return CenterLine(axis, centers, rotations, stretches, closed=closed, stations=stations)


def _off_points(places: Array, points: Array, closed: bool) -> tuple[float, str]:
    """Return how far a smooth line is from its points and the sides of their corners, and what brings it nearer."""
    off, sharp = reading.farthest(points, places), reading.coarse(points, closed)
    if sharp.size:
        beside = np.union1d(sharp, (sharp - 1) % len(points))
        wanted, where = reading.between(points, sharp, closed)
        side = np.searchsorted(np.sort(where), np.arange(len(wanted)), side="right") - 1
        bow = reading.farthest(wanted[np.isin(side, beside)], places)
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
        Anything with the attributes of one of them: ``degrees``, ``knot_vectors``, ``control_points`` (splinepy) or
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
    found = _numbers_of(curve, "control_points", "ctrlpts")
    if found.ndim != 2 or found.shape[1] not in (2, 3):
        raise InputError(f"nurbs: got control points of shape {found.shape}, need (m, 3) or (m, 2)")
    centers = np.pad(found, ((0, 0), (0, 3 - found.shape[1])))
    knots = _knots_of(curve)
    if knots is None:
        knots = np.repeat([0.0, 1.0], p + 1)
    weights = getattr(curve, "weights", None)
    known = weights is not None and np.size(weights) > 0
    axis = Axis(p, knots, np.asarray(weights, dtype=float).ravel() if known else np.ones(len(centers)))
    if len(centers) != axis.count:
        raise InputError(f"nurbs: got {len(centers)} control points, need {axis.count} for the degree and the knots")
    _points("nurbs", centers, (None, 3))
    return _framed(axis, centers, normal, closed, None)


def _framed(axis: Axis, centers: Array, normal: Numbers | None, closed: bool, stations: Array | None) -> CenterLine:
    """Return the line with frames that turn as little as can be, refused where it has a corner."""
    towards = None if normal is None else _points("normal", normal, (3,))
    frames = Frames(axis, centers, towards, closed)
    frames.check()
    return CenterLine(axis, centers, frames=frames, closed=closed, stations=stations)


def _positive(name: str, value: float) -> None:
    positive(name, value)
    representable(name, value)


def _points(name: str, values: Numbers, shape: tuple[int | None, ...]) -> Array:
    """Return finite numbers of a shape, in which None stands for any number."""
    found = numbers(name, values)
    wanted = (
        "(" + ", ".join("m" if size is None else str(size) for size in shape) + ("," if len(shape) == 1 else "") + ")"
    )
    if found.ndim != len(shape) or any(size not in (None, have) for size, have in zip(shape, found.shape, strict=True)):
        raise InputError(f"{name}: got shape {found.shape}, need {wanted}")
    good = np.isfinite(found)
    if not good.all():
        where = f"point {np.argwhere(~good)[0][0]}: " if len(shape) > 1 else ""
        raise InputError(f"{name}: {where}got {found[~good][0]}, need finite numbers")
    return found


def _numbers_of(curve: Any, *names: str) -> Array:
    """Return the numbers in the first of some attributes that there is."""
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
    one = getattr(curve, "knotvector", None) if several is None else several[0]
    return None if one is None else np.array(list(one), dtype=float)
