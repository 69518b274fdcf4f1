"""Where the middles of edges of tetrahedra are that make up rods and bodies: gmsh's own are slow, and turn cells over.

In a rod edges are straight in its parameters, so that cells follow a wire however it winds; on its surfaces, and on
those of bodies, they are on these.  Cells that this makes too thin get edges that are less curved.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from meshes.inverse import parameters
from meshes.joined import BodyPart, RodPart, Solid
from meshes.mesh import Array, Index, Mesh, gauss

# Radii of the disk are the same to this fraction.
_ON = 1e-3

# Cells whose smallest Jacobian determinant, at nodes and points of this rule, is below that fraction of the mean get
# edges that are half as curved, some times, then straight.
_RULE, _FLAT, _HALVES = 5, 0.02, 4

# The edges of a tetrahedron, by its corners.
EDGES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def middles(reference: Array) -> tuple[Index, Index]:
    """Return which nodes of a cell are the corners ``(6, 2)`` of each edge, and which its middle ``(6,)``."""
    corners = [int(np.flatnonzero((reference == one).all(axis=1))[0]) for one in np.eye(4, 3, -1)]
    ends = np.array([[corners[a], corners[b]] for a, b in EDGES])
    away = np.linalg.norm(reference - reference[ends].mean(axis=1)[:, None], axis=2)
    return ends, away.argmin(axis=1)


class Moved(NamedTuple):
    """Nodes ``(m,)``, and where they go ``(m, 3)``."""

    nodes: Index
    places: Array


def on_geometry(
    gmsh: Any, solid: Solid, faces: Mapping[int, Index], curves: Mapping[int, Index], points: Array
) -> list[Moved]:
    """Return middles of edges on curved faces of bodies, then those on curves round these and round joints.

    Parameters
    ----------
    gmsh, solid
        The model that is open, of cells whose edges are straight.
    faces, curves
        Triangles ``(f, 6)`` of faces, and lines ``(l, 3)`` of curves, by the tag of the geometry.
    points
        Of the nodes.
    """
    bodies = [number for number, part in enumerate(solid.parts) if isinstance(part, BodyPart)]
    bent = [face for number in bodies for face in solid.outer[number] if gmsh.model.getType(2, face) != "Plane"]
    entities = [(2, face, np.unique(faces[face][:, 3:])) for face in bent]
    entities += [(1, curve, lines[:, 2]) for curve, lines in curves.items() if gmsh.model.getType(1, curve) != "Line"]
    return [
        Moved(rows, np.reshape(gmsh.model.getClosestPoint(dimension, tag, points[rows].ravel())[0], (-1, 3)))
        for dimension, tag, rows in entities
        if rows.size
    ]


def in_rod(points: Array, part: RodPart, cells: Index, faces: Sequence[Index], reference: Array) -> tuple[Moved, Moved]:
    """Return middles of a rod's edges, then those on its surfaces, where its map has them.

    Parameters
    ----------
    points
        Of the nodes.
    cells
        Those of the rod.
    faces
        Triangles ``(f, 6)`` of each face of it.
    reference
        Positions of a cell's nodes.
    """
    rod = part.rod
    ends, middle = middles(reference)
    nodes, place = np.unique(cells[:, middle], return_index=True)
    ends = cells[:, ends].reshape(-1, 2)[place]
    corners = np.unique(ends)
    own = np.full((len(points), 3), np.nan)
    own[corners] = parameters(rod, points[corners])[0]
    first, second = own[ends[:, 0]], own[ends[:, 1]]
    along = second[:, 2] - first[:, 2]
    if rod.closed:
        period = float(np.ptp(rod.axis.breaks[[0, -1]]))
        along -= period * np.rint(along / period)
    own[nodes, :2] = 0.5 * (first + second)[:, :2]
    own[nodes, 2] = first[:, 2] + 0.5 * along
    outside = []
    for triangles in faces:
        size = np.linalg.norm(own[triangles[:, :3].ravel(), :2], axis=1)
        radius = next((one for one in part.radii if one > 0.0 and np.abs(size - one).max() < _ON), None)
        if radius is not None:
            on = np.unique(triangles[:, 3:])
            own[on, :2] *= radius / np.linalg.norm(own[on, :2], axis=1, keepdims=True)
            outside.append(on)
    if rod.closed:
        own[nodes, 2] = rod.axis.breaks[0] + np.mod(own[nodes, 2] - rod.axis.breaks[0], period)
    surface = np.unique(np.concatenate(outside)) if outside else np.empty(0, dtype=np.int64)
    inner, outer = (Moved(one, rod.points(own[one, :2], own[one, 2])) for one in (nodes, surface))
    return inner, outer


def relaxed(points: Array, cells: Index, reference: Array) -> tuple[Array, int]:
    """Return nodes with edges of cells that are too thin less curved, and how many cells these are.

    They are half as curved as often as that is needed.
    """
    ends, middle = middles(reference)
    where = np.concatenate([gauss("tetrahedron", _RULE)[0], reference])
    points, moved = points.copy(), set()
    straight = points.copy()
    straight[cells[:, middle]] = points[cells[:, ends]].mean(axis=2)
    left = np.arange(len(cells))
    for last in (False,) * _HALVES + (True,):
        det = Mesh("tetrahedron", 2, points, cells[left], reference, {}, np.empty((0, 2))).jacobians(where)
        bad = left[det.min(axis=1) < _FLAT * det.mean(axis=1)]
        rows = np.unique(cells[np.ix_(bad, middle)])
        points[rows] = straight[rows] if last else 0.5 * (points[rows] + straight[rows])
        moved |= {*bad.tolist()}
        left = np.flatnonzero(np.isin(cells, rows).any(axis=1))
    return points, len(moved)
