"""Static equilibrium: SNES with load continuation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.formulation import assembler_for
from isorod.checks import hourglass, overlap, rigid_motions
from isorod.checks.reactions import by_support, check_balance, support_displacements, support_forces, support_moments
from isorod.errors import SolveError, expect, whole_number
from isorod.model.model import Model
from isorod.output.state import Animated, Deformation, State
from isorod.petsc.library import solver_types
from isorod.petsc.options import in_force
from isorod.statics.multipliers import outcome, settle
from isorod.statics.newton import Diverged, Newton, TooDeep
from isorod.statics.path import Path, Step

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult
    from isorod.output.matrices import Matrices


# A load step is halved at most this many times.
HALVINGS = 10

# A step doubles after one of at most so many linear solves; where points come into contact more are usual.
_QUICK, _QUICK_TOUCHING = 4, 6

# With contact, where steps that fail cost most, it takes as many of them more as steps were cut, at most so many.
_WARY = 4

# Before that, penalties of contact are lowered by this factor.
SOFTER = 0.03


@dataclass(frozen=True, eq=False)
class Equilibrium(State, Animated):
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
        rule), wall time.
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
        Sum of the supports' nodal forces times the displacements they prescribe.
    stabilisation
        Of bodies that only contact holds, what is left of the forces that held them on the way, relative to those that
        supports and loads carry, and the solutions it took to let them vanish (`isorod.statics.stabilisation`); None
        where supports hold all.
    path
        Load steps of a model with contact, or where they are to be kept.
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
        """Return an estimate of the relative error (`isorod.checks.estimate`); None where there is none.

        It takes about as long as the solution.  It is the sum of those of the approximation across the ``"section"``
        and along the ``"axis"``, unless one of them is asked for.
        """
        from isorod.checks import estimate

        asked = directions or estimate.DIRECTIONS
        return estimate.of_equilibrium(
            self.model, self.displacement, self.work, self.pressures, asked, self.ranks, self.contacts
        )

    def matrices(self, lumped: bool = False) -> "Matrices":
        """Return the tangent stiffness and the mass about it (`isorod.output.matrices.matrices`)."""
        from isorod.output.matrices import matrices

        return matrices(self.model, self, lumped)

    def record(self) -> dict[str, Any]:
        """Return what a record keeps of it; area in contact and deepest penetration are those of all contacts."""
        kept = ("newton_iterations", "linear_iterations", "load_steps", "cuts", "residual_norms")
        found = {name: getattr(self, name) for name in kept}
        if self.pressures:
            found["pressures"] = sum(one.size for one in self.pressures if one is not None)
        if self.contacts:
            found["contact_area"] = sum(one.area for one in self.contacts)
            found["penetration"] = max(one.penetration for one in self.contacts)
            found["augmentations"] = self.augmentations
            found["contacts"] = [one.record() for one in self.contacts]
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
                pressures=step.pressures,
                contacts=(),
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
        found |= by_support("displacement", np.append(rest, np.reshape(moved, (-1, count, 3)), 0))
        return found | by_support("force", np.append(rest, [one.reactions[:count] for one in frames], 0))

    def fields(self, body: int) -> dict[str, Array]:
        """Return a body's displacement, shape ``(nodes, 3)``, and its pressure coefficients if it has some.

        With contact comes ``contact_pressure``: a row a point, its axis parameter, angle, pressure and contact.
        """
        found = super().fields(body)
        pressure = self.pressures[body] if self.pressures else None
        if pressure is not None:
            found["pressure"] = pressure
        if any((one.body == body).any() for one in self.contacts):
            found["contact_pressure"] = np.concatenate(
                [
                    np.column_stack([one.parameters, one.pressure, np.full(one.pressure.size, k)])[one.body == body]
                    for k, one in enumerate(self.contacts)
                ]
            )
        return found


def solve(
    model: Model,
    load_steps: int = 1,
    comm: PETSc.Comm | None = None,
    petsc: Mapping[str, object] | None = None,
    start: Array | None = None,
    keep: bool = False,
) -> Equilibrium:
    """Bring supports and loads to their full values and return the equilibrium.

    Each load step starts with a predictor, linear from the last equilibrium or, once there are two, the cubic through
    both with their tangents, then SNES (`isorod.statics.convergence` says when it has converged).  A step in which SNES
    diverges, an element inverts (``det F <= 0``) or loses most of its volume, or bodies in contact go through each
    other, is halved and tried again; after quick steps the step doubles.  In the end multipliers of contact are added,
    and points of it, as far as these are wanted (`isorod.statics.multipliers`).  With friction, which depends on the
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
        (`isorod.space.transfer`): the equilibrium is looked for there and, where it is not found, from rest.  Friction,
        which depends on the path, makes nothing of it.
    keep
        Keep the state of each load step (`Equilibrium.path`).

    Raises
    ------
    InputError
        If it is not a model, or the number of steps none, or an option is refused.
    SolveError
        If a rigid motion is free, or a step was halved ten times in vain: the message names element, axis position and
        ``det F``, or the bodies; or penetration does not fall to what the contact asks for.
    """
    expect("model", model, Model)
    load_steps = whole_number("load steps", load_steps, 1, 1_000_000)
    with in_force(petsc):
        return _solve(model, load_steps, comm, start, keep)


def _solve(model: Model, load_steps: int, comm: PETSc.Comm | None, start_at: Array | None, keep: bool) -> Equilibrium:
    """Return what `solve` does, as the options in force say."""
    start = perf_counter()
    loose = rigid_motions.left_to_contact(model)
    overlapped = overlap.warn_at_rest(model)
    assembler = assembler_for(model, comm)
    solver = Newton(assembler, loose)
    try:
        if assembler.contact is not None:
            assembler.contact.space_evenly()
        setup = perf_counter() - start
        assembler.seconds = 0.0
        path = Path(assembler, keep)
        found = _begin(solver, start_at, path)
        cuts, augmentations = _climb(solver, load_steps, path) if found is None else (0, found)
        held = solver.settle()
        forces = assembler.reactions(solver.x, 1.0)
        displacement = assembler.displacement(solver.x, 1.0)
        reactions, moments = support_forces(model, forces), support_moments(model, displacement, forces)
        rtol = solver.snes.getTolerances()[0]
        assembly, solved = assembler.seconds, perf_counter()
        check_balance(assembler, solver.x, displacement, reactions, moments, solver.norms[-1], rtol)
        overlap.warn_in_the_end(model, displacement, overlapped)
        rules = hourglass.better_rules(model)
        if rules:
            hourglass.check_energy(assembler, rules, displacement, assembler.energy(solver.x, 1.0))
        seconds = {"setup": setup, "assembly": assembly, "solve": solved - start - setup - assembly}
        seconds["check"] = perf_counter() - solved
        return Equilibrium(
            model=model,
            displacement=displacement,
            reactions=reactions,
            moments=moments,
            work=float(forces @ model.prescribed(1.0)[model.bound]),
            load_steps=len(path.steps),
            cuts=cuts,
            newton_iterations=solver.iterations,
            linear_iterations=solver.linear_iterations,
            residual_norms=solver.norms,
            seconds=seconds,
            built=assembler.built,
            solver=solver_types(solver.snes),
            ranks=assembler.comm.getSize(),
            contacts=() if assembler.contact is None else outcome(assembler.contact, displacement),
            augmentations=augmentations,
            pressures=assembler.pressures(solver.x),
            stabilisation=None if held is None else (held.left, held.rounds),
            path=path.steps if keep or assembler.contact is not None else (),
        )
    finally:
        solver.destroy()


def _begin(solver: Newton, start: Array | None, path: Path) -> int | None:
    """Look for the equilibrium near a displacement; return how often multipliers were updated, None if it fails."""
    contact = solver.assembler.contact
    if start is None or (contact is not None and contact.friction is not None) or not solver.begin(start):
        return None
    solver.settle()
    updates = 0 if contact is None else _settle_in_the_end(solver)
    path.reached(solver.x, 1.0)
    return updates


def _climb(solver: Newton, load_steps: int, path: Path) -> tuple[int, int]:
    """Go to the full load; return how many steps were cut, and how often multipliers were updated; fill the path."""
    contact = solver.assembler.contact
    rubs = contact is not None and contact.friction is not None
    stages = solver.assembler.model.stages
    factor, step, cuts, augmentations = 0.0, 1.0 / load_steps, 0, 0
    smallest, quick = step / 2**HALVINGS, 0
    while factor < 1.0:
        end = next(stage for stage in stages if stage > factor)
        target = end if factor + step > end - 1e-12 else factor + step
        try:
            solves, updates = _rub(solver, factor, target) if rubs else (solver.advance(factor, target), 0)
        except Diverged as problem:
            deep = isinstance(problem, TooDeep)
            # Springs of friction are as stiff as penalties: what rubs would slide farther on the way than it has to.
            if contact is not None and not rubs and not deep and contact.may_soften:
                contact.stiffen(SOFTER)
                continue
            if contact is not None and deep and contact.is_soft:
                contact.stiffen(1.0 / SOFTER)
            cuts += 1
            step = 0.5 * (target - factor)
            if step < smallest:
                raise SolveError(f"load factor {target:.6g}: {problem}") from None
            continue
        factor = target
        if factor == end:
            solver.forget_path()
        if factor == 1.0:
            solver.settle()
            if contact is not None and (not rubs or solver.stabilisation is not None):
                updates += _settle_in_the_end(solver)
        augmentations += updates
        path.reached(solver.x, factor)
        quick = quick + 1 if solves <= (_QUICK if contact is None else _QUICK_TOUCHING) else 0
        if factor == end:
            step, quick = 1.0 / load_steps, 0
        elif quick > (0 if contact is None else min(cuts, _WARY)):
            step, quick = 2.0 * step, 0
            if rubs:
                # Whoever asks for more steps, since friction depends on the path, gets them.
                step = min(step, 1.0 / load_steps)
    return cuts, augmentations


def _rub(solver: Newton, factor: float, target: float) -> tuple[int, int]:
    """Take a load step with friction; return how many linear solves it took, and updates of multipliers.

    Friction depends on the path, so multipliers are right at the end of each step.
    """
    contact = solver.assembler.contact
    assert contact is not None
    contact.place(factor)
    contact.accept(solver.assembler.displacement(solver.x, factor))
    start, undo = solver.x.copy(), contact.keep()
    solves = solver.advance(factor, target)
    try:
        return solves, settle(solver, target)
    except Diverged:
        # Shorter steps, whose points stick where they have touched, bring it nearer.
        start.copy(solver.x)
        undo()
        solver.forget_path()
        raise


def _settle_in_the_end(solver: Newton) -> int:
    try:
        return settle(solver, 1.0)
    except Diverged as problem:
        raise SolveError(str(problem)) from None
