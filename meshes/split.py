"""Curved tetrahedra of a Rod with a flat section.

Triangles of the section, prisms of the layers, three tetrahedra to a prism.
"""

from dataclasses import dataclass

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.bricks import axis_positions
from meshes.mesh import Array, Index, Mesh
from meshes.strip import levels, rotation

_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
# Node numbers amid the corners of the 10-node tetrahedron.
AMID = {(0, 1): 4, (0, 2): 5, (0, 3): 6, (1, 2): 7, (1, 3): 8, (2, 3): 9}
REFERENCE = np.concatenate([_CORNERS, [0.5 * (_CORNERS[a] + _CORNERS[b]) for a, b in AMID]])
_OUTWARD = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
FACE_REFERENCE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]])


@dataclass(frozen=True, eq=False)
class Triangles:
    """Six-node triangles of the unit disk.

    Attributes
    ----------
    points
        Nodes, shape ``(nodes, 2)``.
    corners
        Corner nodes of the triangles, shape ``(triangles, 3)``.
    amid
        The node amid each pair of corners that an edge joins, and a corner amid itself.
    """

    points: Array
    corners: Index
    amid: dict[tuple[int, int], int]


def fan(along: int, across: int = 1, clustering: float = 1.0, turn: float = 0.0) -> Triangles:
    """Return columns of triangles across a diameter, with a fan of ``across`` at each of its ends.

    Two edges along the circle meet at an end of the diameter.  Their middle nodes stand amid in the coordinate along
    the diameter, hence far from the end, which keeps the corner convex.

    Parameters
    ----------
    along, across
        Numbers of columns, at least 2, and of triangle pairs in one.
    clustering, turn
        See `meshes.strip.strip`.
    """
    if along < 2 or across < 1:
        raise InputError(f"cells of the section: got {along} along and {across} across, need at least 2 and 1")
    # Corners by (column, row): one at each end, across + 1 in between; coordinates x and y / height at x.
    x = levels(along, clustering)
    places: list[tuple[float, float]] = []
    number = np.zeros((along + 1, across + 1), dtype=np.int64)
    for column in range(along + 1):
        end = column in (0, along)
        for row in range(across + 1):
            if end and row:
                number[column, row] = number[column, 0]
            else:
                number[column, row] = len(places)
                places.append((x[column], 0.0 if end else 2.0 * row / across - 1.0))
    triangles = []
    for column in range(along):
        for row in range(across):
            a, b = number[column, row], number[column + 1, row]
            c, d = number[column + 1, row + 1], number[column, row + 1]
            # Diagonals mirrored in the middle, so that the ends look alike.
            halves = ((a, b, c), (a, c, d)) if (2 * column < along) == (2 * row < across) else ((a, b, d), (b, c, d))
            triangles += [half for half in halves if len(set(half)) == 3]
    s, t = np.array(places).T
    points = [*np.stack([s, t * np.sqrt(np.maximum(0.0, 1.0 - s * s))], axis=1)]
    ends = (int(number[0, 0]), int(number[-1, 0]))
    amid = {(k, k): k for k in range(len(places))}
    for triangle in triangles:
        for p, q in ((0, 1), (1, 2), (0, 2)):
            a, b = sorted((int(triangle[p]), int(triangle[q])))
            if (a, b) in amid:
                continue
            amid[a, b] = len(points)
            middle = 0.5 * (points[a] + points[b])
            # An end has no height and stands in every row.
            rows = {places[k][1] for k in (a, b) if k not in ends}
            if rows in ({-1.0}, {1.0}):
                middle[1] = rows.pop() * np.sqrt(1.0 - middle[0] ** 2)
            points.append(middle)
    return Triangles(np.array(points) @ rotation(turn), np.array(triangles), amid)


def layered(rod: Rod, section: Triangles, layers: int, grading: float = 1.0) -> Mesh:
    """Return 10-node tetrahedra, every node where the Rod's map puts it.

    The prisms over the triangles are cut such that neighbours have the same diagonals on their common faces: a diagonal
    starts at the lowest node of its face (Dompierre, Labbe, Vallet, Camarero, "How to subdivide pyramids, prisms and
    hexahedra into tetrahedra", 8th Int. Meshing Roundtable, 1999).

    Parameters
    ----------
    rod
        An open rod.
    layers, grading
        See `meshes.bricks.bricks`.
    """
    u = axis_positions(rod, layers, 2, grading)
    positions, _ = rod.grid(section.points, u)
    count = len(section.points)
    one_layer = []
    for a, b, c in np.sort(section.corners, axis=1).tolist():
        for prism_part in (
            ((a, 0), (b, 0), (c, 0), (c, 2)),
            ((a, 0), (b, 0), (b, 2), (c, 2)),
            ((a, 0), (a, 2), (b, 2), (c, 2)),
        ):
            nodes = [node + count * level for node, level in prism_part]
            for p, q in AMID:
                (one, low), (other, high) = prism_part[p], prism_part[q]
                nodes.append(section.amid[min(one, other), max(one, other)] + count * (low + high) // 2)
            one_layer.append(nodes)
    cells = (np.array(one_layer) + 2 * count * np.arange(layers)[:, None, None]).reshape(-1, 10)
    points = positions.reshape(-1, 3)
    corners = points[cells[:, :4]]
    mirrored = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
    cells[mirrored] = cells[mirrored][:, [0, 2, 1, 3, 5, 4, 6, 7, 9, 8]]
    parameters = np.concatenate([np.tile(section.points, (u.size, 1)), np.repeat(u, count)[:, None]], axis=1)
    faces = named_faces(cells, parameters[:, 2])
    mesh = Mesh("tetrahedron", 2, points, cells, REFERENCE, faces, FACE_REFERENCE, parameters)
    mesh.check()
    return mesh


def named_faces(cells: Index, u: Array) -> dict[str, Index]:
    """Return the boundary triangles by name, 6 nodes each, outward normal; ``u`` is the axis parameter of each node."""
    every = []
    for a, b, c in _OUTWARD:
        edges = [AMID[min(p, q), max(p, q)] for p, q in ((a, b), (b, c), (c, a))]
        every.append(cells[:, [a, b, c, *edges]])
    triangles = np.concatenate(every)
    _, where, count = np.unique(np.sort(triangles[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    boundary = triangles[where[count == 1]]
    start = (u[boundary] == u.min()).all(axis=1)
    end = (u[boundary] == u.max()).all(axis=1)
    return {"start": boundary[start], "end": boundary[end], "lateral": boundary[~start & ~end]}
