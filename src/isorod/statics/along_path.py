"""Derivatives along the path of load steps: of laws with memory, friction, and wherever the tangent is not exact.

In an increment the residual ``R(u, s, p) = 0`` depends on the state ``s`` at the end of the last increment, which is a
function of the parameter ``p`` too.  The increments of the solution are repeated, together with models of perturbed
parameters (`isorod.statics.differences`) that have states of their own.  These are brought into equilibrium with the
factors of the solution's consistent tangent, ``K du = -R``, starting from the solution plus their last difference to
it.  That is direct differentiation (P. Michaleris, D. A. Tortorelli & C. A. Vidal, Tangent operators and design
sensitivity formulations for transient non-linear coupled problems with applications to elastoplasticity, IJNME 37
(1994) 2471-2499) without the derivative of a return mapping by hand: an increment costs one tangent for any number of
parameters, and a few residuals and back-substitutions for each.  With the symmetric part of a tangent there are more of
these.  Derivatives are those of a solution with the same increments.

Where contact settles in each increment (`isorod.statics.contact_policy`), all models update their multipliers as often
as the solution does, and have stick points of their own.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks.reactions import carried
from isorod.errors import SolveError
from isorod.model.model import Model
from isorod.model.past import Past
from isorod.options import defaults
from isorod.petsc.direct import direct, room
from isorod.statics.along_contact import PREDICTORS, Touching
from isorod.statics.contact_policy import Settling, Stage
from isorod.statics.derivatives import as_solved, equilibrium, numbers
from isorod.statics.differences import (
    ASIDE,
    BY,
    NEAR,
    Derivatives,
    Kinked,
    Measured,
    PerturbedModels,
    Steps,
    near,
    silently,
)
from isorod.statics.path import Step

# Iterations stop when a correction leaves more than this fraction of the residual, by rounding or by a wrong tangent;
# their maximum number.
_LEAVES, _MOST = 0.5, 40

# Residual over forces allowed in the solution's own increments.  For perturbed models it is relative to what rounding
# leaves there: with the solution's tangent, and with their own.
_BALANCED, _ROUNDED, _OWN = 1e-6, 4.0, 100.0

# Maximum number of unknowns of all models that are followed together: some 5 kB of memory each.
_TOGETHER = 400_000

# Difference allowed between the predicted end of an increment and that of the solution, relative to its largest
# displacement; number of iterative refinements with the factors of another model's tangent.
_AHEAD, _REFINED = 1e-4, 2

# Least rounding assumed, where the solution's residual vanishes.
_LEAST = 1e-14


class _Tangent:
    """A tangent and its factors, made on first use."""

    def __init__(self) -> None:
        self._matrix: PETSc.Mat | None = None
        self._ksp: PETSc.KSP | None = None

    def close(self) -> None:
        """Give back matrix and factors."""
        for item in (self._ksp, self._matrix):
            if item is not None:
                item.destroy()

    def fill(self, assembler: Assembler, x: PETSc.Vec, factor: float) -> None:
        """Set the tangent at a state."""
        if self._matrix is None:
            self._matrix = assembler.matrix()
            self._ksp = direct(self._matrix, factorisation(assembler))
        assembler.tangent(x, factor, self._matrix)

    def solved(self, force: PETSc.Vec, near: "_Tangent | None" = None) -> PETSc.Vec:
        """Return the displacement by a force; by refinement with the factors of a nearby tangent if given."""
        if near is not None:
            displacement = near.solved(force)
            for _ in range(_REFINED):
                displacement.axpy(1.0, near.solved(force - self._matrix * displacement))
            return displacement
        assert self._ksp is not None
        displacement = force.duplicate()
        self._ksp.solve(force, displacement)
        return displacement


class _Run:
    """A model on a path of increments; its laws have the state at the start of the present one.

    Attributes
    ----------
    x, left
        The end of the increment, and its residual relative to the largest forces so far.
    """

    def __init__(self, model: Model, comm: PETSc.Comm, settlings: Sequence[Settling]) -> None:
        self.assembler = assembler_for(model, comm)
        self.touching = Touching(self.assembler, settlings[:1])
        self.x, self._rest = self.assembler.vector(), self.assembler.vector()
        self._acting = np.empty(0)
        self._past, self._steps = list[Past](), list[Step]()
        self.left = self._most = 0.0

    def balance(self, factor: float, near: _Tangent, own: _Tangent, most: tuple[float, float]) -> None:
        """Iterate the end of an increment to equilibrium, to round-off level.

        Parameters
        ----------
        near, own
            A nearby tangent; and one that is filled at each iterate where the first leaves more than ``most[0]``, as
            where points yield that do not in the solution.
        most
            Residuals allowed with these.
        """
        last, tangent, fresh = np.inf, near, False
        for _ in range(_MOST):
            self._acting = self.assembler.acting(self.x, factor, self._rest)
            self._most = max(self._most, float(np.linalg.norm(self._acting)))
            self.left = self._rest.norm() / (self._most or 1.0)
            if not self.left < _LEAVES * last:
                if fresh or self.left <= most[0] or not np.isfinite(self.left):
                    break
                tangent, fresh = own, True
            if fresh:
                tangent.fill(self.assembler, self.x, factor)
            last = self.left
            self.x.axpy(-1.0, tangent.solved(self._rest))
        if not self.left <= most[fresh]:
            raise SolveError(f"no equilibrium at {self.assembler.model.when(factor)}")
        # Displacements are rounded: in stiff directions that is most of the residual.
        (change,) = self.assembler.acting_along(self.x, factor, [tangent.solved(self._rest)])
        self._acting = self._acting - change

    def leave(self, factor: float, like: Step | None) -> None:
        """Record the end of the increment, as a load step of the solution does, and begin the next."""
        displacement = self.assembler.displacement(self.x, factor).copy()
        if like is not None:
            own = carried(self.assembler, self.x, factor, self._acting)
            step, contact = Step(factor, own.reactions, moments=own.moments), self.assembler.contact
            if contact is not None:
                step = step._replace(push=contact.push(), obstacles=contact.obstacle_loads())
            if like.displacement is not None:
                step = step._replace(displacement=displacement, pressures=self.assembler.pressures(self.x))
            self._steps.append(step)
        if factor < 1.0:
            self._past.append(Past(factor, displacement))
            self.assembler.advance(self.x, factor)

    def answer(self, solution: Any) -> Any:
        """Return the results at the end."""
        result = equilibrium(solution, self.assembler, self.x, self._acting)
        return replace(result, model=self.assembler.model.after(self._past), path=self._steps, largest=None)


class _Replay:
    """The path of a solution, repeated together with perturbed models.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`.
    """

    def __init__(self, solution: Any) -> None:
        self.comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD
        self.run, self._solution = _Run(solution.model.after(()), self.comm, solution.settlings), solution
        self._settlings = {settling.factor: settling for settling in solution.settlings}
        self._tangents = _Tangent(), _Tangent()

    def close(self) -> None:
        """Give back matrices and factors."""
        for tangent in self._tangents:
            tangent.close()

    def go(self, beside: Mapping[str, Sequence[_Run]]) -> dict[str, str]:
        """Take all increments, with the perturbed models; return why some of these failed, by their names."""
        own, none, start = self.run, dict[str, str](), 0.0
        for end, like in increments(self._solution):
            factor, settling = end.factor, self._settlings.get(end.factor)
            if settling is not None:
                self._begin(start, settling, [*chain.from_iterable(beside.values())])
            for stage in [Stage(end.displacement)] if settling is None else settling.stages:
                none |= self._reach(factor, stage, beside)
                beside = {name: runs for name, runs in beside.items() if name not in none}
                self._update(factor, stage, [*chain.from_iterable(beside.values())])
            for run in (own, *chain.from_iterable(beside.values())):
                run.leave(factor, like)
            start = factor
        return none

    def _begin(self, start: float, settling: Settling, beside: Sequence[_Run]) -> None:
        """Begin an increment in which contact settles; each model has a predicted end of its own."""
        own, (tangent, spare) = self.run, self._tangents
        times = settling.penalties / own.touching.penalties
        for run in (own, *beside):
            run.touching.begin(run.x, start)
            run.touching.harden(times)
        places = [settling.ahead] * len(beside)
        if own.touching.rubs:
            tangent.fill(own.assembler, own.x, start)
            ahead = partial(own.touching.ahead, own.x, start, settling.factor - start, tangent.solved)
            off = [float(np.abs(ahead(predictor) - settling.ahead).max()) for predictor in PREDICTORS]
            if not min(off) <= _AHEAD * np.abs(settling.ahead).max():
                raise SolveError(f"the increment to {own.assembler.model.when(settling.factor)} is foreseen otherwise")
            predictor = PREDICTORS[int(np.argmin(off))]
            there = ahead(predictor)
            for k, run in enumerate(beside):
                spare.fill(run.assembler, run.x, start)
                solved = partial(spare.solved, near=tangent)
                change = run.touching.ahead(run.x, start, settling.factor - start, solved, predictor) - there
                places[k] = settling.ahead + change
        for run, place in zip((own, *beside), (settling.ahead, *places), strict=True):
            run.touching.go(place, settling.points)

    def _reach(self, factor: float, stage: Stage, beside: Mapping[str, Sequence[_Run]]) -> dict[str, str]:
        """Go to an equilibrium of the solution, and to those of the perturbed models; return why some of these fail."""
        own, (tangent, spare), none = self.run, self._tangents, dict[str, str]()
        before = own.x
        # Pressures are kept at the end alone.
        pressures = self._solution.pressures if factor == 1.0 else own.assembler.pressures(before)
        own.x = own.assembler.state(stage.displacement, pressures)
        if stage.penalties is not None:
            times = stage.penalties / own.touching.penalties
            for run in (own, *chain.from_iterable(beside.values())):
                run.touching.harden(times)
        tangent.fill(own.assembler, own.x, factor)
        own.balance(factor, tangent, tangent, (_BALANCED, _BALANCED))
        rounding = max(own.left, _LEAST)
        for name, runs in beside.items():
            try:
                for run in runs:
                    run.x.axpy(1.0, own.x - before)
                    run.balance(factor, tangent, spare, (_ROUNDED * rounding, _OWN * rounding))
            except SolveError as problem:
                none[name] = f"beside it there is {problem}"
        return none

    def _update(self, factor: float, stage: Stage, beside: Sequence[_Run]) -> None:
        """Update multipliers as in the solution."""
        if stage.update is not None:
            penalties, in_cells, part = stage.update
            times = penalties / self.run.touching.penalties
            for run in (self.run, *beside):
                run.touching.harden(times)
                run.touching.update(run.x, factor, in_cells, part)


def increments(solution: Any) -> list[tuple[Past, Step | None]]:
    """Return the ends of the increments on which the solution depends, and their load steps where it has these."""
    steps = {step.factor: step for step in solution.path}
    if solution.settlings:
        ends = [Past(settling.factor, settling.stages[-1].displacement) for settling in solution.settlings]
    else:
        known = [Past(step.factor, step.displacement) for step in solution.path if step.displacement is not None]
        before = solution.model.past if solution.model.remembers else known
        ends = [*(past for past in before if past.factor < 1.0), Past(1.0, solution.displacement)]
    return [(end, steps.get(end.factor)) for end in ends]


def suits(solution: Any) -> bool:
    """Return whether derivatives of a solution are to be taken along the path.

    They are with memory, without contact; with friction, where no stabilisation has held bodies; with follower
    pressures, whose tangent may lack its unsymmetric part; and where states over time are kept, which results may use.
    With finite element bodies there are none.
    """
    model = solution.model
    if model.solids:
        return False
    if model.contacts:
        rubs = any(contact.friction for contact in model.contacts) and not model.remembers
        return bool(rubs and solution.settlings and solution.stabilisation is None)
    return bool(
        model.remembers
        or (model.following and model.has_potential)
        or (model.times is not None and len(increments(solution)) > 1)
    )


def derivatives(
    solution: Any,
    make: Callable[[Mapping[str, float]], Model],
    at: Mapping[str, float],
    measure: Callable[[Any], Mapping[str, object]],
) -> Derivatives:
    """Return the same as `isorod.statics.derivatives.derivatives`, for a solution that depends on its path.

    Raises
    ------
    InputError
        As there.
    SolveError
        If an increment cannot be repeated.
    """
    beside = PerturbedModels(as_solved(make, solution.model.times), at, solution.model)
    # With small steps few points begin to flow, slip or touch; where none do, larger ones have less rounding.
    laws = [law for body in solution.model.bodies for law in body.laws]
    kinks = any(law.kinks or not getattr(law, "stores", True) for law in laws)
    fractions = [NEAR, ASIDE] if solution.model.contacts else [NEAR if kinks else BY]
    left, rates = list(at), dict[str, Measured]()
    many = max(1, _TOGETHER // (4 * max(solution.model.unknowns, 1)))
    for fraction in fractions:
        none = dict[str, str]()
        for first in range(0, max(len(left), 1), many):
            steps, runs = dict[str, Steps](), dict[str, list[_Run]]()
            with closing(_Replay(solution)) as replay, silently(), defaults(room(replay.comm)):
                for name in left[first : first + many]:
                    try:
                        steps[name], models = beside.models(name, fraction)
                        runs[name] = [_Run(model, replay.comm, solution.settlings) for model in models]
                    except Kinked as problem:
                        none[name] = str(problem)
                none |= replay.go(runs)
                values, measured = near(lambda result: numbers(measure(result)), replay.run.answer(solution))
                for name, own in runs.items():
                    try:
                        if name not in none:
                            ends = [measured(run.answer(solution)) for run in own]
                            rates[name] = steps[name].slopes(ends, values)
                    except Kinked as problem:
                        none[name] = str(problem)
        left = list(none)
        if not left:
            break
    return Derivatives(beside.at, values, {name: rates[name] for name in at if name in rates}, none).of_peaks()
