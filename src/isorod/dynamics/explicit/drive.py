"""What acts on explicit steps from outside: loads, springs to ground, and supports that move, by time.

Where supports move what they hold at ``v_h``, the momenta of steps are those of what is free alone, ``p = M_ff v_f``:

    (p+ - p-) / dt + c (p+ + p-) / 2 = F - f - M_fh ((v_h+ - v_h-) / dt + c (v_h+ + v_h-) / 2),

and ``v_h`` half a step ahead is the way from this step to the next over its length: places of supports are exact.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.assembly import averages, exerted
from isorod.assembly.constraints import Constraints
from isorod.assembly.pressing import FollowerLoads
from isorod.dynamics.explicit.step_kernel import DISSIPATED, FOLLOWED, PUSHED, Course
from isorod.errors import InputError


class Drive:
    """Loads, springs, mean motions that are held, and supports that move, in explicit steps.

    Attributes
    ----------
    time, step
        At which forces are asked for, and the time step: they are their means half a step about it, so that between
        velocities loads have their whole impulse, whatever their history.
    since
        When velocities were last staggered: from there on they have it.

    Raises
    ------
    InputError
        If there is what explicit steps do not know, or what several ranks do not.
    """

    def __init__(self, system: Any) -> None:
        self._system, model = system, system.model
        self.time = self.since = 0.0
        self.step = 1.0
        self._moves = model.moves
        for k, one in model.means.items():
            if one.clock.moves:
                raise InputError(f"support {k}: explicit steps move no mean motions; use integrator 'implicit'")
        if system.ranks.size > 1 and (model.following or model.means or self._moves):
            raise InputError(
                "loads: on several ranks explicit steps know no moments, pressures that follow, mean supports, springs "
                "and supports that move; use one rank, or integrator 'implicit'"
            )
        self._springs = [averages.mean_of(model, one) for one in model.means.values() if one.stiffness is not None]
        self._held = [k for k, one in model.means.items() if one.stiffness is None]
        self._constraints = Constraints(model) if model.means else None
        self._carriers = model.is_control_point.repeat(3)
        self._following = [
            (share.which, FollowerLoads(share, [one for one in model.following if one.body == share.which]))
            for share in (system.ranks.shares if model.following else ())
        ]
        self._before = self._impulse = self._loads = self._outside = np.empty(0)

    def _loaded(self, displacement: Array) -> Array:
        """Return the forces of loads, of a displacement in the model's order, as it is."""
        span = max(self.time - 0.5 * self.step, self.since), self.time + 0.5 * self.step
        model = self._system.model
        found = model.loaded(*span).copy()
        for b, pressing in self._following:
            pressing.at(*span)
            space, first = model.bodies[b].space, model.first_node[b]
            nodes = space.element_nodes.reshape(space.axis.elements, -1, space.layer_nodes)
            pushed = pressing.forces(model.nodal(displacement, b)[nodes])
            np.add.at(found.reshape(-1, 3), first + nodes, pushed)
        return found

    def forces(self, displacement: Array) -> Array:
        """Return the forces of loads and springs at a displacement, both state vectors."""
        return self._split(displacement)[1]

    def _split(self, displacement: Array) -> tuple[Array, Array]:
        """Return the forces of loads alone, and with springs."""
        system = self._system
        moved, loads, both = displacement[system.order], np.zeros_like(displacement), np.zeros_like(displacement)
        found = self._loaded(moved)
        loads[system.order] = found
        for one in self._springs:
            assert one.stiffness is not None
            found = found + one.pushed(-one.stiffness * one.moved(moved), moved.size // 3).ravel()
        both[system.order] = found
        return loads, both

    def loads(self, displacement: Array) -> Array:
        """Return the forces of loads alone, as `forces` does."""
        return self._split(displacement)[0]

    def stored(self, displacement: Array) -> float:
        """Return the energy of springs."""
        moved = displacement[self._system.order]
        springs = ((one.stiffness, one.moved(moved)) for one in self._springs)
        return sum(0.5 * float(stiffness @ way**2) for stiffness, way in springs if stiffness is not None)

    def next(self, time: float, step: float) -> Array:
        """Return how fast supports move what they hold until the next step."""
        model = self._system.model
        return (model.placed(time + step) - model.placed(time))[model.held] / step

    def inertia(self, before: Array, after: Array, course: Course) -> Array:
        """Return the forces that the mass of what is held has on what is free, given its velocities."""
        held, system = self._system.state.held, self._system
        grown = np.zeros(system.model.dofs)
        grown[held] = (after - before) / course.step + 0.5 * course.damping * (after + before)
        forces = system.momenta(grown) if self._moves else grown
        forces[held] = 0.0
        return forces

    def begin(self, time: float, course: Course) -> None:
        """Set what acts in the step from a time on."""
        system, state = self._system, self._system.state
        self.time, self.step = time, course.step
        self._loads, self._outside = self._split(state.displacement)
        self._before, self._impulse = state.velocity.copy(), state.impulse.copy()
        state.loads[:] = self._outside
        if self._moves:
            after = self.next(time, course.step)
            state.loads[:] -= self.inertia(state.velocity[state.held], after, course)
            state.velocity[state.held] = after
        # Each rank has its own of what is added up.
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
        state.sums[PUSHED:FOLLOWED] += dt * (self._carriers * pushed[system.order]).reshape(-1, 3).sum(axis=0)
        if not (self._moves or self._held):
            return
        resisted = system.momenta((state.velocity - self._before) / dt + course.damping * mean)
        if self._moves:
            carried = (state.impulse - self._impulse) / dt + resisted[state.held]
            state.sums[FOLLOWED] += dt * float(carried @ mean[state.held])
            if course.damping > 0.0:
                held = np.zeros_like(mean)
                held[state.held] = mean[state.held]
                beside = system.momenta(held)
                # The kernel knows that of what is free alone.
                lost = 2.0 * float(mean @ beside) - float(held @ beside)
                state.sums[DISSIPATED] += dt * course.damping * lost
        if self._held:
            inside = state.forces + resisted
            if self._moves:
                inside -= self.inertia(self._before[state.held], state.velocity[state.held], course)
            found = self.averages(inside, state.displacement)
            held_alone = {k: found[k] for k in self._held}
            state.sums[PUSHED:FOLLOWED] += dt * averages.forces_of(system.model, held_alone).sum(axis=0)

    def averages(self, forces: Array, displacement: Array) -> dict[int, Array]:
        """Return what mean supports exert, of internal and inertial less external forces, as state vectors."""
        if self._constraints is None:
            return {}
        order = self._system.order
        return exerted.carried(self._constraints, forces[order], displacement[order])
