"""Parameters of points of rods, by Newton's method."""

import numpy as np
from scipy.spatial import cKDTree

from isorod.geometry.disk import circle, harmonic_functions
from isorod.geometry.rod import Rod
from meshes.mesh import Array

# First guesses: points round each of some circles of the disk, in sections so many to an element.
_AROUND, _RADII, _SECTIONS = 12, (0.4, 0.9), 12

_STEPS = 40

# A step that changes parameters, of the disk and relative to an element, by less is the last.
_SMALL = 1e-13


def parameters(rod: Rod, points: Array) -> tuple[Array, Array]:
    """Return the parameters ``xi_1, xi_2, u`` ``(m, 3)`` of points ``(m, 3)``, and how far they are from there.

    Points that are not in the rod have those of a point of its surface that is near.
    """
    u = rod.axis.evenly(_SECTIONS)
    disk = np.concatenate([[[0.0, 0.0]], *(radius * circle(_AROUND) for radius in _RADII)])
    guesses = np.column_stack([np.tile(disk, (u.size, 1)), np.repeat(u, len(disk))])
    parameters = guesses[cKDTree(rod.grid(disk, u)[0].reshape(-1, 3)).query(points)[1]]
    low, high = rod.axis.breaks[[0, -1]]
    length = (high - low) / rod.axis.elements
    scale = np.array([1.0, 1.0, length])
    left = np.arange(len(points))
    for _ in range(_STEPS):
        here, tangents = _at(rod, parameters[left])
        step = np.linalg.solve(tangents, (points[left] - here)[:, :, None])[:, :, 0]
        # No farther than a guess can be off.
        step /= np.maximum(1.0, np.abs(step / scale).max(axis=1) / 0.3)[:, None]
        before = parameters[left]
        parameters[left] = _inside(rod, before + step)
        going = np.abs((parameters[left] - before) / scale).max(axis=1) > _SMALL
        left = left[going]
        if not left.size:
            break
    return parameters, np.linalg.norm(_at(rod, parameters)[0] - points, axis=1)


def _inside(rod: Rod, where: Array) -> Array:
    """Return parameters, those beyond the disk on its edge and those beyond the ends there."""
    low, high = rod.axis.breaks[[0, -1]]
    xi, u = where[:, :2], where[:, 2]
    xi = xi / np.maximum(1.0, np.linalg.norm(xi, axis=1, keepdims=True))
    u = low + np.mod(u - low, high - low) if rod.closed else np.clip(u, low, high)
    return np.column_stack([xi, u])


def _at(rod: Rod, where: Array) -> tuple[Array, Array]:
    """Return positions ``(m, 3)`` and derivatives ``(m, 3, 3)`` at parameters ``(m, 3)``."""
    first, along, slopes = rod.axis.local(where[:, 2])
    across, gradients = harmonic_functions(rod.section_points, where[:, :2])
    near = rod.control_points[first[:, None] + np.arange(along.shape[1])]
    section, change = (np.einsum("mj,mjia->mia", one, near) for one in (along, slopes))
    tangents = np.empty((len(where), 3, 3))
    tangents[:, :, :2] = np.einsum("mid,mia->mad", gradients, section)
    tangents[:, :, 2] = np.einsum("mi,mia->ma", across, change)
    return np.einsum("mi,mia->ma", across, section), tangents
