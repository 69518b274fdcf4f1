"""The outer surfaces of meshes, with the lines that are drawn upon them."""

from typing import Any, NamedTuple

import numpy as np

# How far beside a face cells are looked for, over its size.
_BESIDE = (0.02, 0.1, 0.3)

# Degrees by which a surface bends where an edge is drawn.
_SHARP = 40.0

# Points nearer to each other than this share of a face are one.
_CLOSE = 1e-3


class Skin(NamedTuple):
    """The outer surface of a mesh, with its fields.

    Attributes
    ----------
    faces
        Triangles, each piece of the mesh with points of its own.
    whole
        The same with points that pieces share.
    edges
        Where pieces end, and edges of the surface.
    """

    faces: Any
    whole: Any
    edges: Any

    def moved(self, share: float, motion: str = "motion") -> "Skin":
        """Return the skin moved by a share of a field."""
        found = [one.copy() for one in self]
        for one in found:
            if one.n_points:
                one.points = one.points + share * one.point_data[motion]
        return Skin(*found)


def skin(mesh: Any) -> Skin:
    """Return the outer surface of a mesh; the faces between its pieces are left out.

    A piece is what has the same number ``element`` among the data of its cells or, without these, what shares points.
    """
    import pyvista
    from scipy.spatial import KDTree

    surface = mesh.extract_surface(algorithm="dataset_surface")
    centres = surface.cell_centers().points
    size = np.sqrt(np.abs(surface.compute_cell_sizes(length=False, volume=False).cell_data["Area"]))
    near, _ = KDTree(centres).query(centres, k=2)
    # Of two pieces that meet, faces lie on each other.
    surface = surface.remove_cells(near[:, 1] < _CLOSE * size)
    if "element" in mesh.cell_data:
        surface = surface.remove_cells(_within(mesh, surface))
    surface = surface.triangulate()
    used, numbered = np.unique(surface.regular_faces, return_inverse=True)
    faces = pyvista.PolyData.from_regular_faces(surface.points[used], numbered.reshape(-1, 3))
    for name, values in surface.point_data.items():
        faces.point_data[name] = values[used]
    if "element" in surface.cell_data:
        faces.cell_data["element"] = surface.cell_data["element"]
    whole = faces.clean(tolerance=_CLOSE * float(np.quantile(size[size > 0.0], 0.01)), absolute=True)
    edges = _borders(whole) if "element" in faces.cell_data else faces.extract_feature_edges(_SHARP)
    return Skin(faces, whole, edges)


def _within(mesh: Any, surface: Any) -> Any:
    """Return which faces have cells of the mesh on both sides: where these meet, but not corner to corner."""
    centres, normals = surface.cell_centers().points, surface.face_normals
    size = np.sqrt(np.abs(surface.compute_cell_sizes(length=False, volume=False).cell_data["Area"]))
    found = np.zeros(len(centres), dtype=bool)
    # Flat cells leave gaps where curved ones meet.
    for share in _BESIDE:
        rest = np.flatnonzero(~found)
        step = share * size[rest, None] * normals[rest]
        before, behind = (mesh.find_containing_cell(centres[rest] + side) for side in (step, -step))
        found[rest] = (before >= 0) & (behind >= 0)
    return found


def _borders(surface: Any) -> Any:
    """Return the lines between faces of different elements, and where a surface bends sharply."""
    import pyvista

    faces = surface.regular_faces
    element = np.asarray(surface.cell_data["element"])[-len(faces) :]
    corners = surface.points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    lines, first, numbered, counts = np.unique(
        sides, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    last = np.empty(len(lines), dtype=np.int64)
    last[numbered.ravel()] = np.arange(len(sides))
    one, other = first % len(faces), last % len(faces)
    bent = (normals[one] * normals[other]).sum(axis=1) < np.cos(np.radians(_SHARP))
    shown = lines[(counts == 2) & ((element[one] != element[other]) | bent)]
    found = pyvista.PolyData(surface.points, lines=np.insert(shown, 0, 2, axis=1).ravel())
    for name, values in surface.point_data.items():
        found.point_data[name] = values
    return found
