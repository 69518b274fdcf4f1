"""A `Mesh` handed to dolfinx: partitioned over the ranks, its named faces recognised as facets."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx.mesh import locate_entities_boundary
from mpi4py import MPI
from scipy.spatial import cKDTree

from isorod.errors import InputError
from isorod.fenics import compat
from meshes.mesh import Array, Index, Mesh, match

# Vertices are recognised by position, to this fraction of the mesh's extent.
_SAME_PLACE = 1e-9


@dataclass(frozen=True, eq=False)
class Domain:
    """A dolfinx mesh, and positions of the vertices of each named face.

    Attributes
    ----------
    mesh
        The dolfinx mesh.
    shape
        Shape of its cells, ``"hexahedron"`` or ``"tetrahedron"``.
    cells
        Number of cells on all ranks.
    faces
        Vertex positions by face name, shape ``(vertices, 3)``, all of them on every rank.
    """

    mesh: Any
    shape: str
    cells: int
    faces: dict[str, Array]

    @classmethod
    def distribute(cls, mesh: Mesh | None, comm: MPI.Comm = MPI.COMM_WORLD) -> "Domain":
        """Partition a mesh that rank 0 has; other ranks pass None."""
        head = None
        if mesh is not None:
            corners = np.isin(mesh.face_reference, (0.0, 1.0)).all(axis=1)
            faces = {name: mesh.points[np.unique(nodes[:, corners])] for name, nodes in mesh.faces.items()}
            head = (mesh.shape, mesh.order, len(mesh.cells), faces)
        head = comm.bcast(head, root=0)
        assert head is not None
        shape, order, count, faces = head
        nodes = compat.reference_nodes(shape, order)
        if mesh is not None:
            cells, points = mesh.cells[:, match(mesh.reference, nodes)], mesh.points
        else:
            cells, points = np.empty((0, len(nodes)), dtype=np.int64), np.empty((0, 3))
        return cls(compat.create_mesh(comm, cells, points, shape, order), shape, count, faces)

    def facets(self, name: str) -> Index:
        """Return this rank's facets of a named face."""
        if name not in self.faces:
            raise InputError(f"support: got face {name!r}, need one of {', '.join(self.faces)}")
        facets = self._with_vertices(name)
        if name == "lateral":
            # Where a section is a single cell, all vertices of its end faces lie on the lateral surface too.
            ends = [self._with_vertices(other) for other in self.faces if other != name]
            facets = np.setdiff1d(facets, np.concatenate([*ends, np.empty(0, dtype=facets.dtype)]))
        return facets

    def _with_vertices(self, name: str) -> Index:
        where = self.faces[name]
        slack = _SAME_PLACE * np.ptp(np.concatenate(list(self.faces.values())), axis=0).max()
        tree = cKDTree(where)
        return locate_entities_boundary(self.mesh, 2, lambda x: tree.query(x.T)[0] < slack)
