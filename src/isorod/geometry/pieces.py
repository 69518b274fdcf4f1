"""Straight lines and arcs that follow each other: exact, as rational quadratic curves, and so are frames along them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.geometry.axis import Axis
from isorod.tensors import rotation


class Piece(NamedTuple):
    """A straight line, or an arc: its three control points ``(3, 3)``, length, angle, and the axis it turns about."""

    points: Array
    length: float
    angle: float = 0.0
    about: Array = np.array([0.0, 0.0, 1.0])


def joined(pieces: Sequence[Piece]) -> tuple[Axis, Array]:
    """Return the axis, whose parameter is the length, and control points ``(axis.count, 3)`` of pieces in a row."""
    breaks = np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])])
    knots = np.concatenate([breaks[:1], np.repeat(breaks, 2), breaks[-1:]])
    weights = np.ones(2 * len(pieces) + 1)
    weights[1::2] = np.cos(0.5 * np.array([piece.angle for piece in pieces]))
    return Axis(2, knots, weights), np.concatenate([pieces[0].points[:1], *(piece.points[1:] for piece in pieces)])


def tensors(pieces: Sequence[Piece], first: Array) -> tuple[Array, Array]:
    """Return the control tensors ``R_j`` and ``S_j`` of frames that turn with the arcs, ``(2 pieces + 1, 3, 3)``.

    Parameters
    ----------
    first
        The frame at the start, its columns the section's directions and the tangent ``(3, 3)``.
    """
    rotations, stretches = [first], [np.eye(3)]
    for piece in pieces:
        half = rotation(0.5 * piece.angle * piece.about) @ rotations[-1]
        # Across the axis of the arc, a section's vectors go as its control points do.
        axial = np.outer(piece.about, piece.about)
        spread = axial + (np.eye(3) - axial) / np.cos(0.5 * piece.angle)
        rotations += [half, rotation(piece.angle * piece.about) @ rotations[-1]]
        stretches += [half.T @ spread @ half, np.eye(3)]
    return np.array(rotations), np.array(stretches)
