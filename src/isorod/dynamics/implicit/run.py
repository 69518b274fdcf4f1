"""Implicit steps of a motion: Newton's iterations and cuts of the step."""

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
    from isorod.contact.passing import Passing

# A step is halved at most so often, and cut into at most so many pieces more: where all of them are as short, the next
# steps would be too, and a shorter step is what to ask for.
_HALVINGS, _CUTS = 10, 64

# What checkpoints keep of solids.
_KEPT = ("displacement", "velocity", "work")


class Run(run.Run):
    """A motion under way in implicit steps.

    Attributes
    ----------
    solids
        The finite element bodies.
    """

    integrator = "implicit"
    lag = 0.0
    # Contact is counted by who started the run.
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
            # Outputs and checkpoints know the same history.
            self.assembler.contact.look(system.points)
            self.assembler.contact.share(system.contact.friction)
        self.newton = Newton(self.assembler)
        # Cuts in this step and before, at most, and the shortest piece of it that could be taken.
        self._allowed, self._shortest = _CUTS, np.inf
        self._passing: Passing | None = None
        if self.assembler.contact is not None:
            from isorod.contact import passing

            self._passing = passing.Passing(system.model)

    def solver(self) -> dict[str, str]:
        """Return the names of the methods at work."""
        return {"time integration": "energy-momentum conserving", **solver_types(self.newton.snes)}

    def end(self) -> None:
        """See `isorod.dynamics.run.Run`."""
        self.newton.destroy()
        self._inertia.destroy()

    def begin(self, displacement: Array, velocity: Array) -> None:
        """Place the bodies, those that are incompressible so that no volume changes, and take the first output.

        Displacement and velocity have those of solids behind those of rods.
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
            velocity = self.assembler.tied(velocity, lambda one: one.clock.rate(0.0, False))
        self.solids.displacement[:], self.solids.velocity[:] = displacement[rods:], velocity[rods:]
        self._place_facets()
        super().begin(displacement[:rods], velocity[:rods])
        self.assembler.know(self.system.states)
        self._phase = self._from_start()

    def _place_facets(self) -> None:
        """Tell contact where the facets are that rods touch."""
        if self.assembler.contact is not None:
            self.system.beyond = self.solids.displacement[self.assembler.contact.beyond - self.system.model.dofs]

    @property
    def _displacement(self) -> Array:
        """Of all degrees of freedom, those of solids behind those of rods."""
        return np.append(self.system.state.displacement[self.system.order], self.solids.displacement)

    @property
    def _velocity(self) -> Array:
        return np.append(self.system.state.velocity[self.system.order], self.solids.velocity)

    def identity(self, displacement: Array, velocity: Array) -> dict[str, Any]:
        """See `isorod.dynamics.run.Run`."""
        found = super().identity(displacement, velocity)
        if self.system.model.solids:
            found["model"] += self.solids.digest()
        return found

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
        self.assembler.know(self.system.states)
        self.assembler.pressure = kept["pressure"]
        for name in _KEPT:
            getattr(self.solids, name)[:] = kept[f"solid_{name}"]
        self._phase = self._from_start()
        self._phase.restore(kept)

    @property
    def time_error(self) -> float | None:
        """See `isorod.dynamics.run.Run`."""
        return self._phase.error()

    def met(self, index: int) -> Array:
        """See `isorod.dynamics.run.Run`."""
        everywhere = np.append(*(self.rows[name][index] for name in ("displacement", "solid_displacement")))
        return self.assembler.met(everywhere)

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
        # What swings faster than steps follow goes back and forth: it is nearer to where it was than to where it goes.
        guesses = sorted((dt * velocity, np.zeros_like(velocity)), key=lambda one: self.newton.imbalance(one, level))
        change = self.newton.solve(guesses[0], level)
        if change is None:
            change = self.newton.solve(guesses[1], level)
        self.newton_iterations = self.newton.iterations
        problem = f"SNES diverged (reason {self.newton.snes.getConvergedReason()})"
        if change is not None and self._passing is not None and self.assembler.contact is not None:
            ends = self.assembler.met(displacement), self.assembler.met(displacement + change)
            through = self._passing.deep(self.assembler.contact.packed) or self._passing.passed(
                *ends, (time, time + dt)
            )
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
        """Return what supports move in a step, and change the velocity at its start to what begins it.

        Places and velocities of supports are exact at the ends of steps, a kink of their motion in a step or not; with
        ``moved / dt`` less half the change of the velocity in place of this, the step has the change as it is.
        """
        model = self.system.model
        if not model.moves:
            return None
        ends, assembler = (time, time + dt), self.assembler

        def change(one: MeanSupport) -> float:
            return one.clock.at(ends[1]) - one.clock.at(ends[0])

        def begun(one: MeanSupport) -> float:
            rates = [one.clock.rate(end, end > 0.0) for end in ends]
            return change(one) / dt - 0.5 * (rates[1] - rates[0])

        moved = np.zeros_like(velocity)
        moved[model.held] = (model.placed(ends[1]) - model.placed(ends[0]))[model.held]
        grown = model.rates(ends[1], True)[model.held] - velocity[model.held]
        velocity[model.held] = moved[model.held] / dt - 0.5 * grown
        velocity[:] = assembler.tied(velocity, begun)
        return assembler.tied(moved, change)

    def _unturned(self, displacement: Array, time: float) -> Array:
        """Return a displacement as bodies that supports spin see it: what is prescribed is not late."""
        model = self.system.model
        if not any(motion.turn.any() for motion in model.motions):
            return displacement
        result = displacement.copy()
        for one, motion in zip(model.supports, model.motions, strict=True):
            if isinstance(one, Support) and motion.clock.moves and motion.turn.any():
                space, (first, last) = model.bodies[one.body].space, model.first_node[one.body : one.body + 2]
                arms = space.positions - space.is_control_point[:, None] * center_of(space, one)
                own = arms + displacement.reshape(-1, 3)[first:last]
                turned = own @ rotation(motion.clock.at(time) * motion.turn) - arms
                result.reshape(-1, 3)[first:last] = turned
        return result

    def _refuse_deep(self, time: float) -> None:
        """Raise `SolveError` if bodies are as deep in each other where a step starts: no shorter one helps."""
        if self._passing is None or self.assembler.contact is None:
            return
        self.assembler.contact.forces(np.zeros(self.assembler.contact.start.size))
        deep = self._passing.deep(self.assembler.contact.packed)
        if deep is not None:
            raise SolveError(f"step {self.taken + 1}, time {time:.6g}: {deep} before the step{self._jumped()}")

    def _jumped(self) -> str:
        """Return, at the start of the motion, what supports that are displaced do."""
        if self.taken > 0 or not np.any(self.rows["displacement"][0][self.system.model.held]):
            return ""
        return "; prescribed displacements are applied instantaneously at time 0: reduce them, or use loads"

    def _given_up(self, problem: str, time: float, halvings: int) -> str:
        """Return why a step could not be taken, and what would be right."""
        place = f"step {self.taken + 1}, time {time:.6g}: {problem} in a time step of {self.step:.4g}"
        how = " and at the minimum step size"
        if halvings < _HALVINGS:
            how = f", cut {_CUTS} times: use {self._shortest:.2g}"
        worst = self.system.worst(self.system.state.displacement) + self.solids.worst()
        return f"{place}{how}; {worst}{self._jumped()}"

    def _move(self, time: float, dt: float, level: float, change: Array, begun: Array) -> None:
        """Add a step's change of the displacement to the state, and its sums; ``begun`` is the velocity it began at."""
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
            after = self.assembler.tied(after, lambda one: one.clock.rate(time + dt, True))
            # What supports make faster all at once, at kinks of their motion, they push at the mean of both velocities.
            start = self._velocity
            rest = 0.5 * (start + after) - mean
            state.sums[FOLLOWED] += float(rest @ self.assembler.momenta(after - start))
        state.velocity[system.order] = after[:rods]
        self.solids.move(change[rods:], after[rods:])
        if active:
            state.sums[ACTIVATED] -= level * (self._energies()[1] - before)
        self.system.go_on(dt)
        self.assembler.know(self.system.states)
        self.taken += 1

    def _add_impulses(self, time: float, dt: float, level: float, change: Array) -> None:
        """Add impulses and work of a step to the sums: of supports, contact, loads, and on solids."""
        state, model, solids = self.system.state, self.system.model, self.solids
        rods = model.dofs
        met = self.assembler.met(change)
        change, moved = change[:rods], change[rods:]
        if self.assembler.coupling is None:
            held = self.assembler.reactions(self.newton.x, level)
        else:
            carried = self.assembler.carried_forces(self.newton.x, level)
            held = carried[model.bound]
            means = self.assembler.averages(self.newton.x, level)
            state.sums[PUSHED:FOLLOWED] += dt * averages.forces_of(model, means).sum(axis=0)
            for k, amounts in means.items():
                one = model.means[k]
                if one.clock.moves:
                    way = one.clock.at(time + dt) - one.clock.at(time)
                    state.sums[FOLLOWED] += way * float(amounts @ one.values)
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
            pushed = self.assembler.contact.forces(met)[0]
            pushed[:rods] *= self._carried
            state.sums[PUSHED:FOLLOWED] += dt * resultant(pushed)
            state.sums[FOLLOWED] += self.assembler.contact.work()
            state.sums[DISSIPATED] += self.assembler.contact.accept(met)

    def _energies(self) -> tuple[float, float, float]:
        """Return the stored energy without activation, what full activation adds, and what laws have dissipated."""
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
        """Return the state by the names of `isorod.dynamics.History`; changes nothing of it."""
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
            "tie_forces": np.array([one.force for one in ties]).reshape(-1, 3),
            "tie_moments": np.array([one.moment for one in ties]).reshape(-1, 3),
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
    """Return what assembles steps, and what solves with the mass."""
    given = system.model, system.ranks.communicator
    if not is_mixed(system.model):
        assembler = StepAssembler(*given)
        return assembler, Inertia(assembler)
    from isorod.dynamics.implicit.mixed import MixedStepAssembler

    mixed = MixedStepAssembler(*given)
    return mixed, MixedInertia(mixed)
