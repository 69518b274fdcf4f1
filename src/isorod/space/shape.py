"""How long, wide, bent and twisted a rod is: what the choice of a space goes by (`isorod.space.choice`)."""

from typing import NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.geometry.disk import circle
from isorod.geometry.rod import Rod

# A tube's wall bends where it is held or ends, over a few times sqrt(radius times thickness): elements of that many
# times this err by 6e-3 at the most under pressure, and so many carry tubes of any length.
WALL, MOST_WALL = 2.0, 16

# A section that is so much wider than thick is no tube.
ROUND = 0.5

# Rods of more elements were cut so for their shape; points in an element at which its frame is looked at.
_MANY, _LOOKS = 1000, 7


class Shape(NamedTuple):
    """What the choices go by.

    Attributes
    ----------
    angle
        The largest angle by which an element turns, bent or twisted, radians.
    slenderness
        Length over width.
    bend
        The largest curvature, or twist over length, of an element times the radius.
    walls
        Elements of a tube.
    radius
        Largest distance of the outline from the centre line.
    thinness
        The least one over the largest one, of a section.
    u, way
        Axis parameters in rising order, and lengths along the centre line there, both ends included.
    """

    angle: float
    slenderness: float
    bend: float
    walls: float
    radius: float
    thinness: float
    u: Array
    way: Array


def shape_of(rod: Rod) -> Shape:
    """Return what the choices go by."""
    breaks = rod.axis.breaks
    count = min(rod.axis.elements, _MANY)
    u = rod.axis.within((np.arange(_LOOKS) + 0.5) / _LOOKS)[:count].ravel()
    position, jacobian = rod.grid([[0.0, 0.0], *circle(8)], u)
    frames = np.linalg.qr(jacobian[:, 0, :, [2, 0, 1]].transpose(1, 2, 0))[0]
    # Columns that point as the derivatives do.
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
        # Elements so many are short.
        u, way = breaks[[0, -1]], np.array([0.0, length])
    else:
        way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(position[:, 0], axis=0), axis=1)))
        # Half a step more on either side.
        steps_ = 0.5 * way[[1]], 0.5 * (way[[-1]] - way[[-2]])
        way = np.concatenate([[0.0], way + steps_[0], [way[-1] + steps_[0][0] + steps_[1][0]]])
        u = np.concatenate([breaks[:1], u, breaks[-1:]])
    walls = _walls(rod, float(length), radii)
    bend = float((angles / long).max() * radius)
    thinness = float((radii.min(axis=1) / radii.max(axis=1)).min())
    return Shape(float(angles.max()), float(0.5 * length / radius), bend, walls, radius, thinness, u, way)


def _walls(rod: Rod, length: float, radii: Array) -> float:
    """Return how many elements a tube takes for its wall; 0 if the rod is none.

    ``radii`` ``(u, 8)`` are those of the outline at places along the rod.
    """
    hole = rod.rings[0]
    if not hole or (radii.min(axis=1) < ROUND * radii.max(axis=1)).any():
        return 0.0
    # Mean radius times thickness.
    size = float(radii.mean()) * np.sqrt(0.5 * (1.0 - hole**2))
    return min(length / (WALL * size), MOST_WALL)
