"""Results of dynamics at the outputs of a motion."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.checks.reactions import by_name, support_displacements
from isorod.dynamics.explicit.step_kernel import activation
from isorod.errors import whole_number
from isorod.model.model import Model
from isorod.output.solids import WithSolids, owned
from isorod.output.state import Animated, State

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult

# Scalar results of a history.
_CURVES = (
    *("kinetic", "stored", "contact_energy", "added_kinetic", "muscle_work", "load_work", "dissipated"),
    *("energy_error", "momentum_error", "contact_force", "contact_area", "penetration"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Instant(State, WithSolids):
    """A motion at one of its outputs, with results at any point (`isorod.output.state`).

    Attributes
    ----------
    model, displacement, factor, pressures, solids
        As for `isorod.output.state.State`.
    velocity
        All degrees of freedom, shape ``(dofs,)``.
    time
        Time of the output.
    solid_velocities
        Velocity of each solid's degrees of freedom on this rank.
    """

    velocity: Array
    time: float
    solid_velocities: Sequence[Array] = ()

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement and velocity, ``(nodes, 3)``, and its pressure coefficients if it has some."""
        values = super().fields(body) | {"velocity": self.model.nodal(self.velocity, body)}
        pressure = self.pressures[body] if self.pressures else None
        return values if pressure is None else values | {"pressure": pressure}

    def __repr__(self) -> str:
        largest = np.abs(self.displacement).max(initial=0.0)
        return f"Instant {self.time:.6g} of {self.model!r}\n  largest displacement {largest:.6g}"


@dataclass(frozen=True, eq=False)
class History(Animated):
    """A motion at its outputs: ``history[k]`` is the `Instant` ``k``, with results at any point.

    Attributes
    ----------
    model
        The model.
    times
        Times of the outputs, shape ``(o,)``; all arrays below begin with this axis.
    displacement, velocity
        All degrees of freedom, shape ``(o, dofs)``.
    reactions
        Force of each support on the model, shape ``(o, supports, 3)``.
    tie_forces, tie_moments
        Force of each tie on its slave, and its moment about the middle of the slave's surface at rest, shape ``(o,
        ties, 3)``; not available in explicit steps, ``(o, 0, 3)``.
    obstacle_forces, obstacle_moments
        Force of the rigid obstacle of each contact on the rods, friction included, and its moment about its centre of
        rotation, or its own, shape ``(o, contacts, 3)``; zeros without obstacle.
    contact_force, contact_area, penetration
        Sum of normal forces, reference area in contact, and largest penetration, of all pairs.
    contact_forces, contacts
        Normal force of each contact, shape ``(o, contacts)``, and its result at the output of its largest force.
    solid_displacement, solid_velocity
        Degrees of freedom of the finite element bodies, concatenated, shape ``(o, s)``; on every rank.
    pressure
        Coefficients of the pressures of mixed bodies, concatenated (`Model.split_pressures`), force per area, shape
        ``(o, p)``: in dynamic equilibrium at the time of the output; of pressure waves faster than the steps, the mean.
    kinetic, stored, contact_energy
        Energies: of explicit steps ``v- M v+ / 2`` with the velocities half a step before and after, which the scheme
        conserves where forces are linear, of implicit ones ``v M v / 2``; matrix and passive fibres; penalty and
        frictional springs.
    added_kinetic
        Kinetic energy of the mass added for the time step (`isorod.dynamics.explicit.mass`), shape ``(o,)``.
    muscle_work, dissipated, load_work
        Work of active fibres, dissipation by damping, friction and laws, and work of loads and moving obstacles.
    energy_error
        Energies less their initial sum less work, over the work done: the largest so far of muscle work, dissipation,
        the loads' work and initial energy.
    momentum_error
        Change of linear momentum less the impulses of supports, loads, obstacles and damping, over the sum of their
        magnitudes and the initial one.
    steps, time_step, critical_step
        Number of steps taken, the last time step, and the smallest estimate of the critical one of explicit steps,
        with the added mass.
    estimates
        Time and value of each estimate of the critical step, shape ``(estimates, 2)``.
    microseconds_a_step
        Wall time of the compiled loop; zero if no steps remained.
    newton_iterations, cuts
        Of implicit steps, since the run was last continued: Newton iterations in all, and steps halved and repeated.
    resumed
        Time at which the run continued from a checkpoint, or None.
    time_error
        Estimated displacement error of implicit steps, relative to the largest so far
        (`isorod.dynamics.implicit.phase`); None for explicit ones, and for a single step.
    seconds, built, solver, ranks
        As for `isorod.statics.Equilibrium`; ``loop`` is the part of ``solve`` spent in compiled steps.
    ramp
        Time in which the activation of muscles grows.
    """

    model: Model
    times: Array
    displacement: Array
    velocity: Array
    reactions: Array
    tie_forces: Array
    tie_moments: Array
    obstacle_forces: Array
    obstacle_moments: Array
    contact_force: Array
    contact_forces: Array
    contact_area: Array
    penetration: Array
    kinetic: Array
    pressure: Array
    solid_displacement: Array
    solid_velocity: Array
    stored: Array
    contact_energy: Array
    added_kinetic: Array
    muscle_work: Array
    dissipated: Array
    load_work: Array
    energy_error: Array
    momentum_error: Array
    steps: int
    time_step: float
    critical_step: float
    estimates: Array
    microseconds_a_step: float
    newton_iterations: int
    cuts: int
    resumed: float | None
    time_error: float | None
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int
    ramp: float = 0.0
    contacts: "Sequence[ContactResult]" = ()

    def __len__(self) -> int:
        return self.times.size

    def __getitem__(self, number: int) -> Instant:
        """Return the motion at an output, the initial state by 0, the end by -1; raises `InputError`."""
        k = whole_number("output", number, -len(self), len(self) - 1) % len(self)
        time = float(self.times[k])
        factor = float(activation(time, self.ramp))
        return Instant(
            self.model,
            self.displacement[k],
            self.velocity[k],
            time,
            factor=factor,
            pressures=self.model.split_pressures(self.pressure[k]),
            solids=owned(self.model, self.solid_displacement[k]),
            solid_velocities=owned(self.model, self.solid_velocity[k]),
        )

    def __iter__(self) -> Iterator[Instant]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        return (
            f"History of {self.model!r}\n  {self.times.size} outputs from time {self.times[0]:.6g} to "
            f"{self.times[-1]:.6g}, {self.steps} steps of {self.time_step:.3g}\n"
            f"  errors of energy {self.energy_error[-1]:.2g}, of momentum {self.momentum_error[-1]:.2g}"
        )

    @property
    def added_kinetic_share(self) -> float:
        """Fraction of the kinetic energy, over all outputs, in mass added for the time step."""
        total = float(self.kinetic.sum())
        return float(self.added_kinetic.sum()) / total if total > 0.0 else 0.0

    def record(self) -> dict[str, Any]:
        """Return the entries of a record: all results but the motion itself."""
        left_out = (
            "model",
            "displacement",
            "velocity",
            "pressure",
            *(() if self.tie_forces.size else ("tie_forces", "tie_moments")),
            *(
                ()
                if any(contact.obstacle for contact in self.model.contacts)
                else ("obstacle_forces", "obstacle_moments")
            ),
            "solid_displacement",
            "solid_velocity",
            "contacts",
            "estimates",
            "seconds",
            "built",
            "solver",
            "ranks",
            "ramp",
        )
        record = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in left_out}
        return record | {"added_kinetic_share": self.added_kinetic_share}

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement and velocity at the end, shape ``(nodes, 3)``."""
        return self[-1].fields(body)

    def frames(self) -> list[tuple[float, Instant]]:
        """Return the time and the motion of each output."""
        return [(instant.time, instant) for instant in self]

    def curves(self) -> dict[str, Array]:
        """Return time, energies, contact, results of supports, and force and moment of ties: a row per output."""
        table = {"time": self.times} | {name.replace("_", " "): getattr(self, name) for name in _CURVES}
        moved = np.array([support_displacements(self.model, state) for state in self.displacement])
        count = len(self.model.supports)
        table |= by_name("support", "displacement", moved) | by_name("support", "force", self.reactions[:, :count])
        return table | by_name("tie", "force", self.tie_forces) | by_name("tie", "moment", self.tie_moments)
