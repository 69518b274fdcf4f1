"""Rods of the cases about large deformation: straight ones and the shallow arch, circular sections of radius 1."""

import numpy as np

from isorod.geometry.axis import Axis
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle


def straight(length: float, points: int = 4) -> Rod:
    """Return a straight rod along z from the origin, one quadratic element."""
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    return Rod.sweep(circle(points), axis, np.outer([0.0, 0.5, 1.0], [0.0, 0.0, length]))


def arch(span: float, rise: float) -> Rod:
    """Return a parabolic arch in the x-z plane, one quadratic element."""
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    rotations = []
    for slope in (4.0 * rise / span, 0.0, -4.0 * rise / span):
        t, y = np.array([1.0, 0.0, slope]) / np.hypot(1.0, slope), np.array([0.0, 1.0, 0.0])
        rotations.append(np.stack([y, np.cross(t, y), t], axis=1))
    centers = np.array([[-0.5 * span, 0.0, 0.0], [0.0, 0.0, 2.0 * rise], [0.5 * span, 0.0, 0.0]])
    return Rod.sweep(circle(4), axis, centers, np.array(rotations))
