"""Centre lines whose Python function takes an object that a file does not have."""

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np

from isorod.arrays import Numbers
from isorod.errors import InputError, whole_number
from isorod.geometry import center_line
from isorod.geometry.axis import MAX_DEGREE


def nurbs(
    points: Numbers,
    degree: int = 3,
    knots: Sequence[float] | None = None,
    weights: Sequence[float] | None = None,
    closed: bool = False,
    normal: Numbers | None = None,
) -> center_line.CenterLine:
    """Return the line of a NURBS curve, with frames as those of a polyline.

    Parameters
    ----------
    points
        Control points, not multiplied by their weights.
    degree
        From 1 to 6.
    knots
        As many as there are points and one more than the degree; evenly spaced and clamped where not given.
    weights
        One for each point; all 1 where not given.
    closed
        Whether its end is its start, with the same tangent.
    normal
        Vector towards which a section's x points at the start.
    """
    count = len(np.atleast_2d(points))
    whole_number("nurbs: degree", degree, 1, MAX_DEGREE)
    if count <= degree:
        raise InputError(f"nurbs: got {count} points, need at least {degree + 1} for degree {degree}")
    if knots is None:
        knots = [*[0.0] * degree, *np.linspace(0.0, 1.0, count - degree + 1), *[1.0] * degree]
    curve = SimpleNamespace(degree=degree, knotvector=knots, ctrlpts=points, weights=weights)
    return center_line.nurbs(curve, closed, normal=normal)
