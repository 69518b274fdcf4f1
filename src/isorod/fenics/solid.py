"""A finite element body of dolfinx: forces, tangent and mass in the numbering of its space, and its surface."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from isorod.arrays import Array, Index, Numbers
from isorod.errors import InputError, numbers
from isorod.fenics import compat, forms
from isorod.fenics.cells import Cells
from isorod.fenics.flags import FAST
from isorod.fenics.recovery import Recovered, averages, recovered
from isorod.fenics.surface import Rows, Surface, Trace
from isorod.material.law import Material

__all__ = ["Rows", "Solid", "Trace"]


class Solid:
    """A finite element body: a dolfinx space with a stored energy or a UFL residual, Dirichlet conditions and loads.

    Unknowns are displacements, units of length, numbered ``3 node + component`` with dolfinx' global numbers of nodes,
    of which each rank owns a range.  All methods are collective over the mesh's communicator.

    Parameters
    ----------
    space
        dolfinx vector Lagrange space of 3 components, on a mesh of tetrahedra or hexahedra.
    law
        The law; its fibres, if any, are vectors.  The load factor scales activation.  Its energy is integrated by
        rules of degree ``2 p`` on hexahedra and ``2 p - 2``, at least 1, on tetrahedra, ``p`` the space's degree.
    density
        Mass per reference volume; needed for masses.
    conditions
        Dirichlet conditions of dolfinx on the space or its components, with values at load factor 1.
    load
        UFL linear form: external virtual work at load factor 1.
    form
        UFL residual instead of a law: virtual work of the stresses less that of the loads at load factor 1, with a
        its own quadrature.  Its value at rest is taken for the loads: at load factor ``f`` the residual is ``F(u) -
        (1 - f) F(0)``.  Follower loads should be given as ``load``.
    unknown
        The Function of displacement in ``form`` and ``load``; it is overwritten.

    Raises
    ------
    InputError
        If the mesh has no solid cells in space, the space is no vector Lagrange space or does not contain rigid
        rotations; or if law and form are both given, or neither.
    SolveError
        If the C compiler fails.
    """

    def __init__(
        self,
        space: Any,
        law: Material | None = None,
        density: float = 0.0,
        conditions: Sequence[Any] = (),
        load: Any = None,
        form: Any = None,
        unknown: Any = None,
    ) -> None:
        _check_space(space)
        _check(space, law, form, unknown, load)
        for condition in conditions:
            if not compat.is_on(condition, space):
                raise InputError("conditions of the solid: one is of another space than the one given")
        self.space, self.law, self.density, self.conditions = space, law, float(density), tuple(conditions)
        mesh = space.mesh
        self.comm: MPI.Comm = mesh.comm
        index_map = space.dofmap.index_map
        self.nodes = int(index_map.size_global)
        self.owned: tuple[int, int] = tuple(int(k) for k in index_map.local_range)  # type: ignore[assignment]
        self._count = self.owned[1] - self.owned[0]
        self.unknown = unknown if unknown is not None else dolfinx.fem.Function(space)
        self._force = dolfinx.fem.Function(space)
        self.factor = dolfinx.fem.Constant(mesh, 1.0)
        self._energy = None
        if law is not None:
            energy, internal = forms.of_law(law, self.unknown, self.factor, self.rule_degree)
            self._energy = compat.form(energy, FAST)
            external = ufl.Form([])
        else:
            internal, external = forms.split(form, self.unknown)
        if load is not None:
            external += load
        self.outer = external
        self._load = None if external.empty() else compat.form(external, FAST)
        residual = internal if external.empty() else internal - self.factor * external
        self._residual = compat.form(residual, FAST)
        tangent = ufl.derivative(residual, self.unknown, ufl.TrialFunction(space))
        self._tangent = compat.form(tangent, FAST)

    @property
    def degree(self) -> int:
        """Degree of the shape functions."""
        return int(self.space.element.basix_element.degree)

    @property
    def curved(self) -> bool:
        """Whether facets may be curved: the geometry of the mesh has a degree above 1."""
        return int(compat.geometry_element(self.space.mesh).degree) > 1

    @property
    def rule_degree(self) -> int:
        """Degree of the quadrature of a law's energy."""
        return 2 * self.degree if self._bricks else max(1, 2 * self.degree - 2)

    @property
    def _bricks(self) -> bool:
        return str(self.space.mesh.topology.cell_name()) == "hexahedron"

    @cached_property
    def positions(self) -> Array:
        """Positions of this rank's nodes at rest, shape ``(nodes, 3)``."""
        return np.array(self.space.tabulate_dof_coordinates()[: self._count], dtype=float)

    @property
    def held(self) -> tuple[Index, Array]:
        """Supported unknowns on this rank: global numbers ``(n,)`` ascending, and values at load factor 1."""
        values = dolfinx.fem.Function(self.space)
        dofs = [np.empty(0, dtype=np.int64)]
        for condition in self.conditions:
            # The count of this rank's own ones is wrong in 0.5.2.
            dofs.append(np.asarray(condition.dof_indices()[0], dtype=np.int64))
            compat.impose(condition, values.x.array)
        local = np.unique(np.concatenate(dofs))
        local = local[local < 3 * self._count]
        return local + 3 * self.owned[0], values.x.array[local].astype(float)

    def residual(self, u: Array, factor: float) -> Array:
        """Return this rank's entries ``(3 nodes,)`` of internal forces less ``factor`` times the external ones.

        NaN where ``det F <= 0`` with a nonlinear law.

        Parameters
        ----------
        u
            This rank's displacements, shape ``(3 nodes,)``.
        factor
            Load factor.
        """
        self.set(u, factor)
        return self.assembled(self._residual)

    def internal(self, u: Array, factor: float) -> Array:
        """Return this rank's entries ``(3 nodes,)`` of internal forces alone (`residual`)."""
        return self.residual(u, factor) + factor * self.loads(u)

    def tangent(self, u: Array, factor: float) -> PETSc.Mat:
        """Return the derivative of `residual` (AIJ), the same matrix in every call."""
        self.set(u, factor)
        compat.assemble_matrix(self.matrix, self._tangent, ())
        return self.matrix

    @cached_property
    def matrix(self) -> PETSc.Mat:
        """The matrix that `tangent` returns."""
        return compat.create_matrix(self._tangent, "aij")

    def mass(self) -> PETSc.Mat:
        """Return the consistent mass matrix (AIJ), the same in every call.

        Raises
        ------
        InputError
            If there is no density.
        """
        if not 0.0 < self.density < np.inf:
            raise InputError(f"density of the solid: got {self.density:g}, need a positive mass per volume")
        return self._mass

    def smallest_jacobian(self, u: Array) -> float:
        """Return the smallest ``det F`` of all ranks, at the centres and corners of cells."""
        values = self._in_cells(ufl.det(ufl.Identity(3) + ufl.grad(self.unknown)), u)
        return float(self.comm.allreduce(values.min(initial=np.inf), op=MPI.MIN))

    def largest_gradient(self, u: Array) -> float:
        """Return the largest component of the displacement gradient of all ranks, at the same points."""
        values = np.abs(self._in_cells(ufl.grad(self.unknown), u))
        return float(self.comm.allreduce(values.max(initial=0.0), op=MPI.MAX))

    def _in_cells(self, value: Any, u: Array) -> Array:
        """Return a UFL expression at displacements, at the centres and corners of this rank's cells."""
        self.set(u, 0.0)
        cells = Cells(self.space)
        evaluate = compat.expression(value, np.vstack([cells.middle, cells.corners]), FAST)
        return evaluate(self.space.mesh, np.arange(len(cells.x), dtype=np.int32))

    def momenta(self, velocity: Array) -> Array:
        """Return the mass matrix times this rank's velocities, shape ``(3 nodes,)`` both."""
        matrix = self.mass()
        moving, result = matrix.createVecs()
        moving.array_w[:] = velocity
        matrix.mult(moving, result)
        return np.array(result.array_r)

    @property
    def volume(self) -> float:
        """The volume at rest, of all ranks."""
        unit = dolfinx.fem.Constant(self.space.mesh, PETSc.ScalarType(1.0))
        return float(self.comm.allreduce(dolfinx.fem.assemble_scalar(compat.form(unit * self._dx(0), FAST))))

    def _dx(self, degree: int) -> Any:
        """Return the measure whose rule is exact for polynomials of a degree in the reference cell."""
        geometry = compat.geometry_element(self.space.mesh).degree
        # Plus the degree of the Jacobian.
        exact = degree + (3 * geometry - 1 if self._bricks else 3 * (geometry - 1))
        return ufl.dx(domain=self.space.mesh, metadata={"quadrature_degree": exact})

    @cached_property
    def _mass(self) -> PETSc.Mat:
        u, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        bilinear = compat.form(self.density * ufl.inner(u, v) * self._dx(2 * self.degree), FAST)
        matrix = compat.create_matrix(bilinear, "aij")
        compat.assemble_matrix(matrix, bilinear, ())
        return matrix

    def energy(self, u: Array, factor: float) -> float:
        """Return the stored energy of all ranks.

        Raises
        ------
        InputError
            If the body has no law.
        """
        if self._energy is None:
            raise InputError("energy of the solid: it was given as a form, which stores none; give a law")
        self.set(u, factor)
        return float(self.comm.allreduce(dolfinx.fem.assemble_scalar(self._energy), op=MPI.SUM))

    def loads(self, u: Array) -> Array:
        """Return this rank's entries ``(3 nodes,)`` of the loads at load factor 1, given its displacements."""
        if self._load is None:
            return np.zeros(3 * self._count)
        self.set(u, 1.0)
        return self.assembled(self._load)

    def recovered(self, u: Array, about: Array | None = None) -> Recovered | None:
        """Return the error estimate by recovered strains (`isorod.fenics.recovery`); None if there is no law.

        With ``about``, ``u`` is a small motion about that displacement; both ``(3 nodes,)`` on this rank.
        """
        if self.law is None:
            return None
        state = None if about is None else self._moved(about)[1]
        return recovered(*self._moved(u), self.nodes, self.law, self.comm, state)

    def gradients(self, u: Array) -> Array:
        """Return the displacement gradients at all nodes, averaged over cells, shape ``(nodes, 3, 3)``."""
        return averages(*self._moved(u), self.nodes, self.comm)

    def _moved(self, u: Array) -> tuple[Cells, Array]:
        """Return this rank's cells, and the displacements of their nodes ``(cells, m, 3)``."""
        compat.fill(self.unknown, u)
        cells = Cells(self.space)
        local = compat.cell_dofs(self.space, len(cells.x))
        return cells, self.unknown.x.array.reshape(-1, 3)[local]

    def external(self) -> Array:
        """Return this rank's entries ``(3 nodes,)`` of the loads at load factor 1, of follower loads at rest."""
        return self.loads(np.zeros(3 * self._count))

    def function(self, u: Array) -> Any:
        """Return this rank's displacements ``(3 nodes,)`` as a new dolfinx Function."""
        result = dolfinx.fem.Function(self.space)
        compat.fill(result, u)
        return result

    def rows(self, points: Numbers, facets: Index | None = None) -> Rows:
        """Return shape functions at points, by linear extrapolation from the nearest point of the body.

        Every rank passes the same points and gets the same rows.

        Parameters
        ----------
        points
            Shape ``(q, 3)``.
        facets
            This rank's numbers of exterior facets: only cells with one of them are searched, and points outside these
            are projected on the facets.  All cells and exterior facets if None.

        Raises
        ------
        InputError
            If points are not finite positions, there are no facets on any rank, or not all are exterior.
        """
        where = numbers("points", points)
        if where.ndim != 2 or where.shape[1] != 3 or not np.isfinite(where).all():
            raise InputError(f"points: got shape {where.shape}, need finite positions, shape (q, 3)")
        return self._surface.rows(where, facets)

    def trace(self, facets: Index | None, pieces: int | None = None) -> Trace:
        """Return quadrature points on exterior facets of all ranks, on every rank.

        Parameters
        ----------
        facets
            This rank's numbers of facets; all exterior facets if None.
        pieces
            Subdivisions of each side of a facet, with a rule of degree 2 in each; by default one rule that is exact
            for products of shape functions.

        Raises
        ------
        InputError
            If there are no facets on any rank, or not all are exterior.
        """
        return self._surface.trace(facets, pieces)

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.space)

    def set(self, u: Array, factor: float) -> None:
        """Set the state of forms: this rank's displacements ``(3 nodes,)`` and the load factor."""
        compat.fill(self.unknown, u)
        self.factor.value = factor

    def assembled(self, form: Any) -> Array:
        """Return this rank's entries ``(3 nodes,)`` of a compiled linear form in the state of `set`."""
        vector = compat.petsc_vector(self._force)
        compat.assemble_vector(vector, form)
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return np.array(self._force.x.array[: 3 * self._count], dtype=float)


def _check_space(space: Any) -> None:
    """Raise `InputError` if a space is not suitable for displacements of a body."""
    mesh = getattr(space, "mesh", None)
    if mesh is None or not hasattr(space, "dofmap"):
        raise InputError(f"space of the solid: got {type(space).__name__}, need a dolfinx function space")
    cell = str(mesh.topology.cell_name())
    if mesh.geometry.dim != 3 or cell not in ("tetrahedron", "hexahedron"):
        raise InputError(
            f"mesh of the solid: got {cell} cells in {mesh.geometry.dim}-D, need tetrahedra or hexahedra in 3-D"
        )
    size = space.dofmap.index_map_bs
    if size != 3:
        raise InputError(f"space of the solid: got block size {size}, need a vector space of 3 components")
    element = space.element.basix_element
    if element.family.name != "P" or element.discontinuous or not space.element.interpolation_ident:
        raise InputError(f"space of the solid: got {space.ufl_element()}, need Lagrange elements")
    if mesh.comm.allreduce(not Cells(space).rotates):
        raise InputError(
            f"space of the solid: degree {element.degree} on curved cells of degree "
            f"{compat.geometry_element(mesh).degree} cannot rotate rigidly, need at least the degree of the cells"
        )


def _check(space: Any, law: Material | None, form: Any, unknown: Any, load: Any) -> None:
    """Raise `InputError` if law, form, unknown and load do not define a body."""
    if (law is None) == (form is None):
        raise InputError(
            f"solid: got {'neither a law nor' if law is None else 'both a law and'} a form, need one of them"
        )
    if form is not None:
        if unknown is None:
            raise InputError("solid: got a form without its unknown, the dolfinx Function of displacement in it")
    if unknown is not None and unknown.function_space != space:
        raise InputError("unknown of the solid: it is of another space than the one given")
    for name, value in (("form", form), ("load", load)):
        if value is not None and [argument.ufl_function_space() for argument in value.arguments()] != [space]:
            raise InputError(f"{name} of the solid: need a UFL form with one test function, of the space given")
