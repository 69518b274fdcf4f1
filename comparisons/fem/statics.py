"""Static equilibrium with dolfinx: displacement elements, Newton's method by PETSc's SNES driven directly."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any, Protocol

import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem import enhanced, quadrature
from comparisons.fem.domain import Domain
from comparisons.measure.timing import Clock, peak_memory
from isorod.errors import SolveError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import Energy
from isorod.options import defaults
from isorod.petsc.direct import room
from meshes.mesh import Array, Index

# The tangent of a stable equilibrium is symmetric and positive definite: half the work of LU. 2: approximate minimum
# fill.
DIRECT = {
    "ksp_type": "preonly",
    "pc_type": "cholesky",
    "pc_factor_mat_solver_type": "mumps",
    "mat_mumps_icntl_7": 2,
}
NEWTON = {"snes_linesearch_type": "basic", "snes_rtol": 1e-9, "snes_max_it": 15}

# Preconditioners that need the rigid motions.
ALGEBRAIC = ("gamg", "ml", "hypre")


class Faces(Protocol):
    """An object with facets of named faces, such as `Domain`."""

    def facets(self, name: str) -> Any:
        """Return this rank's facets of a face."""


@dataclass(frozen=True, eq=False)
class Held:
    """Displacement prescribed on a named face of the mesh.

    Parameters
    ----------
    face
        Name of the face.
    displacement
        A vector (units of length), or a function of positions ``(3, m)`` that returns displacements ``(3, m)``.
    """

    face: str
    displacement: tuple[float, float, float] | Callable[[Array], Array] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Element:
    """How the displacement is approximated and integrated.

    Parameters
    ----------
    degree
        Polynomial degree.
    quadrature
        Degree of the rule in every form, or the name of one of `comparisons.fem.quadrature.RULES`; ``2 degree`` on
        bricks and ``2 degree - 2``, at least 1, on tetrahedra if None.
    family
        ``"Lagrange"``, or on bricks ``"S"`` (serendipity) or ``"enhanced"`` (degree 1 with nine incompatible modes a
        cell).
    """

    degree: int = 2
    quadrature: int | str | None = None
    family: str = "Lagrange"

    def rule(self, shape: str) -> int | str:
        """Return the quadrature degree, or the rule's name, on a cell shape."""
        if self.quadrature is not None:
            return self.quadrature
        return 2 * self.degree if shape == "hexahedron" else max(1, 2 * self.degree - 2)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A static solution.

    Attributes
    ----------
    displacement
        The dolfinx function.
    reactions
        Force of each support on the body, shape ``(supports, 3)``, the same on every rank.
    dofs
        Number of degrees of freedom, supported ones included.
    newton_iterations, linear_iterations
        Numbers of linear solves, and of Krylov iterations in all.
    residual_norms
        Norm of the residual at each SNES iteration.
    seconds
        ``forms`` (symbolic work and compilation or its cache), ``setup`` (space, supports, vectors and matrix),
        ``assembly``, ``solve`` (the rest of SNES), wall time of this rank.
    options
        PETSc options in force, as given.
    peak_memory
        Largest resident set of a rank so far, bytes.
    """

    displacement: Any
    reactions: Array
    dofs: int
    newton_iterations: int
    linear_iterations: int
    residual_norms: list[float]
    seconds: dict[str, float]
    options: dict[str, str]
    peak_memory: int = field(default=0)


def solve(
    domain: Domain,
    energy: Energy,
    held: Sequence[Held],
    element: Element | None = None,
    options: Mapping[str, object] | None = None,
    flags: Sequence[str] = FAST,
    matrix_type: str | None = None,
) -> Equilibrium:
    """Return the equilibrium under prescribed displacements, in one load step.

    Parameters
    ----------
    domain
        The mesh.
    energy
        Stored-energy density per reference volume, a function of the deformation gradient.
    held
        Supports; a later one wins where faces meet.
    element
        Displacement element and quadrature.
    options
        PETSc options that the user's own override; MUMPS if not given; Newton steps are undamped in both cases.
    flags
        C compiler flags for the forms.
    matrix_type
        PETSc matrix type.

    Raises
    ------
    SolveError
        If SNES or its linear solver fails.
    """
    element = element or Element()
    clock = Clock()
    state, F = _space(domain.mesh, element)
    clock.lap("setup")
    stored = energy(F) * ufl.dx(metadata=quadrature.measure(element.rule(domain.shape)))
    residual, tangent = variations(stored, state, flags)
    clock.lap("forms")
    supports = [Support(state.function_space, domain, one) for one in held]
    with defaults(NEWTON | dict(DIRECT if options is None else options)):
        newton = Newton(state, residual, tangent, supports, matrix_type)
        clock.lap("setup")
        newton.solve()
        reactions = newton.reactions()
        clock.lap("solve")
        typed = dict(PETSc.Options().getAll())
        iterations = newton.snes.getIterationNumber(), newton.snes.getLinearSolveIterations()
        newton.destroy()
    dofmap = state.function_space.dofmap
    solving = clock.seconds["solve"] - newton.seconds
    return Equilibrium(
        displacement=state.sub(0).collapse() if element.family == "enhanced" else state,
        reactions=reactions,
        dofs=dofmap.index_map.size_global * dofmap.index_map_bs,
        newton_iterations=iterations[0],
        linear_iterations=iterations[1],
        residual_norms=newton.norms,
        seconds=clock.seconds | {"assembly": newton.seconds, "solve": solving},
        options=typed,
        peak_memory=domain.mesh.comm.allreduce(peak_memory(), op=MPI.MAX),
    )


def _space(mesh: Any, element: Element) -> tuple[Any, Any]:
    """Return the displacement, a dolfinx function, and its deformation gradient."""
    if element.family == "enhanced":
        state = dolfinx.fem.Function(enhanced.space(mesh))
        return state, enhanced.deformation_gradient(state)
    lagrange = compat.element(mesh, element.family, element.degree, 3)
    state = dolfinx.fem.Function(compat.function_space(mesh, lagrange))
    return state, ufl.Identity(3) + ufl.grad(state)


def variations(stored: Any, state: Any, flags: Sequence[str]) -> tuple[Any, Any]:
    """Return the first and the second variation of an energy, compiled: the residual and its derivative."""
    space = state.function_space
    residual = ufl.derivative(stored, state, ufl.TestFunction(space))
    tangent = ufl.derivative(residual, state, ufl.TrialFunction(space))
    return compat.form(residual, flags), compat.form(tangent, flags)


class Support:
    """A support in a space of displacements, or a mixed one whose first part they are.

    Attributes
    ----------
    condition
        The dolfinx condition.
    dofs, components
        This rank's own degrees of freedom under it, and the direction 0, 1, 2 of each.
    unit
        Coefficients that make a unit translation: 1 at Lagrange nodes, not in elements whose unknowns are moments.
    places
        Where the node of each is held, shape ``(m, 3)``; of Lagrange elements.
    """

    def __init__(self, space: Any, domain: Faces, held: Held) -> None:
        facets = domain.facets(held.face)
        mixed = space.num_sub_spaces == 2
        plain = space.sub(0).collapse()[0] if mixed else space
        value = dolfinx.fem.Function(plain)
        displacement = held.displacement
        if callable(displacement):
            value.interpolate(displacement)
        else:
            constant = np.array(displacement, dtype=float)[:, None]
            value.interpolate(lambda x: np.repeat(constant, x.shape[1], axis=1))
        if mixed:
            dofs, in_plain = dolfinx.fem.locate_dofs_topological((space.sub(0), plain), 2, facets)
            self.condition = dolfinx.fem.dirichletbc(value, [dofs, in_plain], space.sub(0))
        else:
            nodes = dolfinx.fem.locate_dofs_topological(space, 2, facets)
            self.condition = dolfinx.fem.dirichletbc(value, nodes)
            dofs = in_plain = (3 * nodes[:, None] + np.arange(3)).ravel()
        own = dofs < space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        translation = dolfinx.fem.Function(plain)
        translation.interpolate(lambda x: np.ones_like(x))
        self.dofs: Index = dofs[own]
        self.components: Index = in_plain[own] % 3
        self.unit: Array = translation.x.array[in_plain[own]]
        at = dolfinx.fem.Function(plain)
        at.interpolate(lambda x: x)
        self.places: Array = (at.x.array + value.x.array).reshape(-1, 3)[in_plain[own] // 3]


class Newton:
    """SNES on compiled forms; a subclass may add forces that no form has, and their derivative.

    ``definite``: the tangent is positive definite, which its factorisation relies on.
    """

    def __init__(
        self,
        u: Any,
        residual: Any,
        tangent: Any,
        supports: Sequence[Any],
        matrix_type: str | None,
        definite: bool = True,
    ) -> None:
        self.residual, self.tangent, self.supports = residual, tangent, supports
        self.conditions = [support.condition for support in supports]
        self.state = compat.petsc_vector(u)
        self.x = self.state.duplicate()
        self.force = self.state.duplicate()
        self.matrix = compat.create_matrix(tangent, matrix_type)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
        self.matrix.setOption(PETSc.Mat.Option.SPD, definite)
        self.seconds = 0.0
        self.norms: list[float] = []
        self.snes = PETSc.SNES().create(self.state.getComm())
        self.snes.setFunction(self._residual, self.force)
        self.snes.setJacobian(self._tangent, self.matrix)
        self.snes.setMonitor(lambda snes, k, norm: self.norms.append(norm))
        self.snes.setFromOptions()
        space = u.function_space
        if self.snes.getKSP().getPC().getType() in ALGEBRAIC and space.dofmap.index_map_bs == 3:
            own = space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local]
            self.matrix.setNearNullSpace(rigid_motions(self.matrix.createVecRight(), own))

    def _copy(self, x: PETSc.Vec) -> None:
        x.copy(self.state)
        self.state.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        start = perf_counter()
        self._copy(x)
        compat.assemble_vector(out, self.residual)
        self.add_forces(out)
        # Only the first state does not fulfil the conditions of supports, so that only then is there anything to lift.
        if snes.getIterationNumber() == 0:
            compat.lift(out, self.tangent, self.conditions, self.state)
        out.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        dolfinx.fem.petsc.set_bc(out, self.conditions, self.state, -1.0)
        self.seconds += perf_counter() - start

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        start = perf_counter()
        self._copy(x)
        compat.assemble_matrix(P, self.tangent, self.conditions)
        self.add_stiffness(P)
        if J.handle != P.handle:
            J.assemble()
        self.seconds += perf_counter() - start

    def add_forces(self, out: PETSc.Vec) -> None:
        """Add to the internal forces; nothing here."""

    def add_stiffness(self, matrix: PETSc.Mat) -> None:
        """Add to their derivative; nothing here."""

    def solve(self, first: PETSc.Vec | None = None) -> None:
        """Solve from rest, or from a state ``first``; the solution ends up in the function."""
        if first is None:
            self.x.set(0.0)
        else:
            first.copy(self.x)
        with defaults(room(self.snes.getComm())):
            self.snes.solve(None, self.x)
        reason = self.snes.getConvergedReason()
        if reason < 0:
            why = f"SNES diverged after {self.snes.getIterationNumber()} iterations (reason {reason})"
            if reason == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE:
                why += ", its linear solver failed: if the tangent may be indefinite or singular, try -pc_type lu"
            else:
                why += ": take a smaller displacement, a finer quadrature or more iterations (-snes_max_it)"
            raise SolveError(why)
        self._copy(self.x)

    def reactions(self) -> Array:
        """Return the internal force's work on unit translations of each support, on every rank."""
        start = perf_counter()
        compat.assemble_vector(self.force, self.residual)
        self.force.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        force = self.force.array_r
        sums = np.array([np.bincount(s.components, force[s.dofs] * s.unit, 3) for s in self.supports]).reshape(-1, 3)
        total = self.force.getComm().tompi4py().allreduce(sums, op=MPI.SUM)
        self.seconds += perf_counter() - start
        return total

    def destroy(self) -> None:
        """Free the factors now: PETSc and Python hold each other through the callbacks, and no collector sees it."""
        for thing in (self.snes, self.matrix, self.force, self.x):
            thing.destroy()


def rigid_motions(positions: PETSc.Vec, x: Array) -> PETSc.NullSpace:
    """Return the six rigid motions, which algebraic multigrid asks for.

    Parameters
    ----------
    positions
        A vector of the displacements, overwritten.
    x
        Where this rank's own of them are, shape ``(nodes, 3)``.
    """
    positions.setBlockSize(3)
    positions.array[:] = x.ravel()
    return PETSc.NullSpace().createRigidBody(positions)
