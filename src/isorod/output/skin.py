"""The outer surfaces of meshes, with the lines that are drawn upon them."""

from typing import Any, NamedTuple

import numpy as np

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

    A piece is what shares points.
    """
    import pyvista
    from scipy.spatial import KDTree

    surface = mesh.extract_surface(algorithm="dataset_surface")
    centres = surface.cell_centers().points
    size = np.sqrt(np.abs(surface.compute_cell_sizes(length=False, volume=False).cell_data["Area"]))
    near, _ = KDTree(centres).query(centres, k=2)
    # Of two pieces that meet, faces lie on each other.
    surface = surface.remove_cells(near[:, 1] < _CLOSE * size)
    surface = surface.triangulate()
    used, numbered = np.unique(surface.regular_faces, return_inverse=True)
    faces = pyvista.PolyData.from_regular_faces(surface.points[used], numbered.reshape(-1, 3))
    for name, values in surface.point_data.items():
        faces.point_data[name] = values[used]
    whole = faces.clean(tolerance=_CLOSE * float(np.quantile(size[size > 0.0], 0.01)), absolute=True)
    return Skin(faces, whole, faces.extract_feature_edges(_SHARP))
