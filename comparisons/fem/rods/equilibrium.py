"""Static equilibrium of rods: load steps, Newton's method by SNES, contacts by their nodal forces."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import ufl
from mpi4py import MPI
from petsc4py import PETSc

from comparisons.fem.continuation import lead
from comparisons.fem.known import with_pressures
from comparisons.fem.pressed import Pressed, Touching
from comparisons.fem.rods.contacts import Contacts
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.laws import Laws
from comparisons.fem.rods.loads import Following, centrifugal, dead
from comparisons.fem.rods.means import TIMES, Mean, Moment, means_of, moments_of
from comparisons.fem.rods.solution import Solution
from comparisons.fem.rods.supports import Supports
from comparisons.fem.rods.ties import carried
from comparisons.fem.statics import DIRECT, NEWTON
from comparisons.measure.timing import Clock, peak_memory
from isorod.checks.rigid_motions import refuse_free
from isorod.errors import SolveError
from isorod.fenics import compat
from isorod.files.solid import OfBody
from isorod.model.model import Model
from isorod.options import defaults
from meshes.mesh import Array, Mesh

# A load step is halved at most this many times.
HALVINGS = 10

# Forces that no longer fall are rounding if they are below this share of those that the supports and loads exert.
_ROUNDING = 1e-6
_STALLED = 0.3

# Where contacts come and go the forces that are left may grow at first; from the third iteration on this is too much.
_WILD = 5.0


class Loaded(Pressed):
    """Newton's method with dead loads and contacts, and an end that knows rounding.

    Attributes
    ----------
    factor
        Load factor.
    """

    def __init__(
        self,
        elements: Elements,
        forms: tuple[Any, Any],
        supports: Supports,
        loads: Array,
        contacts: Sequence[Touching],
        symmetric: bool,
    ) -> None:
        self.factor = 0.0
        self._elements, self._carried = elements, 0.0
        self.carry(loads)
        self._course: list[float] = []
        mixed = elements.split[1] is not None
        self._definite = symmetric and not contacts and not mixed
        super().__init__(elements, *forms, supports.conditions, contacts, self._definite)
        if not symmetric:
            self.matrix.setOption(PETSc.Mat.Option.SYMMETRY_ETERNAL, False)
            self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, False)
        self.snes.setConvergenceTest(self._converged)

    def carry(self, loads: Array) -> None:
        """Set the dead loads at full load, by node ``(nodes, 3)``."""
        self._loads = self._elements.to_dofs(loads)[: self._elements.own]
        self._size = float(np.linalg.norm(loads))

    def add_forces(self, out: PETSc.Vec) -> None:
        """Add contacts and dead loads."""
        out.array[:] -= self.factor * self._loads
        super().add_forces(out)
        # With what the supports take: of their size the rest must be small.
        self._carried = out.norm()

    def _converged(self, snes: PETSc.SNES, k: int, norms: tuple[float, float, float]) -> Any:
        norm, reason = norms[2], PETSc.SNES.ConvergedReason
        if not np.isfinite(norm):
            return reason.DIVERGED_FNORM_NAN
        self._course = [*self._course, norm] if k else [norm]
        relative, absolute, _, most = snes.getTolerances()
        scale = max(self._carried, self.factor * self._size, self._course[0])
        if k and (norm <= relative * scale or norm <= absolute):
            return reason.CONVERGED_FNORM_RELATIVE
        if k > 1 and _STALLED * self._course[-2] < norm <= _ROUNDING * scale:
            return reason.CONVERGED_SNORM_RELATIVE
        if self.contacts and k > 2 and norm > _WILD * self._course[0]:
            return reason.DIVERGED_DTOL
        return reason.DIVERGED_MAX_IT if k >= most else reason.ITERATING

    def solve(self, first: PETSc.Vec | None = None) -> None:
        """Solve; where the tangent turns out not to be definite, without counting on it from then on."""
        try:
            super().solve(first)
        except SolveError:
            failed = self.snes.getConvergedReason() == PETSc.SNES.ConvergedReason.DIVERGED_LINEAR_SOLVE
            if not (failed and self._definite):
                raise
            self._definite = False
            self.matrix.setOption(PETSc.Mat.Option.SPD, False)
            self.snes.getKSP().getPC().reset()
            self.norms.clear()
            super().solve(first)


def solve(
    model: Model,
    mesh: Mesh,
    rule: int,
    load_steps: int,
    options: Mapping[str, object] | None,
    flags: Sequence[str],
    bodies: Sequence[OfBody] = (),
    comm: MPI.Comm = MPI.COMM_SELF,
) -> Solution:
    """Return the equilibrium at full load, see `comparisons.fem.rods.solve`."""
    clock = Clock()
    elements = Elements(mesh, [body.space.rod for body in model.bodies], with_pressures(model), comm)
    laws = Laws(elements, model, rule)
    supports = Supports(elements, model, bodies)
    refuse_free(model)
    loads = dead(elements, model, bodies)
    contacts, means = Contacts(elements, model), means_of(elements, model, laws.unit)
    acting: list[Mean | Moment] = [*means.values(), *moments_of(elements, model)]
    clock.lap("setup")
    forms = _forms(elements, laws, model, rule, flags)
    clock.lap("forms")
    symmetric = not model.following
    direct = DIRECT if symmetric else DIRECT | {"pc_type": "lu"}
    with defaults(NEWTON | dict(direct if options is None else options)):
        newton = Loaded(elements, forms, supports, loads, [*contacts.all, *acting], symmetric)
        clock.lap("setup")

        def load(factor: float) -> None:
            newton.factor = laws.activation.value = factor
            for one in acting:
                one.factor = factor
            supports.move(factor)

        try:
            counts = lead(newton, load, 1.0, 1.0 / load_steps, "load factor", HALVINGS)
            counts["stiffened"] = contacts.stiffen(newton)
            for _ in range(TIMES if means else 0):
                for mean in means.values():
                    mean.tighten()
                newton.norms.clear()
                newton.solve(newton.x.copy())
            compat.assemble_vector(newton.force, newton.residual)
            newton.add_forces(newton.force)
            newton.force.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            nodal = elements.to_nodes(newton.force.array_r)
            displacement = elements.to_nodes(newton.state.array_r).copy()
            pressure = elements.nodal_pressure(laws.unit, flags)
            reactions, moments = supports.forces(nodal, displacement)
            for k, mean in means.items():
                reactions[k], moments[k] = mean.resultant
            touches = contacts.outcome(newton)
            typed = dict(PETSc.Options().getAll())
        finally:
            newton.destroy()
        clock.lap("solve")
    seconds = clock.seconds | {"assembly": newton.seconds, "solve": clock.seconds["solve"] - newton.seconds}
    if newton.contacts:
        seconds["contact"] = newton.contact_seconds
    solution = Solution(
        model=model,
        mesh=mesh,
        analysis="statics",
        cell_parameters=elements.parameters,
        place=laws.place,
        seconds=seconds,
        dofs=elements.dofs,
        unknowns=supports.free,
        options=typed,
        peak_memory=comm.allreduce(peak_memory(), op=MPI.MAX),
        iterations=counts,
        displacement=displacement,
        pressure=pressure,
        reactions=reactions,
        moments=moments,
        contacts=touches,
        residual_norms=list(newton.norms),
        bodies=bodies,
    )
    return replace(solution, ties=carried(solution, elements, rule, bodies)) if model.ties else solution


def _forms(elements: Elements, laws: Laws, model: Model, rule: int, flags: Sequence[str]) -> tuple[Any, Any]:
    """Return internal forces, with those of loads that change with the displacement, and their derivative."""
    state, (u, pressure) = elements.state, elements.split
    stored = laws.energy()
    if model.spin is not None:
        stored += laws.activation * centrifugal(laws, model.spin, u)
    space = state.function_space
    test = ufl.TestFunction(space)
    residual = ufl.derivative(stored, state, test)
    pressed = Following(elements, model, rule, u, test if pressure is None else ufl.split(test)[0]).work
    if pressed is not None:
        residual += laws.activation * pressed
    tangent = ufl.derivative(residual, state, ufl.TrialFunction(space))
    return compat.form(residual, flags), compat.form(tangent, flags)
