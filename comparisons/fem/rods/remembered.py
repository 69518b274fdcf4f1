"""Laws with memory in dolfinx: isorod's compiled laws at the points of a rule, whose stress and moduli are fields.

The laws and their states are isorod's; elements, forms, Newton's method and load steps are not.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import basix
import dolfinx.fem
import numpy as np
import ufl
from petsc4py import PETSc

from comparisons.fem.continuation import lead
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.equilibrium import HALVINGS, Loaded
from comparisons.fem.rods.laws import places_of
from comparisons.fem.rods.loads import nodal
from comparisons.fem.rods.places import on_rod
from comparisons.fem.rods.solution import Solution
from comparisons.fem.rods.supports import Supports
from comparisons.fem.rods.task import Task, typed
from comparisons.fem.statics import DIRECT
from comparisons.measure.timing import Clock
from isorod.checks.rigid_motions import refuse_free
from isorod.fenics import compat
from isorod.material.law import Material
from isorod.model.model import Model
from isorod.model.past import Past
from isorod.model.times import until
from isorod.options import defaults
from isorod.statics.path import Step
from meshes.mesh import Array, Index
from meshes.within import lagrange

# Steps are doubled until the forces change by less than this fraction, as isorod's by default.
CHANGE, MANY = 2.5e-3, [2**k for k in range(9)]


class Remembered:
    """The laws of a model's bodies at the quadrature points of all cells.

    Parameters
    ----------
    elements
        Mesh and space.
    model
        Bodies with their laws.
    rule
        Degree of the quadrature.
    flags
        C compiler flags of the forms.

    Attributes
    ----------
    place
        Row of each cell's law among those of all bodies, one behind the other, shape ``(cells,)``.
    forms
        Internal forces and their derivative, compiled.
    """

    def __init__(self, elements: Elements, model: Model, rule: int, flags: Sequence[str]) -> None:
        self._elements, source = elements, elements.source
        self.place, laws, _ = places_of(elements, model)
        points, _ = basix.make_quadrature(getattr(basix.CellType, source.shape), rule)
        state, mesh = elements.state, elements.mesh
        self._gradient = compat.expression(ufl.Identity(3) + ufl.grad(state), np.asarray(points), flags)
        at = np.einsum("qn,cnp->cqp", lagrange(source.order, source.reference, np.asarray(points)), elements.parameters)
        self._own: list[tuple[Index, Material]] = []
        here = self.place[elements.rows]
        for k in np.unique(here):
            cells = np.flatnonzero(here == k)
            rows = elements.rows[cells]
            placed = laws[k].placed(on_rod(elements.rods[elements.rod_of[rows[0]]], at[rows]))
            self._own.append((cells, placed))
        spaces = [compat.function_space(mesh, compat.quadrature_element(mesh, rule, size)) for size in (9, 81)]
        self._stress, self._moduli = (dolfinx.fem.Function(space) for space in spaces)
        self._dofs = [compat.cell_dofs(space, len(elements.rows)) for space in spaces]
        test, trial = ufl.TestFunction(state.function_space), ufl.TrialFunction(state.function_space)
        dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": rule, "quadrature_scheme": "default"})
        stress = ufl.as_matrix(np.array([self._stress[k] for k in range(9)]).reshape(3, 3).tolist())
        slope = ufl.grad(trial)
        change = [sum(self._moduli[9 * k + m] * slope[m // 3, m % 3] for m in range(9)) for k in range(9)]
        turned = ufl.as_matrix(np.array(change).reshape(3, 3).tolist())
        work, stiffness = (ufl.inner(one, ufl.grad(test)) * dx for one in (stress, turned))
        self.forms = compat.form(work, flags), compat.form(stiffness, flags)

    def _gradients(self) -> Array:
        """Return the deformation gradients of the state, ``(cells, points, 3, 3)``."""
        count = len(self._elements.rows)
        values = self._gradient(self._elements.mesh, np.arange(count, dtype=np.int32))
        return values.reshape(count, -1, 3, 3)

    def see(self, factor: float, moduli: bool) -> None:
        """Set the stress of the state at a load factor, or the ``moduli``."""
        F = self._gradients()
        field, size = (self._moduli, 81) if moduli else (self._stress, 9)
        for cells, law in self._own:
            reached = law.reached(factor)
            values = reached.tangent(F[cells]) if moduli else reached.stress(F[cells])
            where = self._dofs[moduli][cells]
            field.x.array.reshape(-1, size)[where] = values.reshape(*where.shape, size)

    def go_on(self, factor: float) -> None:
        """Advance the laws to the state, an equilibrium at a load factor."""
        F = self._gradients()
        self._own = [(cells, law.advanced(F[cells], factor)) for cells, law in self._own]


class _Flowing(Loaded):
    """Newton's method with `Remembered` laws; loads are those of `carry`, at the load factor ``time``."""

    def __init__(self, elements: Elements, laws: Remembered, supports: Supports) -> None:
        super().__init__(elements, laws.forms, supports, np.zeros_like(elements.source.points), [], True)
        self._laws, self.time = laws, 0.0
        self.factor = 1.0

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self._copy(x)
        self._laws.see(self.time, False)
        if snes.getIterationNumber() == 0:
            # The supports' displacements are lifted by the tangent.
            self._laws.see(self.time, True)
        super()._residual(snes, x, out)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        self._copy(x)
        self._laws.see(self.time, True)
        super()._tangent(snes, x, J, P)


def solve(task: Task, load_steps: int | None, end_time: float | None) -> Solution:
    """Return the equilibrium at full load, or at the end of a time, see `comparisons.fem.rods.solve`.

    Where no number of steps from one kink of tables to the next is given, they double as isorod's do, until forces and
    moments of supports change by less than `CHANGE` of the largest along the path.
    """
    task = task if end_time is None else replace(task, model=until(task.model, end_time))
    if load_steps is not None:
        return _in_steps(task, load_steps)
    before, seconds = None, dict[str, float]()
    for steps in MANY:
        solution = _in_steps(task, steps)
        seconds = {name: seconds.get(name, 0.0) + value for name, value in solution.seconds.items()}
        if before is not None and _apart(before, solution) < CHANGE:
            break
        before = solution
    return replace(solution, seconds=seconds)


def _apart(before: Solution, after: Solution) -> float:
    """Return how far forces or moments of supports are apart at load factors that both have, over the largest."""
    old, new = ({one.factor: one for one in solution.path} for solution in (before, after))
    changes = []
    for name in ("reactions", "moments"):
        most = max(np.abs(getattr(one, name)).max() for one in after.path)
        apart = max(np.abs(getattr(new[k], name) - getattr(old[k], name)).max() for k in new.keys() & old.keys())
        changes.append(apart / most if most else 0.0)
    return float(max(changes))


def _in_steps(task: Task, load_steps: int) -> Solution:
    """Return the equilibrium after ``load_steps`` steps from each kink of a table to the next."""
    clock, model, elements = Clock(), task.model, task.elements()
    supports = Supports(elements, model)
    refuse_free(model)
    clock.lap("setup")
    laws = Remembered(elements, model, task.rule, task.flags)
    clock.lap("forms")
    dead = [nodal(elements, model, load) for load in model.loads]
    past, path = list[Past](), list[Step]()
    with defaults(task.newton(DIRECT)):
        newton = _Flowing(elements, laws, supports)
        clock.lap("setup")

        def load(factor: float) -> None:
            newton.time = factor
            fractions = [model.amplitude(one.history, factor) for one in model.loads]
            newton.carry(sum((a * b for a, b in zip(fractions, dead, strict=True)), np.zeros_like(task.mesh.points)))
            supports.move(factor)

        def reached(factor: float) -> None:
            """Record an equilibrium, and advance the laws to it."""
            displacement, (reactions, moments) = newton.carried(supports)
            past.append(Past(factor, displacement))
            path.append(Step(factor, reactions, moments=moments))
            if factor < 1.0:
                laws.go_on(factor)

        try:
            counts: dict[str, int] = {}
            for begin, end in pairwise([0.0, *model.stages]):
                each = lead(newton, load, end, (end - begin) / load_steps, "load factor", HALVINGS, begin, reached)
                counts = {name: counts.get(name, 0) + count for name, count in each.items()}
            options = typed()
        finally:
            newton.destroy()
        clock.lap("solve")
    return task.solved(
        "statics",
        elements,
        supports,
        newton,
        clock,
        place=laws.place,
        options=options,
        iterations=counts,
        displacement=past[-1].displacement,
        reactions=path[-1].reactions,
        moments=path[-1].moments,
        residual_norms=list(newton.norms),
        past=past[:-1],
        path=path,
    )
