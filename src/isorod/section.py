"""Control polygons of cross sections: the outline is ``sum_i Phi_i(theta) P_i``."""

import numpy as np
from numpy.typing import ArrayLike

from isorod.disk import Array, boundary_functions, check_count, control_points
from isorod.errors import InputError


def circle(n: int, radius: float = 1.0) -> Array:
    """Return the ``(n, 2)`` control points of a circle, exact for any ``n >= 3``; ``radius`` in units of length."""
    if not (np.isfinite(radius) and radius > 0.0):
        raise InputError(f"section radius: got {radius:g}, need a positive length")
    return ellipse(n, radius, radius)


def ellipse(n: int, a: float, b: float) -> Array:
    """Return the ``(n, 2)`` control points of an ellipse with half axes ``a`` and ``b``, exact for any ``n >= 3``."""
    for name, value in (("a", a), ("b", b)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"section half axis {name}: got {value:g}, need a positive length")
    return control_points(n) * np.array([a, b])


def flower(n: int = 16, petals: int = 4, radius: float = 1.0, depth: float = 0.3) -> Array:
    """Return the ``(n, 2)`` control points of a flower, concave between its petals (Lu & Zhou 2011, Fig. 3).

    The polygon's radius is ``radius * (1 + depth cos(petals theta))``.  Whether the map folds is for `Rod.check` to say.
    """
    theta = 2.0 * np.pi * np.arange(check_count(n)) / n
    if not 0.0 <= depth < 1.0:
        raise InputError(f"flower depth: got {depth:g}, need 0 <= depth < 1")
    return circle(n, radius) * (1.0 + depth * np.cos(petals * theta))[:, None]


def from_points(points: ArrayLike, n: int) -> Array:
    """Return the ``(n, 2)`` control points whose outline fits a closed polyline in the least-squares sense.

    Parameters
    ----------
    points
        Points of the outline in counter-clockwise order, shape ``(m, 2)``, ``m >= n``, the first not repeated; the first point
        stands at the angle 0 of the disk and the others at angles in proportion to the arc length.
    n
        Number of control points.

    Raises
    ------
    InputError
        If there are too few points, two neighbours coincide, a value is not finite, or the order is clockwise.
    """
    points = np.asarray(points, dtype=float)
    if points.ndim != 2 or points.shape[1] != 2 or points.shape[0] < check_count(n):
        raise InputError(f"section points: got an array of shape {points.shape}, need (m, 2) with m >= {n}")
    if not np.isfinite(points).all():
        raise InputError(f"section point {np.argmax(~np.isfinite(points).all(axis=1))} is not finite")
    edges = np.roll(points, -1, axis=0) - points
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    if (lengths == 0.0).any():
        raise InputError(f"section point {np.argmax(lengths == 0.0)} coincides with the next one")
    if np.sum(points[:, 0] * edges[:, 1] - points[:, 1] * edges[:, 0]) <= 0.0:
        raise InputError("section points run clockwise; give them counter-clockwise")
    theta = 2.0 * np.pi * np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) / lengths.sum()
    fitted, _, rank, _ = np.linalg.lstsq(boundary_functions(n, theta), points, rcond=None)
    if rank < n:
        raise InputError(f"section points: they determine only {rank} of {n} control points; give more or spread them")
    return fitted
