"""The one place that talks to gmsh: sessions, and a `Mesh` as discrete entities in a .msh file."""

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from isorod.errors import InputError
from isorod.files.wires import gmsh_session
from isorod.output.results import write_beside
from meshes.mesh import Array, Index, Mesh, match


def write(mesh: Mesh, path: str | Path) -> None:
    """Write a mesh as .msh (format 4.1), the boundary and the volume, or its regions, as named physical groups.

    Raises
    ------
    InputError
        If the file cannot be written; nothing is left half-written.
    """

    def save(beside: Path) -> None:
        with gmsh_session() as gmsh:
            _build(gmsh, mesh)
            gmsh.write(str(beside))

    write_beside(Path(path), save)


def _build(gmsh: ModuleType, mesh: Mesh) -> None:
    """Put a mesh into the current model."""
    add = gmsh.model.mesh
    surfaces = {name: k + 1 for k, name in enumerate(mesh.faces)}
    for tag in surfaces.values():
        gmsh.model.addDiscreteEntity(2, tag)
    regions = mesh.regions or {"volume": np.arange(len(mesh.cells))}
    volumes = {name: k + 1 for k, name in enumerate(regions)}
    for tag in volumes.values():
        gmsh.model.addDiscreteEntity(3, tag, list(surfaces.values()))
    add.addNodes(3, 1, np.arange(1, len(mesh.points) + 1), mesh.points.ravel())

    tensor = mesh.shape == "hexahedron"
    cell, face = ("Hexahedron", "Quadrangle") if tensor else ("Tetrahedron", "Triangle")
    first = 1
    groups = [(2, tag, face, mesh.face_reference, mesh.faces[name]) for name, tag in surfaces.items()]
    groups += [(3, tag, cell, mesh.reference, mesh.cells[regions[name]]) for name, tag in volumes.items()]
    for dimension, tag, family, reference, nodes in groups:
        kind = add.getElementType(family, mesh.order)
        order = match(reference, _reference(gmsh, kind, dimension, tensor))
        numbers = np.arange(first, first + len(nodes))
        add.addElementsByType(tag, kind, numbers, (nodes[:, order] + 1).ravel())
        first += len(nodes)
    for name, tag in surfaces.items():
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [tag], tag), name)
    for name, tag in volumes.items():
        gmsh.model.setPhysicalName(3, gmsh.model.addPhysicalGroup(3, [tag], len(surfaces) + tag), name)


def _reference(gmsh: ModuleType, kind: int, dimension: int, tensor: bool) -> Array:
    """Return gmsh's reference nodes of an element type, in the unit square or cube, triangle or tetrahedron."""
    _, _, _, count, local, _ = gmsh.model.mesh.getElementProperties(kind)
    nodes = np.asarray(local).reshape(count, -1)[:, :dimension]
    return 0.5 * (nodes + 1.0) if tensor else nodes


def elements(gmsh: Any, dimension: int, entities: Sequence[int]) -> tuple[Index, Array]:
    """Return the node tags of all elements on entities ``(cells, n)``, and the reference positions of their nodes."""
    blocks = []
    for entity in entities:
        types, _, nodes = gmsh.model.mesh.getElements(dimension, entity)
        if len(types) != 1:
            raise InputError("mesh: gmsh returned cells of more than one kind")
        _, _, _, count, local, _ = gmsh.model.mesh.getElementProperties(types[0])
        blocks.append(nodes[0].astype(np.int64).reshape(-1, count))
    return np.concatenate(blocks), np.asarray(local).reshape(count, -1)[:, :dimension]


def mirror(reference: Array) -> Index:
    """Return the permutation of nodes that swaps the first two coordinates of the reference simplex."""
    swapped = reference.copy()
    swapped[:, [0, 1]] = reference[:, [1, 0]]
    return match(reference, swapped)
