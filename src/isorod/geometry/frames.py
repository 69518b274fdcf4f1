"""Rotation-minimising frames along a curve, and its arc length."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry.axis import Axis
from isorod.geometry.fitting import evaluate

# Samples of each element, from which a frame is transported to the parameters in between. The angle's error is of
# fourth order: 4e-8 rad over a turn of a helix as steep as it is wide, of 8 elements.
_SAMPLES = 16

# Largest corner of a centre line, radians.
_CORNER = 5e-4


@dataclass(frozen=True, eq=False)
class Frames:
    """Rotation-minimising frames of a curve, by double reflection (Wang, Jüttler, Zheng, Liu, ACM TOG 27(1), 2008).

    Parameters
    ----------
    axis, centers
        The curve: control points ``(axis.count, 3)``.
    normal
        Vector ``(3,)``, whose component normal to the curve at its start is the first direction there; by default that
        is x under the smallest rotation that takes z to the tangent.
    closed
        Whether the frame's angle after a turn is corrected evenly along the length, so that the last is the first.
    """

    axis: Axis
    centers: Array
    normal: Array | None = None
    closed: bool = False

    def __call__(self, u: Array) -> Array:
        """Return the first and the second direction at parameters ``(t,)``, as columns, shape ``(t, 3, 2)``."""
        samples, places, tangents, carried, bend = self._carried
        k = np.clip(np.searchsorted(samples, u, side="right") - 1, 0, samples.size - 2)
        where, tangent = self._along(u)
        first = _reflected(places[k], where, tangents[k], tangent, carried[k])
        second = np.cross(tangent, first)
        angle = (bend / self.length.total * self.length(u))[:, None]
        turned = np.cos(angle) * first + np.sin(angle) * second
        return np.stack([turned, np.cross(tangent, turned)], axis=2)

    def check(self) -> None:
        """Raise `InputError` if the curve stands still, has a corner, or is closed but does not end as it begins."""
        self._along(self.axis.evenly(_SAMPLES))
        breaks, nudge = self.axis.breaks, 1e-9 * np.diff(self.axis.breaks)
        before, after = self._along(breaks[1:] - nudge)[1], self._along(breaks[:-1] + nudge)[1]
        turn = np.linalg.norm(np.roll(after, -1, axis=0) - before, axis=1)
        if self.closed:
            gap, size = np.linalg.norm(self.centers[-1] - self.centers[0]), np.ptp(self.centers)
            if gap > 1e-9 * size:
                raise InputError(f"closed centre line: the end is {gap:.3g} away from the start; they must coincide")
        else:
            turn = turn[:-1]
        if turn.size and turn.max() > _CORNER:
            k = int(np.argmax(turn))
            angle = np.degrees(2.0 * np.arcsin(0.5 * min(2.0, turn[k])))
            raise InputError(
                f"centre line: corner of {angle:.3g} degrees at u = {breaks[k + 1]:.4g}; it must be smooth"
            )

    @cached_property
    def length(self) -> "ArcLength":
        """The arc length up to a parameter."""
        return ArcLength(self.axis, self.centers)

    @cached_property
    def _carried(self) -> tuple[Array, Array, Array, Array, float]:
        """Return samples' parameters, places, tangents and first directions, and the angle that closes the curve."""
        samples = self.axis.evenly(_SAMPLES)
        places, tangents = self._along(samples)
        # Rotation of each step relative to arbitrary directions; their sum is the frame's.
        aside = _aside(tangents)
        above = np.cross(tangents, aside)
        moved = _reflected(places[:-1], places[1:], tangents[:-1], tangents[1:], aside[:-1])
        steps = np.arctan2(np.einsum("ta,ta->t", moved, above[1:]), np.einsum("ta,ta->t", moved, aside[1:]))
        start = self._start(tangents[0])
        angle = np.arctan2(start @ above[0], start @ aside[0]) + np.concatenate([[0.0], np.cumsum(steps)])
        carried = np.cos(angle)[:, None] * aside + np.sin(angle)[:, None] * above
        bend = np.arctan2(np.cross(tangents[0], carried[-1]) @ start, carried[-1] @ start) if self.closed else 0.0
        return samples, places, tangents, carried, float(bend)

    def _along(self, u: Array) -> tuple[Array, Array]:
        """Return places and unit tangents ``(t, 3)``."""
        where, slope = evaluate(self.axis, self.centers, u)
        speed = np.linalg.norm(slope, axis=1)
        if not speed.min() > 1e-6 * self.length.pace:
            raise InputError(
                f"centre line: it stands still at u = {u[np.argmin(speed)]:.4g} and has no direction there"
            )
        return where, slope / speed[:, None]

    def _start(self, tangent: Array) -> Array:
        """Return the first direction at the start."""
        if self.normal is None:
            x, y, z = tangent
            return (
                np.array([1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), -x]) if z > -0.999 else _aside(tangent[None])[0]
            )
        across = self.normal - (self.normal @ tangent) * tangent
        size = np.linalg.norm(across)
        if not size > 1e-6 * np.linalg.norm(self.normal):
            raise InputError(f"normal: {_vector(self.normal)} runs along the centre line's start; take another")
        result: Array = across / size
        return result


class ArcLength:
    """The arc length of a curve, control points ``(axis.count, 3)``, from its start up to parameters."""

    def __init__(self, axis: Axis, centers: Array) -> None:
        self.u = axis.evenly(_SAMPLES)
        # Simpson's rule between samples.
        middle = 0.5 * (self.u[1:] + self.u[:-1])
        self.speed, between = (np.linalg.norm(evaluate(axis, centers, u)[1], axis=1) for u in (self.u, middle))
        step = np.diff(self.u) / 6.0 * (self.speed[:-1] + 4.0 * between + self.speed[1:])
        self.length = np.concatenate([[0.0], np.cumsum(step)])
        self.total = float(self.length[-1])
        # Mean length per unit of the parameter.
        self.pace = self.total / float(self.u[-1] - self.u[0])

    def __call__(self, u: Array) -> Array:
        """Return the lengths ``(t,)`` at parameters ``(t,)``."""
        k = np.clip(np.searchsorted(self.u, u, side="right") - 1, 0, self.u.size - 2)
        h = self.u[k + 1] - self.u[k]
        s = (u - self.u[k]) / h
        # Hermite's cubic.
        low, high, rise = h * self.speed[k], h * self.speed[k + 1], self.length[k + 1] - self.length[k]
        result: Array = self.length[k] + s * (low + s * (3.0 * rise - 2.0 * low - high + s * (low + high - 2.0 * rise)))
        return result


def _reflected(start: Array, end: Array, tangent: Array, last: Array, vector: Array) -> Array:
    """Return vectors transported between places: reflected by the chord, then so that tangents agree."""

    def mirror(vectors: Array, normal: Array) -> Array:
        square = np.einsum("ta,ta->t", normal, normal)
        factor = 2.0 * np.einsum("ta,ta->t", normal, vectors) / np.where(square > 0.0, square, 1.0)
        return vectors - factor[:, None] * normal

    chord = end - start
    # Without a chord there is no rotation: any direction along the curve serves.
    chord = np.where(np.any(chord, axis=1)[:, None], chord, tangent)
    carried = mirror(vector, chord)
    return mirror(carried, last - mirror(tangent, chord))


def _aside(tangents: Array) -> Array:
    """Return a unit vector normal to each tangent."""
    least = np.eye(3)[np.argmin(np.abs(tangents), axis=1)]
    across = np.cross(np.cross(tangents, least), tangents)
    result: Array = across / np.linalg.norm(across, axis=1, keepdims=True)
    return result


def _vector(values: Array) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
