"""A body of dolfinx whose supports and loads are on groups of facets, which have names."""

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
    """Numbers of the facets of each group on this rank, by its name; none of groups that are partly within the mesh.

    Attributes
    ----------
    inner
        How many of these groups' facets are within the mesh, and of how many.
    """

    def __init__(self) -> None:
        super().__init__()
        self.inner: dict[str, tuple[int, int]] = {}

    def __missing__(self, name: str) -> Index:
        count, wanted = self.inner[name]
        raise InputError(f"group {name}: {count:,} of its {wanted:,} facets are none of the mesh's surface")


class Groups:
    """A mesh and the facets of its groups.

    Attributes
    ----------
    mesh
        The dolfinx mesh, of all ranks.
    facets
        This rank's numbers of the facets of each group; `InputError` where some are none of the mesh's surface.

    Parameters
    ----------
    points, cells, shape, degree
        Nodes ``(n, 3)``, those of each cell in gmsh's order ``(c, m)``, what the cells are, and the degree of their
        geometry; the same on every rank.
    groups
        Corners ``(f, 3 or 4)`` of facets, by the name of the group.
    """

    def __init__(self, points: Array, cells: Index, shape: str, degree: int, groups: Mapping[str, Index]) -> None:
        comm = MPI.COMM_WORLD
        order = compat.gmsh_order(shape, cells.shape[1])
        # The first rank has all of it, and dolfinx deals it out.
        own = slice(None) if comm.rank == 0 else slice(0)
        self.mesh = compat.create_mesh(comm, cells[own, order], points[own], shape, degree)
        exterior = compat.exterior_facets(self.mesh)
        numbers = np.sort(corners(self.mesh, exterior), axis=1)
        self.facets = Facets()
        for name, given in groups.items():
            wanted = np.unique(np.sort(given, axis=1), axis=0)
            found = exterior[_among(numbers, wanted)]
            count = comm.allreduce(len(found), op=MPI.SUM)
            if count < len(wanted):
                self.facets.inner[name] = len(wanted) - count, len(wanted)
            else:
                self.facets[name] = found


def corners(mesh: Any, facets: Index) -> Index:
    """Return the numbers ``(f, 3 or 4)`` that the corners of facets of this rank had when the mesh was made."""
    faces = np.array(basix.topology(compat.geometry_element(mesh).cell_type)[2], dtype=np.int64)
    cells, first = compat.links(mesh, 2, 3)
    cell = cells[first[facets]]
    table = compat.links(mesh, 3, 2)[0].reshape(-1, len(faces))[cell]
    nodes = compat.geometry_dofs(mesh, mesh.topology.index_map(3).size_local)[cell]
    found = np.take_along_axis(nodes, faces[(table == facets[:, None]).argmax(axis=1)], axis=1)
    return np.asarray(compat.original_nodes(mesh)[found])


def space_of(groups: Groups, degree: int) -> Any:
    """Return the Lagrange space of displacements of a degree."""
    return compat.function_space(groups.mesh, compat.element(groups.mesh, "Lagrange", degree, 3))


def conditions(space: Any, groups: Groups, held: Iterable[Held]) -> list[Any]:
    """Return dolfinx's Dirichlet conditions."""
    found = []
    for one in held:
        for k in ("xyz".index(letter) for letter in one.components):
            dofs = dolfinx.fem.locate_dofs_topological(space.sub(k), 2, groups.facets[one.group].astype(np.int32))
            value = PETSc.ScalarType(one.displacement[k])
            found.append(dolfinx.fem.dirichletbc(value, dofs, space.sub(k)))
    return found


def external(space: Any, groups: Groups, loads: Sequence[Load]) -> Any:
    """Return the linear form of loads, None if there are none."""
    mesh, v = groups.mesh, ufl.TestFunction(space)
    # Facets may be in several groups; a form knows one number of each.
    names = [one.group for one in loads if one.group is not None]
    marks = np.zeros(compat.entities(mesh, 2), dtype=np.int64)
    for k, name in enumerate(dict.fromkeys(names)):
        marks[groups.facets[name]] += 2**k
    facets = np.flatnonzero(marks).astype(np.int32)
    kinds = np.unique(np.concatenate(mesh.comm.allgather(marks[facets])))
    tags = dolfinx.mesh.meshtags(mesh, 2, facets, np.searchsorted(kinds, marks[facets]).astype(np.int32))
    ds = ufl.Measure("ds", domain=mesh, subdomain_data=tags)
    normal, found = ufl.FacetNormal(mesh), ufl.Form([])
    for one in loads:
        value: Any = dolfinx.fem.Constant(mesh, np.array(one.vector, dtype=PETSc.ScalarType))
        if one.group is None:
            found += ufl.inner(value, v) * ufl.dx(domain=mesh)
            continue
        bit = 2 ** [*dict.fromkeys(names)].index(one.group)
        on = [ds(int(k)) for k in np.flatnonzero(kinds & bit)]
        if one.total:
            area = sum(
                dolfinx.fem.assemble_scalar(compat.form(dolfinx.fem.Constant(mesh, 1.0) * each, FAST)) for each in on
            )
            value.value /= mesh.comm.allreduce(area, op=MPI.SUM)
        elif one.pressure:
            value = -dolfinx.fem.Constant(mesh, PETSc.ScalarType(one.pressure)) * normal
        for each in on:
            found += ufl.inner(value, v) * each
    return None if found.empty() else found


def described(solid: Solid) -> dict[str, Any]:
    """Return what a record says of a body: cells, their kind, the degree of its displacement, and nodes."""
    mesh = solid.space.mesh
    kind = {"tetrahedron": "tetrahedra", "hexahedron": "hexahedra"}[str(mesh.topology.cell_name())]
    cells = int(mesh.topology.index_map(3).size_global)
    degree = int(solid.space.element.basix_element.degree)
    return {"cells": cells, "kind": kind, "degree": degree, "nodes": solid.nodes}


def _among(rows: Index, wanted: Index) -> NDArray[np.bool_]:
    """Return which rows of numbers are among others, both in order."""
    known = {tuple(row) for row in wanted.tolist()}
    return np.array([tuple(row) in known for row in rows.tolist()], dtype=bool)
