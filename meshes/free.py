"""Tetrahedra of a Rod about equally large everywhere.

Gmsh meshes a straight bar as thick as the rod, the Rod's map bends it.
"""

from types import ModuleType

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.gmsh_model import gmsh_session
from meshes.mesh import Array, Index, Mesh
from meshes.split import AMID, FACE_REFERENCE, REFERENCE, named_faces

# Stations along the rod at which the bar's radius is that of the rod.
_STATIONS = 8


def free(rod: Rod, size: float, order: int = 1) -> Mesh:
    """Return unstructured tetrahedra of order 1 or 2, every node (those amid edges too) where the Rod's map puts it.

    No cell reaches over a knot of the axis.

    Parameters
    ----------
    rod
        An open rod.
    size
        Length of the edges.

    Raises
    ------
    InputError
        If a number is out of its range, or a tetrahedron is inverted.
    """
    if order not in (1, 2):
        raise InputError(f"order of tetrahedra: got {order}, need 1 or 2")
    if rod.closed:
        raise InputError("mesh: the rod is closed; only rods with two ends are meshed")
    u, length, radius = _bar(rod)
    if not 0.0 < size <= length[-1]:
        raise InputError(f"size of the cells: got {size:g}, need a positive length, at most the rod's {length[-1]:.4g}")
    with gmsh_session() as gmsh:
        points, corners = _mesh(gmsh, length, radius, size)
    parameters = np.empty_like(points)
    parameters[:, 2] = np.interp(points[:, 2], length, u)
    parameters[:, :2] = points[:, :2] / np.interp(points[:, 2], length, radius)[:, None]
    parameters[:, :2] /= np.maximum(1.0, np.linalg.norm(parameters[:, :2], axis=1, keepdims=True))
    # gmsh keeps to the planes of the ends but for rounding.
    for level in (u[0], u[-1]):
        parameters[np.abs(parameters[:, 2] - level) < 1e-9 * np.ptp(u), 2] = level

    p = points[corners]
    mirrored = np.linalg.det(p[:, 1:] - p[:, :1]) < 0.0
    corners[mirrored] = corners[mirrored][:, [0, 2, 1, 3]]
    pairs = corners[:, np.array(list(AMID))]
    edges, number = np.unique(np.sort(pairs.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    cells = np.concatenate([corners, len(points) + number.reshape(-1, len(AMID))], axis=1)
    parameters = np.concatenate([parameters, parameters[edges].mean(axis=1)])
    faces = named_faces(cells, parameters[:, 2])
    lateral = np.unique(faces["lateral"])
    parameters[lateral, :2] /= np.linalg.norm(parameters[lateral, :2], axis=1, keepdims=True)

    count, on_face = (4, 3) if order == 1 else (10, 6)
    if order == 1:
        parameters = parameters[: len(points)]
    mesh = Mesh(
        "tetrahedron",
        order,
        rod.points(parameters[:, :2], parameters[:, 2]),
        cells[:, :count],
        REFERENCE[:count],
        {name: nodes[:, :on_face] for name, nodes in faces.items()},
        FACE_REFERENCE[:on_face],
        parameters,
    )
    mesh.check()
    return mesh


def _bar(rod: Rod) -> tuple[Array, Array, Array]:
    """Return stations along the rod: axis parameter, length of the centre line up to there, and mean radius."""
    inside = np.arange(_STATIONS) / _STATIONS
    breaks = rod.axis.breaks
    u = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel(), breaks[-1])
    angle = 2.0 * np.pi * np.arange(32) / 32
    places, _ = rod.grid(np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angle), np.sin(angle)], axis=1)]), u)
    radius = np.linalg.norm(places[:, 1:] - places[:, :1], axis=2).mean(axis=1)
    steps = np.linalg.norm(np.diff(places[:, 0], axis=0), axis=1)
    return u, np.append(0.0, np.cumsum(steps)), radius


def _mesh(gmsh: ModuleType, length: Array, radius: Array, size: float) -> tuple[Array, Index]:
    """Mesh the bar about the z axis, a disk at each end of an axis element.

    Return points and corners of its tetrahedra.
    """
    cad = gmsh.model.occ
    profiles = []
    for first in range(0, len(length) - 1, _STATIONS):
        stations = slice(first, first + _STATIONS + 1)
        rim = [cad.addPoint(r, 0.0, z) for r, z in zip(radius[stations], length[stations], strict=True)]
        low, high = (cad.addPoint(0.0, 0.0, length[k]) for k in (first, first + _STATIONS))
        around = [cad.addLine(low, rim[0]), cad.addSpline(rim), cad.addLine(rim[-1], high), cad.addLine(high, low)]
        profiles.append((2, cad.addPlaneSurface([cad.addCurveLoop(around)])))
    cad.revolve(profiles, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0 * np.pi)
    cad.remove(profiles, True)
    cad.removeAllDuplicates()
    cad.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.option.setNumber("Mesh.Optimize", 1)
    gmsh.model.mesh.generate(3)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    _, nodes = gmsh.model.mesh.getElementsByType(4)
    corners = nodes.astype(np.int64).reshape(-1, 4)
    used, row = np.unique(corners, return_inverse=True)
    place = np.zeros((int(tags.max()) + 1, 3))
    place[tags.astype(np.int64)] = coordinates.reshape(-1, 3)
    return place[used], row.reshape(-1, 4).astype(np.int64)
