"""Static equilibrium of rods: load steps, Newton's method by SNES, contacts by their nodal forces."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import ufl
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
from comparisons.fem.rods.task import Task, typed
from comparisons.fem.rods.ties import carried
from comparisons.fem.statics import DIRECT
from comparisons.measure.timing import Clock
from isorod.checks.rigid_motions import refuse_free
from isorod.errors import SolveError
from isorod.fenics import compat
from isorod.options import defaults
from meshes.mesh import Array

# A load step is halved at most this many times.
HALVINGS = 10

# Residuals that no longer fall are rounding if they are below this fraction of the forces of supports and loads.
_ROUNDING = 1e-6
_STALLED = 0.3

# Where contacts open and close the residual may grow at first; from the third iteration on this factor is too much.
_WILD = 5.0


class Loaded(Pressed):
    """Newton's method with dead loads and contacts, and a convergence test that recognises rounding.

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
        # With the reactions: the residual must be small beside them.
        self._carried = out.norm()

    def carried(self, supports: Supports) -> tuple[Array, tuple[Array, Array]]:
        """Return the displacement of the mesh's nodes, ``(nodes, 3)``, and force and moment of each support."""
        compat.assemble_vector(self.force, self.residual)
        self.add_forces(self.force)
        self.force.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        displacement = self._elements.to_nodes(self.state.array_r).copy()
        return displacement, supports.forces(self._elements.to_nodes(self.force.array_r), displacement)

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


def solve(task: Task, load_steps: int) -> Solution:
    """Return the equilibrium at full load, see `comparisons.fem.rods.solve`."""
    clock, model = Clock(), task.model
    elements = task.elements(with_pressures(model))
    laws = Laws(elements, model, task.rule)
    supports = Supports(elements, model, task.bodies)
    refuse_free(model)
    loads = dead(elements, model, task.bodies)
    contacts, means = Contacts(elements, model), means_of(elements, model, laws.unit)
    acting: list[Mean | Moment] = [*means.values(), *moments_of(elements, model)]
    clock.lap("setup")
    forms = _forms(elements, laws, task)
    clock.lap("forms")
    symmetric = not model.following
    with defaults(task.newton(DIRECT if symmetric else DIRECT | {"pc_type": "lu"})):
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
            displacement, (reactions, moments) = newton.carried(supports)
            for k, mean in means.items():
                reactions[k], moments[k] = mean.resultant
            more = {
                "pressure": elements.nodal_pressure(laws.unit, task.flags),
                "contacts": contacts.outcome(newton),
                "options": typed(),
            }
        finally:
            newton.destroy()
        clock.lap("solve")
    solution = task.solved(
        "statics",
        elements,
        supports,
        newton,
        clock,
        place=laws.place,
        iterations=counts,
        displacement=displacement,
        reactions=reactions,
        moments=moments,
        residual_norms=list(newton.norms),
        **more,
    )
    if newton.contacts:
        solution.seconds["contact"] = newton.contact_seconds
    return replace(solution, ties=carried(solution, elements, task.rule, task.bodies)) if model.ties else solution


def _forms(elements: Elements, laws: Laws, task: Task) -> tuple[Any, Any]:
    """Return the forms of internal forces and of loads that depend on the displacement, and of their derivative."""
    model, state, (u, pressure) = task.model, elements.state, elements.split
    stored = laws.energy()
    if model.spin is not None:
        stored += laws.activation * centrifugal(laws, model.spin, u)
    space = state.function_space
    test = ufl.TestFunction(space)
    residual = ufl.derivative(stored, state, test)
    pressed = Following(elements, model, task.rule, u, test if pressure is None else ufl.split(test)[0]).work
    if pressed is not None:
        residual += laws.activation * pressed
    tangent = ufl.derivative(residual, state, ufl.TrialFunction(space))
    return compat.form(residual, task.flags), compat.form(tangent, task.flags)
