"""Centre lines as wire is bent: straight lines, arcs and helices, each starting at the end of the last."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isorod.arrays import Array, Numbers
from isorod.choices import chosen
from isorod.errors import Checked, InputError, finite
from isorod.geometry.axis import Axis
from isorod.geometry.coils import Winding, check_angle, wound
from isorod.geometry.frames import ArcLength, Frames
from isorod.geometry.given import check_length, finite_points
from isorod.geometry.line import CenterLine
from isorod.geometry.segments import Segment, joined, tensors
from isorod.tensors import rotation

# Largest gap between end and start of a closed chain, relative to its length, and between directions, radians.
_CLOSED = 1e-6


class Tip:
    """The end of a chain so far: its position, normal, binormal and tangent as columns, and the section's direction.

    Attributes
    ----------
    place, triad, first
        Shapes ``(3,)``, ``(3, 3)``, and ``(3,)`` of the section's first direction.
    """

    def __init__(self, place: Array, triad: Array) -> None:
        self.place, self.triad, self.first = place, triad, triad[:, 0]

    def roll(self, degrees: float) -> None:
        """Turn the plane of bending about the tangent; the section stays."""
        self.triad = rotation(np.radians(degrees) * self.triad[:, 2]) @ self.triad

    def frame(self) -> Array:
        """Return the section's directions and the tangent, as columns."""
        tangent = self.triad[:, 2]
        return np.stack([self.first, np.cross(tangent, self.first), tangent], axis=1)


@dataclass(frozen=True)
class Straight(Checked):
    """A straight line along the tangent.

    Parameters
    ----------
    length
        Units of length.
    """

    length: float

    def __post_init__(self) -> None:
        super().__post_init__()
        check_length("length", self.length)

    def line(self, tip: Tip) -> CenterLine:
        """Return the line from a tip on, and move the tip to its end."""
        points = np.array([[0.0], [0.5], [1.0]]) * self.length * tip.triad[:, 2]
        return _exact([Segment(tip.place + points, self.length)], tip)


@dataclass(frozen=True)
class Arc(Checked):
    """An arc of a circle in the plane of bending.

    Parameters
    ----------
    radius
        Units of length.
    angle
        Turn towards the normal, degrees, -360 to 360; negative: away from it.
    roll
        Rotation of the plane of bending about the tangent at its start, degrees, for this piece and later ones.
    """

    radius: float
    angle: float
    roll: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_length("radius", self.radius)
        check_angle("angle", self.angle)
        finite("roll", self.roll)

    def line(self, tip: Tip) -> CenterLine:
        """Return the line from a tip on, and move the tip to its end."""
        tip.roll(self.roll)
        sense, count = np.sign(self.angle), chosen(lambda: int(np.ceil(abs(self.angle) / 90.0 - 1e-9)))
        turn = np.radians(abs(self.angle)) / count
        about, to_centre = sense * tip.triad[:, 1], sense * self.radius * tip.triad[:, 0]
        centre = tip.place + to_centre
        segments = []
        for k in range(count):
            start, end = (centre - rotation(step * turn * about) @ to_centre for step in (k, k + 1))
            out = -rotation((k + 0.5) * turn * about) @ to_centre
            corner = centre + out / np.cos(0.5 * turn)
            segments.append(Segment(np.array([start, corner, end]), self.radius * turn, turn, about))
        return _exact(segments, tip)


@dataclass(frozen=True)
class Helix(Checked):
    """A helix that turns towards the normal; with a pitch it rises towards the binormal, tangent times normal.

    Parameters
    ----------
    radius, pitch
        As those of the curve `helix`: numbers, or lists of them; a negative pitch makes it left-handed.
    turns
        Their number, positive, not necessarily an integer.
    roll
        Rotation of the plane of bending about the tangent at its start, degrees, for this piece and later ones.
    """

    radius: Numbers
    pitch: Numbers
    turns: float
    roll: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._winding()
        finite("roll", self.roll)

    def _winding(self) -> Winding:
        return wound(self.radius, self.pitch, self.turns)

    def line(self, tip: Tip) -> CenterLine:
        """Return the line from a tip on, and move the tip to its end; its parameter is the length."""
        tip.roll(self.roll)
        winding = self._winding()
        helix = winding.line()
        start, end = winding.frames(np.array([0.0, self.turns]))
        # A helix bends towards its axis: normals point there.
        inwards = np.array([-1.0, -1.0, 1.0])
        turn = (tip.triad * inwards) @ start.T
        centers = tip.place + (helix.centers - helix.centers[0]) @ turn.T
        section = start.T @ turn.T @ tip.frame()[:, :2]
        length, last = ArcLength(helix.axis, helix.centers).total, helix.axis.breaks[-1]
        axis = Axis(helix.axis.degree, helix.axis.knots * (length / last), helix.axis.weights)

        def frames(u: Array) -> Array:
            directions: Array = turn @ winding.frames(self.turns / length * u) @ section
            return directions

        tip.place, tip.triad = centers[-1], (turn @ end) * inwards
        tip.first = (turn @ end @ section)[:, 0]
        return CenterLine(axis, centers, frames=frames, deviation=helix.deviation, cure=helix.cure)


def _exact(segments: Sequence[Segment], tip: Tip) -> CenterLine:
    """Return straight lines or arcs, and move the tip to their end."""
    rotations, stretches = tensors(segments, tip.frame())
    for segment in segments:
        tip.triad = rotation(segment.angle * segment.about) @ tip.triad
    tip.place, tip.first = segments[-1].points[2], rotations[-1][:, 0]
    return CenterLine(*joined(segments), rotations, stretches)


def chain(
    pieces: Sequence[Straight | Arc | Helix],
    *,
    start: Numbers = (0.0, 0.0, 0.0),
    direction: Numbers = (0.0, 0.0, 1.0),
    normal: Numbers | None = None,
    closed: bool = False,
) -> CenterLine:
    """Return a wire's line as it is bent: straight lines, arcs and helices, each tangent to the last.

    As on a bending machine the wire is fed, turned and bent (length, rotation, angle): an arc bends it towards the
    normal, in the plane of bending, which `roll` turns about the wire first.  The section does not turn about straight
    lines and arcs; along a helix it keeps its angle to the helix's normal.  Straight lines and arcs, and rods swept
    along them, are exact; helices are those of the curve `helix`.  Tangents are continuous where pieces meet.  The
    axis parameter is the length along the line, within a helix evenly in its turns.

    Parameters
    ----------
    pieces
        In order, each `{straight = ...}`, `{arc = ...}` or `{helix = ...}`.
    start
        Point ``(3,)``.
    direction
        Tangent at the start, ``(3,)``.
    normal
        Vector ``(3,)`` towards which the first arc bends, unless it has a roll, and a section's x points at the start;
        by default x under the smallest rotation that takes z to the direction.
    closed
        Whether its end is its start, with the same tangent; the section's rotation is then closed evenly if needed.
    """
    if not pieces:
        raise InputError("chain: got no pieces, need at least one")
    origin, along = finite_points("start", start, (3,)), finite_points("direction", direction, (3,))
    if not np.any(along):
        raise InputError("direction: got zeros, need a vector")
    towards = None if normal is None else finite_points("normal", normal, (3,))
    axis = Axis(1, np.array([0.0, 0.0, 1.0, 1.0]), np.ones(2))
    across = Frames(axis, np.array([origin, origin + along]), towards)(np.zeros(1))[0]
    begin = np.concatenate([across, along[:, None] / np.linalg.norm(along)], axis=1)
    tip = Tip(origin, begin)
    line = _in_a_row([piece.line(tip) for piece in pieces])
    if not closed:
        return line
    gap, bend = np.linalg.norm(tip.place - origin), np.linalg.norm(tip.triad[:, 2] - begin[:, 2])
    if gap > _CLOSED * line.axis.breaks[-1] or bend > _CLOSED:
        raise InputError(
            f"closed: the end is {gap:.4g} away from the start, and its direction {np.degrees(bend):.3g} degrees; they "
            "must coincide"
        )
    line.centers[-1] = line.centers[0]
    if np.abs(tip.frame() - begin).max() > _CLOSED:
        return replace(
            line, rotations=None, stretches=None, frames=Frames(line.axis, line.centers, begin[:, 0], True), closed=True
        )
    return replace(line, closed=True)


def _in_a_row(lines: Sequence[CenterLine]) -> CenterLine:
    """Return lines joined end to end, each beginning at a weight of 1 where the last one ended."""
    degree = max(line.axis.degree for line in lines)
    axes = [line.axis.refine(1, degree) for line in lines]
    starts = np.concatenate([[0.0], np.cumsum([axis.breaks[-1] for axis in axes])])
    knots = [axis.knots[degree + 1 :] + start for axis, start in zip(axes, starts, strict=False)]
    # Joints have the degree as multiplicity.
    knots = [np.zeros(degree + 1), *(part[:-1] for part in knots), starts[-1:]]
    parts = [line.axis.transfer(axis, line.centers) for line, axis in zip(lines, axes, strict=True)]

    def row(several: Sequence[Array]) -> Array:
        return np.concatenate([several[0], *(part[1:] for part in several[1:])])

    axis = Axis(degree, np.concatenate(knots), row([part.weights for part in axes]))
    worst = max(lines, key=lambda line: line.deviation)
    if all(line.frames is None for line in lines):
        rotations, stretches = (row([getattr(line, name) for line in lines]) for name in ("rotations", "stretches"))
        return CenterLine(axis, row(parts), rotations, stretches, stations=starts)

    def frames(u: Array) -> Array:
        which = np.clip(np.searchsorted(starts, u, side="right") - 1, 0, len(lines) - 1)
        directions = np.empty((u.size, 3, 2))
        for k, (line, first) in enumerate(zip(lines, starts, strict=False)):
            here = which == k
            if here.any():
                directions[here] = line.directions(np.clip(u[here] - first, 0.0, line.axis.breaks[-1]))
        return directions

    return CenterLine(axis, row(parts), frames=frames, stations=starts, deviation=worst.deviation, cure=worst.cure)
