"""Length, width, curvature and twist of a rod, from which a space is chosen (`isorod.space.choice`)."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.geometry.disk import circle
from isorod.geometry.rod import Rod

# A tube's wall bends where it is held or ends, over a few times sqrt(radius times thickness): elements of the first
# number times this err by at most 6e-3 under pressure, and the second number of them suffices for any length.
WALL, MOST_WALL = 2.0, 16

# A section whose thickness over width is less is not a tube.
ROUND = 0.5

# Rods of more elements are taken to be resolved already; samples of the frame in an element.
_MANY, _LOOKS = 1000, 7


class Shape(NamedTuple):
    """Measures of a rod's shape.

    Attributes
    ----------
    angle
        The largest rotation of an element by bending or twist, radians.
    slenderness
        Length over width.
    bend
        The largest curvature, or twist over length, of an element times the radius.
    walls
        Elements that the wall of a tube needs.
    radius
        Largest distance of the outline from the centre line.
    thinness
        The least such distance over the largest one, of a section.
    u, lengths
        Axis parameters in rising order, and arc lengths of the centre line there, both ends included.
    """

    angle: float
    slenderness: float
    bend: float
    walls: float
    radius: float
    thinness: float
    u: Array
    lengths: Array


def shape_of(rod: Rod) -> Shape:
    """Return the measures of a rod's shape."""
    breaks = rod.axis.breaks
    count = min(rod.axis.elements, _MANY)
    u = rod.axis.within((np.arange(_LOOKS) + 0.5) / _LOOKS)[:count].ravel()
    position, jacobian = rod.grid([[0.0, 0.0], *circle(8)], u)
    frames = np.linalg.qr(jacobian[:, 0, :, [2, 0, 1]].transpose(1, 2, 0))[0]
    # Columns in the direction of the derivatives.
    frames = frames * np.sign(np.einsum("tab,bta->tb", frames, jacobian[:, 0, :, [2, 0, 1]]))[:, None, :]
    frames = frames.reshape(count, _LOOKS, 3, 3)
    traces = np.einsum("etab,etab->et", frames[:, 1:], frames[:, :-1])
    angles = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0)).sum(axis=1) * _LOOKS / (_LOOKS - 1)
    length = np.linalg.norm(np.diff(position[:, 0], axis=0), axis=1).sum() * _LOOKS * count / (_LOOKS * count - 1)
    long = np.linalg.norm(np.diff(position[:, 0].reshape(count, _LOOKS, 3), axis=1), axis=2).mean(axis=1) * _LOOKS
    scale = rod.axis.elements / count
    length *= scale
    radii = np.linalg.norm(position[:, 1:] - position[:, :1], axis=2)
    radius = float(radii.max())
    if count < rod.axis.elements:
        # So many elements are short: lengths at the ends suffice.
        u, lengths = breaks[[0, -1]], np.array([0.0, length])
    else:
        lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position[:, 0], axis=0), axis=1)))
        # Extended by half a step on either side.
        steps_ = 0.5 * lengths[[1]], 0.5 * (lengths[[-1]] - lengths[[-2]])
        lengths = np.concatenate([[0.0], lengths + steps_[0], [lengths[-1] + steps_[0][0] + steps_[1][0]]])
        u = np.concatenate([breaks[:1], u, breaks[-1:]])
    walls = _walls(rod, float(length), radii)
    bend = float((angles / long).max() * radius)
    thinness = float((radii.min(axis=1) / radii.max(axis=1)).min())
    return Shape(float(angles.max()), float(0.5 * length / radius), bend, walls, radius, thinness, u, lengths)


def _walls(rod: Rod, length: float, radii: Array) -> float:
    """Return the number of elements that the wall of a tube needs; 0 if the rod is not a tube.

    ``radii`` ``(u, 8)`` are those of the outline at points along the rod.
    """
    hole = rod.rings[0]
    if not hole or (radii.min(axis=1) < ROUND * radii.max(axis=1)).any():
        return 0.0
    # Mean radius times thickness.
    size = float(radii.mean()) * np.sqrt(0.5 * (1.0 - hole**2))
    return min(length / (WALL * size), MOST_WALL)
