"""Explicit time integration: the time step and its stability."""

from time import perf_counter
from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.assembly import averages
from isorod.dynamics import run
from isorod.dynamics.explicit.step_kernel import (
    ACTIVATED,
    BLOWN,
    DEEP,
    DISSIPATED,
    DONE,
    FOLLOWED,
    INVERTED,
    LOST,
    Course,
)
from isorod.dynamics.explicit.system import System
from isorod.dynamics.run import IMBALANCE, Settings, total
from isorod.errors import InputError, SolveError

# Default time step, and that advised for an unstable one, in critical steps.
_SAFE = 0.9

# The critical step is estimated again at an output after this many steps, or when activation or contact has grown.
_STEPS = 50

# An interval is unstable above this multiple of the energy available; it is repeated with a step shorter by this
# factor, at most so many times.
_GROWTH = 10.0
_OUTCOMES = {
    INVERTED: "an element inverts",
    BLOWN: "kinetic energy exceeds the total energy available: the time step is unstable",
    LOST: "a closest-point projection in contact did not converge",
}
_SHORTER = 0.8
_RETRIES = 15

# Change of elements' mean deformation gradients at which the added mass is updated; this is checked after about as many
# steps as they need for it, at least so many.
STRAYS = 0.15
_FIRST_LOOK = 4

# Changes since the last estimate of the critical step that require a new one: of mean deformation gradients, and of the
# area in contact.
_CHANGED = 0.02
_WIDER = 1.1

# Seconds of compiled steps between returns to Python, which then sees Ctrl-C.
_BLOCK = 0.2


class Run(run.Run):
    """A running explicit time integration."""

    integrator = "explicit"
    lag = 0.5

    def __init__(self, system: System, settings: Settings) -> None:
        super().__init__(system, settings)
        self._carried *= system.model.free >= 0
        if system.model.ties or any(mean.stiffness is None for mean in system.model.means.values()):
            system.tie()
        # Estimated number of steps in a block.
        self._block = 1
        # Displacement at the last estimate, in the model's order.
        self._estimated_at = np.zeros(system.model.dofs)

    def begin(self, displacement: Array, velocity: Array) -> None:
        """Place the bodies, choose the time step, and take the first output."""
        if self.system.ties is not None:
            displacement, velocity = (self.system.ties.tied(vector) for vector in (displacement, velocity))
        self._estimated_at = displacement.copy()
        self.system.mass.place(displacement)
        super().begin(displacement, velocity)

    def _now(self) -> dict[str, Array]:
        """Return the state without the recorded outputs."""
        since = 0.0 if self.system.drive is None else self.system.drive.since
        own = {"placed": self.system.mass.at, "estimated_at": self._estimated_at, "since": np.array(since)}
        return super()._now() | own

    def restore(self, kept: dict[str, Array]) -> None:
        """Continue from what `state` returned; see `isorod.dynamics.run.Run.restore`."""
        self._estimated_at = kept["estimated_at"]
        self.system.mass.place(kept["placed"])
        if self.system.drive is not None:
            self.system.drive.since = float(kept["since"])
        super().restore(kept)

    def solver(self) -> dict[str, str]:
        """Return the names of the methods at work."""
        return {"time integration": "central differences"}

    def end(self) -> None:
        """See `isorod.dynamics.run.Run`; explicit steps have nothing to release."""

    def _choose(self, critical: float) -> None:
        """Choose the time step and the mass it needs, and set the initial state of the scheme."""
        self._divide(_SAFE * critical if self.settings.time_step is None else self.settings.time_step)
        if self.settings.time_step is not None and self.step > critical:
            self._add_mass(critical)
        self._stagger(self.system.state.velocity.copy(), 0.0, 0.0, 0.0)

    def _add_mass(self, critical: float) -> None:
        """Add mass until the step is stable; ``critical`` is the critical step of the consistent mass."""
        mass = self.system.mass
        scaling = mass.scaling_for(self.step, critical)
        self.system.scale(scaling)
        critical = self._critical()
        # Stress and active fibres may require more.
        while self.step > critical and scaling < mass.largest_scaling:
            scaling = min(2.0 * scaling, mass.largest_scaling)
            self.system.scale(scaling)
            critical = self._critical()
        self.estimates[-1] = (0.0, critical)
        if self.step > critical:
            raise InputError(
                f"time step {self._step_text()}: unstable, the critical time step is {critical:.4g} with the largest "
                f"mass scaling; use at most {_SAFE * critical:.3g}"
            )

    def _advance(self) -> float:
        """Take the steps to the next output and record it; return the wall time of the steps.

        An unstable interval is repeated with a shorter step, unless the step is the user's.
        """
        last = self.system.state.displacement.copy()
        seconds = 0.0
        for retries in range(_RETRIES + 1):
            limit = _GROWTH * (abs(self._energy) + self._available) + self._noise
            if self.system.drive is not None or any(
                contact.motion is not None for contact in self.system.model.contacts
            ):
                # The work of loads, supports and obstacles is unknown; the energy balance is checked instead.
                limit = np.inf
            course = Course(self.time, self.step, self.settings.ramp, self.settings.damping, limit)
            taken, outcome, spent = self._take(course)
            seconds += spent
            self.system.update_states(self.step)
            if outcome == DEEP:
                raise SolveError(
                    f"step {self.taken + taken}, time {self.time + taken * self.step:.6g}: penetration "
                    "exceeds half the smaller radius (tunnelling); increase the penalty"
                )
            self.index += 1
            seen = self._measure()
            problem = _OUTCOMES.get(outcome, "")
            if outcome == DONE and not np.isfinite(seen["kinetic"]):
                problem = _OUTCOMES[INVERTED]
            elif outcome == DONE:
                error = self._balance(seen)
                problem = "" if abs(error) <= IMBALANCE else f"energy balance error {error:.2g} of the work done"
            if not problem:
                break
            self.index -= 1
            if self.settings.time_step is not None or retries == _RETRIES:
                raise self._blown(taken, last, problem)
            shorter = _SHORTER * self.step
            self._go_back()
            self._restep(shorter)
        self.taken += taken
        self._record(seen)
        if self.system.ties is not None:
            # Forces that ties transfer would accumulate in the momenta of both sides.
            self.system.settle()
        self._watch(seen)
        return seconds

    def _take(self, course: Course) -> tuple[int, int, float]:
        """Take the steps of an interval; return the number taken, the outcome, and the wall time."""
        taken, steps, outcome, seconds = 0, _FIRST_LOOK, DONE, 0.0
        while outcome == DONE and taken < self.count:
            start = perf_counter()
            steps = self._follow(self.time + taken * self.step, steps)
            end = min(taken + steps, self.count)
            seconds += perf_counter() - start
            taken, outcome, spent = self._steps(course, taken, end)
            seconds += spent
        return taken, outcome, seconds

    def _steps(self, course: Course, taken: int, end: int) -> tuple[int, int, float]:
        """Take steps after ``taken`` of an interval, to the ``end``; return as `_take` does."""
        outcome, seconds = DONE, 0.0
        with self.system.parted():
            while outcome == DONE and taken < end:
                first, last = taken, min(taken + self._block, end)
                start = perf_counter()
                taken, outcome = self.system.advance(course, first, last)
                spent = perf_counter() - start
                seconds += spent
                block = max(1, int(_BLOCK * (last - first) / max(spent, 1e-9)))
                self._block = self.system.ranks.first(block)
                self.report(self.time + taken * self.step)
        return taken, outcome, seconds

    def _follow(self, time: float, most: int) -> int:
        """Update the added mass where bodies have deformed; return the number of steps until the next check.

        It is at most twice the last one, ``most``, as bodies accelerate.
        """
        mass, state, order = self.system.mass, self.system.state, self.system.order
        if not mass.follows:
            return self.count
        if mass.change(state.displacement[order] - mass.at) > STRAYS:
            self._place(time)
        fastest = self.step * mass.change(state.velocity[order])
        # If this is not finite the next step raises an error.
        return int(np.clip(STRAYS / fastest, _FIRST_LOOK, 2 * most)) if fastest > 0.0 else 2 * most

    def _place(self, time: float) -> None:
        """Set the added mass to that of the present state; velocities stay, momenta change by those of added mass."""
        system, state = self.system, self.system.state
        energy, before = self._moving_energy(time), self._free_momentum()
        system.place(state.displacement)
        system.settle()
        self._energy += self._moving_energy(time) - energy
        self._momentum += self._free_momentum() - before

    def _moving_energy(self, time: float) -> float:
        """Return the kinetic energy (`isorod.dynamics.History.kinetic`) at a time, also between outputs."""
        forces, _ = self._forces(time)
        return 0.5 * float(self.system.momenta(self.system.state.velocity) @ self._ahead(forces, time))

    def _forces(self, time: float) -> tuple[Array, tuple[float, ...]]:
        """Return the result of `System.forces` at a time."""
        if self.system.drive is not None:
            self.system.drive.time, self.system.drive.step = time, self.step
        return self.system.forces(self.system.state.displacement, self.level(time), time)

    def _ahead(self, forces: Array, time: float) -> Array:
        """Return the velocity half a step after a time, given the forces at it."""
        system, state, dt = self.system, self.system.state, self.step
        half, held = 0.5 * self.settings.damping * dt, np.zeros(state.held.size)
        if system.drive is not None:
            held = system.drive.next(time, dt)
            course = Course(time, dt, self.settings.ramp, self.settings.damping, 0.0)
            forces = forces + system.drive.inertia(state.velocity[state.held], held, course)
        return system.velocity(((1.0 - half) * state.momenta - dt * forces) / (1.0 + half), held)

    def _stagger(self, velocity: Array, dissipated: float, work: float, loaded: float) -> None:
        """Set the velocity half a step before that at the time of the displacement.

        The sums are set so that dissipation, muscle work and the work of loads are as given.
        """
        system, state = self.system, self.system.state
        if system.drive is not None:
            system.drive.since = self.time
        forces, _ = self._forces(self.time)
        momenta, behind = system.momenta(velocity), np.zeros_like(velocity)
        momenta += 0.5 * self.step * (forces + self.settings.damping * momenta)
        if system.drive is not None:
            behind[state.held] = 2.0 * velocity[state.held] - system.drive.next(self.time, self.step)
            momenta -= system.momenta(behind)
        state.momenta[:] = momenta
        state.momenta[state.held] = 0.0
        state.velocity[:] = system.velocity(state.momenta, behind[state.held])
        seen = self._measure()
        state.sums[DISSIPATED] += dissipated - seen["dissipated"]
        state.sums[ACTIVATED] += work - seen["muscle_work"]
        state.sums[FOLLOWED] += loaded - seen["load_work"]

    def _measure(self) -> dict[str, Any]:
        """Return the state by the names of `isorod.dynamics.History`, without changing it."""
        system, state, dt = self.system, self.system.state, self.step
        now, before = self.level(self.time), self.level(self.time - dt)
        forces, contact = self._forces(self.time)
        half = 0.5 * self.settings.damping * dt
        behind = state.velocity
        ahead = self._ahead(forces, self.time)
        mean = 0.5 * (behind + ahead)
        velocity = mean[system.order]
        stored, active, lost = system.energies(state.displacement)
        # Reactions include the inertia of neighbours.
        resisted = system.momenta((ahead - behind) / dt + self.settings.damping * mean)
        seen = self._seen(velocity, (forces + resisted)[state.held], contact)
        seen["load_work"] += 0.5 * system.obstacle_work(self.time - dt, self.time)
        if system.drive is not None:
            inside = forces + resisted
            loads = system.drive.loads(state.displacement)
            loads[state.held] += inside[state.held]
            seen["load_work"] += 0.5 * dt * float(loads @ behind)
            means = system.drive.averages(inside, state.displacement)
            seen["reactions"] += averages.forces_of(system.model, means)
            stored += system.drive.stored(state.displacement)
        return seen | {
            "kinetic": 0.5 * float(system.momenta(behind) @ ahead),
            "added_kinetic": 0.5 * system.mass.added(velocity),
            "stored": stored,
            "muscle_work": state.sums[ACTIVATED] + 0.5 * (now - before) * active - now * active,
            "dissipated": state.sums[DISSIPATED] + half * float(system.momenta(behind) @ mean) + contact[-1] + lost,
        }

    def _watch(self, seen: dict[str, Any]) -> None:
        """Estimate the critical step again where it may have decreased, and shorten the step or raise an error."""
        system, state = self.system, self.system.state
        level, area = self.level(self.time), seen["contact_area"]
        steps, last_level, last_area = self._estimated
        stiffer = level > last_level or area > _WIDER * last_area
        if not stiffer:
            moved = state.displacement[system.order] - self._estimated_at
            if self.taken - steps < _STEPS or system.mass.change(moved) <= _CHANGED:
                return
        critical = system.critical_step(state.displacement, level)
        if self.step > critical and system.mass.follows:
            self._place(self.time)
            critical = system.critical_step(state.displacement, level)
        self.estimates.append((self.time, critical))
        self._estimated[:] = self.taken, level, area
        self._estimated_at = state.displacement[system.order]
        if self.step <= critical and (
            self.settings.time_step is not None or self.step <= 0.5 * (1.0 + _SAFE) * critical
        ):
            return
        if self.settings.time_step is not None:
            raise SolveError(
                f"step {self.taken}, time {self.time:.6g}: the time step {self._step_text()} has become unstable, "
                f"the critical time step is now {critical:.4g}; {self._advice(critical)}"
            )
        self._restep(_SAFE * critical)

    def _restep(self, longest: float) -> None:
        """Continue from the last output with another time step."""
        before = self._free_momentum()
        velocity = np.zeros(self.system.model.dofs)
        velocity[self.system.order] = self.rows["velocity"][-1]
        self._divide(longest)
        self._stagger(velocity, *(self.rows[name][-1] for name in ("dissipated", "muscle_work", "load_work")))
        self._momentum += self._free_momentum() - before
        # The energy that the scheme conserves depends on the step (`History.kinetic`).
        self._energy += total(self._measure()) - total({name: values[-1] for name, values in self.rows.items()})

    def _advice(self, critical: float) -> str:
        """Return advice for a critical step below the user's."""
        if self.system.mass.scaling > 0.0:
            # With a shorter one less mass is added, and the critical step decreases too.
            return "leave it out (--time-step 0) to follow the critical time step of the consistent mass"
        return f"use at most {_SAFE * critical:.3g}"

    def _blown(self, taken: int, last: Array, what: str) -> SolveError:
        """Return the error of steps unstable since the last output, that has the displacement ``last``."""
        time = self.time + taken * self.step
        critical = self.system.critical_step(last, self.level(self.time))
        advice = "use a smaller one, or refine or thicken the body there"
        if self.step > critical or self.system.mass.scaling > 0.0:
            advice = self._advice(critical)
        return SolveError(
            f"step {self.taken + taken}, time {time:.6g}: {what}; "
            f"{self.system.worst(self.system.state.displacement)}; time step {self._step_text()}, critical time "
            f"step {critical:.4g} at the previous output: {advice}"
        )
