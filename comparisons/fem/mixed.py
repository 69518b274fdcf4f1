"""Static equilibrium near and at incompressibility with dolfinx: Taylor-Hood elements.

The displacement is of one degree more than the pressure.  Of a law ``W = psi + kappa/2 theta^2``, such as those of
isorod's that split, stationary point of ``integral of psi + p theta - p^2 / (2 kappa)``: for the pressure that is left,
the law itself; ``kappa`` may be infinite.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import dolfinx.fem
import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem import quadrature
from comparisons.fem.domain import Domain
from comparisons.fem.statics import NEWTON, Held, Newton, Support, variations
from isorod.errors import InputError
from isorod.fenics import compat
from isorod.fenics.flags import FAST
from isorod.fenics.stored import energy_of
from isorod.material.law import Material
from isorod.options import defaults
from meshes.mesh import Array

# Symmetric and indefinite: no SPD shortcut. 2: approximate minimum fill.
DIRECT = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps", "mat_mumps_icntl_7": 2}


@dataclass(frozen=True, eq=False)
class Guided:
    """One component of the displacement prescribed on a named face, the others free.

    Its reaction is the work of the forces there on the displacement itself, in the component's place.

    Parameters
    ----------
    face
        Name of the face.
    component
        0, 1 or 2.
    displacement
        Function of positions ``(3, m)`` that returns the component's displacements ``(m,)``.
    """

    face: str
    component: int
    displacement: Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A static solution.

    Attributes
    ----------
    state
        The dolfinx function of displacement and pressure, the latter in units of the modulus
        of pressure waves of ``psi``.
    reactions
        Force of each support on the body (work of a guided one), shape ``(supports, 3)``, the same on every rank.
    moments
        Moment of each about the mean of the places where its nodes are held, zero of a guided one, of that shape.
    deflections
        Mean displacement of each loaded face, by its name, shape ``(3,)``.
    dofs, newton_iterations
        Numbers of degrees of freedom and of linear solves.
    seconds
        Wall time, of ``all`` of it.
    """

    state: Any
    reactions: Array
    moments: Array
    deflections: dict[str, Array]
    dofs: int
    newton_iterations: int
    seconds: dict[str, float]


def solve(
    domain: Domain,
    law: Material,
    held: Sequence[Held | Guided],
    loads: Mapping[str, tuple[float, float, float]] | None = None,
    degree: int = 2,
    steps: int = 1,
    options: Mapping[str, object] | None = None,
    flags: Sequence[str] = FAST,
) -> Equilibrium:
    """Return the equilibrium under prescribed displacements and dead loads, in equal load steps.

    Parameters
    ----------
    domain
        The mesh.
    law
        The material.
    held
        Supports, or guided components; a later one wins where faces meet.
    loads
        Total force by the name of the face over which it is spread uniformly.
    degree
        Degree of the displacement, at least 2.
    steps
        Number of load steps.
    options
        PETSc options; MUMPS where not given.
    flags
        C compiler flags for the forms.

    Raises
    ------
    SolveError
        If SNES or its linear solver fails.
    """
    start = perf_counter()
    mesh = domain.mesh
    state = dolfinx.fem.Function(compat.function_space(mesh, element(mesh, degree)))
    rule = 2 * degree if domain.shape == "hexahedron" else 2 * degree - 2
    faces = [_Face(domain, name, force, rule, flags) for name, force in (loads or {}).items()]
    factor = dolfinx.fem.Constant(mesh, PETSc.ScalarType(0.0))
    u, _ = ufl.split(state)
    energy = stored(state, law, factor) * ufl.dx(metadata=quadrature.measure(rule))
    energy -= sum(factor * ufl.inner(ufl.as_vector(one.traction.tolist()), u) * one.ds for one in faces)
    forms = variations(energy, state, flags)

    iterations = 0
    first = None
    with defaults(NEWTON | dict(DIRECT if options is None else options)):
        for k in range(1, steps + 1):
            factor.value = k / steps
            supports = [_support(state.function_space, domain, one, k / steps) for one in held]
            newton = Newton(state, *forms, supports, None, definite=False)
            newton.solve(first)
            reactions, moments = newton.reactions(), _moments(newton)
            iterations += newton.snes.getIterationNumber()
            first = newton.x.copy()
            newton.destroy()
    dofmap = state.function_space.dofmap
    return Equilibrium(
        state,
        reactions,
        moments,
        {one.name: one.mean(u) for one in faces},
        dofmap.index_map.size_global * dofmap.index_map_bs,
        iterations,
        {"all": perf_counter() - start},
    )


def _moments(newton: Newton) -> Array:
    """Return `Equilibrium.moments` after reactions."""
    force, comm = newton.force.array_r, newton.force.getComm().tompi4py()
    moments = np.zeros((len(newton.supports), 3))
    for row, support in zip(moments, newton.supports, strict=True):
        if isinstance(support, Support):
            total = comm.allreduce(np.append(support.places.sum(axis=0), len(support.places)), op=MPI.SUM)
            arms = support.places - total[:3] / total[3]
            row[:] = np.cross(arms, np.eye(3)[support.components] * force[support.dofs, None]).sum(axis=0)
    return np.asarray(comm.allreduce(moments, op=MPI.SUM))


def element(mesh: Any, degree: int) -> Any:
    """Return the element of displacements of a degree, and of pressures of one less."""
    parts = [compat.element(mesh, "Lagrange", degree, 3), compat.element(mesh, "Lagrange", degree - 1)]
    return compat.mixed_element(parts)


def stored(state: Any, law: Material, activation: Any = 1.0) -> Any:
    """Return the density, of displacement and pressure, whose integral is stationary at equilibrium."""
    if np.isfinite(law.lame) and law.logarithmic and not law.stored.quadratic:
        raise InputError(
            "law: its volumetric energy is no square of ln J; these elements take it as incompressible only"
        )
    u, pressure = ufl.split(state)
    F = ufl.Identity(3) + ufl.grad(u)
    theta = ufl.ln(ufl.det(F)) if law.logarithmic else ufl.tr(F) - 3.0
    p = law.shear.modulus * pressure
    return energy_of(law.shear, activation)(F) + p * theta - (0.5 / law.lame) * p**2


class _Face:
    """A loaded face: its measure ``ds``, its area, and the force over it."""

    def __init__(self, domain: Domain, name: str, force: Sequence[float], rule: int, flags: Sequence[str]) -> None:
        facets = np.sort(domain.facets(name)).astype(np.int32)
        tags = dolfinx.mesh.meshtags(domain.mesh, 2, facets, np.ones(facets.size, dtype=np.int32))
        data = {"subdomain_data": tags, "metadata": {"quadrature_degree": rule}}
        self.name, self.flags, self.mesh = name, flags, domain.mesh
        self.ds = ufl.Measure("ds", domain=domain.mesh, **data)(1)
        self.area = self._integral(dolfinx.fem.Constant(domain.mesh, PETSc.ScalarType(1.0)))
        self.traction = np.array(force) / self.area

    def _integral(self, integrand: Any) -> float:
        form = compat.form(integrand * self.ds, self.flags)
        return float(self.mesh.comm.allreduce(dolfinx.fem.assemble_scalar(form), op=MPI.SUM))

    def mean(self, u: Any) -> Array:
        """Return the mean of a vector field, shape ``(3,)``."""
        return np.array([self._integral(u[a]) for a in range(3)]) / self.area


class _Guide:
    """A guided component, as `comparisons.fem.statics.Newton` takes supports."""

    def __init__(self, space: Any, domain: Domain, guided: Guided, factor: float) -> None:
        part = space.sub(0).sub(guided.component)
        plain = part.collapse()[0]
        value = dolfinx.fem.Function(plain)
        value.interpolate(lambda x: factor * guided.displacement(x))
        dofs, in_plain = dolfinx.fem.locate_dofs_topological((part, plain), 2, domain.facets(guided.face))
        self.condition = dolfinx.fem.dirichletbc(value, [dofs, in_plain], part)
        own = dofs < space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self.dofs = dofs[own]
        self.components = np.full(self.dofs.size, guided.component)
        self.unit = value.x.array[in_plain[own]]


def _support(space: Any, domain: Domain, held: Held | Guided, factor: float) -> "Support | _Guide":
    if isinstance(held, Guided):
        return _Guide(space, domain, held, factor)
    displacement = held.displacement
    if callable(displacement):
        return Support(space, domain, Held(held.face, lambda x: factor * displacement(x)))
    return Support(space, domain, Held(held.face, tuple(factor * np.array(displacement))))
