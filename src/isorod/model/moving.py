"""Motions of rigid obstacles: along a path, and about an axis that moves with it."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.errors import Checked, InputError, finite, numbers
from isorod.tensors import cross, rotation

Vector = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class ObstacleMotion(Checked):
    """A rigid motion: the point ``x`` of an obstacle at rest is at ``move + center + R(angle) (x - center)``.

    Parameters
    ----------
    move
        Displacement at load factor 1, ``(3,)``, linear in the load factor; or a path, rows of load factor, in motions
        of time, and displacement, linear between them: ``[[0, 0, 0, 0], [0.5, 0, 0, -1], [1, 2, 0, -1]]``.
    angle
        Angle about the axis at load factor 1, radians, in scene files degrees; whole turns count.  Or rows of load
        factor or time, and angle: ``[[0, 0], [2, 720]]``.
    axis
        ``"x"``, ``"y"``, ``"z"``, or a direction; where not given that of a cylinder.
    center
        A point of the axis, which moves with the obstacle; where not given its own ``point`` or ``center``.

    Raises
    ------
    InputError
        If nothing moves, rows do not begin with zeros or do not ascend, or an axis is missing.

    Attributes
    ----------
    plain
        Whether it is linear in the load factor: neither is given by rows.
    """

    plain: ClassVar[bool]
    move: Numbers = (0.0, 0.0, 0.0)
    angle: Numbers = 0.0
    axis: Literal["x", "y", "z"] | Vector | None = None
    center: Vector | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.move, self.angle
        self._set(plain=any(np.ndim(one) == k and np.any(one) for one, k in zip(given, (1, 0), strict=True)))
        for name, columns in (("move", 3), ("angle", 1)):
            self._set(**{name: _rows(name, getattr(self, name), columns)})
        if not (self._moves or self._turns):
            raise InputError("motion: move and angle are zero; need a motion, or leave it out")
        if not isinstance(self.axis, str | None):
            finite("motion: axis", self.axis)
            if not np.any(self.axis):
                raise InputError(f"motion: axis: got {self.axis}, need a direction")
        if self.axis is not None and not self._turns:
            raise InputError("motion: axis is given, but no angle")
        if self.center is not None:
            finite("motion: center", self.center)

    @property
    def _moves(self) -> bool:
        return bool(np.any(np.asarray(self.move)[:, 1:]))

    @property
    def _turns(self) -> bool:
        return bool(np.any(np.asarray(self.angle)[:, 1:]))

    def about(self, center: Vector | None, axis: Vector | None = None) -> "ObstacleMotion":
        """Return the motion with an obstacle's own center and axis where none are given."""
        motion = copy(self)
        motion._set(center=center if self.center is None else self.center)
        if self.axis is None and self._turns:
            motion._set(axis=axis)
        for name in ("axis", "center"):
            if motion._turns and getattr(motion, name) is None:
                raise InputError(f"motion: {name} is missing: the obstacle turns, and has none of its own")
        return motion

    @property
    def direction(self) -> Array:
        """Unit vector along the axis; zero where it does not turn."""
        if self.axis is None:
            return np.zeros(3)
        axis = np.eye(3)["xyz".index(self.axis)] if isinstance(self.axis, str) else np.array(self.axis, dtype=float)
        return np.asarray(axis / np.linalg.norm(axis))

    @property
    def middle(self) -> Array:
        """The point that is turned about, at rest."""
        return np.zeros(3) if self.center is None else np.array(self.center, dtype=float)

    @cached_property
    def track(self) -> Array:
        """Load factor or time, displacement and angle, linear between rows, shape ``(m, 5)``."""
        move, angle = np.asarray(self.move, dtype=float), np.asarray(self.angle, dtype=float)
        when = np.union1d(move[:, 0], angle[:, 0])
        columns = [np.interp(when, move[:, 0], move[:, 1 + a]) for a in range(3)]
        return np.column_stack([when, *columns, np.interp(when, angle[:, 0], angle[:, 1])])

    def at(self, when: float) -> tuple[Array, Array]:
        """Return ``R`` and ``c`` at a load factor or time: a point at ``x`` at rest is at ``R x + c``."""
        track = self.track
        move = np.array([np.interp(when, track[:, 0], track[:, 1 + a]) for a in range(3)])
        turned = rotation(np.interp(when, track[:, 0], track[:, 4]) * self.direction)
        return turned, move + self.middle - turned @ self.middle

    def back(self, places: Array, when: float) -> Array:
        """Return positions at rest of points at ``places`` ``(..., 3)`` at a load factor or time."""
        turned, moved = self.at(when)
        return np.asarray((places - moved) @ turned)

    def rates(self, places: Array) -> Array:
        """Return the obstacle's velocity by the load factor at its end, at places ``(m, 3)``."""
        track = self.track
        if track[-1, 0] < 1.0:
            return np.zeros_like(places)
        rate = (track[-1] - track[-2])[1:] / (track[-1, 0] - track[-2, 0])
        arms = places - self.middle - track[-1, 1:4]
        return np.asarray(rate[:3] + arms @ cross(rate[3] * self.direction).T)

    def fastest(self, when: float) -> float:
        """Return the derivative of its angle by the load factor, after a load factor, radians."""
        track = self.track
        k = int(np.searchsorted(track[:, 0], when, side="right"))
        if k == len(track):
            return 0.0
        change = track[k] - track[k - 1]
        return float(abs(change[4]) / change[0])


def refuse_late(motions: Sequence[ObstacleMotion | None]) -> None:
    """Raise `InputError` if a motion goes on after load factor 1."""
    for index, motion in enumerate(motions):
        if motion is not None and motion.track[-1, 0] > 1.0 + 1e-12:
            raise InputError(
                f"contact {index}: motion of the obstacle: got rows up to {motion.track[-1, 0]:g}, need load factors "
                "up to 1 in statics"
            )


def _rows(name: str, given: Numbers, columns: int) -> Array:
    """Return rows of load factor or time and displacement or angle."""
    rows = numbers(f"motion: {name}", given)
    shape = "(3,)" if columns == 3 else "a number"
    if rows.shape == (() if columns == 1 else (3,)):
        rows = np.column_stack([[0.0, 1.0], np.outer([0.0, 1.0], rows)])
    elif rows.ndim != 2 or rows.shape[1] != 1 + columns or len(rows) < 2:
        raise InputError(
            f"motion: {name}: got shape {rows.shape}, need {shape}, or two rows or more of load factor or time and "
            + ("displacement, (m, 4)" if columns == 3 else "angle, (m, 2)")
        )
    finite(f"motion: {name}", rows.ravel())
    if rows[0].any():
        raise InputError(f"motion: {name}: got a first row {rows[0].tolist()}, need zeros: the obstacle as it stands")
    late = np.flatnonzero(np.diff(rows[:, 0]) <= 0.0)
    if late.size:
        raise InputError(
            f"motion: {name}: row {late[0] + 1} is at {rows[late[0] + 1, 0]:g}, need load factors or times that rise"
        )
    return rows
