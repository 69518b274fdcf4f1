"""A running time integration, explicit or implicit: outputs, balances, and the state of checkpoints."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from isorod import __version__
from isorod.arrays import Array
from isorod.checks.reactions import support_forces
from isorod.dynamics.explicit.step_kernel import FOLLOWED, PUSHED, activation
from isorod.dynamics.explicit.system import System
from isorod.errors import InputError, SolveError
from isorod.model.model import Model

# Error allowed in the energy balance, relative to the work done.
IMBALANCE = 0.05

# Maximum number of steps.
_MOST = 1e12


@dataclass(frozen=True)
class Settings:
    """Parameters of a run; see `isorod.dynamics.solve`."""

    end_time: float
    outputs: int
    time_step: float | None = None
    damping: float = 0.0
    ramp: float = 0.0


class Run(ABC):
    """A running time integration.

    Attributes
    ----------
    index, taken
        Numbers of intervals between outputs completed, and of steps.
    count
        Steps in an interval.
    rows
        Outputs so far, by the names of `isorod.dynamics.History`.
    estimates
        Time and value of each estimate of the critical step.
    newton_iterations, cuts
        Of implicit steps, so far: Newton iterations, and steps halved and repeated.
    report
        Called with the time reached, a few times a second where steps are short.
    """

    integrator: ClassVar[str]
    # Fraction of a step by which velocities lag behind displacements.
    lag: ClassVar[float]
    built: Sequence[str] = ("mass",)

    def __init__(self, system: System, settings: Settings) -> None:
        self.system, self.settings = system, settings
        # From the decimal end time: twice the time with twice the outputs has the same steps, to the last bit.
        self.interval = float(Fraction(repr(float(settings.end_time))) / settings.outputs)
        self.index, self.taken, self.count = 0, 0, 1
        self.newton_iterations = self.cuts = 0
        self.rows: dict[str, list[Any]] = {}
        self.report: Callable[[float], object] = lambda time: None
        self._kept: dict[str, Array] = {}
        self.estimates: list[tuple[float, float]] = []
        # Steps taken, activation, and area in contact at the last estimate.
        self._estimated = np.zeros(3)
        # Energy at the start; momentum less all impulses, a constant.
        self._energy = 0.0
        self._momentum = np.zeros(3)
        # Only functions that add up to one take part in the virtual work of a translation.
        self._carried = system.model.is_control_point.repeat(3).astype(float)
        own = np.zeros(2)
        for elements in system.ranks.element_ranges:
            body, table = elements.body, elements.body.space.tabulate(elements.first, elements.last)
            for k, name in enumerate(("activation_work", "modulus")):
                values = [getattr(law, name) for law in body.shear_laws]
                own[k] += np.sum(body.at_points(table, values) * table.weights)
        work, size = system.ranks.sums(own)
        # The largest work of activation.
        self._available = float(work)
        # Energies below this may be rounding, as of a body at rest.
        self._noise = 1e-12 * float(size)

    @abstractmethod
    def solver(self) -> dict[str, str]:
        """Return the names of the methods at work."""

    @abstractmethod
    def end(self) -> None:
        """Release what only the collector of cycles would; no step follows."""

    def advance(self) -> float:
        """Take the steps to the next output and record it; return the wall time of the steps.

        Ctrl-C restores the state of the last output.
        """
        self._kept = {name: np.array(value) for name, value in self._now().items()}
        try:
            return self._advance()
        except KeyboardInterrupt:
            self._go_back()
            raise

    @abstractmethod
    def _advance(self) -> float:
        """Implement `advance`."""

    @abstractmethod
    def _choose(self, critical: float) -> None:
        """Choose the time step, given the critical one, and set the initial state of the steps."""

    @abstractmethod
    def _measure(self) -> dict[str, Any]:
        """Return the state by the names of `isorod.dynamics.History`, without changing it."""

    @property
    def time_error(self) -> float | None:
        """The error of the steps, relative to the largest displacement; None where it is not available."""
        return None

    def contact_displacement(self, index: int) -> Array:
        """Return the displacement at an output for contact, followed by that of facets."""
        displacement: Array = self.rows["displacement"][index]
        return displacement

    @property
    def outputs(self) -> int:
        """Number of intervals between outputs."""
        return self.settings.outputs

    @property
    def time(self) -> float:
        """Time of the last output."""
        return self.index * self.interval

    @property
    def step(self) -> float:
        """Time step."""
        return self.interval / self.count

    def level(self, time: float) -> float:
        """Return the fraction of the full activation at a time."""
        return activation(time, self.settings.ramp)

    def begin(self, displacement: Array, velocity: Array) -> None:
        """Place the bodies, choose the time step, and take the first output."""
        system, state = self.system, self.system.state
        state.displacement[system.order] = displacement
        state.velocity[system.order] = velocity
        system.update_states(0.0)
        critical = self._critical()
        if not critical > 0.0:
            raise InputError(f"initial state: an element is inverted; {self.system.worst(state.displacement)}")
        self.estimates.append((0.0, critical))
        self._choose(critical)
        self._momentum = self._free_momentum()
        seen = self._measure()
        # Dissipation at the initial state is not part of the motion.
        self._energy = total(seen) + seen["dissipated"]
        self._estimated[:] = 0.0, self.level(0.0), seen["contact_area"]
        self._balance(seen)
        self._record(seen)

    def _critical(self) -> float:
        """Return the critical step at the start with the present mass, the smaller without and with full activation."""
        return min(self.system.critical_step(self.system.state.displacement, level) for level in (0.0, 1.0))

    def _divide(self, longest: float) -> None:
        """Divide the interval into equal steps, none longer than the given one."""
        count = np.ceil(self.interval / longest - 1e-9)
        if not count * self.outputs < _MOST:
            own = "" if longest == self.settings.time_step else " (by the critical time step)"
            raise InputError(
                f"time step {longest:.4g}{own}: {count * self.outputs:.3g} steps to the end at "
                f"{self.interval * self.outputs:.4g}, at most {_MOST:.0e} can be taken"
            )
        self.count = max(1, int(count))

    def _step_text(self) -> str:
        """Return the time step, requested and taken, as text."""
        requested = self.settings.time_step
        if requested is None or np.isclose(requested, self.step, rtol=1e-6, atol=0.0):
            return f"{self.step:.4g}"
        return f"{requested:.4g} ({self.step:.4g} taken, {self.count:,} to each of {self.outputs:,} outputs)"

    def _seen(self, velocity: Array, held: Array, contact: Sequence[float]) -> dict[str, Any]:
        """Return the outputs that both integrators have in common.

        Parameters
        ----------
        velocity
            At the time of the displacement, in the model's order, shape ``(dofs,)``.
        held
            Forces on the held degrees of freedom.
        contact
            From `isorod.dynamics.explicit.system.System.forces`.
        """
        energy, normal, area, deepest, *_ = contact
        displacement = self.system.state.displacement[self.system.order]
        return {
            "times": self.time,
            "displacement": displacement,
            "velocity": velocity,
            "reactions": self._by_support(held),
            "obstacle_forces": (exerted := self.system.obstacle_loads())[:, :3],
            "obstacle_moments": exerted[:, 3:],
            "tie_forces": np.zeros((0, 3)),
            "tie_moments": np.zeros((0, 3)),
            "contact_force": normal,
            "contact_forces": self.system.contact_forces(),
            "contact_area": area,
            "penetration": max(0.0, -deepest),
            "contact_energy": energy,
            "pressure": np.empty(0),
            "solid_displacement": np.empty(0),
            "solid_velocity": np.empty(0),
            "load_work": float(self.system.state.sums[FOLLOWED]),
        }

    def _record(self, seen: dict[str, Any]) -> None:
        """Append an output.

        Raises
        ------
        SolveError
            If a value is not finite.
        """
        for name, value in seen.items():
            if not np.isfinite(value).all():
                raise SolveError(f"step {self.taken}, time {self.time:.6g}: {name.replace('_', ' ')} is not finite")
            self.rows.setdefault(name, []).append(value)

    def _balance(self, seen: dict[str, Any]) -> float:
        """Add the errors of the balances to an output; return that of the energy."""
        works = ("muscle_work", "load_work", "dissipated")
        scale = max(abs(work) for name in works for work in [self._energy, seen[name], *self.rows.get(name, [])])
        error = total(seen) - self._energy - seen["muscle_work"] - seen["load_work"] + seen["dissipated"]
        amount = self._amount()
        momentum_error = float(np.linalg.norm(self._free_momentum() - self._momentum))
        seen["energy_error"] = error / scale if scale > self._noise else 0.0
        seen["momentum_error"] = momentum_error / amount if amount > 0.0 else 0.0
        return float(seen["energy_error"])

    def _amount(self) -> float:
        """Return the sum of the magnitudes of momenta and impulses."""
        state = self.system.state
        impulses = np.abs(self._by_support(state.impulse)).sum() + np.abs(state.sums[PUSHED:FOLLOWED]).sum()
        moving = np.abs(self._moving(state.velocity)).sum()
        return float(moving + impulses)

    def _by_support(self, held: Array) -> Array:
        """Return the sums of values at held degrees of freedom by support, shape ``(supports, 3)``."""
        return support_forces(self.system.model, held)

    def _moving(self, velocity: Array) -> Array:
        """Return the momenta of control points, from a state vector of velocities, in the model's order."""
        return self._carried * self.system.mass.momenta(velocity[self.system.order])

    def _free_momentum(self) -> Array:
        """Return the momentum at the time of the velocities less all impulses so far: a constant."""
        state = self.system.state
        moved = state.displacement - self.lag * self.step * state.velocity
        moving = self._moving(state.velocity + self.settings.damping * moved)
        given = self._by_support(state.impulse).sum(axis=0) + state.sums[PUSHED:FOLLOWED]
        return moving.reshape(-1, 3).sum(axis=0) - given

    def identity(self, displacement: Array, velocity: Array) -> dict[str, Any]:
        """Return the properties in which a checkpoint and this run must agree."""
        system = self.system
        digest = hashlib.sha256()
        digest.update(system.digest().encode())
        mixed = [body for body in system.model.bodies if body.formulation == "mixed"]
        digest.update(" ".join(law.identity for body in system.model.bodies for law in body.laws).encode())
        digest.update(repr((system.model.loads, system.model.ties, _clocks(system.model))).encode())
        for array in (
            *(body.densities for body in system.model.bodies),
            *([law.lame for law in body.laws] for body in mixed),
            system.state.held,
            displacement,
            velocity,
            system.model.external,
            *system.contact_data,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        return {
            "version": __version__,
            "integrator": self.integrator,
            "time_step": self.settings.time_step,
            "damping": float(self.settings.damping),
            "ramp": float(self.settings.ramp),
            "model": digest.hexdigest(),
        }

    def state(self) -> dict[str, Array]:
        """Return the state from which to continue (see `restore`)."""
        return self._now() | {f"row_{name}": np.array(values) for name, values in self.rows.items()}

    def _go_back(self) -> None:
        """Return to the last output."""
        outputs = int(self._kept["counts"][0]) + 1
        rows: dict[str, Any] = {f"row_{name}": values[:outputs] for name, values in self.rows.items()}
        self.restore({name: value.copy() for name, value in self._kept.items()} | rows)

    def _now(self) -> dict[str, Array]:
        """Return the state without the recorded outputs."""
        system, state = self.system, self.system.state
        return {
            "finished": np.array(self.index == self.outputs),
            "interval": np.array(self.interval),
            "counts": np.array([self.index, self.taken, self.count]),
            "displacement": state.displacement,
            "velocity": state.velocity,
            "momenta": state.momenta,
            "scaling": np.array(system.mass.scaling),
            "impulse": state.impulse,
            "sums": state.sums,
            "points": np.array(system.points).reshape(-1, 2),
            "starts": system.starts,
            "anchors": system.anchors,
            "states": system.states,
            "estimates": np.array(self.estimates),
            "estimated": self._estimated,
            "highest": system.highest,
            "energy": np.array(self._energy),
            "momentum": self._momentum,
        }

    def restore(self, kept: dict[str, Array]) -> None:
        """Continue from the result of `state`, to another end time if that is later.

        Raises
        ------
        InputError
            If outputs are not at the same times.
        """
        interval, reached = float(kept["interval"]), int(kept["counts"][0])
        end = self.interval * self.outputs
        if not abs(interval - self.interval) <= 1e-9 * interval:
            outputs = max(round(end / interval), 1)
            raise InputError(
                f"output interval of the checkpoint is {interval:.6g}, requested {self.interval:.6g}; "
                f"use {outputs} outputs to time {outputs * interval:.6g}"
            )
        if reached > self.outputs:
            raise InputError(
                f"has reached time {reached * interval:.6g}, past the end time {end:.6g}; take a later one"
            )
        # The next outputs are at the times of an uninterrupted run.
        self.interval = interval
        self.index, self.taken, self.count = (int(value) for value in kept["counts"])
        self.system.scale(float(kept["scaling"]))
        for name in ("displacement", "velocity", "momenta", "impulse", "sums"):
            getattr(self.system.state, name)[:] = kept[name]
        self.system.starts[:] = kept["starts"]
        self.system.anchors[:] = kept["anchors"]
        self.system.highest[:] = kept["highest"]
        self.system.set_states(kept["states"])
        self.estimates = [(float(time), float(value)) for time, value in kept["estimates"]]
        self._estimated = kept["estimated"]
        self._energy = float(kept["energy"])
        self._momentum = kept["momentum"]
        self.rows = {name[4:]: list(values) for name, values in kept.items() if name.startswith("row_")}


def total(seen: dict[str, Any]) -> float:
    """Return the total energy of an output."""
    return float(seen["kinetic"] + seen["stored"] + seen["contact_energy"])


def _clocks(model: Model) -> list[object]:
    """Return the motions of supports over time."""
    moved = [(each.turn.tolist(), each.path[-1].tolist(), each.clock) for each in model.motions if each.clock.moves]
    return [*moved, *((mean.values.tolist(), mean.clock) for mean in model.means.values() if mean.clock.moves)]
