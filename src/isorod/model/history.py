"""Factors by time of loads and of motions of supports."""

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isorod.arrays import Array, Numbers
from isorod.errors import Checked, InputError, numbers


@dataclass(frozen=True)
class TimeTable:
    """A factor by time, linear between its points, constant before the first and after the last.

    Attributes
    ----------
    times, factors
        The points; at two of the same time the factor jumps.
    """

    times: tuple[float, ...]
    factors: tuple[float, ...]

    @classmethod
    def of(cls, given: "TimeTable | Numbers") -> "TimeTable":
        """Return the table of rows ``[time, factor]``; raises `InputError` for rows that are none."""
        if isinstance(given, TimeTable):
            return given
        rows = numbers("history", given)
        if rows.ndim != 2 or rows.shape[1] != 2 or not rows.size:
            raise InputError(f"history: got shape {rows.shape}, need rows [time, factor], as [[0, 0], [0.1, 1]]")
        if not np.isfinite(rows).all():
            raise InputError(f"history: row {np.argmin(np.isfinite(rows).all(axis=1))} is not finite")
        back = np.flatnonzero(np.diff(rows[:, 0]) < 0.0)
        if back.size:
            k = int(back[0])
            raise InputError(
                f"history: times run back from {rows[k, 0]:g} to {rows[k + 1, 0]:g} (row {k + 1}); need them to rise"
            )
        return cls(tuple(rows[:, 0].tolist()), tuple(rows[:, 1].tolist()))

    @property
    def jumps(self) -> bool:
        """Whether the factor jumps."""
        return bool((np.diff(self.times) == 0.0).any())

    def _interval(self, time: float, before: bool) -> tuple[int, int]:
        """Return the points at both ends of a time's interval: at a point the interval after it, or before it."""
        k = int(np.searchsorted(self.times, time, "left" if before else "right"))
        return max(k - 1, 0), min(k, len(self.times) - 1)

    def at(self, time: float, before: bool = False) -> float:
        """Return the factor at a time; at a jump its value after it, or ``before``."""
        first, last = self._interval(time, before)
        begin, end = self.factors[first], self.factors[last]
        # At a point its factor exactly: rounding would look like a jump there.
        return end if time == self.times[last] else begin + (time - self.times[first]) * self.slope(time, before)

    def slope(self, time: float, before: bool = False) -> float:
        """Return the derivative of the factor after a time, or ``before``."""
        first, last = self._interval(time, before)
        if self.times[first] == self.times[last]:
            return 0.0
        return (self.factors[last] - self.factors[first]) / (self.times[last] - self.times[first])

    def integral(self, begin: float, end: float) -> float:
        """Return the exact integral of the factor over a time interval."""
        inner = [time for time in self.times if begin < time < end]
        ends = np.array([begin, *inner, end])
        values = [0.5 * (self.at(a) + self.at(b, True)) for a, b in pairwise(ends)]
        return float(np.diff(ends) @ values)

    def mean(self, begin: float, end: float) -> float:
        """Return the mean of the factor over a time, or the factor at it where both ends are one."""
        return self.at(begin) if begin == end else self.integral(begin, end) / (end - begin)


@dataclass(frozen=True)
class InTime(Checked):
    """What may have a history.

    Parameters
    ----------
    history
        The factor by time: rows of time and factor, shape ``(n, 2)``, linear between them; in motions constant after
        the last.  In statics it needs an end time, which it must reach.
    """

    history: "TimeTable | Numbers | None" = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.history is not None:
            self._set(history=TimeTable.of(self.history))

    def factor(self, begin: float, end: float) -> float:
        """Return the mean of the factor over a time, or the factor at it where both ends are one."""
        return self.history.mean(begin, end) if isinstance(self.history, TimeTable) else 1.0


@dataclass(frozen=True)
class Clock:
    """The factor of a support's motion by time.

    Attributes
    ----------
    table
        The factor, or None: always 1.
    spins
        Whether the table is that of the factor's rate, which is 1 without a table.
    """

    table: TimeTable | None = None
    spins: bool = False

    @property
    def moves(self) -> bool:
        """Whether there is any motion."""
        return self.spins or self.table is not None

    def at(self, time: float) -> float:
        """Return the factor."""
        if self.spins:
            return time if self.table is None else self.table.integral(0.0, time)
        return 1.0 if self.table is None else self.table.at(time)

    def rate(self, time: float, before: bool) -> float:
        """Return the factor's rate after a time, or ``before``."""
        if self.spins:
            return 1.0 if self.table is None else self.table.at(time, before)
        return 0.0 if self.table is None else self.table.slope(time, before)

    def acceleration(self, time: float) -> float:
        """Return the derivative of the rate: at its kinks the mean of before and after."""
        if not self.spins or self.table is None:
            return 0.0
        return 0.5 * (self.table.slope(time) + self.table.slope(time, True))


class Times(NamedTuple):
    """Times along a model's load path.

    Attributes
    ----------
    path, times
        Path parameters, ascending from 0 to 1, and the times there, constant where tables jump, ``(m,)`` each.
    ramp
        Factor over the path of what has no history.
    of
        The model without times.
    """

    path: Array
    times: Array
    ramp: TimeTable
    of: Any

    @property
    def end(self) -> float:
        """The end time."""
        return float(self.times[-1])

    def time(self, place: float) -> float:
        """Return the time at a path parameter."""
        return float(np.interp(place, self.path, self.times))

    def place(self, time: float) -> float:
        """Return the path parameter at a time; at a jump the one after it."""
        k = min(max(int(np.searchsorted(self.times, time, "right")) - 1, 0), len(self.times) - 2)
        gap = self.times[k + 1] - self.times[k]
        fraction = (time - self.times[k]) / gap if gap else 1.0
        return float(self.path[k] + fraction * (self.path[k + 1] - self.path[k]))


def clock_of(history: "TimeTable | Numbers | None", spins: bool = False) -> Clock:
    """Return the clock of a support."""
    return Clock(history if isinstance(history, TimeTable) else None, spins)


def rigid_velocity(
    positions: Array, is_control_point: NDArray[np.bool_], velocity: Numbers, spin: Numbers, center: Numbers
) -> Array:
    """Return velocities ``(nodes, 3)`` of nodes in a rigid motion.

    Parameters
    ----------
    positions, is_control_point
        Those of `isorod.space.space.Space`, ``(nodes, 3)`` and ``(nodes,)``.
    velocity, spin, center
        Velocity of a point, angular velocity about it, radians per time, and the point, ``(3,)`` each.
    """
    arms = positions - is_control_point[:, None] * np.asarray(center, dtype=float)
    moved = is_control_point[:, None] * np.asarray(velocity, dtype=float)
    return np.asarray(moved + np.cross(np.asarray(spin, dtype=float), arms))
