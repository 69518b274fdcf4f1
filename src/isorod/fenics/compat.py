"""Every dolfinx name that differs between 0.5.2 (Debian 12), 0.9 (Debian 13) and 0.11.

Nothing else knows the version.
"""

import inspect
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import basix
import dolfinx
import numpy as np
import ufl
from cffi import VerificationError
from dolfinx import fem, plot
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.errors import InputError, SolveError

__all__ = [
    "add_matrix",
    "assemble_array",
    "assemble_matrix",
    "assemble_vector",
    "cell_dofs",
    "collapsed",
    "create_matrix",
    "create_mesh",
    "element",
    "entities",
    "expression",
    "exterior_facets",
    "facets_in_cells",
    "fill",
    "form",
    "from_gmsh",
    "function_space",
    "geometry_dofs",
    "geometry_element",
    "gmsh_order",
    "impose",
    "interpolation_points",
    "is_on",
    "lift",
    "links",
    "mixed_element",
    "original_cells",
    "original_nodes",
    "petsc_vector",
    "quadrature_element",
    "reference_nodes",
    "version",
]

version: str = dolfinx.__version__

# Up to 0.7 elements are UFL's, from 0.8 on basix.ufl's.
_UFL_ELEMENTS = hasattr(ufl, "VectorElement")

# Seconds to wait for a form that another rank or run compiles.
_JIT_TIMEOUT = 600


def reference_nodes(shape: str, order: int) -> Array:
    """Return the nodes of dolfinx's geometry element in its order, shape ``(nodes, 3)``."""
    variant = basix.LagrangeVariant.equispaced
    return np.asarray(
        basix.create_element(basix.ElementFamily.P, getattr(basix.CellType, shape), order, variant).points
    )


def create_mesh(comm: MPI.Comm, cells: Index, points: Array, shape: str, order: int) -> Any:
    """Return a mesh distributed over ``comm`` from this rank's part of cells and points."""
    if _UFL_ELEMENTS:
        cell = ufl.Cell(shape, geometric_dimension=3)
        scalar = ufl.FiniteElement("Lagrange", cell, order, variant="equispaced")
        return dolfinx.mesh.create_mesh(comm, cells, points, ufl.Mesh(ufl.VectorElement(scalar)))
    import basix.ufl

    variant = basix.LagrangeVariant.equispaced
    domain = ufl.Mesh(basix.ufl.element("Lagrange", shape, order, lagrange_variant=variant, shape=(3,)))
    names = list(inspect.signature(dolfinx.mesh.create_mesh).parameters)
    if names.index("x") < 3:
        return dolfinx.mesh.create_mesh(comm, cells, points, domain)
    return dolfinx.mesh.create_mesh(comm, cells, domain, points)


def element(mesh: Any, family: str, degree: int, size: int | None = None, equispaced: bool = False) -> Any:
    """Return a scalar or vector element of ``size`` components; ``equispaced`` has the nodes of the geometry."""
    if _UFL_ELEMENTS:
        variant = {"variant": "equispaced"} if equispaced else {}
        scalar = ufl.FiniteElement(family, mesh.ufl_cell(), degree, **variant)
        return scalar if size is None else ufl.VectorElement(scalar, dim=size)
    import basix.ufl

    variant = {"lagrange_variant": basix.LagrangeVariant.equispaced} if equispaced else {}
    return basix.ufl.element(family, mesh.basix_cell(), degree, shape=None if size is None else (size,), **variant)


def mixed_element(parts: Sequence[Any]) -> Any:
    """Return the mixed element of parts."""
    if _UFL_ELEMENTS:
        return ufl.MixedElement(list(parts))
    import basix.ufl

    return basix.ufl.mixed_element(list(parts))


def quadrature_element(mesh: Any, degree: int, size: int) -> Any:
    """Return the element of ``size`` values at each point of the default rule of a degree."""
    if _UFL_ELEMENTS:
        cell = mesh.ufl_cell()
        return ufl.VectorElement("Quadrature", cell, degree=degree, dim=size, quad_scheme="default")
    import basix.ufl

    return basix.ufl.quadrature_element(mesh.basix_cell(), (size,), "default", degree)


def interpolation_points(space: Any) -> Array:
    """Return the reference points at which an element interpolates, shape ``(points, 3)``."""
    points = space.element.interpolation_points
    return np.asarray(points() if callable(points) else points)


def _only(geometry: Any, name: str) -> Any:
    """Return an attribute of a mesh of one kind of cell, which 0.7 and 0.11 have in a list."""
    listed = getattr(geometry, f"{name}s", None)
    return listed[0] if isinstance(listed, list) else getattr(geometry, name)


def geometry_dofs(mesh: Any, cells: int) -> Index:
    """Return the rows of ``mesh.geometry.x`` of the nodes of this rank's first cells, shape ``(cells, nodes)``."""
    dofs = _only(mesh.geometry, "dofmap")
    # An adjacency list up to 0.6, an array of shape (cells, nodes) since.
    # A rank may have no cells at all.
    nodes = geometry_element(mesh).dim
    table = dofs.array.reshape(-1, nodes) if hasattr(dofs, "num_nodes") else dofs
    return np.asarray(table[:cells], dtype=np.int64)


def original_cells(mesh: Any) -> Index:
    """Return the rows of this rank's cells among the cells from which the mesh was made, shape ``(cells,)``."""
    return np.asarray(mesh.topology.original_cell_index, dtype=np.int64)


def original_nodes(mesh: Any) -> Index:
    """Return the rows of the nodes of this rank's geometry among the points from which the mesh was made."""
    return np.asarray(mesh.geometry.input_global_indices, dtype=np.int64)


def gmsh_order(shape: str, nodes: int) -> Index:
    """Return the indices of dolfinx's nodes of a cell in gmsh's order."""
    return np.asarray(dolfinx.cpp.io.perm_gmsh(getattr(dolfinx.mesh.CellType, shape), nodes), dtype=np.int64)


def entities(mesh: Any, dimension: int) -> int:
    """Return the number of entities of a dimension on this rank, with ghosts."""
    mesh.topology.create_entities(dimension)
    index_map = mesh.topology.index_map(dimension)
    return int(index_map.size_local + index_map.num_ghosts)


def cell_dofs(space: Any, cells: int) -> Index:
    """Return the blocked degrees of freedom of this rank's first cells, shape ``(cells, functions)``."""
    table = space.dofmap.list
    # An adjacency list up to 0.6, an array since.
    rows = table.array.reshape(-1, space.dofmap.dof_layout.num_dofs) if hasattr(table, "num_nodes") else table
    return np.asarray(rows[:cells], dtype=np.int64)


def function_space(mesh: Any, element: Any) -> Any:
    """Return a function space."""
    make = getattr(fem, "functionspace", None) or fem.FunctionSpace
    with _quiet():
        return make(mesh, element)


def collapsed(part: Any) -> tuple[Any, Index]:
    """Return a subspace as a space, and the indices of its degrees of freedom in the full space, ``(m,)``."""
    space, back = part.collapse()
    # Later versions have a nested list.
    return space, np.asarray(back, dtype=np.int64).ravel()


def _jit(function: Callable[..., Any], flags: Sequence[str]) -> dict[str, Any]:
    key = "jit_options" if "jit_options" in inspect.signature(function).parameters else "jit_params"
    return {key: {"cffi_extra_compile_args": list(flags), "timeout": _JIT_TIMEOUT}}


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the compiler's command lines, and shorten its failures to one line."""
    before = logging.root.manager.disable
    logging.disable(logging.INFO)
    try:
        yield
    except (VerificationError, RuntimeError) as problem:
        raise SolveError(f"the C compiler or the form compiler failed: {str(problem).splitlines()[-1]}") from problem
    finally:
        logging.disable(before)


def form(integrals: Any, flags: Sequence[str]) -> Any:
    """Return a compiled form; ``flags`` go to the C compiler."""
    with _quiet():
        return fem.form(integrals, **_jit(fem.form, flags))


def expression(value: Any, where: Array, flags: Sequence[str]) -> Callable[[Any, Index], Array]:
    """Return a function of ``(mesh, cells)``: a UFL expression at reference points, shape ``(cells, ...)``."""
    with _quiet():
        compiled = fem.Expression(value, where, **_jit(fem.Expression.__init__, flags))
    if "mesh" in inspect.signature(compiled.eval).parameters:
        return lambda mesh, cells: np.asarray(compiled.eval(mesh, cells))
    return lambda mesh, cells: np.asarray(compiled.eval(cells))


def fill(function: Any, values: Array) -> None:
    """Set a function's entries of this rank to ``values``, and update ghosts."""
    function.x.array[: len(values)] = values
    function.x.scatter_forward()


def petsc_vector(function: Any) -> PETSc.Vec:
    """Return the PETSc vector that shares a function's memory."""
    return function.x.petsc_vec if hasattr(function.x, "petsc_vec") else function.vector


def create_matrix(bilinear: Any, kind: str | None) -> PETSc.Mat:
    """Return an empty matrix of a PETSc type (None: PETSc's default)."""
    if not kind:
        return petsc.create_matrix(bilinear)
    matrix = petsc.create_matrix(bilinear, kind)
    # dolfinx does not check PETSc's error for an unknown type.
    if matrix.getType() not in (kind, f"seq{kind}", f"mpi{kind}"):
        raise InputError(f"matrix type: got {kind!r}, need one of PETSc's such as aij, baij or sbaij")
    return matrix


def assemble_matrix(matrix: PETSc.Mat, bilinear: Any, supports: Sequence[Any]) -> None:
    """Assemble into ``matrix``, rows and columns of supported degrees of freedom replaced by those of the identity."""
    matrix.zeroEntries()
    petsc.assemble_matrix(matrix, bilinear, list(supports))
    matrix.assemble()


def add_matrix(matrix: PETSc.Mat, bilinear: Any, supports: Sequence[Any] = ()) -> None:
    """Add a form to ``matrix`` without finishing the assembly; supports as for `assemble_matrix`."""
    petsc.assemble_matrix(matrix, bilinear, list(supports))


def assemble_vector(vector: PETSc.Vec, linear: Any) -> None:
    """Assemble this rank's cells into ``vector``; contributions to other ranks' entries stay in its ghosts."""
    with vector.localForm() as local:
        local.set(0.0)
    petsc.assemble_vector(vector, linear)


def assemble_array(array: Array, linear: Any) -> None:
    """Assemble into an array as long as a function's ``x.array``; serial."""
    array[:] = 0.0
    fem.assemble_vector(array, linear)


def lift(vector: PETSc.Vec, bilinear: Any, supports: Sequence[Any], state: PETSc.Vec) -> None:
    """Add to ``vector`` the tangent's columns of supported degrees of freedom times their remaining displacements."""
    # By position: the last argument is called scale up to 0.8 and alpha since.
    petsc.apply_lifting(vector, [bilinear], [list(supports)], [state], -1.0)


def geometry_element(mesh: Any) -> Any:
    """Return basix' element of a mesh's geometry, scalar."""
    kind = _only(mesh.geometry, "cmap")
    # 0.5.2 has no variant; its own meshes have these nodes, and up to degree 2 all variants agree.
    variant = basix.LagrangeVariant(getattr(kind, "variant", basix.LagrangeVariant.equispaced))
    cell = getattr(basix.CellType, mesh.topology.cell_name())
    return basix.create_element(basix.ElementFamily.P, cell, kind.degree, variant)


def vtk_cells(space: Any) -> tuple[Array, Array, Array]:
    """Return the cells of a space for pyvista's grids, their types, and the positions of this rank's nodes."""
    # It has another name up to 0.6.
    make = getattr(plot, "vtk_mesh", None) or plot.create_vtk_mesh
    cells, kinds, points = make(space)
    return cells, kinds, points


def links(mesh: Any, low: int, high: int) -> tuple[Index, Index]:
    """Return the connectivity of entities of two dimensions: the linked entities, and their offsets."""
    mesh.topology.create_entities(min(low, high))
    mesh.topology.create_connectivity(low, high)
    connectivity = mesh.topology.connectivity(low, high)
    return np.asarray(connectivity.array, dtype=np.int64), np.asarray(connectivity.offsets, dtype=np.int64)


def facets_in_cells(mesh: Any, facets: Index, count: int) -> tuple[Index, Index]:
    """Return the cells of exterior facets, and their numbers among the ``count`` facets of the cell."""
    cells, first = links(mesh, 2, 3)
    cell = cells[first[facets]]
    return cell, (links(mesh, 3, 2)[0].reshape(-1, count)[cell] == facets[:, None]).argmax(axis=1)


def exterior_facets(mesh: Any) -> Index:
    """Return this rank's own facets on the boundary of the mesh, sorted."""
    for low, high in ((2, 3), (3, 2)):
        links(mesh, low, high)
    return np.sort(np.asarray(dolfinx.mesh.exterior_facet_indices(mesh.topology), dtype=np.int64))


def is_on(condition: Any, space: Any) -> bool:
    """Return whether a condition is on a space or on a component of it."""
    # The condition is a C++ object in 0.5.2, and its space in all versions.
    own = condition.function_space
    return bool(space._cpp_object.contains(getattr(own, "_cpp_object", own)))


def impose(condition: Any, array: Array) -> None:
    """Write a condition's values into an array as long as a function's ``x.array``."""
    if hasattr(condition, "set"):
        condition.set(array)
    else:
        fem.set_bc(array, [condition])


def from_gmsh(model: Any) -> Any:
    """Return the mesh of a gmsh model on all ranks, with the tags of its cells and facets."""
    try:
        reader = import_module("dolfinx.io.gmsh")
    except ImportError:
        reader = import_module("dolfinx.io.gmshio")
    return reader.model_to_mesh(model, MPI.COMM_WORLD, 0)
