"""Results of statics: an equilibrium, its load path, and estimates of its errors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.checks.reactions import by_name, support_displacements
from isorod.checks.tie_result import TieResult
from isorod.model.times import until
from isorod.output.solids import WithSolids
from isorod.output.state import Animated, Deformation, Named, State
from isorod.statics.path import Step, Turn

if TYPE_CHECKING:
    from isorod.checks.estimate import Error
    from isorod.contact.packed import Settled
    from isorod.contact.result import ContactResult
    from isorod.model.model import Model
    from isorod.output.matrices import Matrices
    from isorod.statics.contact_policy import Settling
    from isorod.statics.differences import Derivatives


# Forces, or moments, that are a smaller fraction of the other, for any unit of length, count as zero.
_LITTLE = 1e-6


@dataclass(frozen=True, eq=False)
class Equilibrium(State, WithSolids, Animated):
    """A static solution, with results at any point (`isorod.output.state`).

    Attributes
    ----------
    model
        The model.
    displacement
        All degrees of freedom, shape ``(dofs,)``, on every rank.
    reactions
        Force of each support on the model, shape ``(supports, 3)``.
    load_steps, cuts, newton_iterations
        Steps taken, steps cut and retried, and linear solves in all (each step's predictor included).
    linear_iterations
        Iterations of the linear solver in all those solves (one each where it is direct).
    residual_norms
        Norms of the residual force in the last load step: before the predictor, then at each SNES iteration.
    seconds
        ``setup``, ``assembly``, ``solve`` and ``check`` (balance of forces, overlap in the end, energy by a better
        rule, negative eigenvalues), wall time.
    built
        Names of the operators built.
    solver
        Types of SNES, KSP, PC and factorisation used.
    ranks
        Number of MPI ranks.
    contacts
        Result of each contact of the model.
    settled
        Penalties, multipliers and points of contact at the end.
    augmentations
        Updates of the multipliers of contact.
    moments
        Moment of each support on the model about the mean of its nodes' present positions, shape ``(supports, 3)``.
    work
        Sum of the supports' forces times the displacements, and moments times the rotations, that they prescribe.
    settlings
        How contact settled in each load step, where it does (`isorod.statics.contact_policy`).
    stabilisation
        Of bodies held by contact alone: the remaining artificial forces, relative to those that supports and loads
        carry, and the number of solutions that reduced them (`isorod.statics.stabilisation`); None where supports hold
        all bodies.
    path
        Load steps of a model with contact, or where they are kept.
    negative_eigenvalues
        Number of negative eigenvalues of the tangent stiffness, directions of instability; None where unknown, as with
        friction (`isorod.statics.stability`).
    ties
        Result of each tie of the model.
    largest
        Over time, the state of largest stored energy, if that is one at a kink of a table and not the last: errors are
        those of this state.
    in_more_steps
        Returns the equilibrium with twice as many load steps; collective.
    coarser
        The equilibrium with half as many load steps, where these were doubled.
    """

    reactions: Array
    load_steps: int
    cuts: int
    newton_iterations: int
    residual_norms: list[float]
    seconds: dict[str, float]
    built: list[str]
    solver: dict[str, str]
    ranks: int
    contacts: "Sequence[ContactResult]" = ()
    settled: "Settled | None" = None
    settlings: "Sequence[Settling]" = ()
    augmentations: int = 0
    linear_iterations: int = 0
    moments: Array = field(default_factory=lambda: np.zeros((0, 3)))
    work: float = 0.0
    stabilisation: "tuple[float, int] | None" = None
    path: Sequence[Step] = ()
    negative_eigenvalues: int | None = None
    ties: Sequence[TieResult] = ()
    largest: "Equilibrium | None" = None
    in_more_steps: "Callable[[Equilibrium], Equilibrium] | None" = None
    coarser: "Equilibrium | None" = None

    @property
    def _counted(self) -> str:
        return "load factor" if self.model.times is None else "time"

    def __repr__(self) -> str:
        forces = [f"support {k} ({', '.join(f'{x:.6g}' for x in force)})" for k, force in enumerate(self.reactions[:5])]
        return "\n  ".join(
            (
                f"Equilibrium of {self.model!r}",
                f"load steps {self.load_steps}, cut {self.cuts}, Newton iterations {self.newton_iterations}, "
                f"last residual norm {self.residual_norms[-1]:.3g}",
                f"largest displacement {np.abs(self.displacement).max(initial=0.0):.6g}",
                *(f"reaction of {force}" for force in forces),
            )
        )

    def estimate(self, *directions: str) -> float | None:
        """Return an estimate of the relative error of works; None where there is none (`errors`)."""
        return self.errors(*directions).work

    def errors(self, *directions: str) -> "Error":
        """Return estimates of relative errors (`isorod.checks.estimate`), None where there are none.

        The first call takes about twice as long as the solution; pictures drawn afterwards show the error of stresses.
        Errors are sums of those of the approximation across the ``"section"`` and along the ``"axis"``, or that of one
        direction if given, and of the compliance of frictional springs.  That of works includes an estimate of finite
        element bodies by recovered strains; with these there is none of stresses.  Over time they are those of the
        state of largest stored energy.
        """
        return self._estimated(directions) if directions else self._errors

    @cached_property
    def _errors(self) -> "Error":
        error = self._estimated(())
        if error.work is None or self.steps_error is None:
            return error
        return error._replace(work=error.work + self.steps_error)

    def _estimated(self, directions: Sequence[str]) -> "Error":
        from isorod.checks import embedded, estimate

        if self.largest is not None:
            return self.largest._estimated(directions)
        carried = self.reactions, self.moments
        reached = estimate.Reached(self.displacement, self.work, self.pressures, self.contacts, carried, self.solids)
        error = estimate.of_equilibrium(self.model, reached, directions, self.ranks)
        if self.model.solids:
            meshes = self._of_solids[0].work
            # With contact the rods' part is unknown, and not included.
            rods = 0.0 if self.model.contacts else error.work
            error = estimate.Error(None if rods is None or meshes is None else rods + meshes, None)
        stretched = float(sum(contact.stretched for contact in self.contacts))
        more = stretched and stretched / max(2.0 * self._stored, abs(self.work))
        more += 0.0 if directions else embedded.of(self).error
        return error if error.work is None else error._replace(work=error.work + more)

    @cached_property
    def steps_error(self) -> float | None:
        """The error of support forces, and of final displacements, due to the number of load steps.

        None but with laws with memory and, over time, with friction.

        It is relative to the largest along the path, and twice the difference to twice as many load steps, as errors
        halve when their number doubles.
        """
        if self.coarser is not None:
            return self.coarser._apart(self)
        rubs = self.model.times is not None and any(contact.friction for contact in self.model.contacts)
        if not (self.model.remembers or rubs) or self.in_more_steps is None:
            return None
        # This runs the model with twice as many steps.
        return 2.0 * self._apart(self.in_more_steps(self))

    def _apart(self, finer: "Equilibrium") -> float:
        """Return the difference of support forces and of displacements, relative to the largest along the path."""
        before, after = self._carried(), finer._carried()
        known = [factor for factor in before if factor in after]
        state, changes = finer if finer.largest is None else finer.largest, []
        largest, extent = float(np.abs(state.displacement).max(initial=0.0)), self.model.size
        stores = all(getattr(law, "stores", True) for body in self.model.bodies for law in body.laws)
        inside = state._stored / max(largest, _LITTLE * extent) if stores else 0.0
        for k in range(2):
            old, new = (np.array([carried[factor][k] for factor in known]) for carried in (before, after))
            # At the end all may be unloaded, and in free expansion support forces are rounding.
            most = max(np.abs(carried).max() for pair in after.values() for carried in pair)
            size = max(np.abs(new).max(initial=0.0), _LITTLE * most, _LITTLE * inside * extent**k)
            changes.append(float(np.abs(old - new).max(initial=0.0)) / size if size else 0.0)
        apart = float(np.abs(finer.displacement - self.displacement).max(initial=0.0))
        changes.append(apart / largest if largest else 0.0)
        return max(changes)

    def _carried(self) -> dict[float, tuple[Array, Array]]:
        """Return forces and moments of the supports at load factors at which these are known."""
        known = {step.factor: (step.reactions, step.moments) for step in self.path if len(step.reactions)}
        return known | {1.0: (self.reactions, self.moments)}

    @property
    def factors(self) -> list[float]:
        """Load factors at the ends of load steps, where these are known: with memory, contact, or kept."""
        ends = {*(step.factor for step in self.path), *(past.factor for past in self.model.past)}
        return sorted(ends | {1.0})

    @cached_property
    def _of_solids(self) -> "tuple[Error, Array | None]":
        from isorod.checks import estimate

        return estimate.of_solids(self.model, self.solids, self._stored)

    @property
    def coarsest(self) -> Array | None:
        """Point of finite element bodies with the largest error of works, shape ``(3,)``; None without an estimate."""
        state = self if self.largest is None else self.largest
        return state._of_solids[1] if self.model.solids else None

    @property
    def _stored(self) -> float:
        """Stored energy of the rods."""
        return sum(self.energy(b) for b in range(len(self.model.bodies)))

    @property
    def stress_error(self) -> float | None:
        """The estimate of the error of stresses, where `errors` has computed it: pictures show it."""
        known: Error | None = self.__dict__.get("_errors")
        return None if known is None else known.stress

    def dissipated(self, body: Named) -> float:
        """Return the energy dissipated by laws with memory in a body (`isorod.output.energy.dissipated`)."""
        from isorod.output import energy

        number = self._number(body)
        return energy.dissipated(self.model.bodies[number], self.fields(number), self.factor)

    def matrices(self, lumped: bool = False) -> "Matrices":
        """Return the tangent stiffness and the mass about it (`isorod.output.matrices.matrices`)."""
        from isorod.output.matrices import matrices

        return matrices(self.model, self, lumped)

    def derivatives(
        self,
        make: "Callable[[Mapping[str, float]], Model]",
        at: "Mapping[str, float]",
        measure: "Callable[[Equilibrium], Mapping[str, object]]",
    ) -> "Derivatives":
        """Return the derivatives of results by parameters (`isorod.statics.derivatives.derivatives`).

        With memory or friction they are taken along the path (`isorod.statics.along_path`).
        """
        from isorod.statics import along_path, derivatives

        return (along_path if along_path.suits(self) else derivatives).derivatives(self, make, at, measure)

    def record(self) -> dict[str, Any]:
        """Return the entries of a record; contact area and largest penetration are those of all contacts."""
        names = "newton_iterations", "linear_iterations", "load_steps", "cuts", "residual_norms", "negative_eigenvalues"
        record: dict[str, Any] = {name: getattr(self, name) for name in names}
        if self.model.times is not None:
            record["end_time"] = self.model.times.end
        laws = [law for body in self.model.bodies for law in body.laws if law.remembers]
        if laws and all("dissipated" in law.states for law in laws):
            record["dissipated"] = sum(self.dissipated(b) for b in range(len(self.model.bodies)))
        if self.pressures:
            record["pressures"] = sum(pressures.size for pressures in self.pressures if pressures is not None)
        if self.contacts:
            record["contact_area"] = sum(contact.area for contact in self.contacts)
            record["penetration"] = max(contact.penetration for contact in self.contacts)
            record["augmentations"] = self.augmentations
            record["contacts"] = [contact.record() for contact in self.contacts]
        if self.ties:
            record["ties"] = [tie.record() for tie in self.ties]
        if self.stabilisation is not None:
            record["stabilisation"], record["stabilisation_rounds"] = self.stabilisation
        return record

    def frames(self) -> list[tuple[float, Deformation]]:
        """Return load factor, or time, and state of each load step that was kept; this one is the last."""
        before = [
            replace(
                self,
                model=self.model.after([past for past in self.model.past if past.factor < step.factor]),
                factor=step.factor,
                displacement=step.displacement,
                reactions=step.reactions,
                moments=step.moments,
                pressures=step.pressures,
                solids=step.solids,
                # Known at the last one alone.
                contacts=(),
                ties=(),
            )
            for step in self.path[:-1]
            if step.displacement is not None
        ]
        times = self.model.times
        return [(state.factor if times is None else times.time(state.factor), state) for state in (*before, self)]

    def curves(self) -> dict[str, Array]:
        """Return load factor or time, displacement and force of each support: a row at rest and per kept load step."""
        when, states = zip(*self.frames(), strict=True)
        frames = [state for state in states if isinstance(state, Equilibrium)]
        count = len(self.model.supports)
        rest = np.zeros((1, count, 3))
        moved = [support_displacements(self.model, frame.displacement) for frame in frames]
        table = {self._counted: np.array([0.0, *when])}
        table |= by_name("support", "displacement", np.append(rest, np.reshape(moved, (len(frames), count, 3)), 0))
        return table | by_name("support", "force", np.append(rest, [frame.reactions[:count] for frame in frames], 0))

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement, shape ``(nodes, 3)``, and its pressure coefficients if it has some.

        With contact there is ``contact_pressure``, one row per point: axis parameter, angle, pressure, number of the
        contact, and radius on the disk, less than 1 in a hole.
        """
        fields = super().fields(body)
        pressure = self.pressures[body] if self.pressures else None
        if pressure is not None:
            fields["pressure"] = pressure
        if any((result.body == body).any() for result in self.contacts):
            rod, rows = self.model.bodies[body].space.rod, []
            for k, (contact, result) in enumerate(zip(self.model.contacts, self.contacts, strict=True)):
                here = result.body == body
                radius = contact.disk_radius(body, rod) if here.any() else 1.0
                columns = [np.full(here.sum(), value) for value in (k, radius)]
                rows.append(np.column_stack([result.parameters[here], result.pressure[here], *columns]))
            fields["contact_pressure"] = np.concatenate(rows)
        return fields

    def with_largest(self, turn: Turn | None) -> "Equilibrium":
        """Return it with the state of largest stored energy along the path, where that is another."""
        times = self.model.times
        if turn is None or times is None or not times.time(turn.factor):
            return self
        model, before = until(self.model, times.time(turn.factor)), self.model.past
        assert model.times is not None
        before = [past for past in before if past.factor < turn.factor]
        moved = [past._replace(factor=model.times.place(times.time(past.factor))) for past in before]
        there = replace(
            self,
            model=model.after(moved),
            displacement=turn.displacement,
            reactions=turn.carried.reactions,
            moments=turn.carried.moments,
            work=turn.carried.work,
            pressures=turn.pressures,
            contacts=turn.contacts,
            solids=turn.solids,
            path=(),
            ties=(),
        )
        return replace(self, largest=there)
