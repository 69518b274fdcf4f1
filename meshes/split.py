"""Tetrahedra with the nodes of second-order bricks: each brick becomes six."""

import numpy as np
from numpy.typing import NDArray

from meshes.mesh import Array, Index, Mesh

# The nodes of a 27-node brick form a lattice numbered i + 3 j + 9 k, so the number of the node amid two others is their mean.
_TOP = 18
_RISING = ((0, 2, 8), (0, 8, 6))
_FALLING = ((0, 2, 6), (2, 8, 6))

_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
# Node numbers amid the corners of the 10-node tetrahedron.
_AMID = {(0, 1): 4, (0, 2): 5, (0, 3): 6, (1, 2): 7, (1, 3): 8, (2, 3): 9}
_OUTWARD = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
_FACE_REFERENCE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]])


def tetrahedra_of(bricks: Mesh) -> Mesh:
    """Return 10-node tetrahedra on the nodes of a Rod's 27-node bricks, six to a brick.

    Each quadrilateral of the section is cut from its bluntest corner, so that no triangle keeps a corner with two edges tangent
    to the outline.  The two prisms of a brick are then cut such that neighbours share the diagonals of their common faces: a
    diagonal starts at the lowest node of its face (Dompierre, Labbe, Vallet, Camarero, "How to subdivide pyramids, prisms and
    hexahedra into tetrahedra", 8th Int. Meshing Roundtable, 1999).
    """
    if bricks.shape != "hexahedron" or bricks.order != 2 or bricks.parameters is None:
        raise ValueError("only a Rod's bricks of order 2 are cut into tetrahedra")
    rising = _cut_rising(bricks.parameters[bricks.cells[:, :9], :2])
    parts = []
    for choice, halves in ((rising, _RISING), (~rising, _FALLING)):
        for triangle in halves:
            parts += _prism(bricks.cells[choice], np.array(triangle))
    cells = np.concatenate(parts)
    corners = bricks.points[cells[:, :4]]
    mirrored = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0.0
    cells[mirrored] = cells[mirrored][:, [0, 2, 1, 3, 5, 4, 6, 7, 9, 8]]
    reference = np.concatenate([_CORNERS, [0.5 * (_CORNERS[a] + _CORNERS[b]) for a, b in _AMID]])
    faces = _faces(cells, bricks.parameters[:, 2])
    mesh = Mesh("tetrahedron", 2, bricks.points, cells, reference, faces, _FACE_REFERENCE, bricks.parameters)
    mesh.check()
    return mesh


def _cut_rising(quads: Array) -> NDArray[np.bool_]:
    """Return for 9-node quadrilaterals ``(m, 9, 2)`` whether to cut from the first to the third corner."""

    def bluntness(corner: int, one: int, other: int) -> Array:
        # Tangents of the quadratic edges at their common corner.
        p = quads[:, corner]
        tangents = [4.0 * quads[:, (corner + end) // 2] - 3.0 * p - quads[:, end] for end in (one, other)]
        a, b = (t / np.linalg.norm(t, axis=1, keepdims=True) for t in tangents)
        return -np.sum(a * b, axis=1)

    first = np.maximum(bluntness(0, 2, 6), bluntness(8, 2, 6))
    second = np.maximum(bluntness(2, 0, 8), bluntness(6, 0, 8))
    # Rounding must not decide between equals: a quadrilateral is cut the same way in every layer.
    return first > second - 1e-6


def _prism(bricks: Index, triangle: Index) -> list[Index]:
    """Return the three tetrahedra, each ``(m, 10)``, of the prism over a triangle of lattice corners in each brick."""
    order = np.argsort(bricks[:, triangle], axis=1)
    a, b, c = triangle[order].T
    rows = np.arange(len(bricks))[:, None]
    cut = []
    for corners in ((a, b, c, c + _TOP), (a, b, b + _TOP, c + _TOP), (a, a + _TOP, b + _TOP, c + _TOP)):
        local = np.stack(corners, axis=1)
        amid = np.stack([(local[:, p] + local[:, q]) // 2 for p, q in _AMID], axis=1)
        cut.append(bricks[rows, np.concatenate([local, amid], axis=1)])
    return cut


def _faces(cells: Index, u: Array) -> dict[str, Index]:
    """Return the boundary triangles by name, 6 nodes each, outward normal; ``u`` is the axis parameter of each node."""
    every = []
    for a, b, c in _OUTWARD:
        edges = [_AMID[min(p, q), max(p, q)] for p, q in ((a, b), (b, c), (c, a))]
        every.append(cells[:, [a, b, c, *edges]])
    triangles = np.concatenate(every)
    _, where, count = np.unique(np.sort(triangles[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    boundary = triangles[where[count == 1]]
    start = (u[boundary] == u.min()).all(axis=1)
    end = (u[boundary] == u.max()).all(axis=1)
    return {"start": boundary[start], "end": boundary[end], "lateral": boundary[~start & ~end]}
