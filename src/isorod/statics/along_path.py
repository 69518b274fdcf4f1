"""Derivatives of what laws with memory answer, along the path of their load steps: direct differentiation.

In an increment the residual ``R(u, s, p) = 0`` has the state ``s`` that the increments before have left, which depends
on the parameter too.  The increments of the answer are taken once more.  At the end of each, models beside
(`isorod.statics.differences`) are asked for their residuals where they would be, at ``u + h du/dp``, from states of
their own; the difference over the tangent corrects ``du/dp``, and their states go on from there.  So the states'
derivatives come along, and no return mapping is differentiated by itself (P. Michaleris, D. A. Tortorelli & C. A. Vidal,
Tangent operators and design sensitivity formulations for transient non-linear coupled problems, IJNME 37 (1994)
2471-2499).  The increments stay those of the answer: derivatives are those of the answer in as many.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks.reactions import carried
from isorod.errors import SolveError
from isorod.model.model import Model
from isorod.model.past import Past
from isorod.options import defaults
from isorod.petsc.direct import direct, room
from isorod.statics.derivatives import as_solved, equilibrium, numbers, refuse
from isorod.statics.differences import NEAR, Beside, Derivatives, Kinked, Measured, Steps, silently
from isorod.statics.path import Step

# Corrections of a state, or of a rate, whose residual counts as solved at this share of the forces, or where a
# correction leaves more than this of it: then it is rounding.
_MOST, _SOLVED, _LEAVES = 40, 1e-11, 0.5

# So much of the forces may be left where a state is known; beyond, its tangent is not that of the equilibrium.
_BALANCED, _FAR = 1e-5, 1e-7

# Residuals whose slope is not brought to this share of it, or jumps by more of it, have none.
_ROUGH = 1e-3


class _Walker:
    """A model on the path: its assembler, whose states are those at the start of an increment, and what it leaves.

    Attributes
    ----------
    past, steps
        Where increments but the last have ended, and the load steps of the answer's path.
    acting
        Forces on what supports hold at the end of the last increment (`Assembler.acting`).
    """

    def __init__(self, model: Model, comm: PETSc.Comm) -> None:
        self.assembler = assembler_for(model, comm)
        self.row = self.assembler.vector()
        self.past, self.steps = list[Past](), list[Step]()
        self.acting = np.empty(0)

    def look(self, x: PETSc.Vec, factor: float) -> PETSc.Vec:
        """Return the residual in a state, and note what is acting."""
        self.acting = self.assembler.acting(x, factor, self.row)
        return self.row

    def leave(self, x: PETSc.Vec, factor: float, like: Step | None) -> None:
        """Note where an increment has ended, and let laws go on from there unless it is the last."""
        displacement = self.assembler.displacement(x, factor).copy()
        if like is not None:
            own = carried(self.assembler, x, factor, self.acting)
            step = Step(factor, own.reactions, moments=own.moments)
            if like.displacement is not None:
                step = step._replace(displacement=displacement, pressures=self.assembler.pressures(x))
            self.steps.append(step)
        if factor < 1.0:
            self.past.append(Past(factor, displacement))
            self.assembler.advance(x, factor)

    def answer(self, solution: Any, x: PETSc.Vec) -> Any:
        """Return what answers for it in the end."""
        found = equilibrium(solution, self.assembler, x, self.acting)
        return replace(found, model=self.assembler.model.after(self.past), path=self.steps, largest=None)


class _Rate:
    """How fast the path moves by a parameter: models beside, and the derivative of the unknowns."""

    def __init__(self, steps: Steps, models: Sequence[Model], comm: PETSc.Comm) -> None:
        self.steps = steps
        self.beside = [_Walker(model, comm) for model in models]
        self._rate = self.beside[0].assembler.vector()

    def ends(self, x: PETSc.Vec) -> list[PETSc.Vec]:
        """Return where models beside are."""
        return [x + step * self._rate for step in self.steps.steps]

    def correct(self, way: "_Way", factor: float) -> None:
        """Find how fast the end of an increment moves, from how fast its start does.

        Raises
        ------
        Kinked
            If there is no such rate.
        """
        force, jump = way.walker.row.duplicate(), way.walker.row.duplicate()
        most = way.carried / self.steps.size
        last = np.inf
        for _ in range(_MOST):
            rows = [one.look(x, factor) - way.rest for one, x in zip(self.beside, self.ends(way.x), strict=True)]
            force.zeroEntries()
            force.maxpy(self.steps.weights.tolist(), rows)
            left, most = force.norm(), max(most, force.norm())
            if not _SOLVED * most < left < _LEAVES * last:
                break
            last = left
            self._rate.axpy(-1.0, way.solved(force))
        jump.zeroEntries()
        jump.maxpy(self.steps.jumps.tolist(), rows)
        if not max(left, jump.norm()) <= _ROUGH * most:
            raise Kinked(f"its slope jumps at {way.walker.assembler.model.when(factor)}")

    def leave(self, x: PETSc.Vec, factor: float, like: Step | None) -> None:
        """Let models beside go on."""
        for one, end in zip(self.beside, self.ends(x), strict=True):
            one.leave(end, factor, like)


class _Way:
    """The path of an answer, taken once more: its increments in balance as far as digits go, and their tangents.

    Attributes
    ----------
    x, rest, carried
        The end of an increment, the residual that rounding leaves there, and the size of the forces.
    """

    def __init__(self, solution: Any) -> None:
        self.comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD
        self.walker = _Walker(solution.model.after(()), self.comm)
        self._solution = solution
        self._tangent = self.walker.assembler.matrix()
        with defaults(room(self.comm)):
            self._ksp = direct(self._tangent, factorisation(self.walker.assembler))
        self.x, self.rest = self.walker.assembler.vector(), self.walker.assembler.vector()
        self.carried = 0.0

    def close(self) -> None:
        """Give back matrix and factors."""
        for one in (self._ksp, self._tangent):
            one.destroy()

    def solved(self, force: PETSc.Vec) -> PETSc.Vec:
        """Return the motion that a force makes."""
        found = force.duplicate()
        with defaults(room(self.comm)):
            self._ksp.solve(force, found)
        return found

    def go(self, rates: Mapping[str, _Rate]) -> dict[str, str]:
        """Take the increments, and rates with them; return why some have been left on the way, by their names."""
        solution, none = self._solution, dict[str, str]()
        ends = [*solution.model.past, Past(1.0, solution.displacement)]
        likes = list(solution.path) or [None] * len(ends)
        for end, like in zip(ends, likes, strict=True):
            self._settle(end)
            for name, rate in rates.items():
                if name not in none:
                    try:
                        rate.correct(self, end.factor)
                        rate.leave(self.x, end.factor, like)
                    except Kinked as problem:
                        none[name] = str(problem)
            self.walker.leave(self.x, end.factor, like)
        return none

    def _settle(self, end: Past) -> None:
        """Bring the end of an increment into balance."""
        assembler, last, fresh = self.walker.assembler, np.inf, False
        own = self._solution.pressures if end.factor == 1.0 else assembler.pressures(self.x)
        self.x = assembler.state(end.displacement, own)
        for _ in range(_MOST):
            left = self.walker.look(self.x, end.factor).norm()
            self.carried = float(np.linalg.norm(self.walker.acting))
            if fresh and not _SOLVED * self.carried < left < _LEAVES * last:
                break
            if not fresh or left > _FAR * self.carried:
                # Of laws with memory alone what is left of pressures is not known on the way.
                assembler.tangent(self.x, end.factor, self._tangent)
                fresh = True
            last = left
            self.x.axpy(-1.0, self.solved(self.walker.row))
        if not left <= _BALANCED * self.carried:
            raise SolveError(f"derivatives: no equilibrium once more at {assembler.model.when(end.factor)}")
        self.walker.row.copy(self.rest)


def derivatives(
    solution: Any,
    make: Callable[[Mapping[str, float]], Model],
    at: Mapping[str, float],
    measure: Callable[[Any], Mapping[str, object]],
) -> Derivatives:
    """Return what `isorod.statics.derivatives.derivatives` does, of laws with memory.

    Raises
    ------
    InputError
        As there; with contact too.
    SolveError
        If an increment is not found once more.
    """
    refuse(solution.model)
    beside = Beside(as_solved(make, solution.model.times), at, solution.model)
    found, rates, none = dict[str, Measured](), dict[str, _Rate](), dict[str, str]()
    with closing(_Way(solution)) as way, silently():
        for name in at:
            try:
                rates[name] = _Rate(*beside.models(name, NEAR), way.comm)
            except Kinked as problem:
                none[name] = str(problem)
        none |= way.go(rates)
        values = numbers(measure(way.walker.answer(solution, way.x)))
        for name, rate in rates.items():
            if name in none:
                continue
            ends = [one.answer(solution, x) for one, x in zip(rate.beside, rate.ends(way.x), strict=True)]
            try:
                found[name] = rate.steps.slopes([numbers(measure(one)) for one in ends], values)
            except Kinked as problem:
                none[name] = str(problem)
    return Derivatives(beside.at, values, found, none)
