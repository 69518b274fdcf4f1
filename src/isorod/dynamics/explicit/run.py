"""A motion under way: the time step and its stability, the balances, the state that a checkpoint keeps."""

import hashlib
from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from isorod import __version__
from isorod.arrays import Array
from isorod.dynamics.explicit.step_kernel import BLOWN, DONE, INVERTED, LOST, Course, activation
from isorod.dynamics.explicit.system import System
from isorod.errors import InputError, SolveError

# The step taken where none is given, and what an unstable one is advised to be, in critical steps.
_SAFE = 0.9

# The critical step is estimated again at an output after this many steps, or when activation has grown or contact
# begun.
_STEPS = 50

# An interval has blown up at this many times the energy there can be, or where the balance is off by this share of the
# work done; it is taken again with a step shorter by this factor, so many times.
_GROWTH = 10.0
_OUTCOMES = {
    INVERTED: "an element inverts",
    BLOWN: "there is more kinetic energy than there can be",
    LOST: "a closest point in contact was not found",
}
IMBALANCE = 0.05
_SHORTER = 0.8
_RETRIES = 15

# Steps that no one will wait for.
_MOST = 1e12


class Run:
    """A motion under way; for the parameters see `isorod.dynamics.solve`.

    Attributes
    ----------
    index, taken
        Intervals between outputs completed, and steps.
    count
        Steps in an interval.
    rows
        What was recorded so far, by the names of `isorod.dynamics.History`.
    estimates
        Time and value of each estimate of the critical step.
    """

    integrator = "explicit"
    # What an implicit run has of its own.
    newton_iterations = 0
    cuts = 0
    built: Sequence[str] = ("mass",)

    def __init__(
        self, system: System, end_time: float, outputs: int, time_step: float | None, damping: float, ramp: float
    ) -> None:
        self.system = system
        self.outputs, self.given = outputs, time_step
        self.damping, self.ramp = float(damping), float(ramp)
        self.interval = end_time / outputs
        self.index, self.taken, self.count = 0, 0, 1
        self.rows: dict[str, list[Any]] = {}
        self.estimates: list[tuple[float, float]] = []
        # Steps taken, activation, and whether there was contact at the last estimate.
        self._estimated = np.zeros(3)
        # Energy at the start; momentum that stays when all impulses are taken off.
        self._energy = 0.0
        self._momentum = np.zeros(3)
        model = system.model
        # Only functions that add up to one take part in the virtual work of a translation.
        self._carried = model.is_carrier.repeat(3) * (model.free >= 0)
        volumes = np.concatenate(
            [body.space.tabulate(0, body.space.axis.elements).weights.sum(axis=(1, 2)) for body in model.bodies]
        )
        laws = [law for body in model.bodies for law in body.laws]
        # The most work that activation can do.
        self._available = float(volumes @ [law.activation_work for law in laws])
        # Of a body at rest, rounding of its forces may be all there is.
        self._noise = 1e-12 * float(volumes @ [law.modulus for law in laws])

    def solver(self) -> dict[str, str]:
        """Return the names of the methods at work."""
        return {"time integration": "central differences"}

    @property
    def time(self) -> float:
        """Time of the last output."""
        return self.index * self.interval

    @property
    def step(self) -> float:
        """Time step."""
        return self.interval / self.count

    def begin(self, displacement: Array, velocity: Array) -> None:
        """Place the bodies, choose the time step, and take the first output."""
        system, motion = self.system, self.system.motion
        motion.displacement[system.places] = displacement
        motion.velocity[system.places] = velocity
        critical = self._critical()
        if not critical > 0.0:
            raise InputError(f"initial state: an element is inverted; {self.system.worst(motion.displacement)}")
        self.estimates.append((0.0, critical))
        self._choose(critical)
        self._momentum = self._free_momentum()
        seen = self._measure()
        self._energy = _total(seen)
        self._estimated[:] = 0.0, activation(0.0, self.ramp), seen["contact_area"] > 0.0
        self._balance(seen)
        self._record(seen)

    def _critical(self) -> float:
        """Return the critical step at the start, with the mass there is, without activation and with all of it."""
        return min(self.system.critical_step(self.system.motion.displacement, level) for level in (0.0, 1.0))

    def _choose(self, critical: float) -> None:
        """Choose the time step, given the critical one, and the mass it takes, and make the state what the scheme starts from."""
        self._divide(_SAFE * critical if self.given is None else self.given)
        if self.given is not None and self.step > critical:
            self._add_mass(critical)
        self._stagger(self.system.motion.velocity.copy(), 0.0, 0.0)

    def _add_mass(self, critical: float) -> None:
        """Add mass until the step is stable; ``critical`` is the critical step of the consistent mass."""
        mass = self.system.mass
        scaling = mass.scaling_for(self.step, critical)
        self.system.scale(scaling)
        critical = self._critical()
        # Stress and active fibres may ask for more.
        while self.step > critical and scaling < mass.largest_scaling:
            scaling = min(2.0 * scaling, mass.largest_scaling)
            self.system.scale(scaling)
            critical = self._critical()
        self.estimates[-1] = (0.0, critical)
        if self.step > critical:
            raise InputError(
                f"time step {self.step:.4g}: not stable, the critical step is {critical:.4g} with as much mass as may be added; take at "
                f"most {_SAFE * critical:.3g}"
            )

    def advance(self) -> float:
        """Take the steps to the next output and record it; return the wall time of the steps.

        An interval that blows up is taken again with a shorter step, unless the step is the user's.
        """
        system, motion = self.system, self.system.motion
        last = motion.displacement.copy()
        before = [array.copy() for array in (*motion, system.starts)]
        sums = self._energy, self._momentum.copy(), self.count
        seconds = 0.0
        for retries in range(_RETRIES + 1):
            limit = _GROWTH * (abs(self._energy) + self._available) + self._noise
            course = Course(self.time, self.step, self.ramp, self.damping, limit)
            start = perf_counter()
            taken, outcome = system.advance(course, self.count)
            seconds += perf_counter() - start
            self.index += 1
            seen = self._measure()
            problem = _OUTCOMES.get(outcome, "")
            if outcome == DONE and not np.isfinite(seen["kinetic"]):
                problem = _OUTCOMES[INVERTED]
            elif outcome == DONE:
                error = self._balance(seen)
                problem = (
                    "" if abs(error) <= IMBALANCE else f"the energy balance is off by {error:.2g} of the work done"
                )
            if not problem:
                break
            self.index -= 1
            if self.given is not None or retries == _RETRIES:
                raise self._blown(taken, last, problem)
            shorter = _SHORTER * self.step
            for array, kept in zip((*motion, system.starts), before, strict=True):
                array[:] = kept
            self._energy, self._momentum[:], self.count = sums
            self._restep(shorter)
        self.taken += taken
        self._record(seen)
        self._watch(seen)
        return seconds

    def _divide(self, longest: float) -> None:
        """Cut the interval in equal steps, none longer than the given one."""
        count = np.ceil(self.interval / longest - 1e-9)
        if not count * self.outputs < _MOST:
            raise InputError(
                f"time step {longest:.4g}: {count * self.outputs:.3g} steps to the end at {self.interval * self.outputs:.4g}, at most "
                f"{_MOST:.0e} can be taken"
            )
        self.count = max(1, int(count))

    def _stagger(self, velocity: Array, dissipated: float, work: float) -> None:
        """Take the velocity, given at the time of the displacement, back by half a step.

        What half a step adds to the sums is taken off, so that dissipation and muscle work are as given.
        """
        system, motion = self.system, self.system.motion
        forces, _ = system.forces(motion.displacement, activation(self.time, self.ramp))
        momenta = system.momenta(velocity)
        motion.momenta[:] = momenta + 0.5 * self.step * (forces + self.damping * momenta)
        motion.momenta[motion.held] = 0.0
        motion.velocity[:] = system.velocity(motion.momenta)
        seen = self._measure()
        motion.sums[0] += dissipated - seen["dissipated"]
        motion.sums[1] += work - seen["muscle_work"]

    def _measure(self) -> dict[str, Any]:
        """Return the state by the names of `isorod.dynamics.History`; changes nothing of it."""
        system, motion, dt = self.system, self.system.motion, self.step
        now, before = (activation(time, self.ramp) for time in (self.time, self.time - dt))
        forces, (contact_energy, normal, area, deepest, *_) = system.forces(motion.displacement, now)
        half = 0.5 * self.damping * dt
        behind = motion.velocity
        ahead = system.velocity(((1.0 - half) * motion.momenta - dt * forces) / (1.0 + half))
        velocity = 0.5 * (behind + ahead)
        stored, active = system.energies(motion.displacement)
        # What is held resists the acceleration of its neighbours too.
        resisted = system.momenta((ahead - behind) / dt + self.damping * velocity)
        held = (forces + resisted)[motion.held]
        return {
            "times": self.time,
            "displacement": motion.displacement[system.places],
            "velocity": velocity[system.places],
            "reactions": self._by_support(held),
            "contact_force": normal,
            "contact_area": area,
            "penetration": max(0.0, -deepest),
            "kinetic": 0.5 * float(motion.momenta @ ahead),
            "added_kinetic": 0.5 * system.mass.added(velocity[system.places]),
            "stored": stored,
            "contact_energy": contact_energy,
            "muscle_work": motion.sums[1] + 0.5 * (now - before) * active - now * active,
            "dissipated": motion.sums[0] + half * float(motion.momenta @ velocity),
        }

    def _record(self, seen: dict[str, Any]) -> None:
        """Keep an output."""
        for name, value in seen.items():
            self.rows.setdefault(name, []).append(value)

    def _balance(self, seen: dict[str, Any]) -> float:
        """Add the balances to an output; return the error of the energy."""
        work, dissipated = self.rows.get("muscle_work", []), self.rows.get("dissipated", [])
        scale = max(map(abs, [self._energy, seen["muscle_work"], seen["dissipated"], *work, *dissipated]))
        error = _total(seen) - self._energy - seen["muscle_work"] + seen["dissipated"]
        motion = self.system.motion
        amount = float(np.abs(self._moving(motion.velocity)).sum())
        amount += float(np.abs(self._by_support(motion.impulse)).sum() + np.abs(motion.sums[2:]).sum())
        loose = float(np.linalg.norm(self._free_momentum() - self._momentum))
        seen["energy_error"] = error / scale if scale > self._noise else 0.0
        seen["momentum_error"] = loose / amount if amount > 0.0 else 0.0
        return float(seen["energy_error"])

    def _by_support(self, held: Array) -> Array:
        """Return the sums of what belongs to the held degrees of freedom, shape ``(supports, 3)``."""
        model = self.system.model
        result = np.zeros((max(len(model.supports), 1), 3))
        # Only functions that add up to one take part in the virtual work of a translation.
        carried = model.is_carrier[model.held // 3]
        np.add.at(result, (model.support_of[carried], model.held[carried] % 3), held[carried])
        return result

    def _moving(self, velocity: Array) -> Array:
        """Return the momenta that a state vector has of the free degrees of freedom that move with their rods, in the model's order."""
        return self._carried * self.system.mass.momenta(velocity[self.system.places])

    def _free_momentum(self) -> Array:
        """Return the momentum half a step ago less all impulses so far: a constant."""
        motion = self.system.motion
        moved = motion.displacement - 0.5 * self.step * motion.velocity
        moving = self._moving(motion.velocity + self.damping * moved)
        return moving.reshape(-1, 3).sum(axis=0) - self._by_support(motion.impulse).sum(axis=0) - motion.sums[2:]

    def _watch(self, seen: dict[str, Any]) -> None:
        """Estimate the critical step again where it may have fallen, and shorten the step or stop."""
        system, motion = self.system, self.system.motion
        level, touching = activation(self.time, self.ramp), seen["contact_area"] > 0.0
        steps, last_level, touched = self._estimated
        stiffer = level > last_level or (touching and not touched)
        if not stiffer and self.taken - steps < _STEPS:
            return
        critical = system.critical_step(motion.displacement, level)
        self.estimates.append((self.time, critical))
        self._estimated[:] = self.taken, level, touching
        if self.step <= critical and (self.given is not None or self.step <= 0.5 * (1.0 + _SAFE) * critical):
            return
        if self.given is not None:
            raise SolveError(
                f"step {self.taken}, time {self.time:.6g}: the time step {self.step:.4g} is no longer stable, the critical one is "
                f"{critical:.4g} now; {self._advice(critical)}"
            )
        self._restep(_SAFE * critical)

    def _restep(self, longest: float) -> None:
        """Go on from the last output with another step."""
        before = self._free_momentum()
        velocity = np.zeros(self.system.model.dofs)
        velocity[self.system.places] = self.rows["velocity"][-1]
        self._divide(longest)
        self._stagger(velocity, self.rows["dissipated"][-1], self.rows["muscle_work"][-1])
        self._momentum += self._free_momentum() - before
        # The energy that the scheme conserves depends on the step (`History.kinetic`).
        self._energy += _total(self._measure()) - _total({name: values[-1] for name, values in self.rows.items()})

    def _advice(self, critical: float) -> str:
        """Return what to do about a critical step that has fallen below the user's."""
        if self.system.mass.scaling > 0.0:
            # With a shorter one there is less mass added, and the critical step falls too.
            return "give none (--time-step 0), for one that follows the critical step of the consistent mass"
        return f"take at most {_SAFE * critical:.3g}"

    def _blown(self, taken: int, last: Array, what: str) -> SolveError:
        """Return the error of a run that blew up after some steps from the last output, at the displacement ``last``."""
        time = self.time + taken * self.step
        critical = self.system.critical_step(last, activation(self.time, self.ramp))
        advice = "try a smaller one, or a finer or thicker body where it happened"
        if self.step > critical:
            advice = self._advice(critical)
        return SolveError(
            f"step {self.taken + taken}, time {time:.6g}: {what}; {self.system.worst(self.system.motion.displacement)}; the time step is "
            f"{self.step:.4g}, the critical one was {critical:.4g} at the output before: {advice}"
        )

    def identity(self, displacement: Array, velocity: Array) -> dict[str, Any]:
        """Return what a checkpoint must have in common with this run."""
        system = self.system
        digest = hashlib.sha256()
        digest.update(" ".join(type(law).__name__ for body in system.model.bodies for law in body.laws).encode())
        for array in (
            # All but the elements, which hold addresses.
            *system.mesh[1:],
            *(body.densities for body in system.model.bodies),
            system.motion.held,
            displacement,
            velocity,
            *system.contact_data,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        return {
            "version": __version__,
            "integrator": self.integrator,
            "end_time": self.interval * self.outputs,
            "outputs": self.outputs,
            "time_step": self.given,
            "damping": self.damping,
            "ramp": self.ramp,
            "model": digest.hexdigest(),
        }

    def state(self) -> dict[str, Array]:
        """Return all that is needed to continue (see `restore`)."""
        system, motion = self.system, self.system.motion
        return {
            "finished": np.array(self.index == self.outputs),
            "counts": np.array([self.index, self.taken, self.count]),
            "displacement": motion.displacement,
            "velocity": motion.velocity,
            "momenta": motion.momenta,
            "scaling": np.array(system.mass.scaling),
            "impulse": motion.impulse,
            "sums": motion.sums,
            "starts": system.starts,
            "estimates": np.array(self.estimates),
            "estimated": self._estimated,
            "highest": system.highest,
            "energy": np.array(self._energy),
            "momentum": self._momentum,
        } | {f"row_{name}": np.array(values) for name, values in self.rows.items()}

    def restore(self, state: dict[str, Array]) -> None:
        """Continue from a state."""
        motion = self.system.motion
        self.index, self.taken, self.count = (int(value) for value in state["counts"])
        self.system.scale(float(state["scaling"]))
        for name in ("displacement", "velocity", "momenta", "impulse", "sums"):
            getattr(motion, name)[:] = state[name]
        self.system.starts[:] = state["starts"]
        self.system.highest[:] = state["highest"]
        self.estimates = [(float(time), float(value)) for time, value in state["estimates"]]
        self._estimated = state["estimated"]
        self._energy = float(state["energy"])
        self._momentum = state["momentum"]
        self.rows = {name[4:]: list(values) for name, values in state.items() if name.startswith("row_")}


def _total(seen: dict[str, Any]) -> float:
    """Return the energy of an output, all kinds together."""
    return float(seen["kinetic"] + seen["stored"] + seen["contact_energy"])
