"""Static equilibrium: SNES with load continuation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.formulation import assembler_for
from isorod.checks import hourglass, overlap, rigid_motions, small
from isorod.checks.reactions import by_name, carried, check_balance, check_means, support_displacements
from isorod.checks.tie_result import TieResult, at_load
from isorod.checks.turning import refuse_small
from isorod.errors import whole_number
from isorod.model.model import Model, unmoved
from isorod.output.progress import Teller
from isorod.output.solids import WithSolids
from isorod.output.state import Animated, Deformation, State
from isorod.petsc.library import solver_types
from isorod.petsc.options import in_force
from isorod.statics import stability
from isorod.statics.climb import begin, climb, descend
from isorod.statics.contact_policy import outcome
from isorod.statics.newton import Newton
from isorod.statics.path import Path, Step

if TYPE_CHECKING:
    from isorod.checks.estimate import Error
    from isorod.contact.result import ContactResult
    from isorod.output.matrices import Matrices


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
    augmentations
        Updates of the multipliers of contact.
    moments
        Moment of each support on the model about the mean of its nodes' present positions, shape ``(supports, 3)``.
    work
        Sum of the supports' forces times the displacements, and moments times the turns, that they prescribe.
    stabilisation
        Of bodies that only contact holds, what is left of the forces that held them on the way, relative to those that
        supports and loads carry, and the solutions it took to let them vanish (`isorod.statics.stabilisation`); None
        where supports hold all.
    path
        Load steps of a model with contact, or where they are to be kept.
    negative_eigenvalues
        Of the tangent stiffness: in so many directions the equilibrium is unstable; None where that is not told, as
        with friction (`isorod.statics.stability`).
    ties
        What each tie of the model carries.
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
    augmentations: int = 0
    linear_iterations: int = 0
    moments: Array = field(default_factory=lambda: np.zeros((0, 3)))
    work: float = 0.0
    stabilisation: "tuple[float, int] | None" = None
    path: Sequence[Step] = ()
    negative_eigenvalues: int | None = None
    ties: Sequence[TieResult] = ()
    _counted: ClassVar[str] = "load factor"

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
        say of finite element bodies; of stresses there is none with these.
        """
        return self._estimated(directions) if directions else self._errors

    @cached_property
    def _errors(self) -> "Error":
        return self._estimated(())

    def _estimated(self, directions: Sequence[str]) -> "Error":
        from isorod.checks import embedded, estimate

        found = estimate.of_equilibrium(
            self.model,
            self.displacement,
            self.work,
            self.pressures,
            directions,
            self.ranks,
            self.contacts,
            (self.reactions, self.moments),
            self.solids,
        )
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
    def _of_solids(self) -> "tuple[Error, Array | None]":
        from isorod.checks import estimate

        return estimate.of_solids(self.model, self.solids, self._stored)

    @property
    def coarsest(self) -> Array | None:
        """Where finite element bodies have most of the error of works, shape ``(3,)``; None without an estimate."""
        return self._of_solids[1] if self.model.solids else None

    @property
    def _stored(self) -> float:
        """Energy of the rods."""
        return sum(self.energy(b) for b in range(len(self.model.bodies)))

    @property
    def stress_error(self) -> float | None:
        """The estimate of the error of stresses, where `errors` has told one: pictures say it."""
        known: Error | None = self.__dict__.get("_errors")
        return None if known is None else known.stress

    def matrices(self, lumped: bool = False) -> "Matrices":
        """Return the tangent stiffness and the mass about it (`isorod.output.matrices.matrices`)."""
        from isorod.output.matrices import matrices

        return matrices(self.model, self, lumped)

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
        """Return load factor and state of each load step that was kept, this one the last."""
        before = [
            replace(
                self,
                factor=step.factor,
                displacement=step.displacement,
                reactions=step.reactions,
                moments=step.moments,
                pressures=step.pressures,
                # These are of the last one alone.
                contacts=(),
                ties=(),
            )
            for step in self.path[:-1]
            if step.displacement is not None
        ]
        return [(one.factor, one) for one in (*before, self)]

    def curves(self) -> dict[str, Array]:
        """Return load factor, and displacement and force of each support: from rest, a row a load step kept."""
        frames = [one for _, one in self.frames() if isinstance(one, Equilibrium)]
        count = len(self.model.supports)
        rest = np.zeros((1, count, 3))
        moved = [support_displacements(self.model, one.displacement) for one in frames]
        found = {"load factor": np.array([0.0, *(one.factor for one in frames)])}
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


def solve(
    model: Model,
    load_steps: int = 1,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    start: Array | None = None,
    keep: bool = False,
    stable: bool = False,
    progress: bool = False,
    outputs: int | None = None,
) -> Equilibrium:
    """Bring supports and loads to their full values and return the equilibrium.

    In a load step no support turns by more than a quarter of a turn, and no section of its body by half a turn, so that
    whole turns are counted (`isorod.checks.turning`).  Each step starts with a predictor, linear from the last
    equilibrium or, once there are two, the cubic through both with their tangents, then SNES
    (`isorod.statics.convergence` says when it has converged).  A step in which SNES diverges, an element inverts
    (``det F <= 0``) or loses most of its volume, a section turns too far, or bodies in contact go through each other,
    is halved and tried again; after quick steps the step doubles.  In the end multipliers of contact are added, and
    points of it, as far as these are wanted (`isorod.statics.contact_policy`).  With friction, which depends on the
    path, that is done in each step, and each goes on from where points stick and slip at the end of the one before.

    Parameters
    ----------
    model
        Bodies and supports; a rigid motion that these leave free must be held by contact in the end
        (`isorod.statics.stabilisation`).
    load_steps
        Number of equal steps to start with.
    petsc
        PETSc options for this solve alone, such as ``{"snes_rtol": 1e-10}`` (`isorod.petsc.options.in_force`).
    start
        Displacement ``(dofs,)`` near that at the full load, such as that on another space
        (`isorod.space.transfer`): the equilibrium is looked for there and, where it is not found, or not seen to be
        wound as often as supports turn, from rest.  With friction, which depends on the path, it is where the first
        step looks for its equilibrium if ``load_steps`` is 1.
    keep
        Keep the state of each load step (`Equilibrium.path`).
    stable
        Go on from an equilibrium that is not stable to one that is, the way that the model would go.
    progress
        Show on standard error how far it is (`isorod.output.progress`).
    outputs
        Number of equilibria, evenly spaced in the load factor, that are kept and make the curves (`Equilibrium.path`);
        where not given those of the load steps taken, if they are kept.

    Raises
    ------
    InputError
        If it is not a model, the number of steps none, an option is refused, a body whose law is of small strains is
        turned by more than a quarter of a turn, or what is to be stable has no stability (`isorod.statics.stability`).
    SolveError
        If a rigid motion is free, or a step was halved ten times in vain: the message names element, axis position and
        ``det F``, or the bodies; or penetration does not fall to what the contact asks for; or no stable equilibrium is
        found.
    """
    unmoved(model, "statics")
    load_steps = whole_number("load steps", load_steps, 1, 1_000_000)
    with in_force(petsc):
        return _solve(model, load_steps, comm, start, (keep, outputs), stable, progress)


def _solve(
    model: Model,
    load_steps: int,
    comm: PETSc.Comm | None,
    start_at: Array | None,
    kept: tuple[bool, int | None],
    stable: bool,
    progress: bool,
) -> Equilibrium:
    """Return what `solve` does, as the options in force say."""
    start = perf_counter()
    refuse_small(model)
    loose = rigid_motions.left_to_contact(model)
    overlapped = overlap.warn_at_rest(model)
    assembler = assembler_for(model, comm)
    if assembler.contact is not None and start_at is not None:
        # The matrix is made with room for what touches there.
        assembler.contact.tangent(np.pad(start_at, (0, assembler.contact.beyond.size)))
    solver, told = Newton(assembler, loose), Teller()
    if progress and assembler.comm.getRank() == 0:
        solver.tell = told
    try:
        if stable:
            stability.refuse_untold(solver)
        setup = perf_counter() - start
        assembler.seconds = 0.0
        path = Path(assembler, *kept)
        found = None if path.outputs else begin(solver, start_at, path)
        augmentations = climb(solver, load_steps, path, start_at) if found is None else found
        held = solver.settle()
        if stable:
            augmentations += descend(solver, path)
        displacement = assembler.displacement(solver.x, 1.0)
        _, reactions, moments, work = carried(assembler, solver.x, 1.0)
        rtol = solver.snes.getTolerances()[0]
        assembly, solved = assembler.seconds, perf_counter()
        check_balance(assembler, solver.x, displacement, reactions, moments, solver.norms[-1], rtol)
        check_means(assembler, solver.x, reactions, moments)
        overlap.warn_in_the_end(model, displacement, overlapped)
        small.warn_of_large(model, displacement[None], [assembler.solids(solver.x, 1.0)])
        rules = hourglass.better_rules(model)
        if rules:
            hourglass.check_energy(assembler, rules, displacement, assembler.energy(solver.x, 1.0))
        contacts = () if assembler.contact is None else outcome(assembler.contact, assembler.touching(solver.x, 1.0))
        stabilisation = None if held is None else (held.left, held.rounds)
        negative = stability.negative_eigenvalues(solver)
        stability.warn_of(negative)
        seconds = {"setup": setup, "assembly": assembly, "solve": solved - start - setup - assembly}
        seconds["check"] = perf_counter() - solved
        return Equilibrium(
            model=model,
            displacement=displacement,
            reactions=reactions,
            moments=moments,
            work=work,
            load_steps=len(path.steps),
            cuts=solver.cuts,
            newton_iterations=solver.iterations,
            linear_iterations=solver.linear_iterations,
            residual_norms=solver.norms,
            seconds=seconds,
            built=assembler.built,
            solver=solver_types(solver.snes),
            ranks=assembler.comm.getSize(),
            contacts=contacts,
            augmentations=augmentations,
            pressures=assembler.pressures(solver.x),
            stabilisation=stabilisation,
            path=path.steps if any(kept) or assembler.contact is not None else (),
            negative_eigenvalues=negative,
            ties=at_load(assembler, solver.x, 1.0),
            solids=assembler.solids(solver.x, 1.0),
        )
    finally:
        told.close()
        solver.destroy()
