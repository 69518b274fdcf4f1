"""A body of dolfinx with supports and loads on named groups of facets."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import basix
import dolfinx.fem
import dolfinx.mesh
import numpy as np
import ufl
from mpi4py import MPI
from numpy.typing import NDArray
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.loads import Held, Load
from isorod.fenics.solid import Solid


class Facets(dict[str, Index]):
    """Numbers of the facets of each group on this rank, by name, without groups that have facets inside the mesh.

    Attributes
    ----------
    inner
        For those groups the number of facets inside the mesh, and of all.
    """

    def __init__(self) -> None:
        super().__init__()
        self.inner: dict[str, tuple[int, int]] = {}

    def __missing__(self, name: str) -> Index:
        count, total = self.inner[name]
        raise InputError(f"group {name}: {count:,} of its {total:,} facets are none of the mesh's surface")


class Groups:
    """A mesh and the facets of its groups.

    Attributes
    ----------
    mesh
        The dolfinx mesh, of all ranks.
    facets
        This rank's numbers of the facets of each group; `InputError` if some are not on the mesh's surface.

    Parameters
    ----------
    points, cells, shape, degree
        Nodes ``(n, 3)``, those of each cell in gmsh's order ``(c, m)``, the type of cells, and the degree of their
        geometry; the same on every rank.
    groups
        Corners ``(f, 3 or 4)`` of facets, by the name of the group.
    """

    def __init__(self, points: Array, cells: Index, shape: str, degree: int, groups: Mapping[str, Index]) -> None:
        comm = MPI.COMM_WORLD
        order = compat.gmsh_order(shape, cells.shape[1])
        # The first rank passes all cells, which dolfinx distributes.
        own = slice(None) if comm.rank == 0 else slice(0)
        self.mesh = compat.create_mesh(comm, cells[own, order], points[own], shape, degree)
        exterior = compat.exterior_facets(self.mesh)
        numbers = np.sort(corners(self.mesh, exterior), axis=1)
        self.facets = Facets()
        for name, rows in groups.items():
            group = np.unique(np.sort(rows, axis=1), axis=0)
            present = exterior[_among(numbers, group)]
            count = comm.allreduce(len(present), op=MPI.SUM)
            if count < len(group):
                self.facets.inner[name] = len(group) - count, len(group)
            else:
                self.facets[name] = present


def corners(mesh: Any, facets: Index) -> Index:
    """Return the original numbers ``(f, 3 or 4)`` of the corners of this rank's facets, in the mesh as given."""
    faces = np.array(basix.topology(compat.geometry_element(mesh).cell_type)[2], dtype=np.int64)
    cell, face = compat.facets_in_cells(mesh, facets, len(faces))
    nodes = compat.geometry_dofs(mesh, mesh.topology.index_map(3).size_local)[cell]
    vertices = np.take_along_axis(nodes, faces[face], axis=1)
    return np.asarray(compat.original_nodes(mesh)[vertices])


def space_of(groups: Groups, degree: int) -> Any:
    """Return the Lagrange space of displacements of a degree."""
    return compat.function_space(groups.mesh, compat.element(groups.mesh, "Lagrange", degree, 3))


def conditions(space: Any, groups: Groups, supports: Iterable[Held]) -> list[Any]:
    """Return dolfinx's Dirichlet conditions."""
    result = []
    for support in supports:
        for k in ("xyz".index(letter) for letter in support.components):
            dofs = dolfinx.fem.locate_dofs_topological(space.sub(k), 2, groups.facets[support.group].astype(np.int32))
            value = PETSc.ScalarType(support.displacement[k])
            result.append(dolfinx.fem.dirichletbc(value, dofs, space.sub(k)))
    return result


def external(space: Any, groups: Groups, loads: Sequence[Load]) -> Any:
    """Return the linear form of loads, None if there are none."""
    mesh, v = groups.mesh, ufl.TestFunction(space)
    # A facet may be in several groups, but has one tag: its groups as bits.
    names = [load.group for load in loads if load.group is not None]
    marks = np.zeros(compat.entities(mesh, 2), dtype=np.int64)
    for k, name in enumerate(dict.fromkeys(names)):
        marks[groups.facets[name]] += 2**k
    facets = np.flatnonzero(marks).astype(np.int32)
    kinds = np.unique(np.concatenate(mesh.comm.allgather(marks[facets])))
    tags = dolfinx.mesh.meshtags(mesh, 2, facets, np.searchsorted(kinds, marks[facets]).astype(np.int32))
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=tags)
    normal, result = ufl.FacetNormal(mesh), ufl.Form([])
    for load in loads:
        value: Any = dolfinx.fem.Constant(mesh, np.array(load.vector, dtype=PETSc.ScalarType))
        if load.group is None:
            result += ufl.inner(value, v) * ufl.dx(domain=mesh)
            continue
        bit = 2 ** [*dict.fromkeys(names)].index(load.group)
        measures = [ds(int(k)) for k in np.flatnonzero(kinds & bit)]
        if load.total:
            area = sum(
                dolfinx.fem.assemble_scalar(compat.form(dolfinx.fem.Constant(mesh, 1.0) * measure, FAST))
                for measure in measures
            )
            value.value /= mesh.comm.allreduce(area, op=MPI.SUM)
        elif load.pressure:
            value = -dolfinx.fem.Constant(mesh, PETSc.ScalarType(load.pressure)) * normal
        for measure in measures:
            result += ufl.inner(value, v) * measure
    return None if result.empty() else result


def described(solid: Solid) -> dict[str, Any]:
    """Return the entries of a record for a body: cells, their kind, the degree of its displacement, and nodes."""
    mesh = solid.space.mesh
    kind = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}[str(mesh.topology.cell_name())]
    cells = int(mesh.topology.index_map(3).size_global)
    degree = int(solid.space.element.basix_element.degree)
    return {"cells": cells, "kind": kind, "degree": degree, "nodes": solid.nodes}


def _among(rows: Index, others: Index) -> NDArray[np.bool_]:
    """Return which sorted rows of numbers are among others."""
    known = {tuple(row) for row in others.tolist()}
    return np.array([tuple(row) in known for row in rows.tolist()], dtype=bool)
