"""How large the patch of a contact is by its force, where too few control points see it.

Its width is then wrong by as much as they are apart, but its force, where loads press, is right.  Hertz' theory makes
of that and of the curvatures of both surfaces an ellipse (K. L. Johnson, Contact Mechanics (1985), section 4.2, where
``b/a = (A/B)^(2/3)`` and ``a b = c^2``, ``c^3 = 3 F R / (4 E*)``, are right to a few per cent).
"""

from collections.abc import Mapping

import numpy as np

from isorod.arrays import Array
from isorod.contact.result import ContactResult
from isorod.contact.tables import radii
from isorod.model.contact import Contact, Cylinder, Sphere
from isorod.model.model import Model
from isorod.space.space import Space

# How far from the middle of the patch, in radii, curvatures are looked at, and points that say how the surface is
# turned by now.
_STEP, _NEAR = 0.05, 0.4

# Of the curvatures of the gap the lesser one is taken for this share of the other at least.
_FLATTEST = 1e-3


def extents(
    model: Model, contact: Contact, result: ContactResult, places: Mapping[int, tuple[float, float]]
) -> dict[int, tuple[float, float]]:
    """Return half the length along the axis and half the width round the section of the patch, by body.

    It is empty where the surfaces are flat or hollow, or nobody sees how they are turned.

    Parameters
    ----------
    model, contact, result
        Of a solution.
    places
        Axis parameter and angle of the middle of the patch, by body: two, or one and an obstacle.
    """
    bent, frames, soft = np.zeros((3, 3)), {}, 0.0
    for body, (u, angle) in places.items():
        space = model.bodies[body].space
        frame = _frame(space, result, body, u, angle)
        if frame is None:
            return {}
        frames[body] = frame
        bent += np.einsum("k,ka,kb->ab", _curvatures(space, u, angle), frame, frame)
        soft += 1.0 / min(law.surface_modulus for law in model.bodies[body].laws)
    along, around = next(iter(frames.values()))
    normal = np.cross(along, around)
    normal /= np.linalg.norm(normal)
    bent += _obstacle(contact, normal)
    plane = np.linalg.svd(normal[None])[2][1:]
    curvatures, ways = np.linalg.eigh(plane @ bent @ plane.T)
    if not curvatures[1] > 0.0:
        return {}
    flat, steep = max(curvatures[0], _FLATTEST * curvatures[1]), curvatures[1]
    size = np.cbrt(0.75 * result.force * soft / np.sqrt(flat * steep))
    ratio = np.cbrt(flat / steep)
    axes = np.array([size / ratio, size * ratio])[:, None] * (ways.T @ plane)
    return {body: tuple(np.linalg.norm(frame @ axes.T, axis=1).tolist()) for body, frame in frames.items()}


def _frame(space: Space, result: ContactResult, body: int, u: float, angle: float) -> Array | None:
    """Return the present directions ``(2, 3)`` along the axis and round the section, by points of the contact near."""
    mine = result.body == body
    radius = radii(space, range(space.axis.elements))[1]
    _, jacobian = space.rod.grid(np.zeros((1, 2)), [u])
    stretch = float(np.linalg.norm(jacobian[0, 0, :, 2]))
    away = result.parameters[mine] - [u, angle]
    away[:, 1] = np.angle(np.exp(1j * away[:, 1]))
    near = (np.abs(away * [stretch / radius, 1.0]) < _NEAR).all(axis=1)
    terms = np.column_stack([np.ones(near.sum()), away[near], away[near] ** 2])
    if np.linalg.matrix_rank(terms) < terms.shape[1]:
        return None
    found = np.linalg.lstsq(terms, result.positions[mine][near], rcond=None)[0][1:3]
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _curvatures(space: Space, u: float, angle: float) -> Array:
    """Return the curvatures of a surface at rest along its axis and round its section, positive where they bulge."""
    _, jacobian = space.rod.grid(np.zeros((1, 2)), [u])
    radius = radii(space, range(space.axis.elements))[1]
    step = _STEP * radius / float(np.linalg.norm(jacobian[0, 0, :, 2]))
    places = np.clip(u, space.axis.breaks[0] + step, space.axis.breaks[-1] - step) + step * np.array([-1.0, 0.0, 1.0])
    angles = angle + _STEP * np.array([-1.0, 0.0, 1.0])
    grid = space.rod.grid(np.stack([np.cos(angles), np.sin(angles)], axis=1), places)[0]
    lines = np.stack([grid[:, 1], grid[1]])
    slopes, bends = 0.5 * (lines[:, 2] - lines[:, 0]), lines[:, 2] - 2.0 * lines[:, 1] + lines[:, 0]
    outward = np.cross(slopes[1], slopes[0])
    outward *= np.sign(outward @ (grid[1, 1] - space.rod.grid(np.zeros((1, 2)), places[1:2])[0][0, 0]))
    outward /= np.linalg.norm(outward)
    return -(bends @ outward) / np.sum(slopes**2, axis=1)


def _obstacle(contact: Contact, normal: Array) -> Array:
    """Return the curvature ``(3, 3)`` of what is rigid where a unit normal is that of its surface; zero if flat."""
    other = contact.obstacle
    if isinstance(other, Sphere):
        return np.asarray((np.eye(3) - np.outer(normal, normal)) / other.radius)
    if isinstance(other, Cylinder):
        around = np.cross(np.array(other.axis, dtype=float), normal)
        size = float(np.linalg.norm(around))
        return np.outer(around, around) / (size**2 * other.radius) if size > 0.0 else np.zeros((3, 3))
    return np.zeros((3, 3))
