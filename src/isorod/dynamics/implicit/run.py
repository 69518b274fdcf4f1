"""A motion under way in implicit steps: their cuts, and the balances."""

from time import perf_counter
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.dynamics.explicit.run import IMBALANCE, Run
from isorod.dynamics.explicit.step_kernel import activation
from isorod.dynamics.explicit.system import System
from isorod.dynamics.implicit.assembler import MotionAssembler
from isorod.dynamics.implicit.newton import Newton
from isorod.errors import InputError, SolveError
from isorod.petsc.library import solver_types

# A step is halved at most so often.
_HALVINGS = 10


class ImplicitRun(Run):
    """A motion under way in implicit steps; for the parameters see `isorod.dynamics.solve`.

    Attributes
    ----------
    cuts, newton_iterations
        Steps halved and tried again, and Newton iterations so far.
    """

    integrator = "implicit"

    def __init__(
        self, system: System, end_time: float, outputs: int, time_step: float | None, damping: float, ramp: float
    ) -> None:
        if time_step is None:
            raise InputError(
                "time step: give one; implicit steps are stable whatever they are, no length is the natural one"
            )
        self.assembler = MotionAssembler(system.model)
        super().__init__(system, end_time, outputs, time_step, damping, ramp)
        self._carried = system.model.is_carrier.repeat(3).astype(float)
        self.newton = Newton(self.assembler)
        self.cuts = 0
        # Contact is counted by who started the run.
        self.built = ["tangent", "mass"]
        self._active = self._available > 0.0
        self._inertia = PETSc.KSP().create(PETSc.COMM_SELF)
        self._inertia.setOperators(self.assembler.mass())
        self._inertia.setType("preonly")
        self._inertia.getPC().setType("lu")

    def solver(self) -> dict[str, str]:
        """Return the names of the methods at work."""
        return {"time integration": "energy-momentum conserving", **solver_types(self.newton.snes)}

    def _choose(self, critical: float) -> None:
        self._divide(float(self.given or 0.0))

    def advance(self) -> float:
        """Take the steps to the next output and record it; return the wall time of the steps."""
        start = perf_counter()
        for k in range(self.count):
            self._step(self.time + k * self.step, self.step, 0)
        seconds = perf_counter() - start
        self.index += 1
        seen = self._measure()
        error = self._balance(seen)
        if not abs(error) <= IMBALANCE:
            raise SolveError(
                f"step {self.taken}, time {self.time:.6g}: the energy balance is off by {error:.2g} of the work done; the time step is "
                f"{self.step:.4g}: try a smaller one"
            )
        self._record(seen)
        return seconds

    def _step(self, time: float, dt: float, halvings: int) -> None:
        system, motion, places = self.system, self.system.motion, self.system.places
        displacement, velocity = motion.displacement[places], motion.velocity[places]
        self.assembler.begin(dt, self.damping, displacement, velocity)
        level = activation(time + 0.5 * dt, self.ramp)
        change = self.newton.solve(dt * velocity, level)
        if change is None:
            change = self.newton.solve(np.zeros_like(velocity), level)
        self.newton_iterations = self.newton.iterations
        if change is None:
            self.cuts += 1
            if halvings == _HALVINGS:
                raise SolveError(
                    f"step {self.taken + 1}, time {time:.6g}: SNES diverged (reason {self.newton.snes.getConvergedReason()}) in a time step "
                    f"of {self.step:.4g} however often it was halved; {self.system.worst(motion.displacement)}"
                )
            self._step(time, 0.5 * dt, halvings + 1)
            self._step(time + 0.5 * dt, 0.5 * dt, halvings + 1)
            return
        held = system.model.held
        forces = self.assembler.reactions(self.newton.x, level)
        motion.impulse[:] += dt * forces
        if self.assembler.contact is not None:
            pushed = self.assembler.contact.forces(change)[0] * self._carried
            motion.sums[2:] += dt * pushed.reshape(-1, 3).sum(axis=0)
        before = system.energies(motion.displacement)[1] if self._active else 0.0
        mean = change / dt
        motion.sums[0] += dt * self.damping * float(mean @ self.assembler.momenta(mean))
        motion.displacement[places] = displacement + change
        after = 2.0 * mean - velocity
        after[held] = 0.0
        motion.velocity[places] = after
        if self._active:
            motion.sums[1] -= level * (system.energies(motion.displacement)[1] - before)
        self.taken += 1

    def _measure(self) -> dict[str, Any]:
        """Return the state by the names of `isorod.dynamics.History`; changes nothing of it."""
        system, motion, model = self.system, self.system.motion, self.system.model
        displacement, velocity = motion.displacement[system.places], motion.velocity[system.places]
        forces, (contact_energy, normal, area, deepest, *_) = system.forces(
            motion.displacement, activation(self.time, self.ramp)
        )
        momenta = self.assembler.momenta(velocity)
        balance = forces[system.places] + self.damping * momenta
        residual, solution = self.assembler.state(balance), self.assembler.vector()
        self._inertia.solve(residual, solution)
        acceleration = np.zeros(model.dofs)
        acceleration[model.free >= 0] = -solution.array_r
        held = balance + self.assembler.momenta(acceleration)
        return {
            "times": self.time,
            "displacement": displacement,
            "velocity": velocity,
            "reactions": self._by_support(held[model.held]),
            "contact_force": normal,
            "contact_area": area,
            "penetration": max(0.0, -deepest),
            "kinetic": 0.5 * float(velocity @ momenta),
            "stored": system.energies(motion.displacement)[0],
            "contact_energy": contact_energy,
            "added_kinetic": 0.0,
            "muscle_work": motion.sums[1],
            "dissipated": motion.sums[0],
        }

    def _moving(self, velocity: Array) -> Array:
        return self._carried * self.assembler.momenta(velocity[self.system.places])

    def _free_momentum(self) -> Array:
        """Return the momentum less all impulses so far: a constant."""
        motion = self.system.motion
        moving = self._moving(motion.velocity + self.damping * motion.displacement)
        return moving.reshape(-1, 3).sum(axis=0) - self._by_support(motion.impulse).sum(axis=0) - motion.sums[2:]
