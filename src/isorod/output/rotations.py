"""Rotations of sections: the best fit to the motion of their points (Kabsch), with full turns counted."""

import warnings

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.geometry.disk import circle
from isorod.model.mean import MeanSupport, turns_about
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.space.space import Space
from isorod.tensors import rotation

# A section that rotates by more than this relative to its neighbour may have rotated in the other sense.
APART = 0.5 * np.pi

# A half turn about a perpendicular axis leaves none about the axis: least norm of the quaternion's part along it.
_SEEN = 0.2

# Sections in each element, and points round each.
_SECTIONS, AROUND = 8, 8

# Beyond half a turn, a rotation this near to full turns, radians, does not determine its axis.
_WHOLE = 0.1


def of_section(
    model: Model, displacement: Array, body: int, u: float, about: Array | None, factor: float = 1.0
) -> Array:
    """Return the mean rotation of a section, radians: its vector ``(3,)``, or the angle about an axis.

    About an axis it is the rotation of `isorod.model.mean.MeanSupport`, of any size; the vector is that of the best fit
    to the motion of the section's points (Kabsch), for small ones ``J^-1 int r x u dA`` too.  Full turns are counted
    along the rod from a clamped end, whose rotation is known; without one, from the end that has rotated less, up to
    half a turn.  A warning says if they cannot be followed.

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
        total = sum((vector(step) for step in steps(path)), np.zeros(3))
        if np.linalg.norm(total) > np.pi and size < _WHOLE:
            axis = total / np.linalg.norm(total)
        else:
            axis = mean / size if size else np.array([0.0, 0.0, 1.0])
        return mean + axis * _turns(followed(path, axis) - float(mean @ axis))
    return np.asarray(mean + _turns(followed(path, about) - float(mean)))


def of_points(arms: Array, now: Array, weights: Array, about: Array | None) -> Array:
    """Return the mean rotation of points relative to their centre, ``(q, 3)``, as `of_section`, up to half a turn."""
    if about is not None:
        return np.asarray(turns_about(arms, now, weights, about[None])[0])
    return vector(nearest(arms[None], (weights[:, None] * now)[None])[0])


def _turns(difference: float) -> float:
    """Return the multiple of a full turn, radians, nearest to an angle."""
    if np.isnan(difference):
        warnings.warn("rotation: whole turns cannot be followed along the rod, and are left out", stacklevel=5)
        return 0.0
    return float(2.0 * np.pi * np.round(difference / (2.0 * np.pi)))


def _path(model: Model, nodal: Array, body: int, u: float, factor: float) -> Array:
    """Return rotations ``(t, 3, 3)`` from zero to that of an end's support, and along the rod to a section."""
    space = model.bodies[body].space
    along, ends = sections(space), _ends(model, body, factor)
    xi = circle(AROUND)

    def turned(where: Array) -> Array:
        rest = space.rod.grid(xi, where)[0]
        arms = rest, rest + space.displacement(nodal, xi, where)[0]
        return nearest(*(one - one.mean(axis=1, keepdims=True) for one in arms))

    if not ends:
        # Without a clamped end, the end that has rotated less.
        first, last = (vector(one) for one in turned(along[[0, -1]]))
        ends = {0: first} if np.linalg.norm(first) <= np.linalg.norm(last) else {-1: last}
    side, turn = next(iter(ends.items()))
    path = np.append(along[along < u], u) if side == 0 else np.append(along[along > u], u)
    if side:
        path = np.append(path[-2::-1], u)
    count = 2 + int(4.0 * np.linalg.norm(turn) / APART)
    return np.concatenate([[rotation(f * turn) for f in np.linspace(0.0, 1.0, count)], turned(path)])


def _ends(model: Model, body: int, factor: float) -> dict[int, Array]:
    """Return the rotations of clamped ends of a body by their supports: the start by key 0, the end by -1."""
    space, rotations = model.bodies[body].space, {}
    for support, motion in zip(model.supports, model.motions, strict=True):
        if support.body == body and (layer := clamped_layer(space, support)) is not None:
            begin, end = motion.during
            fraction = np.clip((factor - begin) / (end - begin), 0.0, 1.0)
            rotations[0 if layer == 0 else -1] = fraction * motion.turn
    return rotations


def clamped_layer(space: Space, support: Support | MeanSupport) -> int | None:
    """Return the layer of the end face that a support clamps, None if it does not clamp one."""
    if not isinstance(support, Support) or space.rod.closed or {*support.components, *support.tied} != {*"xyz"}:
        return None
    layers, count = np.unique(np.asarray(support.nodes) // space.layer_nodes, return_counts=True)
    clamped = layers.size == 1 and count[0] == space.layer_nodes and layers[0] in (0, space.layers - 1)
    return int(layers[0]) if clamped else None


def sections(space: Space) -> Array:
    """Return axis parameters ``(t,)`` at which the rotation of sections is followed, with both ends."""
    breaks = space.axis.breaks
    fractions = np.arange(_SECTIONS) / _SECTIONS
    return np.append((breaks[:-1, None] + fractions * np.diff(breaks)[:, None]).ravel(), breaks[-1])


def direction(name: str, given: ArrayLike) -> Array:
    """Return the unit vector ``(3,)`` of a direction of any length; raises `InputError`."""
    vector = np.asarray(given, dtype=float)
    size = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(size) or not size > 0.0:
        raise InputError(f"{name}: got {vector.tolist()}, need three numbers that are not all zero")
    return np.asarray(vector / size)


def vector(turned: Array) -> Array:
    """Return the vector ``(3,)`` of a rotation ``(3, 3)``, up to half a turn."""
    # SciPy keeps its digits near half a turn.
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(turned).as_rotvec())


def nearest(before: Array, after: Array) -> Array:
    """Return the rotations ``(t, 3, 3)`` that fit best points ``(t, q, 3)`` before to those after (Kabsch)."""
    left, _, right = np.linalg.svd(np.einsum("tqa,tqb->tab", after, before))
    left[..., 2] *= np.linalg.det(left @ right)[:, None]
    return np.asarray(left @ right)


def angles(rotations: Array) -> Array:
    """Return the angles of rotations ``(t, 3, 3)``, 0 to pi."""
    return np.arccos(np.clip(0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0), -1.0, 1.0))


def steps(rotations: Array) -> Array:
    """Return the relative rotation of each to the next."""
    return np.asarray(rotations[1:] @ rotations[:-1].swapaxes(1, 2))


def followed(rotations: Array, axis: Array) -> float:
    """Return the total angle about an axis of rotations along a path, NaN where it cannot be followed."""
    relative = steps(rotations)
    if angles(relative).max() > APART:
        return np.nan
    # Quaternions of the relative rotations, real part first.
    real = 0.5 * np.sqrt(1.0 + np.trace(relative, axis1=1, axis2=2))
    skew = relative - relative.swapaxes(1, 2)
    rest = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1) / (4.0 * real[:, None])
    w, v = 1.0, np.zeros(3)
    path = [(w, 0.0)]
    for a, b in zip(real, rest, strict=True):
        w, v = a * w - b @ v, a * v + w * b + np.cross(b, v)
        path.append((w, float(v @ axis)))
    components = np.array(path)
    if np.linalg.norm(components, axis=1).min() < _SEEN:
        return np.nan
    return 2.0 * float(np.unwrap(np.arctan2(components[:, 1], components[:, 0]))[-1])
