"""Diagnosis of a rod map that is not injective (det J <= 0)."""

from collections.abc import Callable

import numpy as np

from isorod.arrays import Array
from isorod.geometry.disk import circle, harmonic_functions

# Sections and their derivatives by the parameter, (t, n, 3) each, at parameters (t,).
Sections = Callable[[Array], tuple[Array, Array]]

# A fold is attributed to the line's curvature if curvature times distance from the centre exceeds this; it is exactly
# one only where sections are normal to the line.
_NEARLY = 0.95


def reason(sections: Sections, u: Array, t: int, xi: Array) -> str:
    """Return the cause of a fold of a rod's map at a parameter and a point of the disk.

    Parameters
    ----------
    sections
        Sections of the rod.
    u
        Ascending parameters along the rod, shape ``(elements, count)``, inside the elements.
    t
        Number of the parameter.
    xi
        Point of the disk, ``(2,)``.
    """
    polygons, along = sections(u.ravel())
    arms = polygons - polygons.mean(axis=1, keepdims=True)
    faces = np.cross(arms, np.roll(arms, -1, axis=1)).sum(axis=1)
    tangents = along.mean(axis=1)
    facing = np.einsum("ta,ta->t", faces, tangents)
    if (facing < 0.0).all():
        return "the outline runs clockwise about the line's direction: reverse its points (or the frame is left-handed)"
    if (facing < 0.0).any():
        return _turned(u.ravel(), facing, faces)

    values, gradients = harmonic_functions(polygons.shape[1], xi)
    plane = gradients[0].T @ polygons[t]
    if np.cross(plane[0], plane[1]) @ faces[t] <= 0.0:
        return "the outline is too deeply concave or crosses itself: the section folds in its own plane"

    element = u[t // u.shape[1]]
    nudge = 1e-4 * (element[-1] - element[0])
    middle = np.clip(u.ravel()[t], element[0] + nudge, element[-1] - nudge)
    near, slopes = (field.mean(axis=1) for field in sections(middle + nudge * np.array([-1.0, 1.0])))
    directions = slopes / np.linalg.norm(slopes, axis=1, keepdims=True)
    bend = (directions[1] - directions[0]) / np.linalg.norm(near[1] - near[0])
    if values[0] @ arms[t] @ bend >= _NEARLY:
        curvature = float(np.linalg.norm(bend))
        reach = float((harmonic_functions(polygons.shape[1], circle(64))[0] @ arms[t] @ bend).max()) / curvature
        return (
            f"the line bends too sharply: its radius of curvature is {1.0 / curvature:.4g} there, and the section "
            f"reaches {reach:.4g} from it towards the inside"
        )
    return "neighbouring sections cross: they tilt, turn or grow too quickly along the line"


def _turned(u: Array, facing: Array, faces: Array) -> str:
    """Return whether sections or the line itself turn back, and where."""
    bad = int(np.argmin(facing))
    good = np.flatnonzero(facing > 0.0)
    if not good.size:
        return "the section has no area or the line stands still"
    before = int(good[np.argmin(np.abs(good - bad))])
    low, high = sorted((u[before], u[bad]))
    what = "the frame flips over" if faces[bad] @ faces[before] < 0.0 else "the centre line turns back"
    return f"{what} between u = {low:.4g} and {high:.4g}"
