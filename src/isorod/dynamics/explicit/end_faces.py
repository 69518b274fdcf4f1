"""Contact of the end faces of rods with rigid planes, in explicit steps: `isorod.contact`'s penalty at their points."""

from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types

from isorod.arrays import Array
from isorod.compiled import F1, F2, STRICT, njit
from isorod.contact.force_kernel import PRESSING
from isorod.contact.packed import Table
from isorod.contact.tables import penalty
from isorod.errors import InputError
from isorod.geometry.quadrature import section_points
from isorod.model.contact import Plane
from isorod.model.model import Model

# A face: its first node, number of nodes, first of its points, number of points; of the plane that it meets a point,
# the unit normal, and the force per volume.
FACE = np.dtype(
    [
        *((name, np.int64) for name in ("first_node", "nodes", "first_point", "points")),
        ("point", np.float64, 3),
        ("normal", np.float64, 3),
        ("penalty", np.float64),
    ]
)


class Faces(NamedTuple):
    """End faces with the planes they meet.

    Attributes
    ----------
    faces
        Rows of `FACE`.
    values
        Section functions at the points of all faces, shape ``(P, K n)``.
    areas
        Reference areas of the points, shape ``(P,)``.
    carries
        1 for the nodes of the model whose functions add up to one, else 0: their forces make the resultant, shape
        ``(nodes,)``.
    """

    faces: Table
    values: Array
    areas: Array
    carries: Array


FACES = types.NamedTuple([types.Array(from_dtype(FACE), 1, "C"), F2, F1, F1], Faces)


def pack(model: Model, mine: Table | None = None) -> Faces:
    """Return the faces of all contacts, or those of which nodes ``mine`` says so.

    Raises
    ------
    InputError
        If a rod that is closed is to have one.
    """
    faces: list[Any] = []
    values: list[Array] = []
    areas: list[Array] = []
    for index, contact in enumerate(model.contacts):
        for which in contact.faces:
            assert isinstance(contact.second, Plane)
            ((body,),) = contact.groups
            space = model.bodies[body].space
            if space.rod.closed:
                raise InputError(f"contact {index}: a closed rod has no end faces")
            layer, u = (0, space.axis.breaks[0]) if which == "start" else (space.layers - 1, space.axis.breaks[-1])
            xi, weights = section_points(space.points_around, space.rule, space.turn)
            jacobian = space.rod.grid(xi, np.array([u]))[1][0]
            first = int(model.first_node[body]) + layer * space.layer_nodes
            if mine is not None and not mine[first]:
                continue
            nodes = (first, space.layer_nodes, sum(part.size for part in areas), weights.size)
            normal = np.array(contact.second.normal, dtype=float)
            faces.append((*nodes, contact.second.point, normal / np.linalg.norm(normal), penalty(model, contact)))
            values.append(space.basis.functions(xi)[0])
            areas.append(weights * np.linalg.norm(np.cross(jacobian[:, :, 0], jacobian[:, :, 1]), axis=1))
    widest = max([part.shape[1] for part in values], default=0)
    padded = [np.pad(part, ((0, 0), (0, widest - part.shape[1]))) for part in values]
    return Faces(
        faces=np.array(faces, FACE),
        values=np.concatenate([np.empty((0, widest)), *padded]),
        areas=np.concatenate([np.empty(0), *areas]),
        carries=model.is_carrier.astype(float),
    )


@njit(PRESSING(FACES, F2, F2), **STRICT)
def add_forces(faces: Faces, positions: Array, forces: Array) -> tuple[float, float, float, float]:
    """Add the forces on the faces; parameters and result are those of `isorod.contact.force_kernel.add_forces`."""
    energy = force = area = deepest = 0.0
    for k in range(faces.faces.size):
        face = faces.faces[k]
        first, point, normal = face.first_node, face.point, face.normal
        for p in range(face.first_point, face.first_point + face.points):
            gap = 0.0
            for a in range(3):
                place = 0.0
                for i in range(face.nodes):
                    place += faces.values[p, i] * positions[first + i, a]
                gap += (place - point[a]) * normal[a]
            if gap >= 0.0:
                continue
            pressure = -face.penalty * gap
            weight = faces.areas[p]
            energy -= 0.5 * weight * pressure * gap
            force += weight * pressure
            area += weight
            deepest = min(deepest, gap)
            for i in range(face.nodes):
                for a in range(3):
                    forces[first + i, a] += weight * pressure * faces.values[p, i] * normal[a]
    return energy, force, area, deepest
