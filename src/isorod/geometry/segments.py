"""Straight and circular segments in a row, exact as rational quadratic curves, with exact frames."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.geometry.axis import Axis
from isorod.tensors import rotation


class Segment(NamedTuple):
    """A straight line, or an arc: its three control points ``(3, 3)``, length, angle, and the axis of rotation."""

    points: Array
    length: float
    angle: float = 0.0
    about: Array = np.array([0.0, 0.0, 1.0])


def joined(segments: Sequence[Segment]) -> tuple[Axis, Array]:
    """Return the axis, whose parameter is the length, and control points ``(axis.count, 3)`` of segments in a row."""
    breaks = np.concatenate([[0.0], np.cumsum([s.length for s in segments])])
    knots = np.concatenate([breaks[:1], np.repeat(breaks, 2), breaks[-1:]])
    weights = np.ones(2 * len(segments) + 1)
    weights[1::2] = np.cos(0.5 * np.array([s.angle for s in segments]))
    return Axis(2, knots, weights), np.concatenate([segments[0].points[:1], *(s.points[1:] for s in segments)])


def tensors(segments: Sequence[Segment], first: Array) -> tuple[Array, Array]:
    """Return the control tensors ``R_j`` and ``S_j`` of frames that turn with the arcs, ``(2 segments + 1, 3, 3)``.

    Parameters
    ----------
    first
        The frame at the start, its columns the section's directions and the tangent ``(3, 3)``.
    """
    rotations, stretches = [first], [np.eye(3)]
    for segment in segments:
        half = rotation(0.5 * segment.angle * segment.about) @ rotations[-1]
        # Normal to the axis of the arc, a section's vectors are scaled like its control points.
        axial = np.outer(segment.about, segment.about)
        spread = axial + (np.eye(3) - axial) / np.cos(0.5 * segment.angle)
        rotations += [half, rotation(segment.angle * segment.about) @ rotations[-1]]
        stretches += [half.T @ spread @ half, np.eye(3)]
    return np.array(rotations), np.array(stretches)
