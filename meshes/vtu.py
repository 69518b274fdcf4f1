"""Meshes of hexahedra as VTK files: Lagrange cells of the mesh's own order, the rod's parameters at their nodes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from isorod.output.results import write_whole
from isorod.output.vtk import content
from meshes.mesh import Index, Mesh, match


def write(mesh: Mesh, path: Path, cells: Mapping[str, Index] | None = None) -> None:
    """Write a mesh, with numbers of each cell by name; point data are ``xi`` and ``u`` where a rod made the mesh."""
    write_whole(path, content(grid(mesh, cells)))


def grid(mesh: Mesh, cells: Mapping[str, Index] | None = None) -> Any:
    """Return a mesh as pyvista's; of order 1 its cells are plain hexahedra."""
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron

    order, kind = mesh.order, pyvista.CellType
    ticks = np.stack(np.meshgrid(*[np.arange(order + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    places = np.empty((len(ticks), 3))
    number = [vtkHigherOrderHexahedron.PointIndexFromIJK(i, j, k, [order] * 3) for i, j, k in ticks.tolist()]
    places[number] = ticks / order
    nodes = mesh.cells[:, match(mesh.reference, places)]
    made = pyvista.UnstructuredGrid(
        {kind.HEXAHEDRON if order == 1 else kind.LAGRANGE_HEXAHEDRON: nodes}, np.asarray(mesh.points, dtype=float)
    )
    if mesh.parameters is not None:
        made.point_data["xi"], made.point_data["u"] = mesh.parameters[:, :2], mesh.parameters[:, 2]
    for name, numbers in (cells or {}).items():
        made.cell_data[name] = numbers
    return made
