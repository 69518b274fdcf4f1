"""A centre line and the frames along it, and the rods swept along them."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import InputError, expect, numbers
from isorod.geometry.axis import Axis
from isorod.geometry.fitted import radius
from isorod.geometry.fitting import Field, evaluate, resolve
from isorod.geometry.frames import ArcLength
from isorod.geometry.reading import LARGE, Deviation
from isorod.geometry.rod import Rod, closing

Scale = float | Numbers | Callable[[Array], Numbers]

# Largest error of sections along a line, relative to their size. Most of it is tilt, 0.3 degrees, whose effect is of
# second order; sizes are right to 1e-3. A fifth of it takes twice the elements along a cubic spline, whose curvature
# has kinks at the knots.
TOLERANCE = 5e-3


@dataclass(frozen=True, eq=False)
class CenterLine:
    """A centre line to sweep along.

    Parameters
    ----------
    axis, centers
        The curve: control points ``(axis.count, 3)``.
    rotations, stretches
        If exact, the frames' control tensors ``R_j`` and ``S_j`` of eq. 13, ``(axis.count, 3, 3)``.
    frames
        Else a function of parameters ``(t,)``: the section's two directions, ``(t, 3, 2)``.
    closed
        Whether its end is its start.
    stations
        Parameters ``(m,)`` of the input points, at which the values of a list ``scale`` apply.
    deviation
        Its largest distance from the input, units of length.
    cure
        Remedy for a large deviation; empty where the line is as requested.
    """

    axis: Axis
    centers: Array
    rotations: Array | None = None
    stretches: Array | None = None
    frames: Field | None = None
    closed: bool = False
    stations: Array | None = None
    deviation: float = 0.0
    cure: str = ""

    def sweep(
        self,
        section: Numbers,
        closed: bool | None = None,
        *,
        scale: Scale = 1.0,
        twist: float = 0.0,
        end: Numbers | None = None,
        tolerance: float = TOLERANCE,
    ) -> Rod:
        """Return the rod whose section is the control polygon ``(n, 2)``.

        Knots are added where frames, scale and twist are not in the axis's space, until every section is within
        ``tolerance`` of its exact place, measured between the knots.

        Parameters
        ----------
        section
            Control polygon, shape ``(n, 2)``; constant unless one of the following is given.
        closed
            Whether the last section is the first; by default as the line.
        scale
            The section's size: a number, a function of axis parameters ``(t,)``, or several numbers, interpolated
            smoothly (C1) and without overshoot: one for each point of a polyline, or each end of a chain's pieces;
            for other lines evenly spaced in the parameter.
        twist
            Rotation of the last section relative to the first in addition to that of the frames, from its first
            direction to its second, degrees; evenly along the length.
        end
            Control polygon of the last section, with the same number of points; sections in between are interpolated
            linearly in the length.
        tolerance
            Largest error of sections, relative to the size of the largest.

        Raises
        ------
        InputError
            If a number is not positive or finite, shapes do not fit, the last section of a closed rod is not the first,
            or the frames jump.
        """
        closed = self.closed if closed is None else closed
        plain = isinstance(scale, Real) and not isinstance(scale, bool) and scale == 1.0 and twist == 0.0
        if self.frames is None and plain and end is None:
            rod = Rod.sweep(section, self.axis, self.centers, self.rotations, self.stretches, closed)
            return replace(rod, deviation=self._deviation([section], np.ones(1), 0.0))
        first = _polygon("section", section)
        last = first if end is None else _polygon("section at the end", end)
        if last.shape != first.shape:
            raise InputError(f"section at the end: got {len(last)} points, need the {len(first)} of the first")
        expect("twist", twist, float)
        if not np.isfinite(twist):
            raise InputError(f"twist: got {twist}, need a finite number of degrees")
        if not tolerance > 0.0:
            raise InputError(f"sweep: tolerance: got {tolerance:g}, need a positive fraction of the section's size")
        frames, size, length = self.directions, self._size(scale), ArcLength(self.axis, self.centers)

        def arms(u: Array) -> Array:
            fraction = length(u) / length.total
            angle = np.radians(twist) * fraction
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            turned = size(u)[:, None, None] * np.einsum("tak,klt->tal", frames(u), turn)
            polygons = first + fraction[:, None, None] * (last - first)
            result: Array = polygons @ turned.swapaxes(1, 2)
            return result

        sizes = size(self._fine())
        largest = max(np.abs(first).max(), np.abs(last).max()) * sizes.max()
        axis, offsets, off = resolve(self.axis, arms, tolerance * largest)
        centers = self.axis.transfer(axis, self.centers)
        points = centers[:, None, :] + offsets
        deviation = self._deviation([section] if end is None else [section, end], sizes, off)
        return Rod(axis, closing(points) if closed else points, closed, fitted=True, deviation=deviation)

    def _deviation(self, sections: Sequence[Numbers], sizes: Array, sweep: float) -> Deviation:
        """Return the deviation of a rod of these sections and sizes from the input; warn if that of the line is large.

        Sections have warned when they were made.
        """
        radii = [radius(_polygon("section", section)) for section in sections]
        errors = [getattr(section, "deviation", 0.0) for section in sections]
        off = max(error * half for error, half in zip(errors, radii, strict=True))
        line = self.deviation / (min(radii) * sizes.min())
        if self.cure and line >= LARGE:
            warnings.warn(
                f"centre line: its largest deviation is {self.deviation:.3g}, {line:.2g} of the section's radius; "
                f"{self.cure}",
                stacklevel=3,
            )
        placed = sweep / (max(radii) * sizes.max())
        if placed >= LARGE:
            warnings.warn(
                f"sections along the line: their largest deviation is {sweep:.3g}, {placed:.2g} of the radius; take a "
                "smaller tolerance of the sweep (section_tolerance), or a section about its own middle",
                stacklevel=3,
            )
        relative = max(line, *errors, placed)
        return Deviation(self.deviation, float(off * sizes.max()), sweep, float(relative))

    def directions(self, u: Array) -> Array:
        """Return the section's two directions at parameters ``(t,)``, ``(t, 3, 2)``, those of tensors with stretch."""
        if self.frames is not None:
            return self.frames(u)
        tensors = np.broadcast_to(np.eye(3), (self.axis.count, 3, 3))
        for given in (self.stretches, self.rotations):
            tensors = tensors if given is None else given @ tensors
        return evaluate(self.axis, tensors[:, :, :2], u)[0]

    def _fine(self) -> Array:
        """Return parameters, closely spaced."""
        u: Array = np.linspace(self.axis.breaks[0], self.axis.breaks[-1], 16 * self.axis.elements + 1)
        return u

    def _size(self, scale: Scale) -> Callable[[Array], Array]:
        """Return the section's size as a function of parameters ``(t,)``."""
        given = scale if callable(scale) else self._between(numbers("scale", scale))

        def size(u: Array) -> Array:
            result = numbers("scale", given(u))
            if result.shape not in ((), u.shape):
                raise InputError(
                    f"scale: the function gave shape {result.shape} for {u.size} parameters, need one each"
                )
            return np.broadcast_to(result, u.shape)

        u = self._fine()
        sizes = size(u)
        good = (sizes > 0.0) & np.isfinite(sizes)
        if not good.all():
            k = int(np.argmin(good))
            raise InputError(f"scale: got {sizes[k]:g} at u = {u[k]:.4g}, need positive numbers")
        return size

    def _between(self, given: Array) -> Callable[[Array], Array]:
        """Return a function of parameters ``(t,)`` that interpolates numbers."""
        if given.ndim == 0:
            return lambda u: np.full(u.shape, float(given))
        if given.ndim != 1 or given.size < 2:
            raise InputError(f"scale: got an array of shape {given.shape}, need a number or at least 2 in a row")
        good = (given > 0.0) & np.isfinite(given)
        if not good.all():
            k = int(np.argmin(good))
            raise InputError(f"scale: number {k} is {given[k]:g}, need positive numbers")
        # Imported late: only lists of sizes need it.
        from scipy.interpolate import PchipInterpolator

        places = np.linspace(self.axis.breaks[0], self.axis.breaks[-1], given.size)
        if self.stations is not None:
            places = self.stations
            # A closed polyline's first point is its last.
            missing = places.size - given.size
            if missing == 1 and self.closed:
                given = np.append(given, given[0])
            elif missing:
                raise InputError(
                    f"scale: got {given.size} numbers for {places.size - self.closed} points, need one each"
                )
        if not self.closed:
            return PchipInterpolator(places, given)
        # Periodic: one more point on either side.
        length = places[-1] - places[0]
        places = np.concatenate([[places[-2] - length], places, [places[1] + length]])
        return PchipInterpolator(places, np.concatenate([given[-2:-1], given, given[1:2]]))


def _polygon(name: str, points: Numbers) -> Array:
    polygon = numbers(name, points)
    if polygon.ndim != 2 or polygon.shape[1] != 2:
        raise InputError(f"{name}: got shape {polygon.shape}, need (n, 2)")
    return polygon
