"""Centre lines of rods: straight ones and helices."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError, expect, whole_number
from isorod.geometry.axis import MAX_ELEMENTS, Axis
from isorod.geometry.rod import Rod


@dataclass(frozen=True, eq=False)
class CenterLine:
    """A centre line to sweep along: axis and, for each of its functions, ``C_j``, ``R_j``, ``S_j`` of eq. 13."""

    axis: Axis
    centers: Array
    rotations: Array | None = None
    stretches: Array | None = None

    def sweep(self, section: ArrayLike, closed: bool = False) -> Rod:
        """Return the rod whose section is the control polygon ``(n, 2)`` everywhere (see `Rod.sweep`)."""
        return Rod.sweep(section, self.axis, self.centers, self.rotations, self.stretches, closed)


def straight(
    length: float | None = None,
    breaks: Sequence[float] = (0.0, 1.0),
    degree: int = 2,
    continuity: int | None = None,
) -> CenterLine:
    """Return a straight line from the origin along z, whose height grows linearly with the axis parameter.

    Its control points stand at the Greville abscissae, the means of ``degree`` successive knots.

    Parameters
    ----------
    length
        Units of length; where not given the height is the way from the first break.
    breaks
        Distinct knots, ascending.
    degree
        Of the axis.
    continuity
        At the inner breaks, 0 to ``degree - 1``; the latter where not given.
    """
    if length is not None and not (np.isfinite(length) and length > 0.0):
        raise InputError(f"length: got {length:g}, need a positive length")
    if len(breaks) < 2:
        raise InputError(f"straight line: got {len(breaks)} breaks, need at least 2")
    smooth = degree - 1 if continuity is None else whole_number("continuity", continuity, 0, degree - 1)
    times = [degree + 1, *[degree - smooth] * (len(breaks) - 2), degree + 1]
    knots = np.repeat(np.array(breaks, dtype=float), times)
    axis = Axis(degree, knots, np.ones(knots.size - degree - 1))
    heights = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree).mean(axis=1) - knots[0]
    if length is not None:
        heights = length * heights / (knots[-1] - knots[0])
    return CenterLine(axis, heights[:, None] * np.array([0.0, 0.0, 1.0]))


def helix(radius: float, pitch: float, turns: int, arcs_per_turn: int = 4) -> CenterLine:
    """Return a helix about the z axis made of rational quadratic circular arcs, C0 at their joints.

    The section lies in the plane of the radial direction and the helix's binormal.  At the corner control point of an
    arc (weight ``cos(pi / arcs_per_turn)``) the part of every section vector that is normal to z is stretched by the
    inverse weight: with ``pitch = 0`` the swept ring is then an exact torus (Lu & Zhou 2011, Fig. 4).

    Parameters
    ----------
    radius, pitch
        Radius and rise per turn, units of length.
    turns, arcs_per_turn
        Whole numbers of turns, and of arcs (elements) in each; at least 1 and 3.
    """
    if not (np.isfinite(radius) and radius > 0.0):
        raise InputError(f"centre line radius: got {radius:g}, need a positive length")
    if not np.isfinite(pitch):
        raise InputError(f"pitch: got {pitch}, need a finite length")
    for name, count in (("turns", turns), ("arcs a turn", arcs_per_turn)):
        expect(f"helix: {name}", count, int)
    if turns < 1 or arcs_per_turn < 3:
        raise InputError(f"helix: got {turns} turns of {arcs_per_turn} arcs, need at least 1 turn of at least 3 arcs")
    arcs = int(turns * arcs_per_turn)
    if arcs > MAX_ELEMENTS:
        raise InputError(f"helix: {arcs} arcs are too many; at most {MAX_ELEMENTS}")
    knots = np.concatenate([[0.0], np.repeat(np.arange(arcs + 1.0), 2), [arcs]])
    count = 2 * arcs + 1
    phi = np.pi / arcs_per_turn * np.arange(count)
    corner = np.arange(count) % 2 == 1
    weights = np.where(corner, np.cos(np.pi / arcs_per_turn), 1.0)
    cos, sin, zero = np.cos(phi), np.sin(phi), np.zeros(count)

    centers = np.stack([radius * cos / weights, radius * sin / weights, pitch * phi / (2.0 * np.pi)], axis=1)
    slope = np.arctan2(pitch, 2.0 * np.pi * radius)
    radial = np.stack([cos, sin, zero], axis=1)
    tangential = np.stack([-sin, cos, zero], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    minus_binormal = np.sin(slope) * tangential - np.cos(slope) * up
    tangent = np.cos(slope) * tangential + np.sin(slope) * up
    rotations = np.stack([radial, minus_binormal, tangent], axis=2)
    spread = np.zeros((count, 3, 3))
    spread[:, 0, 0] = spread[:, 1, 1] = 1.0 / weights
    spread[:, 2, 2] = 1.0
    stretches = np.einsum("jba,jbc,jcd->jad", rotations, spread, rotations)
    return CenterLine(Axis(2, knots, weights), centers, rotations, stretches)
