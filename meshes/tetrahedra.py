"""Curved tetrahedra of a Rod: gmsh meshes the straight cylinder, the Rod's map bends it."""

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.bricks import axis_positions
from meshes.gmsh_model import elements, gmsh_session, mirror
from meshes.mesh import Array, CellShape, Index, Mesh


def tetrahedra(rod: Rod, around: int, layers: int, order: int = 2) -> Mesh:
    """Return tetrahedra of order 1 or 2, every node (those amid edges too) where the Rod's map puts it.

    gmsh triangulates the unit disk and extrudes it in layers, so that edges along the rod are as long as the
    layers.

    Parameters
    ----------
    rod
        An open rod.
    around
        Number of edges round the rim, at least 3.
    layers
        Number of layers along the rod, a multiple of its axis elements.

    Raises
    ------
    InputError
        If a number is out of its range, or a tetrahedron is inverted.
    """
    if around < 3:
        raise InputError(f"cells round the section: got {around}, need at least 3")
    if order not in (1, 2):
        raise InputError(f"order of tetrahedra: got {order}, need 1 or 2")
    u = axis_positions(rod, layers, 1)
    points, cells, reference, faces, face_reference = _cylinder(around, layers, order)

    # Heights 0 .. layers of the cylinder become axis parameters; the disk's rim is exact but for rounding.
    height = np.interp(points[:, 2], np.arange(layers + 1.0), u)
    xi = points[:, :2]
    xi = xi / np.maximum(1.0, np.linalg.norm(xi, axis=1, keepdims=True))
    shape: CellShape = "tetrahedron"
    parameters = np.concatenate([xi, height[:, None]], axis=1)
    mesh = Mesh(shape, order, rod.points(xi, height), cells, reference, faces, face_reference, parameters)
    mesh.check()
    return mesh


def _cylinder(around: int, layers: int, order: int) -> tuple[Array, Index, Array, dict[str, Index], Array]:
    """Mesh the unit disk times ``(0, layers)``."""
    with gmsh_session() as gmsh:
        geometry = gmsh.model.geo
        size = 2.0 * np.pi / around
        center = geometry.addPoint(0, 0, 0)
        rim = [geometry.addPoint(np.cos(a), np.sin(a), 0, size) for a in (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0)]
        arcs = [geometry.addCircleArc(rim[k], center, rim[(k + 1) % 3]) for k in range(3)]
        # An edge count that 3 does not divide is distributed as evenly as possible.
        for k, arc in enumerate(arcs):
            geometry.mesh.setTransfiniteCurve(arc, (around * (k + 1)) // 3 - (around * k) // 3 + 1)
        disk = geometry.addPlaneSurface([geometry.addCurveLoop(arcs)])
        out = geometry.extrude([(2, disk)], 0, 0, layers, numElements=[layers])
        geometry.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)

        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        row = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        volume = next(tag for dimension, tag in out if dimension == 3)
        end = out[0][1]
        sides = [tag for dimension, tag in out[2:] if dimension == 2]
        cells, reference = elements(gmsh, 3, [volume])
        used = np.unique(cells)
        row[used] = np.arange(used.size)
        position = np.zeros((int(tags.max()) + 1, 3))
        position[tags.astype(np.int64)] = coordinates.reshape(-1, 3)
        surfaces = {"start": [disk], "end": [end], "lateral": sides}
        faces = {}
        for name, entities in surfaces.items():
            nodes, face_reference = elements(gmsh, 2, entities)
            faces[name] = row[nodes]
    cells = row[cells]
    # gmsh hands out left-handed tetrahedra where it extruded against a surface's normal.
    flip, face_flip = mirror(reference), mirror(face_reference)
    p = position[used]
    corner = p[cells[:, :4]]
    negative = np.linalg.det(corner[:, 1:] - corner[:, :1]) < 0.0
    cells[negative] = cells[negative][:, flip]
    for name, nodes in faces.items():
        a, b, c = p[nodes[:, 0]], p[nodes[:, 1]], p[nodes[:, 2]]
        middle = (a + b + c) / 3.0
        outward = {"start": [0.0, 0.0, -1.0], "end": [0.0, 0.0, 1.0], "lateral": middle * [1.0, 1.0, 0.0]}[name]
        inward = np.sum(np.cross(b - a, c - a) * outward, axis=1) < 0.0
        nodes[inward] = nodes[inward][:, face_flip]
    return p, cells, reference, faces, face_reference
