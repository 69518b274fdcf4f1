"""Consistent nodal forces of dead loads on the cells that an input file has: bricks of 20 or 8 nodes."""

from typing import NamedTuple

import numpy as np

from isorod.errors import InputError
from isorod.model.load import BodyForce, Pressure, SectionLoad
from isorod.model.model import Model
from meshes.mesh import Array, Index, Mesh, gauss

# Gauss points in each direction, and how far from an end a section may be by rounding, a share of the axis.
_POINTS = 4
_SAME = 1e-9

# The surface that a pressure acts on, by what its name is in a mesh.
SURFACES = {"outer": "lateral", "inner": "inner"}


class Functions(NamedTuple):
    """Serendipity functions of some nodes of a cell or a face.

    Attributes
    ----------
    places
        Which nodes of a row of the mesh have functions, shape ``(n,)``.
    values, slopes
        Functions ``(m, n)`` and gradients ``(m, n, d)`` at Gauss points of the unit cube or square.
    weights
        Of these points, shape ``(m,)``.
    """

    places: Index
    values: Array
    slopes: Array
    weights: Array


def functions(reference: Array, order: int) -> Functions:
    """Return the functions of nodes ``(nodes, d)`` of a reference cube or square, middles of faces and cells left out.

    Of order 2 they span the monomials with one square at the most.
    """
    dimension = reference.shape[1]
    places = np.flatnonzero((np.abs(reference - 0.5) < 0.25).sum(axis=1) <= order - 1)
    powers = np.stack(np.meshgrid(*[np.arange(order + 1)] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    powers = powers[(powers == 2).sum(axis=1) <= 1]
    inverse = np.linalg.inv(np.prod(reference[places][:, None] ** powers, axis=2))
    where, weights = _rule(dimension)
    slopes = np.empty((len(where), len(places), dimension))
    for a in range(dimension):
        lowered = powers.copy()
        lowered[:, a] = np.maximum(powers[:, a] - 1, 0)
        slopes[:, :, a] = (powers[:, a] * np.prod(where[:, None] ** lowered, axis=2)) @ inverse
    return Functions(places, np.prod(where[:, None] ** powers, axis=2) @ inverse, slopes, weights)


def _rule(dimension: int) -> tuple[Array, Array]:
    where, weights = gauss("hexahedron", 2 * _POINTS - 1)
    if dimension == 3:
        return where, weights
    # Those of a face: points of the cube with one of the first coordinates.
    first = np.isclose(where[:, 0], where[0, 0])
    return where[first, 1:], weights[first] / weights[first].sum()


def dead(mesh: Mesh, model: Model) -> Array:
    """Return the nodal forces at full load of what does not follow the surface, shape ``(nodes, 3)``.

    Raises
    ------
    InputError
        If a load is none of these, or on a section within a rod.
    """
    result = np.zeros_like(mesh.points)
    for k, load in enumerate(model.loads):
        if isinstance(load, SectionLoad):
            if load.turns:
                raise InputError(f"load {k}: a moment is not written")
            if load.force is None:
                continue
            nodes, shares, areas = _on_face(mesh, mesh.faces[end_of(k, load, model)])
            size = np.linalg.norm(areas, axis=2)
            parts = np.einsum("fq,qn->fn", size / size.sum(), shares)
            np.add.at(result, nodes, parts[:, :, None] * np.array(load.force))
        elif isinstance(load, BodyForce):
            cells = mesh.cells[mesh.regions[f"rod {load.body}"]]
            own = functions(mesh.reference, mesh.order)
            nodes = cells[:, own.places]
            det = np.linalg.det(np.einsum("qnb,cna->cqab", own.slopes, mesh.points[nodes]))
            np.add.at(result, nodes, ((det * own.weights) @ own.values)[:, :, None] * np.array(load.density))
        elif isinstance(load, Pressure):
            if not load.follows:
                nodes, shares, areas = _on_face(mesh, mesh.faces[face_of(load)])
                np.add.at(result, nodes, -load.pressure * np.einsum("fqa,qn->fna", areas, shares))
        else:
            raise InputError(f"load {k}: {type(load).__name__} is not written")
    return result


def face_of(load: Pressure) -> str:
    """Return the name of the face that a pressure acts on."""
    return f"rod {load.body} {SURFACES[load.surface]}"


def end_of(k: int, load: SectionLoad, model: Model) -> str:
    """Return the name of the face that a force acts on; raises `InputError` if it is on a section within the rod."""
    low, high = model.bodies[load.body].space.axis.breaks[[0, -1]]
    for name, end in (("start", low), ("end", high)):
        if abs((high if load.u is None else load.u) - end) <= _SAME * (high - low):
            return f"rod {load.body} {name}"
    raise InputError(f"load {k}: a force on a section within a rod is not written; load an end, or a body force")


def _on_face(mesh: Mesh, face: Index) -> tuple[Index, Array, Array]:
    """Return nodes of faces ``(f, n)``, functions at points ``(q, n)``, outward areas of the points ``(f, q, 3)``."""
    own = functions(mesh.face_reference, mesh.order)
    nodes = face[:, own.places]
    tangents = np.einsum("qnb,fna->fqab", own.slopes, mesh.points[nodes])
    areas = np.cross(tangents[..., 0], tangents[..., 1]) * own.weights[:, None]
    return nodes, own.values, areas
