"""Vibration modes with dolfinx: linear elasticity, ``K x = omega^2 M x`` on the free unknowns, by SLEPc."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

from comparisons.fem import compat, quadrature
from comparisons.fem.domain import Domain
from comparisons.fem.material import lame
from comparisons.fem.statics import FAST, Element
from comparisons.timing import peak_memory
from isorod.errors import InputError, SolveError
from isorod.options import defaults
from meshes.mesh import Array, Index

DIRECT = {
    "eps_tol": 1e-10,
    "st_type": "sinvert",
    "st_ksp_type": "preonly",
    "st_pc_type": "cholesky",
    "st_pc_factor_mat_solver_type": "mumps",
}

# Eigensolvers that take a preconditioner instead of a spectral transformation.
PRECONDITIONED = ("lobpcg", "rqcg", "gd", "jd")

RIGID = 6

# The inertia is taken this far (relative) above the last eigenvalue returned.
_ABOVE = 1e-6

# The shift of a free body lies this share of its first flexible eigenvalue below zero.
_SHIFT = 0.1


@dataclass(frozen=True)
class Solid:
    """A linear elastic, isotropic, homogeneous body: Young's modulus, Poisson's ratio, mass per volume."""

    E: float
    nu: float
    density: float


@dataclass(frozen=True, eq=False)
class Modes:
    """Vibration modes, ascending; of a free body the rigid ones come first.

    Attributes
    ----------
    domain
        What was solved on.
    shapes
        Mode shapes, one dolfinx function a mode, ``x^T M x = 1``.
    frequencies
        ``omega / 2 pi``, cycles per time, shape ``(modes,)``.
    eigenvalues
        ``omega^2``, shape ``(modes,)``.
    residuals
        ``|K x - lambda M x| / (|lambda| |M x|)``, shape ``(modes,)``; of rigid modes with the first flexible ``lambda``.
    rigid
        Number of rigid modes among them.
    below
        Number of eigenvalues up to the last one, by the inertia of ``K - tau M`` (Sturm count); None if not asked for.
    dofs, unknowns
        Number of degrees of freedom, with and without those held.
    iterations
        Restarts or iterations of the eigensolver.
    seconds
        ``forms`` (symbolic work and compilation or its cache), ``setup`` (space, supports, matrices), ``assembly``, ``solve``,
        and apart from these ``check`` (the inertia), wall time of this rank.
    options
        PETSc and SLEPc options in force, as given.
    peak_memory
        Largest resident set of a rank so far, bytes.
    """

    domain: Domain
    shapes: list[Any]
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
    options: Mapping[str, object] | None = None,
    flags: Sequence[str] = FAST,
    matrix_type: str | None = None,
    check: bool = True,
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
        Displacement element and quadrature, the same for stiffness and mass.
    options
        PETSc and SLEPc options that the user's own override; `DIRECT` if not given.
    flags
        C compiler flags for the forms.
    matrix_type
        PETSc matrix type.
    check
        Count the eigenvalues below the last one as well.

    Raises
    ------
    InputError
        If the density is not positive or there are fewer unknowns than modes.
    SolveError
        If SLEPc does not converge, or the count shows that a mode was missed.
    """
    if not solid.density > 0.0:
        raise InputError(f"density: got {solid.density:g}, modes need a positive mass per volume")
    start = perf_counter()
    element = element or Element()
    mesh = domain.mesh
    comm = mesh.comm
    space = compat.function_space(mesh, compat.block_element(mesh, element.family, element.degree, 3))
    spaces = perf_counter() - start

    start = perf_counter()
    forms = _forms(space, solid, element.rule(mesh.ufl_cell().cellname()), flags)
    symbolic = perf_counter() - start

    start = perf_counter()
    pencil = _Pencil(space, forms, _free(space, domain, held), matrix_type)
    rigid = 0 if held else RIGID
    wanted = modes + rigid
    if modes < 1 or wanted > pencil.unknowns:
        raise InputError(f"modes: got {modes}, need 1 to {pencil.unknowns - rigid} (the unknowns there are)")
    setup = spaces + perf_counter() - start

    start = perf_counter()
    pencil.assemble()
    assembly = perf_counter() - start

    start = perf_counter()
    with defaults(DIRECT if options is None else options):
        eps = pencil.solve(wanted, -_SHIFT * pencil.first_flexible(rigid) if rigid else 0.0)
        typed = dict(PETSc.Options().getAll())
    eigenvalues, residuals, shapes = pencil.pairs(eps, wanted, rigid)
    solution = perf_counter() - start

    start = perf_counter()
    below = pencil.count_below(eigenvalues[-1]) if check else None
    checking = perf_counter() - start
    found = sum(1 for k in range(eps.getConverged()) if eps.getEigenvalue(k).real <= _just_above(eigenvalues[-1]))
    if below is not None and below != found:
        raise SolveError(
            f"modes: {below} eigenvalues lie at or below {eigenvalues[-1]:.6g}, but {found} were found; "
            "ask for more (-eps_ncv) or shift elsewhere (-st_shift)"
        )
    seconds = {"forms": symbolic, "setup": setup, "assembly": assembly, "solve": solution, "check": checking}
    result = Modes(
        domain=domain,
        shapes=shapes,
        frequencies=np.sqrt(np.maximum(eigenvalues, 0.0)) / (2.0 * np.pi),
        eigenvalues=eigenvalues,
        residuals=residuals,
        rigid=rigid,
        below=below,
        dofs=space.dofmap.index_map.size_global * space.dofmap.index_map_bs,
        unknowns=pencil.unknowns,
        iterations=eps.getIterationNumber(),
        seconds=seconds,
        options=typed,
        peak_memory=comm.allreduce(peak_memory(), op=MPI.MAX),
    )
    eps.destroy()
    pencil.destroy()
    return result


def _just_above(eigenvalue: float) -> float:
    return eigenvalue + _ABOVE * abs(eigenvalue)


def _forms(space: Any, solid: Solid, rule: int | str, flags: Sequence[str]) -> tuple[Any, Any]:
    """Return the compiled forms of stiffness and mass."""
    mu, kappa = lame(solid.E, solid.nu)
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    dx = ufl.dx(metadata=quadrature.measure(rule))
    strain = ufl.sym(ufl.grad(u))
    stress = 2.0 * mu * strain + kappa * ufl.tr(strain) * ufl.Identity(3)
    stiffness = ufl.inner(stress, ufl.sym(ufl.grad(v))) * dx
    mass = solid.density * ufl.inner(u, v) * dx
    return compat.form(stiffness, flags), compat.form(mass, flags)


def _free(space: Any, domain: Domain, held: Sequence[str]) -> Index:
    """Return this rank's own nodes (blocks of degrees of freedom) that are not held, local numbers."""
    own = np.ones(space.dofmap.index_map.size_local, dtype=bool)
    for face in held:
        nodes = dolfinx.fem.locate_dofs_topological(space, 2, domain.facets(face))
        own[nodes[nodes < own.size]] = False
    return np.flatnonzero(own)


class _Pencil:
    """The matrices ``K`` and ``M`` of the free unknowns."""

    def __init__(self, space: Any, forms: tuple[Any, Any], free: Index, matrix_type: str | None) -> None:
        self.space, self.forms = space, forms
        self.comm = space.mesh.comm
        self.unknowns = 3 * self.comm.allreduce(free.size, op=MPI.SUM)
        self.held = self.unknowns < 3 * space.dofmap.index_map.size_global
        first = space.dofmap.index_map.local_range[0]
        self.free = PETSc.IS().createBlock(3, (first + free).astype(PETSc.IntType), comm=self.comm)
        self.full = [compat.create_matrix(forms[0], matrix_type)]
        # The same sparsity, without building it again.
        self.full.append(self.full[0].duplicate())
        self.vector = self.full[0].createVecRight()

    def assemble(self) -> None:
        """Assemble both matrices and take out the rows and columns of what is held."""
        for matrix, form in zip(self.full, self.forms, strict=True):
            compat.assemble_matrix(matrix, form, [])
        if self.held:
            self.stiffness, self.mass = (matrix.createSubMatrix(self.free, self.free) for matrix in self.full)
        else:
            self.stiffness, self.mass = self.full
        for matrix in (self.stiffness, self.mass):
            matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
            matrix.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, True)
            if self.held or matrix is self.mass:
                matrix.setOption(PETSc.Mat.Option.SPD, True)

    def _eps(self, count: int, shift: float) -> SLEPc.EPS:
        eps = SLEPc.EPS().create(self.comm)
        eps.setOperators(self.stiffness, self.mass)
        eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
        eps.setDimensions(min(count, self.unknowns))
        eps.setTarget(shift)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        return eps

    def first_flexible(self, rigid: int) -> float:
        """Return a rough value of the first eigenvalue above the rigid modes of a free body."""
        guess = 1e-8 * self.stiffness.getDiagonal().sum() / self.mass.getDiagonal().sum()
        for _ in range(8):
            eps = self._eps(rigid + 2, -guess)
            eps.setTolerances(1e-4)
            st = eps.getST()
            st.setType(SLEPc.ST.Type.SINVERT)
            st.setShift(-guess)
            st.getKSP().setType(PETSc.KSP.Type.PREONLY)
            st.getKSP().getPC().setType(PETSc.PC.Type.LU)
            st.getKSP().getPC().setFactorSolverType("mumps")
            eps.solve()
            values = sorted(eps.getEigenvalue(k).real for k in range(eps.getConverged()))
            eps.destroy()
            if len(values) <= rigid:
                break
            # Too far below zero, the shift makes rigid and flexible modes look alike.
            if values[rigid] > 0.01 * guess:
                return float(values[rigid])
            guess = max(10.0 * abs(values[rigid]), 1e-3 * guess)
        raise SolveError("modes of a free body: no flexible mode was found to place the shift by; give one (-st_shift)")

    def solve(self, wanted: int, shift: float) -> SLEPc.EPS:
        """Solve for the lowest ``wanted`` eigenvalues, as the options say."""
        # One more than wanted, so that the last one does not lack its twin.
        eps = self._eps(wanted + 1, shift)
        if PETSc.Options().getString("eps_type", "krylovschur") in PRECONDITIONED:
            eps.setWhichEigenpairs(SLEPc.EPS.Which.SMALLEST_REAL)
        eps.setFromOptions()
        eps.solve()
        if eps.getConverged() < wanted:
            raise SolveError(
                f"modes: SLEPc found {eps.getConverged()} of {wanted} in {eps.getIterationNumber()} iterations (reason "
                f"{eps.getConvergedReason()}); raise -eps_max_it or -eps_ncv, or loosen -eps_tol"
            )
        return eps

    def pairs(self, eps: SLEPc.EPS, wanted: int, rigid: int) -> tuple[Array, Array, list[Any]]:
        """Return the lowest eigenvalues, the residuals and the mode shapes."""
        values = np.array([eps.getEigenvalue(k).real for k in range(eps.getConverged())])
        order = np.argsort(values, kind="stable")[:wanted]
        scale = abs(values[order[rigid]])
        x, kx, mx = (self.stiffness.createVecRight() for _ in range(3))
        residuals, shapes = [], []
        for k in order:
            eps.getEigenvector(k, x)
            self.stiffness.mult(x, kx)
            self.mass.mult(x, mx)
            x.scale(1.0 / np.sqrt(x.dot(mx)))
            norm = mx.norm()
            kx.axpy(-values[k], mx)
            residuals.append(kx.norm() / (max(abs(values[k]), scale) * norm))
            shapes.append(self._shape(x))
        return values[order], np.array(residuals), shapes

    def _shape(self, x: PETSc.Vec) -> Any:
        """Return the function of a vector of the free unknowns."""
        shape = dolfinx.fem.Function(self.space)
        own = compat.petsc_vector(shape)
        local = self.free.getIndices() - own.getOwnershipRange()[0]
        own.array[local] = x.array_r
        own.ghostUpdate(addv=PETSc.InsertMode.INSERT, mode=PETSc.ScatterMode.FORWARD)
        return shape

    def count_below(self, eigenvalue: float) -> int:
        """Return the number of eigenvalues up to just above the given one, by Sylvester's law of inertia."""
        shifted = self.stiffness.copy()
        shifted.axpy(-_just_above(eigenvalue), self.mass, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        shifted.setOption(PETSc.Mat.Option.SPD, False)
        pc = PETSc.PC().create(self.comm)
        pc.setOptionsPrefix("sturm_")
        pc.setOperators(shifted)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        # MUMPS knows the inertia only if its root node is not ScaLAPACK's and it looks for zero pivots.
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(13, 1)
        factor.setMumpsIcntl(24, 1)
        pc.setFromOptions()
        pc.setUp()
        negative, _, _ = pc.getFactorMatrix().getInertia()
        pc.destroy()
        shifted.destroy()
        return int(negative)

    def destroy(self) -> None:
        """Free the matrices."""
        for matrix in {m.handle: m for m in (self.stiffness, self.mass, *self.full)}.values():
            matrix.destroy()
