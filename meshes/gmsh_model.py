"""The one place that talks to gmsh: sessions, and a `Mesh` as discrete entities in a .msh file."""

from collections.abc import Mapping, Sequence
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
    regions = dict(mesh.regions) or {"volume": np.arange(len(mesh.cells))}
    surfaces, names_of_surfaces = _apart(mesh.faces, np.concatenate([*mesh.faces.values()]))
    volumes, names_of_volumes = _apart({name: mesh.cells[own] for name, own in regions.items()}, mesh.cells)
    for tag in range(1, len(surfaces) + 1):
        gmsh.model.addDiscreteEntity(2, tag)
    for tag in range(1, len(volumes) + 1):
        gmsh.model.addDiscreteEntity(3, tag, [*range(1, len(surfaces) + 1)])
    add.addNodes(3, 1, np.arange(1, len(mesh.points) + 1), mesh.points.ravel())

    tensor = mesh.shape == "hexahedron"
    cell, face = ("Hexahedron", "Quadrangle") if tensor else ("Tetrahedron", "Triangle")
    first = 1
    groups = [(2, tag, face, mesh.face_reference, nodes) for tag, nodes in enumerate(surfaces, 1)]
    groups += [(3, tag, cell, mesh.reference, nodes) for tag, nodes in enumerate(volumes, 1)]
    for dimension, tag, family, reference, nodes in groups:
        kind = add.getElementType(family, mesh.order)
        order = match(reference, _reference(gmsh, kind, dimension, tensor))
        numbers = np.arange(first, first + len(nodes))
        add.addElementsByType(tag, kind, numbers, (nodes[:, order] + 1).ravel())
        first += len(nodes)
    number = 1
    for dimension, names in ((2, names_of_surfaces), (3, names_of_volumes)):
        for name, entities in names.items():
            gmsh.model.setPhysicalName(dimension, gmsh.model.addPhysicalGroup(dimension, entities, number), name)
            number += 1


def _apart(groups: Mapping[str, Index], nodes: Index) -> tuple[list[Index], dict[str, list[int]]]:
    """Return entities that are not in two groups in part, the nodes of their elements, and those of each group, from 1.

    Groups are of rows of ``nodes`` ``(elements, n)``, which may be there several times.
    """
    _, first, number = np.unique(np.sort(nodes, axis=1), axis=0, return_index=True, return_inverse=True)
    rows = {tuple(row): k for row, k in zip(np.sort(nodes, axis=1).tolist(), number.ravel().tolist(), strict=True)}
    within = np.zeros((len(first), len(groups)), dtype=bool)
    for k, own in enumerate(groups.values()):
        within[[rows[tuple(row)] for row in np.sort(own, axis=1).tolist()], k] = True
    patterns, which = np.unique(~within, axis=0, return_inverse=True)
    which = which.ravel()
    # In the order in which they are in the first group.
    entities = [nodes[np.sort(first[which == k])] for k in range(len(patterns)) if not patterns[k].all()]
    kept = [~one for one in patterns if not one.all()]
    names = {name: [e + 1 for e, one in enumerate(kept) if one[k]] for k, name in enumerate(groups)}
    return entities, names


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
