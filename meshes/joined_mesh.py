"""The mesh of rods and bodies as one solid (`meshes.joined`): tetrahedra, faces by name, parameters of rods."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from meshes.curved import in_rod, on_geometry, relaxed
from meshes.gmsh_model import elements, gmsh_session, mirror
from meshes.inverse import parameters
from meshes.joined import Join, Part, RodPart, Solid
from meshes.mesh import Array, Index, Mesh

# A face is on a surface of a rod if all of its nodes have the parameters of that to this fraction.
_ON = 1e-3

# Of a face of the geometry so much, at least or at most, must be of a group.
_ALL, _NONE = 0.95, 0.05

# Facets that are tried as the nearest to a point, those with the nearest middles.
_TRIED = 32


class Groups(NamedTuple):
    """The surface of a body's own mesh.

    Attributes
    ----------
    triangles
        Its facets, shape ``(f, 3, 3)``.
    members
        Which of them are of a group, by its name.
    needed
        Groups that something holds or loads.
    """

    triangles: Array
    members: Mapping[str, Any]
    needed: Collection[str]


@dataclass(frozen=True, eq=False)
class Joined(Mesh):
    """A mesh of several parts.

    Attributes
    ----------
    by_rod
        Parameters ``xi_1, xi_2, u`` of nodes in each of the rods, shape ``(rods, nodes, 3)``, NaN elsewhere: where two
        are tied, nodes have those of both.
    bodies
        What of it each body is, as a mesh of its own whose faces are named as the groups.
    """

    by_rod: Array = field(default_factory=lambda: np.empty((0, 0, 3)))
    bodies: Sequence[Mesh] = ()

    def parameters_in(self, rod: int, nodes: Index) -> Array:
        """Return the parameters ``(..., 3)`` of nodes ``(...)`` of a rod."""
        return np.asarray(self.by_rod[rod][nodes])


def build(
    parts: Sequence[Part], joins: Sequence[Join], groups: Mapping[int, Groups], level: int
) -> tuple[Joined, list[str]]:
    """Return the mesh of a level, and notes on cells with less curved edges.

    Regions are named as the parts are, ``rod 0`` ... and ``solid 0`` ...; faces ``rod 0 start``, ``rod 0 end``, ``rod 0
    lateral`` and ``rod 0 inner`` (of each what is on the surface), ``solid 0 GROUP``, and ``tie 0`` ..., whose normals
    point out of the slave.

    Parameters
    ----------
    parts, joins
        Rods first.
    groups
        Of bodies, by the number of the part.
    level
        How many times as small as on level 1 cells are.

    Raises
    ------
    InputError
        If they cannot be made one solid, or a group is a part of a face of the geometry.
    """
    with gmsh_session() as gmsh:
        solid = Solid(gmsh, parts, joins)
        solid.mesh(level)
        made = _Nodes(gmsh, solid)
    rods = [(number, part) for number, part in enumerate(parts) if isinstance(part, RodPart)]
    within, outside = [], []
    for number, rod in rods:
        own = [made.faces[face] for face in (*solid.faces(number), *solid.inner[number])]
        both = in_rod(made.points, rod, made.cells[made.regions[rod.name]], own, made.reference)
        within.append(both[0])
        outside.append(both[1])
    curved = made.points.copy()
    # What is on a surface of one is within another, or ends there.
    for moved in (*within, *outside, *made.on_geometry):
        curved[moved.nodes] = moved.places
    points, thin = relaxed(curved, made.cells, made.reference)
    notes = [f"{thin:,} of {len(made.cells):,} cells have edges that are less curved"] if thin else []
    by_rod = np.full((len(rods), len(points), 3), np.nan)
    for k, (_, one) in enumerate(rods):
        nodes = np.unique(made.cells[made.regions[one.name]])
        by_rod[k, nodes] = parameters(one.rod, points[nodes])[0]
    faces: dict[str, Index] = {}
    bodies: list[Mesh] = []
    for number, part in enumerate(parts):
        own = [made.faces[face] for face in solid.outer[number]]
        if isinstance(part, RodPart):
            faces |= _of_rod(part, by_rod[number], own)
            continue
        faces_of_groups = _of_body(part, groups[number], own, points)
        lost = next((name for name in groups[number].needed if name not in faces_of_groups), None)
        if lost is not None:
            raise InputError(f"{part.label}: group {lost} is on no face of the geometry's surface")
        faces |= {f"{part.name} {name}": faces_of_groups[name] for name in groups[number].needed}
        every = _of_body(part, groups[number], [made.faces[face] for face in solid.faces(number)], points)
        bodies.append(_alone(points, made, part.name, every))
    for k, join in enumerate(joins):
        slave = made.regions[parts[join.slave].name]
        own = [made.faces[face] for face in solid.joints[k]]
        faces[f"tie {k}"] = _outward(np.concatenate(own), made.cells[slave], points, made.mirror)
    for part in parts:
        cells = made.cells[made.regions[part.name]]
        for name in [name for name in faces if name.startswith(f"{part.name} ")]:
            faces[name] = _outward(faces[name], cells, points, made.mirror)
    known = np.full((len(points), 3), np.nan)
    for own_parameters in by_rod:
        known = np.where(np.isnan(known), own_parameters, known)
    mesh = Joined(
        "tetrahedron",
        2,
        points,
        made.cells,
        made.reference,
        faces,
        made.face_reference,
        known,
        made.regions,
        by_rod=by_rod,
        bodies=bodies,
    )
    mesh.check()
    return mesh, notes


def body_file(folder: str | Path, name: str) -> Path:
    """Return the file of a body's own mesh (`Joined.bodies`) in a folder."""
    return Path(folder) / f"{name}.msh"


class _Nodes:
    """Gmsh's mesh: nodes, tetrahedra of all parts, triangles of each face of the geometry."""

    def __init__(self, gmsh: Any, solid: Solid) -> None:
        blocks, self.regions, count = [], {}, 0
        for number, part in enumerate(solid.parts):
            own, self.reference = elements(gmsh, 3, [one.tag for one in solid.fragments if one.part == number])
            self.regions[part.name] = np.arange(count, count + len(own))
            blocks.append(own)
            count += len(own)
        cells = np.concatenate(blocks)
        used, rows = np.unique(cells, return_inverse=True)
        self.cells: Index = rows.reshape(cells.shape).astype(np.int64)
        tags, where, _ = gmsh.model.mesh.getNodes()
        row = np.full(int(tags.max()) + 1, -1)
        row[used] = np.arange(used.size)
        order = np.argsort(tags)
        rows = order[np.searchsorted(tags, used, sorter=order)]
        self.points: Array = np.asarray(where).reshape(-1, 3)[rows]
        self.faces = {}
        for face in {face for k in range(len(solid.parts)) for face in (*solid.faces(k), *solid.inner[k])}:
            nodes, self.face_reference = elements(gmsh, 2, [face])
            self.faces[face] = row[nodes]
        curves = {edge: row[elements(gmsh, 1, [edge])[0]] for edge in solid.curves}
        self.on_geometry = on_geometry(gmsh, solid, self.faces, curves, self.points)
        self.mirror = mirror(self.face_reference)


def _of_rod(part: RodPart, own: Array, faces: Sequence[Index]) -> dict[str, Index]:
    """Return a rod's faces by name, and put their nodes' parameters exactly there."""
    low, high = part.rod.axis.breaks[[0, -1]]
    faces_of_surfaces: dict[str, list[Index]] = {}
    for nodes in faces:
        # Corners are on the geometry, whatever became of edges.
        name = _surface(part, own[nodes[:, :3].ravel()])
        if name:
            faces_of_surfaces.setdefault(name, []).append(nodes)
    sections = {"start": low, "end": high}
    circles = {"lateral": 1.0, "inner": part.radii[0]}
    for name, several in faces_of_surfaces.items():
        nodes = np.unique(np.concatenate([one.ravel() for one in several]))
        if name in sections:
            own[nodes, 2] = sections[name]
        else:
            own[nodes, :2] *= circles[name] / np.linalg.norm(own[nodes, :2], axis=1, keepdims=True)
    return {f"{part.name} {name}": np.concatenate(several) for name, several in faces_of_surfaces.items()}


def _surface(part: RodPart, where: Array) -> str:
    """Return the surface of a rod that all points with these parameters ``(m, 3)`` are on, or nothing."""
    low, high = part.rod.axis.breaks[[0, -1]]
    radius, u = np.linalg.norm(where[:, :2], axis=1), (where[:, 2] - low) / (high - low)
    far = {
        "start": 1.0 if part.rod.closed else np.abs(u).max(),
        "end": 1.0 if part.rod.closed else np.abs(u - 1.0).max(),
        "lateral": np.abs(radius - 1.0).max(),
        "inner": np.abs(radius - part.radii[0]).max() if part.radii[0] > 0.0 else 1.0,
    }
    name = min(far, key=lambda one: far[one])
    return name if far[name] < _ON else ""


def _of_body(part: Part, groups: Groups, faces: Sequence[Index], points: Array) -> dict[str, Index]:
    """Return the facets of a body's groups: of each face of the geometry all or none."""
    faces_of_groups: dict[str, list[Index]] = {group: [] for group in groups.members}
    for nodes in faces if faces_of_groups else ():
        corners = points[nodes[:, :3]]
        nearest = _nearest(corners.mean(axis=1), groups.triangles)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        for group, members in groups.members.items():
            fraction = float(area @ members[nearest] / area.sum())
            if fraction > _ALL:
                faces_of_groups[group].append(nodes)
            elif fraction > _NONE and group in groups.needed:
                raise InputError(
                    f"{part.label}: group {group} is {100 * fraction:.0f} % of a face of the geometry; need all of it "
                    "or none: split the face there"
                )
    return {group: np.concatenate(several) for group, several in faces_of_groups.items() if several}


def _alone(points: Array, made: "_Nodes", region: str, faces: Mapping[str, Index]) -> Mesh:
    """Return a part as a mesh of its own."""
    cells = made.cells[made.regions[region]]
    used, rows = np.unique(cells, return_inverse=True)
    row = np.full(len(points), -1)
    row[used] = np.arange(used.size)
    own = {name: row[_outward(nodes, cells, points, made.mirror)] for name, nodes in faces.items()}
    numbered = rows.reshape(cells.shape).astype(np.int64)
    return Mesh("tetrahedron", 2, points[used], numbered, made.reference, own, made.face_reference)


def _nearest(points: Array, triangles: Array) -> Index:
    """Return the number of the triangle ``(f, 3, 3)`` that each of the points ``(m, 3)`` is nearest to."""
    count = min(_TRIED, len(triangles))
    tried = cKDTree(triangles.mean(axis=1)).query(points, k=count)[1].reshape(len(points), count)
    return np.asarray(tried[np.arange(len(points)), _distances(points[:, None], triangles[tried]).argmin(axis=1)])


def _distances(points: Array, triangles: Array) -> Array:
    """Return squared distances ``(...)`` of points ``(..., 3)`` from triangles ``(..., 3, 3)``."""
    a = triangles[..., 0, :]
    sides = np.stack([triangles[..., 1, :] - a, triangles[..., 2, :] - a], axis=-1)
    away = points - a
    normal = sides.swapaxes(-1, -2) @ sides
    st = np.linalg.solve(normal, (sides.swapaxes(-1, -2) @ away[..., None]))[..., 0]
    on = (st >= 0.0).all(axis=-1) & (st.sum(axis=-1) <= 1.0)
    inside = np.where(on, ((away - (sides @ st[..., None])[..., 0]) ** 2).sum(axis=-1), np.inf)
    edges = []
    for k in range(3):
        start, along = triangles[..., k, :], triangles[..., (k + 1) % 3, :] - triangles[..., k, :]
        position = np.clip(((points - start) * along).sum(axis=-1) / (along**2).sum(axis=-1), 0.0, 1.0)
        edges.append(((points - start - position[..., None] * along) ** 2).sum(axis=-1))
    return np.minimum(inside, np.min(edges, axis=0))


def _outward(face: Index, cells: Index, points: Array, flip: Index) -> Index:
    """Return facets of some cells with their nodes in the order in which normals point out of these."""
    rows: dict[tuple[int, ...], int] = {}
    for left_out in range(4):
        own = np.sort(np.delete(cells[:, :4], left_out, axis=1), axis=1)
        rows |= {tuple(three): k for k, three in enumerate(own.tolist())}
    cell = np.array([rows[tuple(three)] for three in np.sort(face[:, :3], axis=1).tolist()], dtype=np.int64)
    a, b, c = (points[face[:, k]] for k in range(3))
    inside = points[cells[cell, :4]].mean(axis=1)
    inward = ((np.cross(b - a, c - a) * (inside - a)).sum(axis=1) > 0.0)[:, None]
    return np.where(inward, face[:, flip], face)
