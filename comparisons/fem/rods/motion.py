"""The motion of rods in isorod's own implicit steps, so that only the discretisation in space differs.

Steps are those of `isorod.dynamics.implicit.assembler`: energy-momentum conserving, with the stress between two states
of `isorod.fenics.forms.between`, and loads in the middle of the step.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import dolfinx.fem
import numpy as np
import ufl
from petsc4py import PETSc

from comparisons.fem.known import Steps
from comparisons.fem.rods.elements import Elements
from comparisons.fem.rods.equilibrium import Loaded
from comparisons.fem.rods.laws import Laws
from comparisons.fem.rods.loads import Following, nodal
from comparisons.fem.rods.solution import Solution
from comparisons.fem.rods.supports import Supports
from comparisons.fem.rods.task import Task, typed
from comparisons.fem.statics import DIRECT
from comparisons.measure.timing import Clock
from isorod.assembly.mass import refuse_massless
from isorod.errors import SolveError
from isorod.fenics import compat
from isorod.model.history import rigid_velocity
from isorod.model.model import Model
from isorod.options import defaults
from meshes.mesh import Array, Index

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion at its outputs, each a `Solution` at a time.

    Attributes
    ----------
    states
        Solutions, the first one at time 0.
    times
        Shape ``(o,)``.
    reactions
        Force of each support on the model, shape ``(o, supports, 3)``.
    """

    states: Sequence[Solution]
    times: Array
    reactions: Array

    def __getitem__(self, k: int) -> Solution:
        return self.states[k]

    def __iter__(self) -> Iterator[Solution]:
        return iter(self.states)

    @property
    def displacement(self) -> Array:
        """Of the mesh's nodes, shape ``(o, nodes, 3)``."""
        return np.array([one.displacement for one in self.states])

    @property
    def seconds(self) -> dict[str, float]:
        """Wall time by part."""
        return self.states[-1].seconds

    @property
    def peak_memory(self) -> int:
        """Largest resident set so far, bytes."""
        return self.states[-1].peak_memory


class _Step(Loaded):
    """Newton's method for the state at the end of a step."""

    forms: "_Forms"

    def _residual(self, snes: PETSc.SNES, x: PETSc.Vec, out: PETSc.Vec) -> None:
        self.forms.go(0)
        super()._residual(snes, x, out)

    def _tangent(self, snes: PETSc.SNES, x: PETSc.Vec, J: PETSc.Mat, P: PETSc.Mat) -> None:
        self.forms.go(0)
        super()._tangent(snes, x, J, P)

    def add_forces(self, out: PETSc.Vec) -> None:
        """Add those of the other points between both states, and dead loads."""
        more = out.duplicate()
        for place in range(1, len(_POINTS)):
            self.forms.go(place)
            compat.assemble_vector(more, self.residual)
            more.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
            out.axpy(1.0, more)
        more.destroy()
        super().add_forces(out)

    def add_stiffness(self, matrix: PETSc.Mat) -> None:
        """Add their derivatives."""
        for place in range(1, len(_POINTS)):
            self.forms.go(place)
            compat.add_matrix(matrix, self.tangent, self.conditions)
            # What conditions insert and forms add must not meet.
            matrix.assemble()


def solve(task: Task, steps: Steps) -> Motion:
    """Return the motion from rest, see `comparisons.fem.rods.solve`."""
    model = task.model
    refuse_massless(model.bodies, "dynamics needs")
    clock, elements = Clock(), task.elements()
    laws, supports = Laws(elements, model, task.rule), Supports(elements, model)
    clock.lap("setup")
    forms = _Forms(elements, laws, task, steps)
    clock.lap("forms")
    supports.move(1.0)
    counts = {"steps": 0, "newton_iterations": 0}
    outputs: list[tuple[Array, Array]] = []
    with defaults(task.newton(DIRECT | {"pc_type": "lu"})):
        dead = [(load, nodal(elements, model, load)) for load in model.loads]
        nothing = np.zeros_like(task.mesh.points)

        def loads(begin: float, end: float) -> Array:
            """Return the means over a time of the forces that do not depend on the state."""
            return np.asarray(sum((load.factor(begin, end) * forces for load, forces in dead), nothing))

        newton = _Step(elements, (forms.residual, forms.tangent), supports, nothing, [], symmetric=False)
        newton.factor, newton.forms = 1.0, forms
        state, zero = newton.x, newton.x.duplicate()
        zero.set(0.0)
        dolfinx.fem.petsc.set_bc(state, newton.conditions, zero, 1.0)
        guess, start = state.duplicate(), state.duplicate()
        own, held = elements.own, supports.held[supports.held < elements.own]

        def record(time: float) -> None:
            forms.pressed_now.at(time, time)
            now = elements.to_dofs(loads(time, time))[:own]
            carried = elements.to_nodes(forms.carried(state, held, now, newton)).copy()
            displacement = elements.to_nodes(state.array_r).copy()
            outputs.append((displacement, supports.forces(carried, displacement)[0]))

        forms.start(elements.to_dofs(_begun(elements, model)), supports.held)
        try:
            record(0.0)
            for k in range(steps.outputs * steps.count):
                ends = k * steps.step, (k + 1) * steps.step
                forms.begin(state, steps.level(0.5 * sum(ends)))
                forms.pressed.at(*ends)
                newton.carry(loads(*ends))
                state.copy(start)
                guess.array[:] = state.array_r + steps.step * forms.velocity.x.array[:own]
                guess.array[held] = state.array_r[held]
                newton.norms.clear()
                try:
                    try:
                        newton.solve(guess)
                    except SolveError:
                        # Fast oscillations are nearer to the last state than to the extrapolated one.
                        newton.norms.clear()
                        newton.solve(start)
                except SolveError as problem:
                    raise SolveError(f"time {ends[1]:.4g}: {problem}; take a smaller time step") from None
                forms.end(newton.x)
                counts["newton_iterations"] += newton.snes.getIterationNumber()
                counts["steps"] += 1
                if (k + 1) % steps.count == 0:
                    record(ends[1])
            options = typed()
        finally:
            newton.destroy()
            forms.destroy()
        clock.lap("solve")
    last = task.solved(
        "dynamics", elements, supports, newton, clock, place=laws.place, options=options, iterations=counts
    )
    states = [replace(last, displacement=one, reactions=carried) for one, carried in outputs]
    times = np.arange(steps.outputs + 1) * steps.end_time / steps.outputs
    return Motion(states, times, np.array([carried for _, carried in outputs]))


def _begun(elements: Elements, model: Model) -> Array:
    """Return the initial velocity of the mesh's nodes (`isorod.model.body.Body`), ``(nodes, 3)``."""
    result = np.zeros_like(elements.source.points)
    for b, body in enumerate(model.bodies):
        if any(body.velocity) or any(body.spin):
            nodes = np.unique(elements.source.cells[elements.cells(b)])
            positions = elements.source.points[nodes]
            result[nodes] = rigid_velocity(
                positions, np.ones(len(nodes), dtype=bool), body.velocity, body.spin, body.turned_about
            )
    return result


class _Forms:
    """The balance of a step, and of a moment.

    Attributes
    ----------
    residual, tangent
        Compiled forms of the step's balance and its derivative, of the state at its end.
    pressed, pressed_now
        Pressures in the step, and at a moment.
    velocity
        At the start of a step, a dolfinx function.
    """

    def __init__(self, elements: Elements, laws: Laws, task: Task, steps: Steps) -> None:
        space, u, flags = elements.space, elements.state, task.flags
        self.elements, self.laws, self.steps = elements, laws, steps
        self.before, self.velocity, self.moment = (dolfinx.fem.Function(space) for _ in range(3))
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        dt, c = (dolfinx.fem.Constant(elements.mesh, value) for value in (steps.step, steps.damping))
        # On the regions of the laws: dolfinx 0.9 takes only one set of regions in a form.
        dx = laws.dx(metadata={"quadrature_degree": 2 * elements.source.order})
        change = u - self.before
        push = laws.density * ufl.inner((2.0 / dt**2 + c / dt) * change - (2.0 / dt) * self.velocity, test) * dx
        # One form for all points between both states, at the first one with inertia and loads: it is compiled faster.
        self._place, self._weight, self._once = (dolfinx.fem.Constant(elements.mesh, 1.0) for _ in range(3))
        residual = self._once * push + self._weight * laws.between(self.before, self._place, test)
        now = ufl.derivative(laws.energy(), u, test) + c * laws.density * ufl.inner(self.velocity, test) * dx
        self.pressed = Following(elements, task.model, task.rule, 0.5 * (u + self.before), test)
        self.pressed_now = Following(elements, task.model, task.rule, u, test)
        if self.pressed.work is not None:
            residual, now = residual + self._once * self.pressed.work, now + self.pressed_now.work
        self.residual = compat.form(residual, flags)
        self.tangent = compat.form(ufl.derivative(residual, u, trial), flags)
        self._now = compat.form(now, flags)
        mass = compat.form(laws.density * ufl.inner(trial, test) * dx, flags)
        self.mass = compat.create_matrix(mass, None)
        compat.assemble_matrix(self.mass, mass, [])
        self._ksp: PETSc.KSP | None = None

    def start(self, velocity: Array, held: Index) -> None:
        """Set the velocity at the start, zero where held."""
        velocity[held] = 0.0
        self.velocity.x.array[:] = velocity

    def go(self, place: int) -> None:
        """Set the point between both states at which the stress is taken."""
        self._place.value, self._weight.value = 0.5 * (1.0 + _POINTS[place]), 0.5 * _WEIGHTS[place]
        self._once.value = float(place == 0)

    def begin(self, state: PETSc.Vec, level: float) -> None:
        """Set the state that a step starts from, and the activation in its middle."""
        compat.fill(self.before, state.array_r)
        self.laws.activation.value = level

    def end(self, state: PETSc.Vec) -> None:
        """Set the velocity at the end of a step."""
        before, velocity = (one.x.array[: self.elements.own] for one in (self.before, self.velocity))
        compat.fill(self.velocity, 2.0 / self.steps.step * (state.array_r - before) - velocity)

    def carried(self, state: PETSc.Vec, held: Index, loads: Array, newton: _Step) -> Array:
        """Return the reactions on all degrees of freedom at this moment, inertia included."""
        compat.fill(self.elements.state, state.array_r)
        balance = newton.force
        compat.assemble_vector(balance, self._now)
        balance.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        balance.array[:] -= loads
        if self._ksp is None:
            # What is held does not accelerate.
            own = self.mass.copy()
            first = own.getOwnershipRange()[0]
            own.zeroRowsColumns((first + held).astype(PETSc.IntType), 1.0)
            self._ksp = PETSc.KSP().create(own.getComm())
            self._ksp.setOptionsPrefix("mass_")
            self._ksp.setOperators(own)
            self._ksp.setType("cg")
            self._ksp.getPC().setType("jacobi")
            self._ksp.setTolerances(rtol=1e-10)
        right, acceleration = balance.copy(), balance.duplicate()
        right.scale(-1.0)
        right.array[held] = 0.0
        self._ksp.solve(right, acceleration)
        self.mass.multAdd(acceleration, balance, right)
        return np.array(right.array_r)

    def destroy(self) -> None:
        """Give back the matrices."""
        if self._ksp is not None:
            self._ksp.destroy()
        self.mass.destroy()
