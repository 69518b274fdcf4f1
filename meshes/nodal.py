"""Consistent nodal forces of dead loads on the cells that an input file has: bricks of 20 or 8 nodes."""

from typing import NamedTuple

import numpy as np

from isorod.errors import InputError
from isorod.model.load import BodyForce, LineLoad, PointLoad, Pressure, SectionLoad, Weight
from isorod.model.model import Model
from meshes.mesh import Array, Index, Mesh, gauss

# Gauss points in each direction, and how far from an end a section may be by rounding, a fraction of the axis.
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
    where, weights = _rule(reference.shape[1])
    return Functions(*at_points(reference, order, where), weights)


def at_points(reference: Array, order: int, where: Array) -> tuple[Index, Array, Array]:
    """Return the same at points ``(m, d)``: `Functions.places`, values ``(m, n)`` and slopes ``(m, n, d)``."""
    dimension = reference.shape[1]
    places = np.flatnonzero((np.abs(reference - 0.5) < 0.25).sum(axis=1) <= order - 1)
    powers = np.stack(np.meshgrid(*[np.arange(order + 1)] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    powers = powers[(powers == 2).sum(axis=1) <= 1]
    inverse = np.linalg.inv(np.prod(reference[places][:, None] ** powers, axis=2))
    slopes = np.empty((len(where), len(places), dimension))
    for a in range(dimension):
        lowered = powers.copy()
        lowered[:, a] = np.maximum(powers[:, a] - 1, 0)
        slopes[:, :, a] = (powers[:, a] * np.prod(where[:, None] ** lowered, axis=2)) @ inverse
    return places, np.prod(where[:, None] ** powers, axis=2) @ inverse, slopes


def _rule(dimension: int) -> tuple[Array, Array]:
    where, weights = gauss("hexahedron", 2 * _POINTS - 1)
    # Those of a face, or a line: points of the cube with one of the first coordinates, or of the first two.
    first = np.isclose(where[:, : 3 - dimension], where[0, : 3 - dimension]).all(axis=1)
    return where[first, 3 - dimension :], weights[first] / weights[first].sum()


def dead(mesh: Mesh, model: Model, factor: float = 1.0) -> Array:
    """Return the nodal forces at a load factor of loads that do not follow the surface, shape ``(nodes, 3)``.

    Raises
    ------
    InputError
        If a load is none of these.
    """
    result = np.zeros_like(mesh.points)
    for k, load in enumerate(model.loads):
        fraction = model.amplitude(load.history, factor)
        if isinstance(load, SectionLoad):
            if load.turns and load in model.following:
                raise InputError(
                    f"load {k}: a moment on a body that turns is not written: CalculiX has no forces that turn with a "
                    "section; a law of small displacements, LinearElastic, takes it"
                )
            nodes, values, areas = on_face(mesh, face_at(mesh, load.body, load.u, model))
            size = np.linalg.norm(areas, axis=2)
            size /= size.sum()
            places = np.einsum("qn,fna->fqa", values, mesh.points[nodes])
            forces = np.einsum("fq,qn,fqa->fna", size, values, _tractions(load, places, size))
        elif isinstance(load, BodyForce | Weight):
            force = np.array(load.density) if isinstance(load, BodyForce) else _weight(k, load)
            own = functions(mesh.reference, mesh.order)
            nodes = mesh.cells[mesh.regions[f"rod {load.body}"]][:, own.places]
            det = np.linalg.det(np.einsum("qnb,cna->cqab", own.slopes, mesh.points[nodes]))
            forces = ((det * own.weights) @ own.values)[:, :, None] * force
        elif isinstance(load, LineLoad):
            nodes, lengths = _along(mesh, load.body, model)
            forces = lengths[:, :, None] * np.array(load.per_length)
        elif isinstance(load, PointLoad):
            nodes, values = _at(mesh, load, model)
            forces = values[:, None] * np.array(load.force)
        elif not isinstance(load, Pressure):
            raise InputError(f"load {k}: {type(load).__name__} is not written")
        elif load.follows:
            continue
        else:
            nodes, values, areas = on_face(mesh, mesh.faces[face_of(load)])
            forces = -load.pressure * np.einsum("fqa,qn->fna", areas, values)
        np.add.at(result, nodes, fraction * forces)
    return result


def _along(mesh: Mesh, body: int, model: Model) -> tuple[Index, Array]:
    """Return nodes of cells ``(c, n)`` and the lengths of the centre line that are theirs, alike over each section."""
    rod = model.bodies[body].space.rod
    cells = mesh.cells[mesh.regions[f"rod {body}"]]
    own = functions(mesh.reference, mesh.order)
    nodes = cells[:, own.places]
    tangents = np.einsum("qnb,cna->cqab", own.slopes, mesh.points[nodes])
    areas = np.linalg.norm(np.cross(tangents[..., 0], tangents[..., 1]), axis=-1) * own.weights
    # Of the points of a cell the last coordinate, along the rod, varies fastest.
    where, weights = _rule(1)
    first, last = mesh.parameters_in(body, cells[:, [0, -1]])[..., 2].T
    begins, layer = np.unique(first, return_inverse=True)
    ends = np.zeros(len(begins))
    # The last layer of a closed rod ends in nodes of the start.
    ends[layer] = np.where(last > first, last, rod.axis.breaks[-1])
    u = begins[:, None] + (ends - begins)[:, None] * where[:, 0]
    speed = np.linalg.norm(rod.grid(np.zeros((1, 2)), u.ravel())[1][:, 0, :, 2], axis=-1).reshape(u.shape)
    slices = areas.reshape(len(cells), -1, len(weights))
    total = np.zeros(u.shape)
    np.add.at(total, layer, slices.sum(axis=1))
    lengths = speed * (ends - begins)[:, None] * weights
    return nodes, (slices * (lengths / total)[layer][:, None]).reshape(areas.shape) @ own.values


def _at(mesh: Mesh, load: PointLoad, model: Model) -> tuple[Index, Array]:
    """Return nodes and functions of the edge on which the place of a force is."""
    edges = edges_at(mesh, load.body, load.u, model, SURFACES[load.surface])
    x, y = np.moveaxis(mesh.parameters_in(load.body, edges)[..., :2], -1, 0)
    # Angles of the edges' nodes from that of the place.
    angle = np.angle((x + 1j * y) * np.exp(-1j * np.radians(load.angle)))
    near = int(np.abs(angle).max(axis=1).argmin())
    ticks = np.linspace(0.0, 1.0, mesh.order + 1)
    ends = angle[near, [0, -1]]
    t = np.clip(ends[0] / (ends[0] - ends[1]), 0.0, 1.0)
    values = [np.prod((t - np.delete(ticks, k)) / (ticks[k] - np.delete(ticks, k))) for k in range(len(ticks))]
    return edges[near], np.array(values)


def face_of(load: Pressure) -> str:
    """Return the name of the face that a pressure acts on."""
    return f"rod {load.body} {SURFACES[load.surface]}"


def _weight(k: int, load: Weight) -> Array:
    """Return the force per volume of a weight."""
    if np.ptp(load.of.densities) > 0.0:
        raise InputError(f"load {k}: the weight of several densities is not written; take body forces")
    return float(load.of.densities[0]) * np.array(load.acceleration)


def _tractions(load: SectionLoad, places: Array, fractions: Array) -> Array:
    """Return the tractions of a load at places of its section, ``(f, q, 3)``, per fraction ``(f, q)`` of its area."""
    tractions = np.broadcast_to(np.array(load.force or (0.0, 0.0, 0.0)), places.shape)
    if not load.turns:
        return tractions
    arms = places - np.einsum("fq,fqa->a", fractions, places)
    # As in isorod: by the mean rotation.
    inertia = np.einsum("fq,fqa,fqa->", fractions, arms, arms) * np.eye(3) - np.einsum(
        "fq,fqa,fqb->ab", fractions, arms, arms
    )
    return tractions + np.cross(np.linalg.solve(inertia, np.array(load.moment)), arms)


def face_at(mesh: Mesh, body: int, u: float | None, model: Model) -> Index:
    """Return the faces of a section, that at the end where none is given, which is a plane of the mesh (`cuts`)."""
    at, same, end = _place(body, u, model)
    if end:
        return mesh.faces[f"rod {body} {end}"]
    # The first nodes of a cell are those of its side towards the start.
    faces = mesh.cells[mesh.regions[f"rod {body}"]][:, : (mesh.order + 1) ** 2]
    return faces[(np.abs(mesh.parameters_in(body, faces)[..., 2] - at) <= same).all(axis=1)]


def edges_at(mesh: Mesh, body: int, u: float, model: Model, surface: str = "lateral") -> Index:
    """Return the edges of the line round a section, which is one of the mesh, ``(edges, nodes)``."""
    at, same, end = _place(body, u, model)
    faces = mesh.faces[f"rod {body} {surface}"].reshape(-1, mesh.order + 1, mesh.order + 1)
    edges = faces[:, -1 if end == "end" else 0]
    return edges[(np.abs(mesh.parameters_in(body, edges)[..., 2] - at) <= same).all(axis=1)]


def _place(body: int, u: float | None, model: Model) -> tuple[float, float, str]:
    """Return the parameter of a section, what differs from it by rounding, and the end that it is; of rings none."""
    rod = model.bodies[body].space.rod
    low, high = rod.axis.breaks[[0, -1]]
    at, same = high if u is None else u, _SAME * (high - low)
    if rod.closed:
        return (low if abs(at - high) <= same else at), same, ""
    return at, same, next((name for name, end in (("start", low), ("end", high)) if abs(at - end) <= same), "")


def on_face(mesh: Mesh, face: Index) -> tuple[Index, Array, Array]:
    """Return nodes of faces ``(f, n)``, functions at points ``(q, n)``, outward areas of the points ``(f, q, 3)``."""
    own = functions(mesh.face_reference, mesh.order)
    nodes = face[:, own.places]
    tangents = np.einsum("qnb,fna->fqab", own.slopes, mesh.points[nodes])
    areas = np.cross(tangents[..., 0], tangents[..., 1]) * own.weights[:, None]
    return nodes, own.values, areas


def on_line(mesh: Mesh, edges: Index) -> tuple[Index, Array, Array]:
    """Return the same of edges: lengths along them ``(e, q, 3)`` in the place of areas."""
    own = functions(np.linspace(0.0, 1.0, mesh.order + 1)[:, None], mesh.order)
    nodes = edges[:, own.places]
    return nodes, own.values, np.einsum("qnb,ena->eqa", own.slopes, mesh.points[nodes]) * own.weights[:, None]
