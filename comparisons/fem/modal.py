"""Vibration modes with dolfinx: linear elasticity, ``K x = omega^2 M x`` on the free unknowns, by SLEPc."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple

import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem import enhanced, quadrature
from comparisons.fem.domain import Domain
from comparisons.fem.statics import ALGEBRAIC, Element, rigid_motions
from comparisons.measure.timing import peak_memory
from isorod.errors import InputError, SolveError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import energy_of
from isorod.material import LinearElastic
from isorod.modal.eigensolvers import only_multiplies
from isorod.modal.pencil import Pencil
from isorod.petsc.matrix import componentwise
from meshes.mesh import Array, Index

# What a user's option overrides.  Measured on the blade (comparisons.fem.published): MUMPS' own choice of ordering and
# one Krylov space without restart are fastest.
DIRECT = {
    "eps_tol": 1e-10,
    "st_type": "sinvert",
    "st_ksp_type": "preonly",
    "st_pc_type": "cholesky",
    "st_pc_factor_mat_solver_type": "mumps",
    # Only a singular mass needs it, and it costs a solve a mode.
    "eps_purify": False,
}

RIGID = 6


@dataclass(frozen=True)
class Solid:
    """A linear elastic, isotropic, homogeneous body: Young's modulus, Poisson's ratio, mass per volume."""

    E: float
    nu: float
    density: float


class Settings(NamedTuple):
    """How the equations are put together and solved.

    Attributes
    ----------
    options
        PETSc and SLEPc options that the user's own override.
    flags
        C compiler flags for the forms.
    matrix_type
        PETSc type of the stiffness matrix when it is factored; if not given ``sbaij``, its upper triangle by blocks,
        and on several ranks ``aij``.
    check
        Count the eigenvalues below the last one, to prove that none was missed.
    """

    options: Mapping[str, object] = DIRECT
    flags: Sequence[str] = FAST
    matrix_type: str | None = None
    check: bool = True


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibration modes, ascending; of a free body the rigid ones come first.

    Attributes
    ----------
    shapes
        Mode shapes ``x^T M x = 1``, a PETSc vector each, on the degrees of freedom that are free.
    carry
        Sets the body's state from such a vector.
    frequencies
        ``omega / 2 pi``, cycles per time, shape ``(modes,)``.
    eigenvalues
        ``omega^2``, shape ``(modes,)``.
    residuals
        ``|K x - lambda M x| / (|lambda| |M x|)``, shape ``(modes,)``; of rigid modes with the first flexible
        ``lambda``.
    rigid
        Number of rigid modes among them.
    below
        Number of eigenvalues up to the last one, by the inertia of ``K - tau M`` (Sturm count); None if not asked for.
    dofs, unknowns
        Number of degrees of freedom, with and without those held.
    iterations
        Restarts or iterations of the eigensolver.
    seconds
        ``forms`` (symbolic work and compilation or its cache), ``setup`` (spaces, supports, empty matrices),
        ``assembly``, ``solve``, and apart from these ``check`` (the inertia), wall time of this rank.
    options
        PETSc and SLEPc options in force, as given.
    peak_memory
        Largest resident set of a rank so far, bytes.
    """

    shapes: list[PETSc.Vec]
    carry: Callable[[PETSc.Vec], None]
    frequencies: Array
    eigenvalues: Array
    residuals: Array
    rigid: int
    below: int | None
    dofs: int
    unknowns: int
    iterations: int
    seconds: dict[str, float]
    options: dict[str, str]
    peak_memory: int


def solve(
    domain: Domain,
    solid: Solid,
    held: Sequence[str] = (),
    modes: int = 10,
    element: Element | None = None,
    settings: Settings | None = None,
) -> Modes:
    """Return the lowest vibration modes.

    Parameters
    ----------
    domain
        The mesh.
    solid
        Material.
    held
        Names of the clamped faces; their unknowns are removed.  Without any the body is free and has six rigid modes.
    modes
        Number of modes besides the rigid ones.
    element
        Displacement element and quadrature of the stiffness; the mass is integrated to twice the element's degree.
    settings
        Of matrices and eigensolver.

    Raises
    ------
    InputError
        If the density is not positive or there are fewer unknowns than modes.
    SolveError
        If SLEPc does not converge, or a mode is missed.
    """
    if not solid.density > 0.0:
        raise InputError(f"density: got {solid.density:g}, modes need a positive mass per volume")
    settings = settings or Settings()
    begin = perf_counter()
    body = _body(domain, solid, held, element or Element(), settings)
    return lowest(body, modes, 0 if held else RIGID, settings, begin)


def lowest(body: "Body", modes: int, rigid: int, settings: Settings, begin: float) -> Modes:
    """Return the lowest modes of a body with ``rigid`` rigid motions; ``begin`` is when its making started."""
    times = [begin]
    if modes < 1 or modes + rigid > body.unknowns:
        raise InputError(f"modes: got {modes}, need 1 to {body.unknowns - rigid} (the unknowns there are)")
    times.append(perf_counter())
    pencil = body.pencil(rigid, settings.options)
    times.append(perf_counter())
    shift = pencil.shift()
    if shift is None:
        raise SolveError("modes of a free body: no flexible mode was found to place the shift by; give one (-st_shift)")
    result = pencil.solve(modes + rigid, shift, settings.check)
    times.append(perf_counter())
    for matrix in (pencil.stiffness, pencil.mass, body.matrix):
        matrix.destroy()
    setup, assembly, solving = np.diff(times)
    return Modes(
        shapes=result.vectors,
        carry=body.carry,
        frequencies=np.sqrt(np.maximum(result.eigenvalues, 0.0)) / (2.0 * np.pi),
        eigenvalues=result.eigenvalues,
        residuals=result.residuals,
        rigid=rigid,
        below=result.below,
        dofs=body.dofs,
        unknowns=body.unknowns,
        iterations=result.iterations,
        seconds={
            "forms": body.symbolic,
            "setup": setup - body.symbolic,
            "assembly": assembly,
            "solve": solving - pencil.check_seconds,
            "check": pencil.check_seconds,
        },
        options=result.options,
        peak_memory=body.comm.allreduce(peak_memory(), op=MPI.MAX),
    )


class Body:
    """Forms and matrices of a body.

    The stiffness is assembled by 3 x 3 blocks (``baij``): inserting a block at a time is three times faster than entry
    by entry. Of the mass only one component is assembled, and PETSc's MAIJ applies it to all three: Lanczos steps
    multiply by it more often than they solve.

    Parameters
    ----------
    state
        A dolfinx function: the displacement, or that and something else.
    displacement
        The displacement, in UFL.
    stored
        Energy of the state, integrals.
    density
        Mass per volume: a number, or a scalar in UFL.
    scalar
        Space of one component of the displacement, where the state is nothing but that.
    free
        This rank's own nodes that are not held, local numbers; or, without ``whole``, degrees of freedom.
    degree
        Of the displacement.
    whole, pressures
        Whether nodes are free or held as a whole; number of degrees of freedom that are pressures.
    bonds
        Adds to the stiffness what no form knows; where the state is the displacement there is no ``scalar`` then.
    """

    def __init__(
        self,
        state: Any,
        displacement: Any,
        stored: Any,
        density: Any,
        scalar: Any,
        free: Index,
        degree: int,
        settings: Settings,
        whole: bool = True,
        pressures: int = 0,
        bonds: Callable[[PETSc.Mat], None] | None = None,
    ) -> None:
        self.state, self.displacement, self.density, self.scalar, self.free = state, displacement, density, scalar, free
        self.space = state.function_space
        self.comm, self.pressures, self._bonds = self.space.mesh.comm, pressures, bonds
        self.plain = scalar is not None and whole
        self.flags = settings.flags
        # Enough points for a mass that is definite, whatever the rule of the stiffness; they cost little in one
        # component.
        self.mass_measure = ufl.dx(domain=self.space.mesh, metadata={"quadrature_degree": 2 * degree})
        # PETSc adds only part of the entries of two parallel sbaij matrices with blocks (MatAXPY, 3.18).
        by_blocks = "sbaij" if self.comm.size == 1 else "aij"
        self.kind = "baij" if self.plain else "aij"
        self.final = settings.matrix_type or (by_blocks if self.plain else "aij")
        dofmap = self.space.dofmap
        self.blocks = dofmap.index_map_bs if whole else 1
        self.dofs = dofmap.index_map.size_global * dofmap.index_map_bs
        self.unknowns = self.comm.allreduce(self.free.size * self.blocks, op=MPI.SUM)
        self.first = dofmap.index_map.local_range[0] * (dofmap.index_map_bs // self.blocks)
        start = perf_counter()
        self.stiffness_form = self._form(stored)
        self.mass_form = self._scalar_mass() if self.plain else None
        self.symbolic = perf_counter() - start
        self.matrix = compat.create_matrix(self.stiffness_form, self.kind)

    def _form(self, energy: Any) -> Any:
        """Return the compiled second variation of an energy."""
        first = ufl.derivative(energy, self.state, ufl.TestFunction(self.space))
        return compat.form(ufl.derivative(first, self.state, ufl.TrialFunction(self.space)), self.flags)

    def _scalar_mass(self) -> Any:
        u, v = ufl.TrialFunction(self.scalar), ufl.TestFunction(self.scalar)
        return compat.form(self.density * ufl.inner(u, v) * self.mass_measure, self.flags)

    def _rows(self, blocks: int) -> PETSc.IS:
        rows = (self.first + self.free).astype(PETSc.IntType)
        return PETSc.IS().createBlock(blocks, rows, comm=self.comm)

    def _reduced(self, matrix: PETSc.Mat, blocks: int, kind: str) -> PETSc.Mat:
        """Remove the rows and columns of held unknowns and convert to the type that is factored."""
        if self.unknowns < self.dofs:
            rows = self._rows(blocks)
            whole, matrix = matrix, matrix.createSubMatrix(rows, rows)
            rows.destroy()
            # petsc4py only marks for destruction what Python forgets.
            if whole.handle != self.matrix.handle:
                whole.destroy()
        return matrix if matrix.getType() in (f"seq{kind}", f"mpi{kind}") else matrix.convert(kind)

    def pencil(self, rigid: int, options: Mapping[str, object]) -> Pencil:
        """Return stiffness and mass of the free unknowns, for an eigensolver with some options."""
        stiffness = self._stiffness()
        # A shift adds the mass to the stiffness: it then needs the same sparsity.
        multiplies = self.plain and not rigid and only_multiplies()
        mass = self._mass() if multiplies else self._mass_by_blocks()
        if PETSc.Options().getAll().get("st_pc_type", options.get("st_pc_type")) in ALGEBRAIC and self.plain:
            own = self.space.tabulate_dof_coordinates()[self.free]
            stiffness.setNearNullSpace(rigid_motions(stiffness.createVecRight(), own))
        return Pencil(
            stiffness,
            mass,
            rigid=rigid,
            pressures=self.pressures,
            # Incompatible modes have no mass, and unknowns without mass have to be purified.
            factors=options if self.plain else {**options, "eps_purify": True},
            entries=self._mass_by_blocks if mass.getType() != stiffness.getType() else None,
            structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN,
        )

    def _stiffness(self) -> PETSc.Mat:
        compat.assemble_matrix(self.matrix, self.stiffness_form, [])
        if self._bonds is not None:
            self._bonds(self.matrix)
        _declare(self.matrix, definite=False)
        whole = self.matrix if self.unknowns < self.dofs else self.matrix.copy()
        definite = self.unknowns < self.dofs and not self.pressures
        return _declare(self._reduced(whole, self.blocks, self.final), definite)

    def _mass(self) -> PETSc.Mat:
        """Assemble the mass to multiply with."""
        if not np.array_equal(_table(self.space), _table(self.scalar)):
            return self._mass_by_blocks()
        matrix = compat.create_matrix(self.mass_form, None)
        compat.assemble_matrix(matrix, self.mass_form, [])
        component = self._reduced(matrix, 1, "aij")
        result = _declare(componentwise(component, 3), definite=True)
        component.destroy()
        return result

    def _mass_by_blocks(self) -> PETSc.Mat:
        """Assemble the mass with the type and sparsity of the stiffness."""
        u = self.displacement
        form = self._form(0.5 * self.density * ufl.inner(u, u) * self.mass_measure)
        matrix = self.matrix.duplicate()
        compat.assemble_matrix(matrix, form, [])
        _declare(matrix, definite=False)
        return _declare(self._reduced(matrix, self.blocks, self.final), definite=False)

    def carry(self, shape: PETSc.Vec) -> None:
        """Set the state from a vector of the free unknowns."""
        own = compat.petsc_vector(self.state)
        own.set(0.0)
        own.array[:].reshape(-1, self.blocks)[self.free] = shape.array_r.reshape(-1, self.blocks)
        own.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)


def _declare(matrix: PETSc.Mat, definite: bool) -> PETSc.Mat:
    """Tell PETSc that a matrix is symmetric, and whether it is positive definite."""
    option: Any = PETSc.Mat.Option
    for flag in (option.SYMMETRIC, option.SYMMETRY_ETERNAL, *([option.SPD] if definite else [])):
        matrix.setOption(flag, True)
    return matrix


def _table(space: Any) -> Index:
    table = space.dofmap.list
    return np.asarray(getattr(table, "array", table)).ravel()


def _body(domain: Domain, solid: Solid, held: Sequence[str], element: Element, settings: Settings) -> Body:
    """Return a homogeneous body, held on named faces."""
    mesh, plain, scalar = domain.mesh, element.family != "enhanced", None
    if plain:
        space = compat.function_space(mesh, compat.element(mesh, element.family, element.degree, 3))
        scalar = compat.function_space(mesh, compat.element(mesh, element.family, element.degree, 1))
    else:
        space = enhanced.space(mesh)
    state = dolfinx.fem.Function(space)
    F = ufl.Identity(3) + ufl.grad(state) if plain else enhanced.deformation_gradient(state)
    dx = ufl.dx(metadata=quadrature.measure(element.rule(domain.shape)))
    stored = energy_of(LinearElastic(solid.E, solid.nu))(F) * dx
    displacement = state if plain else ufl.split(state)[0]
    free = free_unknowns(space, domain, held, plain)
    return Body(state, displacement, stored, solid.density, scalar, free, element.degree, settings)


def free_unknowns(space: Any, domain: Domain, held: Sequence[str], plain: bool) -> Index:
    """Return this rank's own nodes that are not held (without blocks: degrees of freedom), local numbers."""
    own = np.ones(space.dofmap.index_map.size_local, dtype=bool)
    for face in held:
        facets = domain.facets(face)
        if plain:
            where = dolfinx.fem.locate_dofs_topological(space, 2, facets)
        else:
            displacements = space.sub(0).collapse()[0]
            where = dolfinx.fem.locate_dofs_topological((space.sub(0), displacements), 2, facets)[0]
        own[where[where < own.size]] = False
    return np.flatnonzero(own)
