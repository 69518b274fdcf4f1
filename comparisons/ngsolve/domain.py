"""A `Mesh` handed to NGSolve: its corners as vertices, and its curved shape as a deformation of the straight cells."""

import netgen.meshing as netgen
import ngsolve
import numpy as np

from meshes.mesh import Array, Index, Mesh

# Corners of the reference cells as NGSolve numbers them, in the coordinates of `Mesh.reference`.
_CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float)
_SIMPLEX = np.array([(0, 0, 0), (0, 1, 0), (1, 0, 0), (0, 0, 1)], dtype=float)
_CORNERS = {"hexahedron": _CUBE, "tetrahedron": _SIMPLEX}


def build(mesh: Mesh) -> ngsolve.Mesh:
    """Return a mesh's cells, curved by its own polynomials, their named faces as boundaries of these names."""
    cells = mesh.cells[:, _numbers(mesh.reference, _CORNERS[mesh.shape])]
    corners = _numbers(mesh.face_reference, _CUBE[: 4 if mesh.shape == "hexahedron" else 2, :2])
    if mesh.shape == "tetrahedron":
        corners = _numbers(mesh.face_reference, np.array([(0, 0), (1, 0), (0, 1)], dtype=float))
    used = np.unique(cells)
    made = netgen.Mesh(dim=3)
    vertex = dict(zip(used.tolist(), (_point(made, x) for x in mesh.points[used]), strict=True))
    for number, name in enumerate(mesh.faces, 1):
        made.Add(netgen.FaceDescriptor(surfnr=number, domin=1, bc=number))
        made.SetBCName(number - 1, name)
    made.SetMaterial(1, "body")
    for cell in cells.tolist():
        made.Add(netgen.Element3D(1, [vertex[node] for node in cell]))
    for number, faces in enumerate(mesh.faces.values(), 1):
        for face in faces[:, corners].tolist():
            made.Add(netgen.Element2D(number, [vertex[node] for node in face]))
    result = ngsolve.Mesh(made)
    result.SetDeformation(_deformation(result, mesh))
    return result


def _point(made: netgen.Mesh, x: Array) -> netgen.PointId:
    return made.Add(netgen.MeshPoint(netgen.Pnt(*x.tolist())))


def _numbers(nodes: Array, targets: Array) -> Index:
    """Return which of the nodes of a reference cell stand at some places."""
    return np.argmin(np.linalg.norm(nodes[None] - targets[:, None], axis=2), axis=1)


def _deformation(straight: ngsolve.Mesh, mesh: Mesh) -> ngsolve.GridFunction:
    """Return the field that takes cells with straight edges to those of the mesh: the same polynomials."""
    # Blocks of three are evaluated faster than three fields.
    space = ngsolve.H1(straight, order=mesh.order, dim=3)
    scalar = ngsolve.H1(straight, order=mesh.order)
    where = mesh.reference
    if mesh.shape == "tetrahedron":
        # NGSolve's coordinates are the weights of the first three corners.
        where = np.stack([1.0 - where.sum(axis=1), where[:, 1], where[:, 0]], axis=1)
    positions = np.zeros((scalar.ndof, 3))
    for cell in straight.Elements(ngsolve.VOL):
        functions = scalar.GetFE(cell)
        values = np.array([np.asarray(functions.CalcShape(*point)) for point in where.tolist()])
        positions[list(scalar.GetDofNrs(cell))] = np.linalg.solve(values, mesh.points[mesh.cells[cell.nr]])
    for corner in straight.vertices:
        positions[corner.nr] -= corner.point
    field = ngsolve.GridFunction(space)
    field.vec.FV().NumPy()[:] = positions.ravel()
    return field
