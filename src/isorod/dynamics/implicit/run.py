"""Implicit time integration: Newton's iterations and cuts of the step."""

from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.assembly import averages, exerted
from isorod.assembly.factorisation import is_mixed
from isorod.checks.tie_result import results
from isorod.dynamics import run
from isorod.dynamics.explicit.step_kernel import ACTIVATED, DISSIPATED, FOLLOWED, PUSHED
from isorod.dynamics.explicit.system import System
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.dynamics.implicit.inertia import Inertia, MixedInertia
from isorod.dynamics.implicit.newton import Newton
from isorod.dynamics.implicit.phase import Phase
from isorod.dynamics.implicit.solids import Solids, resultant
from isorod.dynamics.run import IMBALANCE, Settings
from isorod.errors import InputError, SolveError
from isorod.model.mean import MeanSupport
from isorod.model.support import Support, center_of
from isorod.petsc.library import solver_types
from isorod.tensors import rotation

if TYPE_CHECKING:
    from isorod.contact.tunnelling import Tunnelling

# Maximum number of halvings of a step, and of cuts in it: with more of these the next steps would need as many, and the
# user should take a shorter step.
_HALVINGS, _CUTS = 10, 64

# State of solids in checkpoints.
_KEPT = ("displacement", "velocity", "work")


class Run(run.Run):
    """A running implicit time integration.

    Attributes
    ----------
    solids
        The finite element bodies.
    """

    integrator = "implicit"
    lag = 0.0
    # `isorod.dynamics.solve` adds contact.
    built = ("tangent", "mass")

    def __init__(self, system: System, settings: Settings) -> None:
        if settings.time_step is None:
            raise InputError(
                "time step: got none, need a positive time: implicit steps are unconditionally stable, none is chosen"
            )
        super().__init__(system, settings)
        self._longest = settings.time_step
        self.assembler, self._inertia = _made(system)
        self.solids = Solids(system.model, self.assembler.coupling)
        self._noise += 1e-12 * self.solids.size
        if system.contact is not None and self.assembler.contact is not None:
            # Steps and outputs have the same history of friction.
            self.assembler.contact.look(system.points)
            self.assembler.contact.use_history(system.contact.friction)
        self.newton = Newton(self.assembler)
        # Largest number of cuts up to the end of this step, and the shortest part of it that converged.
        self._allowed, self._shortest = _CUTS, np.inf
        self._tunnelling: Tunnelling | None = None
        if self.assembler.contact is not None:
            from isorod.contact import tunnelling

            self._tunnelling = tunnelling.Tunnelling(system.model)

    def solver(self) -> dict[str, str]:
        """Return the names of the methods at work."""
        return {"time integration": "energy-momentum conserving", **solver_types(self.newton.snes)}

    def end(self) -> None:
        """See `isorod.dynamics.run.Run`."""
        self.newton.destroy()
        self._inertia.destroy()

    def begin(self, displacement: Array, velocity: Array) -> None:
        """Place the bodies, incompressible ones preserving volume, and take the first output.

        Displacement and velocity are those of rods followed by those of solids.
        """
        rods = self.system.model.dofs
        if self.assembler.coupling is not None:
            held, values = self.solids.held, self.assembler.coupling.constraints.values[rods:]
            displacement[rods:], velocity[rods:] = (
                np.where(held, values, displacement[rods:]),
                np.where(held, 0.0, velocity[rods:]),
            )
        displacement, velocity = self._inertia.prepare(displacement, velocity, self._longest)
        if self.system.model.moves:
            velocity = self.assembler.tied(velocity, lambda mean: mean.clock.rate(0.0, False))
        self.solids.displacement[:], self.solids.velocity[:] = displacement[rods:], velocity[rods:]
        self._place_facets()
        super().begin(displacement[:rods], velocity[:rods])
        self.assembler.set_states(self.system.states)
        self._phase = self._from_start()

    def _place_facets(self) -> None:
        """Set the displacement of facets that rods touch."""
        if self.assembler.contact is not None:
            self.system.beyond = self.solids.displacement[self.assembler.contact.beyond - self.system.model.dofs]

    @property
    def _displacement(self) -> Array:
        """Displacement of all degrees of freedom, of rods followed by those of solids."""
        return np.append(self.system.state.displacement[self.system.order], self.solids.displacement)

    @property
    def _velocity(self) -> Array:
        return np.append(self.system.state.velocity[self.system.order], self.solids.velocity)

    def identity(self, displacement: Array, velocity: Array) -> dict[str, Any]:
        """See `isorod.dynamics.run.Run`."""
        identity = super().identity(displacement, velocity)
        if self.system.model.solids:
            identity["model"] += self.solids.digest()
        return identity

    def _from_start(self) -> Phase:
        displacement, velocity = (
            np.append(self.rows[name][0], self.rows[f"solid_{name}"][0]) for name in ("displacement", "velocity")
        )
        begun, after = self._unturned(displacement, 0.0), displacement + self.step * velocity
        return Phase(self.assembler.momenta, begun, self._unturned(after, self.step) - begun)

    def _now(self) -> dict[str, Array]:
        solids = {f"solid_{name}": getattr(self.solids, name) for name in _KEPT}
        return super()._now() | {"pressure": self.assembler.pressure} | solids | self._phase.state()

    def restore(self, kept: dict[str, Array]) -> None:
        """See `isorod.dynamics.run.Run`."""
        super().restore(kept)
        self.assembler.set_states(self.system.states)
        self.assembler.pressure = kept["pressure"]
        for name in _KEPT:
            getattr(self.solids, name)[:] = kept[f"solid_{name}"]
        self._phase = self._from_start()
        self._phase.restore(kept)

    @property
    def time_error(self) -> float | None:
        """See `isorod.dynamics.run.Run`."""
        return self._phase.error()

    def contact_displacement(self, index: int) -> Array:
        """See `isorod.dynamics.run.Run`."""
        everywhere = np.append(*(self.rows[name][index] for name in ("displacement", "solid_displacement")))
        return self.assembler.contact_displacement(everywhere)

    def _choose(self, critical: float) -> None:
        self._divide(self._longest)

    def _advance(self) -> float:
        """Take the steps to the next output and record it; return the wall time of the steps."""
        start = perf_counter()
        for k in range(self.count):
            self._allowed, self._shortest = self.cuts + _CUTS, self.step
            self._step(self.time + k * self.step, self.step, 0)
            self._phase.add(self._unturned(self._displacement, self.time + (k + 1) * self.step))
            self.report(self.time + (k + 1) * self.step)
        seconds = perf_counter() - start
        self.index += 1
        seen = self._measure()
        error = self._balance(seen)
        if not abs(error) <= IMBALANCE:
            raise SolveError(
                f"step {self.taken}, time {self.time:.6g}: energy balance error {error:.2g} of the work done; "
                f"time step {self._step_text()}: use a smaller one"
            )
        self._record(seen)
        return seconds

    def _step(self, time: float, dt: float, halvings: int) -> None:
        """Take a step, or halves of it where Newton's iterations do not converge."""
        displacement, velocity = self._displacement, self._velocity
        moved = self._driven(time, dt, velocity)
        self.assembler.begin(dt, self.settings.damping, displacement, velocity, moved)
        self.assembler.at(time, time + dt)
        if self.assembler.contact is not None:
            self.assembler.contact.begin(time, dt)
        level = self.level(time + 0.5 * dt)
        # Vibrations faster than the steps alternate: their state is closer to the last one than to its extrapolation.
        guesses = sorted((dt * velocity, np.zeros_like(velocity)), key=lambda x: self.newton.imbalance(x, level))
        change = self.newton.solve(guesses[0], level)
        if change is None:
            change = self.newton.solve(guesses[1], level)
        self.newton_iterations = self.newton.iterations
        problem = f"SNES diverged (reason {self.newton.snes.getConvergedReason()})"
        if change is not None and self._tunnelling is not None and self.assembler.contact is not None:
            at = self.assembler.contact_displacement
            ends = at(displacement), at(displacement + change), (time, time + dt)
            through = self._tunnelling.deep(self.assembler.contact.packed) or self._tunnelling.passed(*ends)
            change, problem = (change, problem) if through is None else (None, f"{through}; increase the penalty:")
        if change is not None:
            self._shortest = min(self._shortest, dt)
            self._move(time, dt, level, change, velocity)
            return
        self._refuse_deep(time)
        self.cuts += 1
        if halvings == _HALVINGS or self.cuts > self._allowed:
            raise SolveError(self._given_up(problem, time, halvings))
        self._step(time, 0.5 * dt, halvings + 1)
        self._step(time + 0.5 * dt, 0.5 * dt, halvings + 1)

    def _driven(self, time: float, dt: float, velocity: Array) -> Array | None:
        """Return the increment prescribed by supports in a step, and set the velocity at its start accordingly.

        Positions and velocities of supports are exact at the ends of steps, also with a kink of their motion within:
        with the initial velocity ``moved / dt`` less half its change, the step has the exact change of velocity.
        """
        model = self.system.model
        if not model.moves:
            return None
        ends, assembler = (time, time + dt), self.assembler

        def change(mean: MeanSupport) -> float:
            return mean.clock.at(ends[1]) - mean.clock.at(ends[0])

        def begun(mean: MeanSupport) -> float:
            rates = [mean.clock.rate(end, end > 0.0) for end in ends]
            return change(mean) / dt - 0.5 * (rates[1] - rates[0])

        moved = np.zeros_like(velocity)
        moved[model.held] = (model.placed(ends[1]) - model.placed(ends[0]))[model.held]
        grown = model.rates(ends[1], True)[model.held] - velocity[model.held]
        velocity[model.held] = moved[model.held] / dt - 0.5 * grown
        velocity[:] = assembler.tied(velocity, begun)
        return assembler.tied(moved, change)

    def _unturned(self, displacement: Array, time: float) -> Array:
        """Return a displacement in frames that rotate with supports: prescribed rotations have no phase error."""
        model = self.system.model
        if not any(motion.turn.any() for motion in model.motions):
            return displacement
        result = displacement.copy()
        for support, motion in zip(model.supports, model.motions, strict=True):
            if isinstance(support, Support) and motion.clock.moves and motion.turn.any():
                space = model.bodies[support.body].space
                arms = space.positions - space.is_control_point[:, None] * center_of(space, support)
                relative = arms + model.nodal(displacement, support.body)
                turned = relative @ rotation(motion.clock.at(time) * motion.turn) - arms
                model.nodal(result, support.body)[:] = turned
        return result

    def _refuse_deep(self, time: float) -> None:
        """Raise `SolveError` if the penetration is too large at the start of a step already: no shorter one helps."""
        if self._tunnelling is None or self.assembler.contact is None:
            return
        self.assembler.contact.forces(np.zeros(self.assembler.contact.start.size))
        deep = self._tunnelling.deep(self.assembler.contact.packed)
        if deep is not None:
            raise SolveError(f"step {self.taken + 1}, time {time:.6g}: {deep} before the step{self._jumped()}")

    def _jumped(self) -> str:
        """Return advice on instantaneous support displacements, at the start of the motion."""
        if self.taken > 0 or not np.any(self.rows["displacement"][0][self.system.model.held]):
            return ""
        return "; prescribed displacements are applied instantaneously at time 0: reduce them, or use loads"

    def _given_up(self, problem: str, time: float, halvings: int) -> str:
        """Return why a step failed, and advice."""
        place = f"step {self.taken + 1}, time {time:.6g}: {problem} in a time step of {self.step:.4g}"
        how = " and at the minimum step size"
        if halvings < _HALVINGS:
            how = f", cut {_CUTS} times: use {self._shortest:.2g}"
        worst = self.system.worst(self.system.state.displacement) + self.solids.worst()
        return f"{place}{how}; {worst}{self._jumped()}"

    def _move(self, time: float, dt: float, level: float, change: Array, begun: Array) -> None:
        """Add a step's displacement increment to the state, and its sums; ``begun`` is the initial velocity."""
        system, state, rods = self.system, self.system.state, self.system.model.dofs
        self._add_impulses(time, dt, level, change)
        self.assembler.accept(self.newton.x)
        mean = change / dt
        state.sums[DISSIPATED] += dt * self.settings.damping * float(mean @ self.assembler.momenta(mean))
        active = self._available > 0.0 or self.solids.active
        before = self._energies()[1] if active else 0.0
        state.displacement[system.order] += change[:rods]
        after = 2.0 * mean - begun
        after[system.model.held] = system.model.rates(time + dt, True)[system.model.held]
        if system.model.moves:
            after = self.assembler.tied(after, lambda support: support.clock.rate(time + dt, True))
            # At kinks of their motion supports do work on sudden changes of velocity at the mean of both velocities.
            start = self._velocity
            rest = 0.5 * (start + after) - mean
            state.sums[FOLLOWED] += float(rest @ self.assembler.momenta(after - start))
        state.velocity[system.order] = after[:rods]
        self.solids.move(change[rods:], after[rods:])
        if active:
            state.sums[ACTIVATED] -= level * (self._energies()[1] - before)
        self.system.update_states(dt)
        self.assembler.set_states(self.system.states)
        self.taken += 1

    def _add_impulses(self, time: float, dt: float, level: float, change: Array) -> None:
        """Add impulses and work of a step to the sums: of supports, contact, loads, and on solids."""
        state, model, solids = self.system.state, self.system.model, self.solids
        rods = model.dofs
        touching = self.assembler.contact_displacement(change)
        change, moved = change[:rods], change[rods:]
        if self.assembler.coupling is None:
            held = self.assembler.reactions(self.newton.x, level)
        else:
            carried = self.assembler.carried_forces(self.newton.x, level)
            held = carried[model.bound]
            means = self.assembler.averages(self.newton.x, level)
            state.sums[PUSHED:FOLLOWED] += dt * averages.forces_of(model, means).sum(axis=0)
            for k, amounts in means.items():
                mean = model.means[k]
                if mean.clock.moves:
                    increment = mean.clock.at(time + dt) - mean.clock.at(time)
                    state.sums[FOLLOWED] += increment * float(amounts @ mean.values)
            pulled = solids.loads(solids.displacement + 0.5 * moved)
            state.sums[FOLLOWED] += float(pulled @ moved)
            state.sums[PUSHED:FOLLOWED] += dt * resultant(pulled + np.where(solids.held, carried[rods:], 0.0))
            solids.add_work(moved)
        state.impulse[:] += dt * held
        state.sums[FOLLOWED] += float(held @ change[model.bound])
        loads = self.assembler.loads(state.displacement[self.system.order] + 0.5 * change)
        state.sums[FOLLOWED] += float(loads @ change)
        state.sums[PUSHED:FOLLOWED] += dt * (loads * self._carried).reshape(-1, 3).sum(axis=0)
        if self.assembler.contact is not None:
            pushed = self.assembler.contact.forces(touching)[0]
            pushed[:rods] *= self._carried
            state.sums[PUSHED:FOLLOWED] += dt * resultant(pushed)
            state.sums[FOLLOWED] += self.assembler.contact.work()
            state.sums[DISSIPATED] += self.assembler.contact.accept(touching)

    def _energies(self) -> tuple[float, float, float]:
        """Return the stored energy without activation, that added by full activation, and the dissipation of laws."""
        rods = self.system.energies(self.system.state.displacement)
        solids = self.solids.energies(self.solids.displacement)
        return rods[0] + solids[0], rods[1] + solids[1], rods[2]

    def _free_momentum(self) -> Array:
        solids = self.solids
        moving = solids.momenta(solids.velocity + self.settings.damping * solids.displacement)
        return super()._free_momentum() + resultant(moving)

    def _amount(self) -> float:
        return super()._amount() + float(np.abs(self.solids.momenta(self.solids.velocity)).sum())

    def _measure(self) -> dict[str, Any]:
        """Return the state by the names of `isorod.dynamics.History`, without changing it."""
        system, state, model, solids = self.system, self.system.state, self.system.model, self.solids
        stored, _, lost = self._energies()
        displacement, velocity, level = self._displacement, self._velocity, self.level(self.time)
        self._place_facets()
        forces, contact = system.forces(state.displacement, level, self.time)
        momenta = self.assembler.momenta(velocity)
        self.assembler.at(self.time, self.time)
        loads = self.assembler.loads(displacement[: model.dofs])
        internal = np.append(forces[system.order] - loads, solids.internal(solids.displacement, level))
        internal[model.dofs :] -= solids.loads(solids.displacement)
        if self.assembler.contact is not None:
            internal[self.assembler.contact.beyond] += forces[model.dofs :]
        bonds, slipped = self.assembler.bonded(displacement)
        balance = internal + bonds + self.settings.damping * momenta
        driven = np.zeros_like(velocity)
        driven[: model.dofs] = model.accelerations(self.time)
        driven = self.assembler.tied(driven)
        carried, pressure = self._inertia.settle(balance, displacement, velocity, driven, self.step)
        held = self.assembler.onto_masters(carried)
        coupling = self.assembler.coupling
        ties = [] if coupling is None else results(model, coupling, carried, displacement)
        seen = self._seen(velocity[: model.dofs], held[model.held], contact)
        if coupling is not None:
            seen["reactions"] += averages.forces_of(model, exerted.carried(coupling.constraints, carried, displacement))
        return seen | {
            "tie_forces": np.array([tie.force for tie in ties]).reshape(-1, 3),
            "tie_moments": np.array([tie.moment for tie in ties]).reshape(-1, 3),
            "kinetic": 0.5 * float(velocity @ momenta),
            "added_kinetic": 0.0,
            "stored": stored + self._inertia.stored(displacement) + slipped + float(solids.work[0]),
            "pressure": pressure,
            "solid_displacement": solids.displacement.copy(),
            "solid_velocity": solids.velocity.copy(),
            "muscle_work": state.sums[ACTIVATED],
            "dissipated": state.sums[DISSIPATED] + contact[-1] + lost,
        }


def _made(system: System) -> tuple[StepAssembler, Inertia]:
    """Return the assembler of steps, and the solver with the mass."""
    given = system.model, system.ranks.communicator
    if not is_mixed(system.model):
        assembler = StepAssembler(*given)
        return assembler, Inertia(assembler)
    from isorod.dynamics.implicit.mixed import MixedStepAssembler

    mixed = MixedStepAssembler(*given)
    return mixed, MixedInertia(mixed)
