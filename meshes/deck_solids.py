"""Finite element bodies of a scene on the cells of input files: their own meshes, supports and loads on groups."""

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from isorod.errors import InputError
from isorod.files.solid import OfBody
from meshes import abaqus
from meshes.mesh import Array, Index, Mesh

if TYPE_CHECKING:
    from isorod.fenics.solid import Solid

# The edges on which gmsh's cells of degree 2 have their nodes behind the corners, in its order.
_EDGES = {
    "tetrahedron": ((0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)),
    "hexahedron": ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
}

# Elements by shape and degree of the displacement: those that have isorod's functions, but 20 of 27 nodes of a brick.
ELEMENTS = {
    ("tetrahedron", 1): "C3D4",
    ("tetrahedron", 2): "C3D10",
    ("hexahedron", 1): "C3D8",
    ("hexahedron", 2): "C3D20R",
}

# Nodes nearer to each other than this fraction of the body's size are the same.
_SAME = 1e-9


def element(body: OfBody, solid: "Solid") -> str:
    """Return the kind of element of a body."""
    return ELEMENTS[body.grid.shape, solid.degree]


def mesh_of(body: OfBody, solid: "Solid", name: str) -> Mesh:
    """Return the mesh of a body, its region and faces by its name and those of its groups: ``solid bone top``."""
    grid, kind = body.grid, abaqus.ELEMENTS[element(body, solid)]
    edges = _EDGES[grid.shape]
    corners = grid.cells[:, : 4 if grid.shape == "tetrahedron" else 8]
    points, cells = grid.points, corners
    ends = np.sort(corners[:, np.array(edges)], axis=-1)
    if kind.order == 2:
        if grid.degree == 2:
            middles = grid.cells[:, corners.shape[1] : corners.shape[1] + len(edges)]
        else:
            pairs, number = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
            middles = len(points) + number.reshape(len(corners), -1)
            points = np.concatenate([points, points[pairs].mean(axis=1)])
        cells = np.concatenate([corners, middles], axis=1)
    places = kind.nodes[: corners.shape[1]]
    reference = np.concatenate([places, places[np.array(edges)].mean(axis=1)]) if kind.order == 2 else places
    between = dict(zip(map(tuple, ends.reshape(-1, 2).tolist()), cells[:, corners.shape[1] :].ravel(), strict=False))

    def whole(facets: Index) -> Index:
        if kind.order == 1:
            return facets
        sides = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=-1), axis=-1)
        middles = [[between[tuple(side)] for side in row] for row in sides.tolist()]
        return np.concatenate([facets, np.array(middles, dtype=np.int64)], axis=1)

    return Mesh(
        grid.shape,  # type: ignore[arg-type]
        kind.order,
        points,
        cells,
        reference,
        {f"{name} {group}": whole(facets) for group, facets in grid.groups.items()},
        np.zeros((0, 2)),
        regions={name: np.arange(len(cells))},
    )


def facets_of(solid: "Solid", facets: Any) -> Index:
    """Return the corners ``(f, 3 or 4)`` of dolfinx's facets, of all of the surface where none are given."""
    from isorod.fenics import compat
    from isorod.fenics.groups import corners

    return corners(solid.space.mesh, compat.exterior_facets(solid.space.mesh) if facets is None else facets)


def forces(mesh: Mesh, solid: "Solid", name: str) -> Array:
    """Return the nodal forces of a body's loads at load factor 1, shape ``(nodes, 3)``."""
    from dolfinx import fem

    from isorod.fenics import compat
    from isorod.fenics.flags import FAST

    result = np.zeros_like(mesh.points)
    if solid.outer.empty():
        return result
    if mesh.shape == "hexahedron" and mesh.order == 2:
        raise InputError(f"{name}: loads on hexahedra of degree 2 are not written to .inp; take tetrahedra")
    vector = fem.Function(solid.space)
    compat.assemble_array(vector.x.array, compat.form(solid.outer, FAST))
    far, row = cKDTree(mesh.points).query(solid.space.tabulate_dof_coordinates())
    assert far.max() < _SAME * np.ptp(mesh.points), "nodes of dolfinx are those of the mesh"
    result[row] = vector.x.array.reshape(-1, 3)
    return result
