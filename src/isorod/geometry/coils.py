"""Centre lines that wind about an axis: arcs, and helices whose radius and pitch may vary."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.choices import chosen
from isorod.errors import InputError, expect, numbers
from isorod.geometry.axis import MAX_ELEMENTS, Axis
from isorod.geometry.fitting import evaluate, inside, nearest
from isorod.geometry.given import check_length
from isorod.geometry.line import CenterLine

# Elements a turn, degree, and least-squares points an element of a helix that is not made of arcs.
HELIX_ELEMENTS = 8
_DEGREE = 4
_POINTS = 12

# Points of an element at which its deviation is measured.
_PLACES = 16

# The remedy in a warning.
_CURE = "a helix is no nearer: its length is right to 1e-6, but gaps to what it touches are off by so much"

Field = Callable[[Array], Array]


def arc(radius: float, angle: float, *, phase: float = 0.0) -> CenterLine:
    """Return an arc of a circle about the z axis in the plane of x and y: exact, and so is the torus swept along it.

    It is a helix without pitch made of equal rational quadratic arcs of at most 90 degrees.

    Parameters
    ----------
    radius
        Units of length.
    angle
        From start to end, degrees, -360 to 360; negative: clockwise seen from above.  A full turn is closed.
    phase
        Angle of the start, from x towards y, degrees.
    """
    check_length("centre line radius", radius)
    check_angle("arc: angle", angle)
    count = chosen(lambda: int(np.ceil(abs(angle) / 90.0 - 1e-9)))
    winding = Winding(_even(radius), _even(0.0), abs(angle) / 360.0, phase, angle < 0.0)
    return _arcs(winding, count, closed=abs(angle) == 360.0)


def check_angle(name: str, angle: float) -> None:
    """Raise `InputError` if an arc cannot turn by an angle, degrees."""
    expect(name, angle, float)
    if not 0.0 < abs(angle) <= 360.0:
        raise InputError(f"{name}: got {angle:g} degrees, need -360 to 360 and not 0")


def helix(
    radius: Numbers,
    pitch: Numbers,
    turns: float,
    arcs_per_turn: int | None = None,
    *,
    phase: float = 0.0,
    left: bool = False,
) -> CenterLine:
    """Return a helix about the z axis, the section in the plane of the radial direction and the helix's binormal.

    Radius and pitch may vary: conical and barrel springs, closed ends, and, without pitch, flat spirals.  Values are
    interpolated smoothly (C1) and without overshoot.

    A quartic spline, C3 (C1 at the values of a list), with 8 elements a turn, by least squares, its ends and their
    tangents exact: the lead angle is within 0.02 degrees of the true one everywhere (at the worst pitch, equal to the
    length of a turn; 0.003 on the spring of Lu & Zhou), the radius within 6e-5, 3e-7 in the mean.

    With ``arcs_per_turn`` rational quadratic circular arcs, C0 at their joints, as in Lu & Zhou (2011): at the corner
    control point of an arc (weight ``cos(pi / arcs_per_turn)``) the part of every section vector that is normal to z is
    stretched by the inverse weight: with ``pitch = 0`` the swept ring is then an exact torus (their Fig. 4).  With a
    pitch the wire lies on the cylinder, but rises unevenly: with 4 arcs a turn that spring's at 3.10 to 4.38 degrees
    in place of 3.95, an error that falls with the square of their number only.

    The wobble makes a spring softer by about its mean square: fully converged, the even helix takes 0.0057 % more force
    than 4 arcs (mean square of the wobble 0.0045 %, volumes equal within 1e-6), with a pitch of 3.6 it takes
    0.0105 % more (0.0086 %; the lead angle of the arcs is 4.29 to 6.05 degrees in place of 5.45).

    Parameters
    ----------
    radius, pitch
        Radius and rise per turn, units of length: a number, several at evenly spaced turns from the first to the
        last, or pairs ``[turn, value]``, the first at turn 0, the last at the last turn.
    turns
        Their number, positive, not necessarily an integer.
    arcs_per_turn
        Number of arcs (elements) in each turn, at least 3; for part of a turn as many as keep arcs no longer.
    phase
        Angle of the start, from x towards y, degrees.
    left
        Whether it is left-handed: clockwise, seen from above, while it rises.
    """
    winding = wound(radius, pitch, turns, phase, left)
    expect("helix: arcs a turn", arcs_per_turn, int | None)
    if arcs_per_turn is None:
        return winding.line()
    if arcs_per_turn < 3:
        raise InputError(f"helix: got {arcs_per_turn} arcs a turn, need at least 3")
    if winding.places.size > 2 or np.size(radius) > 1 or np.size(pitch) > 1:
        raise InputError("helix: arcs a turn: they go with one radius and one pitch")
    _check_count(turns * arcs_per_turn)
    return _arcs(winding, chosen(lambda: max(1, int(np.ceil(turns * arcs_per_turn - 1e-9)))))


class Along(NamedTuple):
    """A value that may vary over turns: itself, derivative and integral, functions of turns ``(t,)``; its places."""

    value: Field
    slope: Field
    integral: Field
    places: Array


@dataclass(frozen=True)
class Winding:
    """A curve that winds about the z axis; its parameter ``t`` is the turns, from 0 to `turns`."""

    radius: Along
    pitch: Along
    turns: float
    phase: float = 0.0
    left: bool = False

    @property
    def places(self) -> Array:
        """Turns between which it is smooth, ``(k,)``, both ends included."""
        given = np.concatenate([[0.0, self.turns], self.radius.places, self.pitch.places])
        return np.unique(np.round(given / self.turns, 12)) * self.turns

    def around(self, t: Array) -> tuple[Array, Array]:
        """Return the radial and the tangential direction, ``(t, 3)`` each."""
        sense = -1.0 if self.left else 1.0
        angle = np.radians(self.phase) + sense * 2.0 * np.pi * t
        cos, sin, zero = np.cos(angle), np.sin(angle), np.zeros(angle.size)
        return np.stack([cos, sin, zero], axis=1), sense * np.stack([-sin, cos, zero], axis=1)

    def points(self, t: Array) -> Array:
        """Return its points ``(t, 3)``."""
        result = self.radius.value(t)[:, None] * self.around(t)[0]
        result[:, 2] = self.pitch.integral(t)
        return result

    def slopes(self, t: Array) -> Array:
        """Return the derivatives of its points by turns, ``(t, 3)``."""
        radial, tangential = self.around(t)
        result = self.radius.slope(t)[:, None] * radial + 2.0 * np.pi * self.radius.value(t)[:, None] * tangential
        result[:, 2] = self.pitch.value(t)
        return result

    def frames(self, t: Array) -> Array:
        """Return the direction away from z, the one normal to it and to the tangent, and the tangent, as columns."""
        slopes = self.slopes(t)
        tangent = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
        radial = self.around(t)[0]
        first = radial - np.einsum("ta,ta->t", radial, tangent)[:, None] * tangent
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        (a, b, c), (d, e, f) = tangent.T, first.T
        across = np.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=1)
        return np.stack([first, across, tangent], axis=2)

    def line(self) -> CenterLine:
        """Return the spline, 8 elements a turn, its parameter proportional to turns."""
        places = self.places
        parts = chosen(lambda: np.maximum(1, np.ceil(HELIX_ELEMENTS * np.diff(places) - 1e-9).astype(int)))
        count = int(parts.sum())
        each = self.turns / count
        cuts = [a + (b - a) * np.arange(n) / n for a, b, n in zip(places[:-1], places[1:], parts, strict=True)]
        breaks = np.append(np.concatenate(cuts), self.turns) / each
        times = np.ones(count + 1, dtype=int)
        # Second derivatives jump at the values of a list.
        times[np.cumsum(parts)[:-1]] = _DEGREE - 1
        times[[0, -1]] = _DEGREE + 1
        knots = np.repeat(breaks, times)
        axis = Axis(_DEGREE, knots, np.ones(knots.size - _DEGREE - 1))
        u = np.append(axis.within(np.arange(_POINTS) / _POINTS).ravel(), breaks[-1])
        ends = each * self.slopes(np.array([0.0, self.turns]))
        centers = nearest(axis, u, self.points(each * u), ends)

        def frames(parameters: Array) -> Array:
            return self.frames(each * parameters)[:, :, :2]

        return CenterLine(axis, centers, frames=frames, deviation=self.off(axis, centers), cure=_CURE)

    def off(self, axis: Axis, centers: Array) -> float:
        """Return the largest distance between a curve and this one, to first order."""
        u = np.sort(np.append(inside(axis, _PLACES).ravel(), axis.breaks))
        where = evaluate(axis, centers, u)[0]
        angle = np.unwrap(np.arctan2(where[:, 1], where[:, 0]))
        t = np.clip(np.abs(angle - angle[0]) / (2.0 * np.pi), 0.0, self.turns)
        radius, rise = self.radius.value(t), self.pitch.value(t)
        low = where[:, 2] - where[0, 2] - self.pitch.integral(t)
        lead = np.arctan2(rise, 2.0 * np.pi * radius)
        return float(np.hypot(np.hypot(*where[:, :2].T) - radius, low * np.cos(lead)).max())


def wound(
    radius: Numbers, pitch: Numbers, turns: float, phase: float = 0.0, left: bool = False, *, name: str = "helix"
) -> Winding:
    """Return the winding of arguments of `helix`; raises `InputError`."""
    expect(f"{name}: turns", turns, float)
    if not 0.0 < turns < np.inf:
        raise InputError(f"{name}: got {turns:g} turns, need a positive number")
    _check_count(turns * HELIX_ELEMENTS)
    radii, rises = numbers("centre line radius", radius), numbers("pitch", pitch)
    for value in np.atleast_1d(radii if radii.ndim < 2 else radii[:, -1]):
        check_length("centre line radius", float(value))
    return Winding(_along("radius", radii, turns), _along("pitch", rises, turns), float(turns), phase, left)


def _along(name: str, values: Array, turns: float) -> Along:
    """Return a value over turns; raises `InputError` if it is not finite, or its turns do not rise from end to end."""
    if not np.isfinite(values).all():
        raise InputError(f"{name}: got {values[~np.isfinite(values)][0]}, need a finite length")
    if values.ndim == 0:
        return _even(float(values))
    if values.ndim > 2 or len(values) < 2 or (values.ndim == 2 and values.shape[1] != 2):
        raise InputError(f"{name}: got shape {values.shape}, need a number, 2 or more, or pairs of turn and number")
    places = np.linspace(0.0, turns, len(values)) if values.ndim == 1 else values[:, 0]
    if places[0] != 0.0 or abs(places[-1] - turns) > 1e-9 * turns or not (np.diff(places) > 0.0).all():
        raise InputError(f"{name}: got turns {', '.join(f'{t:g}' for t in places)}; they must rise from 0 to {turns:g}")
    # Imported late: only varying values need it.
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(places, values if values.ndim == 1 else values[:, 1])
    return Along(curve, curve.derivative(), curve.antiderivative(), places)


def _even(value: float) -> Along:
    return Along(lambda t: np.full(t.shape, value), np.zeros_like, lambda t: value * t, np.empty(0))


def _check_count(arcs: float) -> None:
    if arcs > MAX_ELEMENTS:
        raise InputError(f"helix: {int(arcs)!s:.20} arcs are too many; at most {MAX_ELEMENTS}")


def _arcs(winding: Winding, arcs: int, closed: bool = False) -> CenterLine:
    """Return an even winding as rational quadratic arcs (see `helix`)."""
    knots = np.concatenate([[0.0], np.repeat(np.arange(arcs + 1.0), 2), [arcs]])
    half = np.pi * winding.turns / arcs
    t = winding.turns * np.arange(2 * arcs + 1) / (2 * arcs)
    weights = np.where(np.arange(2 * arcs + 1) % 2 == 1, np.cos(half), 1.0)
    centers, rotations = winding.points(t), winding.frames(t)
    centers[:, :2] /= weights[:, None]
    spread = np.stack([1.0 / weights, 1.0 / weights, np.ones(weights.size)], axis=1)
    stretches = rotations.swapaxes(1, 2) @ (spread[:, :, None] * rotations)
    axis = Axis(2, knots, weights)
    return CenterLine(axis, centers, rotations, stretches, closed=closed, deviation=winding.off(axis, centers))
