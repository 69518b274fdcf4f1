"""External actions on explicit steps: loads, springs to ground, and moving supports, over time.

Where supports move held degrees of freedom at ``v_h``, momenta are those of the free ones alone, ``p = M_ff v_f``:

    (p+ - p-) / dt + c (p+ + p-) / 2 = F - f - M_fh ((v_h+ - v_h-) / dt + c (v_h+ + v_h-) / 2),

and ``v_h`` half a step ahead is the displacement increment to the next step over its length: positions of supports are
exact.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.assembly import averages, exerted
from isorod.assembly.constraints import Constraints
from isorod.assembly.follower import FollowerLoads
from isorod.dynamics.explicit.step_kernel import DISSIPATED, FOLLOWED, PUSHED, Course
from isorod.errors import InputError


class Drive:
    """Loads, springs, held mean motions, and moving supports, in explicit steps.

    Attributes
    ----------
    time, step
        Time of the forces, and time step: forces are means over half a step before and after, so that steps have the
        exact impulse of loads, for any history.
    since
        Time at which velocities were last staggered; means do not begin earlier.

    Raises
    ------
    InputError
        If explicit steps do not support a load or a support, at all or on several ranks.
    """

    def __init__(self, system: Any) -> None:
        self._system, model = system, system.model
        self.time = self.since = 0.0
        self.step = 1.0
        self._moves = model.moves
        for k, mean in model.means.items():
            if mean.clock.moves:
                raise InputError(f"support {k}: explicit steps move no mean motions; use integrator 'implicit'")
        if system.ranks.size > 1 and (model.following or model.means or self._moves):
            raise InputError(
                "loads: explicit steps on several ranks do not support moments, follower pressures, mean supports, "
                "springs and moving supports; use one rank, or integrator 'implicit'"
            )
        self._springs = [averages.mean_of(model, mean) for mean in model.means.values() if mean.stiffness is not None]
        self._held = [k for k, mean in model.means.items() if mean.stiffness is None]
        self._constraints = Constraints(model) if model.means else None
        self._control_points = model.is_control_point.repeat(3)
        self._following = [
            (elements.which, FollowerLoads(elements, [load for load in model.following if load.body == elements.which]))
            for elements in (system.ranks.element_ranges if model.following else ())
        ]
        self._before = self._impulse = self._loads = self._outside = np.empty(0)

    def _loaded(self, displacement: Array) -> Array:
        """Return the forces of loads at a displacement, both in the model's order."""
        span = max(self.time - 0.5 * self.step, self.since), self.time + 0.5 * self.step
        model = self._system.model
        loads = model.loaded(*span).copy()
        for b, pressing in self._following:
            pressing.at(*span)
            space, first = model.bodies[b].space, model.first_node[b]
            nodes = space.element_nodes.reshape(space.axis.elements, -1, space.layer_nodes)
            pushed = pressing.forces(model.nodal(displacement, b)[nodes])
            np.add.at(loads.reshape(-1, 3), first + nodes, pushed)
        return loads

    def forces(self, displacement: Array) -> Array:
        """Return the forces of loads and springs at a displacement, both state vectors."""
        return self._split(displacement)[1]

    def _split(self, displacement: Array) -> tuple[Array, Array]:
        """Return the forces of loads alone, and with springs."""
        system = self._system
        moved, loads, both = displacement[system.order], np.zeros_like(displacement), np.zeros_like(displacement)
        total = self._loaded(moved)
        loads[system.order] = total
        for spring in self._springs:
            assert spring.stiffness is not None
            total = total + spring.pushed(-spring.stiffness * spring.moved(moved), moved.size // 3).ravel()
        both[system.order] = total
        return loads, both

    def loads(self, displacement: Array) -> Array:
        """Return the forces of loads alone, as `forces` does."""
        return self._split(displacement)[0]

    def stored(self, displacement: Array) -> float:
        """Return the energy of springs."""
        moved = displacement[self._system.order]
        springs = ((spring.stiffness, spring.moved(moved)) for spring in self._springs)
        return sum(0.5 * float(stiffness @ travel**2) for stiffness, travel in springs if stiffness is not None)

    def next(self, time: float, step: float) -> Array:
        """Return the velocities of held degrees of freedom until the next step."""
        model = self._system.model
        return (model.placed(time + step) - model.placed(time))[model.held] / step

    def inertia(self, before: Array, after: Array, course: Course) -> Array:
        """Return the inertial forces of held on free degrees of freedom, given their velocities."""
        held, system = self._system.state.held, self._system
        grown = np.zeros(system.model.dofs)
        grown[held] = (after - before) / course.step + 0.5 * course.damping * (after + before)
        forces = system.momenta(grown) if self._moves else grown
        forces[held] = 0.0
        return forces

    def begin(self, time: float, course: Course) -> None:
        """Set the actions in the step that begins at a time."""
        system, state = self._system, self._system.state
        self.time, self.step = time, course.step
        self._loads, self._outside = self._split(state.displacement)
        self._before, self._impulse = state.velocity.copy(), state.impulse.copy()
        state.loads[:] = self._outside
        if self._moves:
            after = self.next(time, course.step)
            state.loads[:] -= self.inertia(state.velocity[state.held], after, course)
            state.velocity[state.held] = after
        # Ranks' contributions are summed: each has the forces on its own degrees of freedom.
        mine = np.zeros(state.loads.size)
        mine[system.ranks.mine] = state.loads[system.ranks.mine]
        state.loads[:] = mine

    def end(self, course: Course) -> None:
        """Add impulses and work of the step to the sums."""
        system, state, dt = self._system, self._system.state, course.step
        mine, mean = system.ranks.mine, 0.5 * (self._before + state.velocity)
        state.sums[FOLLOWED] += dt * float(self._loads[mine] @ mean[mine])
        pushed = np.zeros_like(mean)
        pushed[mine] = self._outside[mine]
        state.sums[PUSHED:FOLLOWED] += dt * (self._control_points * pushed[system.order]).reshape(-1, 3).sum(axis=0)
        if not (self._moves or self._held):
            return
        resisted = system.momenta((state.velocity - self._before) / dt + course.damping * mean)
        if self._moves:
            carried = (state.impulse - self._impulse) / dt + resisted[state.held]
            state.sums[FOLLOWED] += dt * float(carried @ mean[state.held])
            if course.damping > 0.0:
                held = np.zeros_like(mean)
                held[state.held] = mean[state.held]
                held_momenta = system.momenta(held)
                # The kernel counts that of free degrees of freedom alone.
                lost = 2.0 * float(mean @ held_momenta) - float(held @ held_momenta)
                state.sums[DISSIPATED] += dt * course.damping * lost
        if self._held:
            inside = state.forces + resisted
            if self._moves:
                inside -= self.inertia(self._before[state.held], state.velocity[state.held], course)
            exerted_by_means = self.averages(inside, state.displacement)
            held_alone = {k: exerted_by_means[k] for k in self._held}
            state.sums[PUSHED:FOLLOWED] += dt * averages.forces_of(system.model, held_alone).sum(axis=0)

    def averages(self, forces: Array, displacement: Array) -> dict[int, Array]:
        """Return the forces of mean supports, from internal and inertial less external forces, as state vectors."""
        if self._constraints is None:
            return {}
        order = self._system.order
        return exerted.carried(self._constraints, forces[order], displacement[order])
