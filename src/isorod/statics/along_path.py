"""Derivatives along the path of load steps: of laws with memory, friction, and wherever the tangent is not exact.

In an increment the residual ``R(u, s, p) = 0`` has the state ``s`` that the increments before have left, which depends
on the parameter too.  The increments of the answer are taken once more, and beside it models of parameters a little off
(`isorod.statics.differences`) take the same ones, with states of their own: each is brought into balance by the factors
of the answer's consistent tangent, ``K du = -R``, from where the answer ends an increment and what it was off before.
That is direct differentiation (P. Michaleris, D. A. Tortorelli & C. A. Vidal, Tangent operators and design sensitivity
formulations for transient non-linear coupled problems with applications to elastoplasticity, IJNME 37 (1994) 2471-2499)
without the derivative of a return mapping by hand: an increment costs one tangent, whatever number of parameters there
is, and a few residuals and back-substitutions for each.  The symmetric part of a tangent does as well, in more of
these.  Derivatives are those of an answer in as many increments.

Where contact settles in each increment (`isorod.statics.contact_policy`), its multipliers are updated beside the answer
as often as there, and its points of friction hang where each model's own states have left them.
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
from isorod.statics.differences import ASIDE, BY, NEAR, Beside, Derivatives, Kinked, Measured, Steps, near, silently
from isorod.statics.path import Step

# A correction that leaves more than this share of a residual leaves rounding, or has the wrong tangent; how many there
# are at most.
_LEAVES, _MOST = 0.5, 40

# So much of the forces may be left of the answer's own increments.  Of those beside it may be so many times what
# rounding leaves of these: with the answer's tangent, and with their own.
_BALANCED, _ROUNDED, _OWN = 1e-6, 4.0, 100.0

# Unknowns of all models that take the path beside the answer at a time: some 5 kB of memory each.
_TOGETHER = 400_000

# How far the foreseen end of an increment may be from that of the answer, of its largest displacement; how often what
# factors of a tangent beside it say is refined.
_AHEAD, _REFINED = 1e-4, 2

# Where the answer is balanced to the last digit.
_LEAST = 1e-14


class _Tangent:
    """A tangent and its factors; they are made when they are needed first."""

    def __init__(self) -> None:
        self._matrix: PETSc.Mat | None = None
        self._ksp: PETSc.KSP | None = None

    def close(self) -> None:
        """Give back matrix and factors."""
        for one in (self._ksp, self._matrix):
            if one is not None:
                one.destroy()

    def fill(self, assembler: Assembler, x: PETSc.Vec, factor: float) -> None:
        """Let it be that of a state."""
        if self._matrix is None:
            self._matrix = assembler.matrix()
            self._ksp = direct(self._matrix, factorisation(assembler))
        assembler.tangent(x, factor, self._matrix)

    def solved(self, force: PETSc.Vec, near: "_Tangent | None" = None) -> PETSc.Vec:
        """Return the motion that a force makes, by the factors of a tangent that is near if there is one."""
        if near is not None:
            found = near.solved(force)
            for _ in range(_REFINED):
                found.axpy(1.0, near.solved(force - self._matrix * found))
            return found
        assert self._ksp is not None
        found = force.duplicate()
        self._ksp.solve(force, found)
        return found


class _Run:
    """A model that takes the increments of a path; its laws know what was before the one that it is in.

    Attributes
    ----------
    x, left
        The end of the increment, and what is out of balance there, as a share of the largest forces so far.
    """

    def __init__(self, model: Model, comm: PETSc.Comm, settlings: Sequence[Settling]) -> None:
        self.assembler = assembler_for(model, comm)
        self.touching = Touching(self.assembler, settlings[:1])
        self.x, self._rest = self.assembler.vector(), self.assembler.vector()
        self._acting = np.empty(0)
        self._past, self._steps = list[Past](), list[Step]()
        self.left = self._most = 0.0

    def balance(self, factor: float, near: _Tangent, own: _Tangent, most: tuple[float, float]) -> None:
        """Bring the end of an increment into balance, as far as digits go.

        Parameters
        ----------
        near, own
            A tangent near the end; and one that becomes that of each iterate where more than the first of ``most`` is
            left of it, as where points yield that do not in the answer.
        most
            What may be left, with both.
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
        # Displacements are rounded: in stiff directions that is most of what is left.
        (change,) = self.assembler.acting_along(self.x, factor, [tangent.solved(self._rest)])
        self._acting = self._acting - change

    def leave(self, factor: float, like: Step | None) -> None:
        """Note where the increment has ended, as a load step of the answer does, and go on from there."""
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
        """Return what answers for it in the end."""
        found = equilibrium(solution, self.assembler, self.x, self._acting)
        return replace(found, model=self.assembler.model.after(self._past), path=self._steps, largest=None)


class _Replay:
    """The path of an answer, taken once more with others beside it.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`.
    """

    def __init__(self, solution: Any) -> None:
        self.comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD
        self.run, self._solution = _Run(solution.model.after(()), self.comm, solution.settlings), solution
        self._settlings = {one.factor: one for one in solution.settlings}
        self._tangents = _Tangent(), _Tangent()

    def close(self) -> None:
        """Give back matrices and factors."""
        for one in self._tangents:
            one.close()

    def go(self, beside: Mapping[str, Sequence[_Run]]) -> dict[str, str]:
        """Take all increments, and the models beside with it; return why some have not come along, by their names."""
        own, none, start = self.run, dict[str, str](), 0.0
        for end, like in increments(self._solution):
            factor, settling = end.factor, self._settlings.get(end.factor)
            if settling is not None:
                self._begin(start, settling, [*chain.from_iterable(beside.values())])
            for stage in [Stage(end.displacement)] if settling is None else settling.stages:
                none |= self._reach(factor, stage, beside)
                beside = {name: several for name, several in beside.items() if name not in none}
                self._update(factor, stage, [*chain.from_iterable(beside.values())])
            for one in (own, *chain.from_iterable(beside.values())):
                one.leave(factor, like)
            start = factor
        return none

    def _begin(self, start: float, settling: Settling, beside: Sequence[_Run]) -> None:
        """Begin an increment in which contact settles; where it is foreseen to lead is another beside the answer."""
        own, (tangent, spare) = self.run, self._tangents
        times = settling.penalties / own.touching.penalties
        for one in (own, *beside):
            one.touching.begin(one.x, start)
            one.touching.harden(times)
        places = [settling.ahead] * len(beside)
        if own.touching.rubs:
            tangent.fill(own.assembler, own.x, start)
            ahead = partial(own.touching.ahead, own.x, start, settling.factor - start, tangent.solved)
            off = [float(np.abs(ahead(each) - settling.ahead).max()) for each in PREDICTORS]
            if not min(off) <= _AHEAD * np.abs(settling.ahead).max():
                raise SolveError(f"the increment to {own.assembler.model.when(settling.factor)} is foreseen otherwise")
            each = PREDICTORS[int(np.argmin(off))]
            there = ahead(each)
            for k, one in enumerate(beside):
                spare.fill(one.assembler, one.x, start)
                solved = partial(spare.solved, near=tangent)
                change = one.touching.ahead(one.x, start, settling.factor - start, solved, each) - there
                places[k] = settling.ahead + change
        for one, place in zip((own, *beside), (settling.ahead, *places), strict=True):
            one.touching.go(place, settling.points)

    def _reach(self, factor: float, stage: Stage, beside: Mapping[str, Sequence[_Run]]) -> dict[str, str]:
        """Reach an equilibrium of the answer, and the models beside those near it; return why some do not."""
        own, (tangent, spare), none = self.run, self._tangents, dict[str, str]()
        before = own.x
        # Pressures are not known everywhere on the way.
        pressures = self._solution.pressures if factor == 1.0 else own.assembler.pressures(before)
        own.x = own.assembler.state(stage.displacement, pressures)
        if stage.penalties is not None:
            times = stage.penalties / own.touching.penalties
            for one in (own, *chain.from_iterable(beside.values())):
                one.touching.harden(times)
        tangent.fill(own.assembler, own.x, factor)
        own.balance(factor, tangent, tangent, (_BALANCED, _BALANCED))
        rounding = max(own.left, _LEAST)
        for name, several in beside.items():
            try:
                for one in several:
                    one.x.axpy(1.0, own.x - before)
                    one.balance(factor, tangent, spare, (_ROUNDED * rounding, _OWN * rounding))
            except SolveError as problem:
                none[name] = f"beside it there is {problem}"
        return none

    def _update(self, factor: float, stage: Stage, beside: Sequence[_Run]) -> None:
        """Update multipliers as the answer did."""
        if stage.update is not None:
            penalties, in_cells, part = stage.update
            times = penalties / self.run.touching.penalties
            for one in (self.run, *beside):
                one.touching.harden(times)
                one.touching.update(one.x, factor, in_cells, part)


def increments(solution: Any) -> list[tuple[Past, Step | None]]:
    """Return where the increments have ended whose states count, and the load steps that the answer has of them."""
    steps = {one.factor: one for one in solution.path}
    if solution.settlings:
        return [(Past(one.factor, one.stages[-1].displacement), steps.get(one.factor)) for one in solution.settlings]
    known = [Past(one.factor, one.displacement) for one in solution.path if one.displacement is not None]
    before = solution.model.past if solution.model.remembers else known
    ends = [*(one for one in before if one.factor < 1.0), Past(1.0, solution.displacement)]
    return [(one, steps.get(one.factor)) for one in ends]


def suits(solution: Any) -> bool:
    """Return whether derivatives of a solution are to be found along the path.

    They are with a memory, without contact; with friction, where nothing else has held bodies meanwhile; with
    pressures that follow, whose tangent may be symmetric in part alone; and where states over time are kept, of which
    something may be measured.  With finite element bodies there are none.
    """
    model = solution.model
    if model.solids:
        return False
    if model.contacts:
        rubs = any(one.friction for one in model.contacts) and not model.remembers
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
    """Return what `isorod.statics.derivatives.derivatives` does, of a solution and the path to it.

    Raises
    ------
    InputError
        As there.
    SolveError
        If an increment is not found once more.
    """
    beside = Beside(as_solved(make, solution.model.times), at, solution.model)
    # Between models that are near few points begin to flow, slip or touch; where none do there is less rounding
    # farther off.
    laws = [law for body in solution.model.bodies for law in body.laws]
    kinks = any(law.kinks or not getattr(law, "stores", True) for law in laws)
    shares = [NEAR, ASIDE] if solution.model.contacts else [NEAR if kinks else BY]
    left, found = list(at), dict[str, Measured]()
    many = max(1, _TOGETHER // (4 * max(solution.model.unknowns, 1)))
    for share in shares:
        none = dict[str, str]()
        for first in range(0, max(len(left), 1), many):
            steps, runs = dict[str, Steps](), dict[str, list[_Run]]()
            with closing(_Replay(solution)) as replay, silently(), defaults(room(replay.comm)):
                for name in left[first : first + many]:
                    try:
                        steps[name], models = beside.models(name, share)
                        runs[name] = [_Run(model, replay.comm, solution.settlings) for model in models]
                    except Kinked as problem:
                        none[name] = str(problem)
                none |= replay.go(runs)
                values, measured = near(lambda one: numbers(measure(one)), replay.run.answer(solution))
                for name, several in runs.items():
                    try:
                        if name not in none:
                            ends = [measured(one.answer(solution)) for one in several]
                            found[name] = steps[name].slopes(ends, values)
                    except Kinked as problem:
                        none[name] = str(problem)
        left = list(none)
        if not left:
            break
    return Derivatives(beside.at, values, {name: found[name] for name in at if name in found}, none).of_peaks()
