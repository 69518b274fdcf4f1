"""What statics answers: an equilibrium, the way to it, and estimates of its errors."""

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


# Forces, or moments, that are a smaller share of the other, whatever the unit of length, are none.
_LITTLE = 1e-6


@dataclass(frozen=True, eq=False)
class Equilibrium(State, WithSolids, Animated):
    """A static solution, which answers for any point of it (`isorod.output.state`).

    Attributes
    ----------
    model
        What was solved.
    displacement
        All degrees of freedom, shape ``(dofs,)``, on every rank.
    reactions
        Force of each support on the model, shape ``(supports, 3)``.
    load_steps, cuts, newton_iterations
        Steps taken, steps cut and retried, and linear solves in all (each step's predictor counted).
    linear_iterations
        Iterations of the linear solver in all those solves (one each where it is direct).
    residual_norms
        Norms of the out-of-balance force in the last load step: before the predictor, then at each SNES iteration.
    seconds
        ``setup``, ``assembly``, ``solve`` and ``check`` (balance of forces, overlap in the end, energy by a better
        rule, negative eigenvalues), wall time.
    built
        Operators that were built.
    solver
        Types of SNES, KSP, PC and factorisation used.
    ranks
        Number of MPI ranks.
    contacts
        Outcome of each contact of the model.
    settled
        How contact was settled.
    augmentations
        Updates of the multipliers of contact.
    moments
        Moment of each support on the model about the mean of its nodes' present positions, shape ``(supports, 3)``.
    work
        Sum of the supports' forces times the displacements, and moments times the turns, that they prescribe.
    settlings
        How contact settled in each load step, where it does (`isorod.statics.contact_policy`).
    stabilisation
        Of bodies that only contact holds, what is left of the forces that held them on the way, relative to those that
        supports and loads carry, and the solutions it took to let them vanish (`isorod.statics.stabilisation`); None
        where supports hold all.
    path
        Load steps of a model with contact, or where they are to be kept.
    negative_eigenvalues
        Of the tangent stiffness: in so many directions the equilibrium is unstable; None where that is unknown, as with
        friction (`isorod.statics.stability`).
    ties
        What each tie of the model carries.
    largest
        Over time, where a state at a kink of a table stored more energy than the last one, that of most: errors are
        those there.
    in_more_steps
        Returns the equilibrium that twice as many load steps reach; collective.
    coarser
        That of half as many load steps, where these were doubled.
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

        It takes about twice as long as the solution, once; pictures drawn afterwards say that of stresses.  They are
        sums of those of the approximation across the ``"section"`` and along the ``"axis"``, unless one of them is
        asked for, and of what springs give way that points stick by.  To that of works comes what recovered strains
        say of finite element bodies; of stresses there is none with these.  Over time they are those where most energy
        was stored.
        """
        return self._estimated(directions) if directions else self._errors

    @cached_property
    def _errors(self) -> "Error":
        found = self._estimated(())
        if found.work is None or self.steps_error is None:
            return found
        return found._replace(work=found.work + self.steps_error)

    def _estimated(self, directions: Sequence[str]) -> "Error":
        from isorod.checks import embedded, estimate

        if self.largest is not None:
            return self.largest._estimated(directions)
        carried = self.reactions, self.moments
        reached = estimate.Reached(self.displacement, self.work, self.pressures, self.contacts, carried, self.solids)
        found = estimate.of_equilibrium(self.model, reached, directions, self.ranks)
        if self.model.solids:
            meshes = self._of_solids[0].work
            # Beside contact the rods' part is not known, and not counted.
            rods = 0.0 if self.model.contacts else found.work
            found = estimate.Error(None if rods is None or meshes is None else rods + meshes, None)
        stretched = float(sum(one.stretched for one in self.contacts))
        more = stretched and stretched / max(2.0 * self._stored, abs(self.work))
        more += 0.0 if directions else embedded.of(self).error
        return found if found.work is None else found._replace(work=found.work + more)

    @cached_property
    def steps_error(self) -> float | None:
        """The error of supports' forces, and of displacements in the end, by few load steps.

        They depend on these with laws with memory, and over time with friction; elsewhere None.

        It is relative to the largest on the way, and that of twice or half as many load steps apart, where what they
        err by halves as they double.
        """
        if self.coarser is not None:
            return self.coarser._apart(self)
        rubs = self.model.times is not None and any(one.friction for one in self.model.contacts)
        if not (self.model.remembers or rubs) or self.in_more_steps is None:
            return None
        # It takes a run in twice as many once.
        return 2.0 * self._apart(self.in_more_steps(self))

    def _apart(self, finer: "Equilibrium") -> float:
        """Return how far another is, of supports' forces and of displacements, relative to the largest on its way."""
        before, after = self._carried(), finer._carried()
        known = [one for one in before if one in after]
        state, changes = finer if finer.largest is None else finer.largest, []
        largest, extent = float(np.abs(state.displacement).max(initial=0.0)), self.model.size
        stores = all(getattr(law, "stores", True) for body in self.model.bodies for law in body.laws)
        inside = state._stored / max(largest, _LITTLE * extent) if stores else 0.0
        for k in range(2):
            old, new = (np.array([one[factor][k] for factor in known]) for one in (before, after))
            # In the end all may be let go, and supports of what expands freely carry rounding.
            most = max(np.abs(one).max() for pair in after.values() for one in pair)
            size = max(np.abs(new).max(initial=0.0), _LITTLE * most, _LITTLE * inside * extent**k)
            changes.append(float(np.abs(old - new).max(initial=0.0)) / size if size else 0.0)
        apart = float(np.abs(finer.displacement - self.displacement).max(initial=0.0))
        changes.append(apart / largest if largest else 0.0)
        return max(changes)

    def _carried(self) -> dict[float, tuple[Array, Array]]:
        """Return forces and moments of the supports at load factors at which these are known."""
        known = {one.factor: (one.reactions, one.moments) for one in self.path if len(one.reactions)}
        return known | {1.0: (self.reactions, self.moments)}

    @property
    def factors(self) -> list[float]:
        """Load factors at which load steps have ended, where these are known: with a memory, contact, or kept."""
        ends = {*(one.factor for one in self.path), *(one.factor for one in self.model.past)}
        return sorted(ends | {1.0})

    @cached_property
    def _of_solids(self) -> "tuple[Error, Array | None]":
        from isorod.checks import estimate

        return estimate.of_solids(self.model, self.solids, self._stored)

    @property
    def coarsest(self) -> Array | None:
        """Where finite element bodies have most of the error of works, shape ``(3,)``; None without an estimate."""
        state = self if self.largest is None else self.largest
        return state._of_solids[1] if self.model.solids else None

    @property
    def _stored(self) -> float:
        """Energy of the rods."""
        return sum(self.energy(b) for b in range(len(self.model.bodies)))

    @property
    def stress_error(self) -> float | None:
        """The estimate of the error of stresses, where `errors` has computed it: pictures show it."""
        known: Error | None = self.__dict__.get("_errors")
        return None if known is None else known.stress

    def dissipated(self, body: Named) -> float:
        """Return what laws with memory have dissipated in a body (`isorod.output.energy.dissipated`)."""
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
        """Return the derivatives of what is measured by parameters (`isorod.statics.derivatives.derivatives`).

        Of laws with memory, and with friction, they are those along the path (`isorod.statics.along_path`).
        """
        from isorod.statics import along_path, derivatives

        return (along_path if along_path.suits(self) else derivatives).derivatives(self, make, at, measure)

    def record(self) -> dict[str, Any]:
        """Return what a record keeps of it; area in contact and deepest penetration are those of all contacts."""
        kept = (
            "newton_iterations",
            "linear_iterations",
            "load_steps",
            "cuts",
            "residual_norms",
        )
        found = {name: getattr(self, name) for name in (*kept, "negative_eigenvalues")}
        if self.model.times is not None:
            found["end_time"] = self.model.times.end
        laws = [law for body in self.model.bodies for law in body.laws if law.remembers]
        if laws and all("dissipated" in law.states for law in laws):
            found["dissipated"] = sum(self.dissipated(b) for b in range(len(self.model.bodies)))
        if self.pressures:
            found["pressures"] = sum(one.size for one in self.pressures if one is not None)
        if self.contacts:
            found["contact_area"] = sum(one.area for one in self.contacts)
            found["penetration"] = max(one.penetration for one in self.contacts)
            found["augmentations"] = self.augmentations
            found["contacts"] = [one.record() for one in self.contacts]
        if self.ties:
            found["ties"] = [one.record() for one in self.ties]
        if self.stabilisation is not None:
            found["stabilisation"], found["stabilisation_rounds"] = self.stabilisation
        return found

    def frames(self) -> list[tuple[float, Deformation]]:
        """Return load factor, or time, and state of each load step that was kept, this one the last."""
        before = [
            replace(
                self,
                model=self.model.after([one for one in self.model.past if one.factor < step.factor]),
                factor=step.factor,
                displacement=step.displacement,
                reactions=step.reactions,
                moments=step.moments,
                pressures=step.pressures,
                solids=step.solids,
                # These are of the last one alone.
                contacts=(),
                ties=(),
            )
            for step in self.path[:-1]
            if step.displacement is not None
        ]
        times = self.model.times
        return [(one.factor if times is None else times.time(one.factor), one) for one in (*before, self)]

    def curves(self) -> dict[str, Array]:
        """Return load factor or time, displacement and force of each support: from rest, a row a load step kept."""
        when, states = zip(*self.frames(), strict=True)
        frames = [one for one in states if isinstance(one, Equilibrium)]
        count = len(self.model.supports)
        rest = np.zeros((1, count, 3))
        moved = [support_displacements(self.model, one.displacement) for one in frames]
        found = {self._counted: np.array([0.0, *when])}
        found |= by_name("support", "displacement", np.append(rest, np.reshape(moved, (len(frames), count, 3)), 0))
        return found | by_name("support", "force", np.append(rest, [one.reactions[:count] for one in frames], 0))

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement, shape ``(nodes, 3)``, and its pressure coefficients if it has some.

        With contact comes ``contact_pressure``: a row a point, its axis parameter, angle, pressure, contact, and the
        radius on the disk, less than 1 in a hole.
        """
        found = super().fields(body)
        pressure = self.pressures[body] if self.pressures else None
        if pressure is not None:
            found["pressure"] = pressure
        if any((one.body == body).any() for one in self.contacts):
            rod, rows = self.model.bodies[body].space.rod, []
            for k, (asked, one) in enumerate(zip(self.model.contacts, self.contacts, strict=True)):
                here = one.body == body
                behind = [
                    np.full(here.sum(), each) for each in (k, asked.disk_radius(body, rod) if here.any() else 1.0)
                ]
                rows.append(np.column_stack([one.parameters[here], one.pressure[here], *behind]))
            found["contact_pressure"] = np.concatenate(rows)
        return found

    def with_largest(self, turn: Turn | None) -> "Equilibrium":
        """Return it with the state of most energy on the way, where that is not this one."""
        times = self.model.times
        if turn is None or times is None or not times.time(turn.factor):
            return self
        model, before = until(self.model, times.time(turn.factor)), self.model.past
        assert model.times is not None
        before = [one for one in before if one.factor < turn.factor]
        past = [one._replace(factor=model.times.place(times.time(one.factor))) for one in before]
        there = replace(
            self,
            model=model.after(past),
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
