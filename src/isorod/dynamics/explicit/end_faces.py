"""Contact of end faces with rigid planes, for explicit dynamics: the penalty of `isorod.contact` at a face's points."""

from typing import NamedTuple

import numpy as np
from numba import f8, i8, njit, types

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, STRICT
from isorod.errors import InputError
from isorod.geometry.quadrature import section_points
from isorod.model.contact import Plane
from isorod.model.model import Model


class Faces(NamedTuple):
    """End faces with the planes they meet.

    Attributes
    ----------
    faces
        First node, number of nodes, first row in ``values``, number of points; shape ``(F, 4)``.
    planes
        Point, unit normal, penalty; shape ``(F, 7)``.
    values
        Section functions at the points of all faces, shape ``(P, K n)``.
    areas
        Reference areas of the points, shape ``(P,)``.
    carries
        1 for the nodes of the model whose functions add up to one, else 0: their forces make the resultant, shape
        ``(nodes,)``.
    """

    faces: Index
    planes: Array
    values: Array
    areas: Array
    carries: Array


FACES = types.NamedTuple([types.Array(i8, 2, "C"), F2, F2, F1, F1], Faces)


def pack(model: Model) -> Faces:
    """Return the faces of all contacts; raises `InputError` if a rod that is closed is to have one."""
    faces: list[list[int]] = []
    planes: list[list[float]] = []
    values: list[Array] = []
    areas: list[Array] = []
    for index, contact in enumerate(model.contacts):
        for which in contact.faces:
            assert isinstance(contact.second, Plane)
            space = model.bodies[contact.first].space
            if space.rod.closed:
                raise InputError(f"contact {index}: a closed rod has no end faces")
            layer, u = (0, space.axis.breaks[0]) if which == "start" else (space.layers - 1, space.axis.breaks[-1])
            xi, weights = section_points(space.points_around, space.rule, space.turn)
            jacobian = space.rod.grid(xi, np.array([u]))[1][0]
            first = int(model.first_node[contact.first]) + layer * space.layer_nodes
            faces.append([first, space.layer_nodes, sum(part.size for part in areas), weights.size])
            normal = np.array(contact.second.normal, dtype=float)
            planes.append([*contact.second.point, *normal / np.linalg.norm(normal), contact.penalty])
            values.append(space.section_functions(xi)[0])
            areas.append(weights * np.linalg.norm(np.cross(jacobian[:, :, 0], jacobian[:, :, 1]), axis=1))
    widest = max([part.shape[1] for part in values], default=0)
    padded = [np.pad(part, ((0, 0), (0, widest - part.shape[1]))) for part in values]
    return Faces(
        faces=np.array(faces, dtype=np.int64).reshape(-1, 4),
        planes=np.array(planes, dtype=float).reshape(-1, 7),
        values=np.concatenate([np.empty((0, widest)), *padded]),
        areas=np.concatenate([np.empty(0), *areas]),
        carries=model.carries.astype(float),
    )


@njit(types.UniTuple(f8, 4)(FACES, F2, F2), **STRICT)
def add_forces(faces: Faces, positions: Array, forces: Array) -> tuple[float, float, float, float]:
    """Add the forces on the faces; parameters and result are those of `isorod.contact.force_kernel.add_forces`."""
    energy = force = area = deepest = 0.0
    for k in range(faces.faces.shape[0]):
        first, nodes, start, count = faces.faces[k]
        plane = faces.planes[k]
        for point in range(start, start + count):
            gap = 0.0
            for a in range(3):
                place = 0.0
                for i in range(nodes):
                    place += faces.values[point, i] * positions[first + i, a]
                gap += (place - plane[a]) * plane[3 + a]
            if gap >= 0.0:
                continue
            pressure = -plane[6] * gap
            weight = faces.areas[point]
            energy -= 0.5 * weight * pressure * gap
            force += weight * pressure
            area += weight
            deepest = min(deepest, gap)
            for i in range(nodes):
                for a in range(3):
                    forces[first + i, a] += weight * pressure * faces.values[point, i] * plane[3 + a]
    return energy, force, area, deepest
