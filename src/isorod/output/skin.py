"""The outer surfaces of meshes, with their edges."""

from typing import Any, NamedTuple

import numpy as np

# Angle of a surface, degrees, from which an edge is drawn.
_SHARP = 40.0

# Distance of equal points over the size of faces.
_CLOSE = 1e-3


class Skin(NamedTuple):
    """The outer surface of a mesh, with its fields.

    Attributes
    ----------
    faces
        Triangles, each connected part of the mesh with its own points.
    whole
        The same with common points of adjacent parts.
    edges
        Boundaries of parts, and edges of the surface.
    """

    faces: Any
    whole: Any
    edges: Any

    def moved(self, factor: float, motion: str = "motion") -> "Skin":
        """Return the skin moved by a factor times a field."""
        meshes = [part.copy() for part in self]
        for part in meshes:
            if part.n_points:
                part.points = part.points + factor * part.point_data[motion]
        return Skin(*meshes)


def skin(mesh: Any) -> Skin:
    """Return the outer surface of a mesh, without the faces between adjacent connected parts."""
    import pyvista
    from scipy.spatial import KDTree

    surface = mesh.extract_surface(algorithm="dataset_surface")
    centres = surface.cell_centers().points
    size = np.sqrt(np.abs(surface.compute_cell_sizes(length=False, volume=False).cell_data["Area"]))
    near, _ = KDTree(centres).query(centres, k=2)
    # Faces of two adjacent parts coincide.
    surface = surface.remove_cells(near[:, 1] < _CLOSE * size)
    surface = surface.triangulate()
    used, numbered = np.unique(surface.regular_faces, return_inverse=True)
    faces = pyvista.PolyData.from_regular_faces(surface.points[used], numbered.reshape(-1, 3))
    for name, values in surface.point_data.items():
        faces.point_data[name] = values[used]
    whole = faces.clean(tolerance=_CLOSE * float(np.quantile(size[size > 0.0], 0.01)), absolute=True)
    return Skin(faces, whole, faces.extract_feature_edges(_SHARP))
