"""By how much sections of rods turn: the rotation nearest to how their points move, whole turns counted."""

import warnings

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.mean import MeanSupport, turns_about
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.tensors import rotation

# A section that turns by more than this against its neighbour may have turned the other way.
APART = 0.5 * np.pi

# A half turn about an axis across leaves no turn about an axis: this share of a unit quaternion must be left.
_SEEN = 0.2

# Sections looked at an element, and places round each.
_SECTIONS, _AROUND = 8, 8

# What has turned more than half a turn and is this near to whole turns, radians, has no axis of its own.
_WHOLE = 0.1


def of_section(
    model: Model, displacement: Array, body: int, u: float, about: Array | None, factor: float = 1.0
) -> Array:
    """Return the mean rotation of a section, radians: its vector ``(3,)``, or the angle about an axis.

    About an axis it is the rotation of `isorod.model.mean.MeanSupport`, of any size; its vector is that of the rotation
    that is nearest to how the section's points move (Kabsch), for small ones ``J^-1 int r x u dA`` too.  Whole turns
    are counted from a held end whose turn is known, on along the rod; where no end is, from the end that has turned by
    less, up to half a turn.  Where they cannot be followed a warning says so.

    Parameters
    ----------
    displacement
        All degrees of freedom, shape ``(dofs,)``.
    body, u
        Number of the body, and axis parameter of the section.
    about
        Unit vector ``(3,)``; None for the vector of the rotation.
    factor
        Load factor of the state.
    """
    space, nodal = model.bodies[body].space, model.nodal(displacement, body)
    moved = MeanSupport(u, np.eye(3), np.eye(3), body=body).moved(space, nodal)
    mean = of_points(*moved, about)
    path = _path(model, nodal, body, u, factor)
    if about is None:
        size = float(np.linalg.norm(mean))
        wound = sum((vector(one) for one in steps(path)), np.zeros(3))
        if np.linalg.norm(wound) > np.pi and size < _WHOLE:
            axis = wound / np.linalg.norm(wound)
        else:
            axis = mean / size if size else np.array([0.0, 0.0, 1.0])
        return mean + axis * _turns(followed(path, axis) - float(mean @ axis))
    return np.asarray(mean + _turns(followed(path, about) - float(mean)))


def of_points(arms: Array, now: Array, weights: Array, about: Array | None) -> Array:
    """Return the mean rotation of places from their middle, ``(q, 3)``, as `of_section`, up to half a turn."""
    if about is not None:
        return np.asarray(turns_about(arms, now, weights, about[None])[0])
    return vector(nearest(arms[None], (weights[:, None] * now)[None])[0])


def _turns(difference: float) -> float:
    """Return the whole turns, radians, that are nearest to an angle."""
    if np.isnan(difference):
        warnings.warn("rotation: whole turns cannot be followed along the rod, and are left out", stacklevel=5)
        return 0.0
    return float(2.0 * np.pi * np.round(difference / (2.0 * np.pi)))


def _path(model: Model, nodal: Array, body: int, u: float, factor: float) -> Array:
    """Return rotations ``(t, 3, 3)`` from none, by the turn of an end's support, along the rod to a section."""
    space = model.bodies[body].space
    breaks = space.axis.breaks
    share = np.arange(_SECTIONS) / _SECTIONS
    along = np.append((breaks[:-1, None] + share * np.diff(breaks)[:, None]).ravel(), breaks[-1])
    ends = _ends(model, body, factor)
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    xi = np.stack([np.cos(angle), np.sin(angle)], axis=1)

    def turned(where: Array) -> Array:
        rest = space.rod.grid(xi, where)[0]
        arms = rest, rest + space.displacement(nodal, xi, where)[0]
        return nearest(*(one - one.mean(axis=1, keepdims=True) for one in arms))

    if not ends:
        # Of what is held elsewhere, or nowhere, the end that has turned by less.
        first, last = (vector(one) for one in turned(breaks[[0, -1]]))
        ends = {0: first} if np.linalg.norm(first) <= np.linalg.norm(last) else {-1: last}
    side, turn = next(iter(ends.items()))
    way = np.append(along[along < u], u) if side == 0 else np.append(along[along > u], u)
    if side:
        way = np.append(way[-2::-1], u)
    count = 2 + int(4.0 * np.linalg.norm(turn) / APART)
    return np.concatenate([[rotation(f * turn) for f in np.linspace(0.0, 1.0, count)], turned(way)])


def _ends(model: Model, body: int, factor: float) -> dict[int, Array]:
    """Return by how much supports turn the ends of a body that they hold whole: at its start by 0, at its end by -1."""
    space, found = model.bodies[body].space, {}
    for support, motion in zip(model.supports, model.motions, strict=True):
        if support.body != body or not isinstance(support, Support) or space.rod.closed:
            continue
        layers, count = np.unique(np.asarray(support.nodes) // space.layer_nodes, return_counts=True)
        whole = {*support.components, *support.tied} == {*"xyz"} and (count == space.layer_nodes).all()
        if whole and layers.size == 1 and layers[0] in (0, space.layers - 1):
            begin, end = motion.during
            share = np.clip((factor - begin) / (end - begin), 0.0, 1.0)
            found[0 if layers[0] == 0 else -1] = share * motion.turn
    return found


def direction(name: str, given: ArrayLike) -> Array:
    """Return the unit vector ``(3,)`` of a direction of any length; raises `InputError`."""
    found = np.asarray(given, dtype=float)
    size = float(np.linalg.norm(found))
    if found.shape != (3,) or not np.isfinite(size) or not size > 0.0:
        raise InputError(f"{name}: got {found.tolist()}, need three numbers that are not all zero")
    return np.asarray(found / size)


def vector(turned: Array) -> Array:
    """Return the vector ``(3,)`` of a rotation ``(3, 3)``, up to half a turn."""
    # Half a turn is where others lose digits.
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(turned).as_rotvec())


def nearest(before: Array, after: Array) -> Array:
    """Return the rotations nearest to what takes places ``(t, q, 3)`` to others, shape ``(t, 3, 3)`` (Kabsch)."""
    left, _, right = np.linalg.svd(np.einsum("tqa,tqb->tab", after, before))
    left[..., 2] *= np.linalg.det(left @ right)[:, None]
    return np.asarray(left @ right)


def angles(rotations: Array) -> Array:
    """Return the angles of rotations ``(t, 3, 3)``, 0 to pi."""
    return np.arccos(np.clip(0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0), -1.0, 1.0))


def steps(rotations: Array) -> Array:
    """Return what takes each rotation to the next."""
    return np.asarray(rotations[1:] @ rotations[:-1].swapaxes(1, 2))


def followed(rotations: Array, axis: Array) -> float:
    """Return the angle about an axis by which rotations along a path turn in all, NaN where it cannot be followed."""
    each = steps(rotations)
    if angles(each).max() > APART:
        return np.nan
    # As quaternions, the real part of a small step first.
    real = 0.5 * np.sqrt(1.0 + np.trace(each, axis1=1, axis2=2))
    skew = each - each.swapaxes(1, 2)
    rest = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) / (4.0 * real[:, None])
    w, v = 1.0, np.zeros(3)
    path = [(w, 0.0)]
    for a, b in zip(real, rest, strict=True):
        w, v = a * w - b @ v, a * v + w * b + np.cross(b, v)
        path.append((w, float(v @ axis)))
    seen = np.array(path)
    if np.linalg.norm(seen, axis=1).min() < _SEEN:
        return np.nan
    return 2.0 * float(np.unwrap(np.arctan2(seen[:, 1], seen[:, 0]))[-1])
