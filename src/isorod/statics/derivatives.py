"""Derivatives of what is measured of an equilibrium by numbers of its model.

Of the residual ``R(u, p) = 0`` the equilibrium moves by ``du/dp = - K^-1 dR/dp``: one back-substitution of the factors
of the tangent for each parameter, whatever is measured.  ``dR/dp`` is a difference of residuals at one displacement, of
models that are built of other parameters on the same discretisation (`isorod.choices`), and so is what is measured,
where these are in balance, to which they come from there with the same factors.
"""

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod import choices
from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks.reactions import carried
from isorod.checks.tie_result import at_load
from isorod.errors import InputError, SolveError
from isorod.model.model import Model
from isorod.options import defaults
from isorod.petsc.direct import direct, room

# What is measured, by its name: numbers or arrays of them.
Measured = dict[str, Array]

# Returns what is measured at steps from a parameter of a name.
Along = Callable[[str, Sequence[float]], list[Measured]]

# Builds are what a derivative costs.  Two models do, this share of the parameter from it, where what is measured bends
# by no more than ``_BENT`` of its slope over the step: of what goes with a power of the parameter the slope is then
# right to the square of that.
_NEAR, _BENT = 2e-4, 1e-3

# Where it bends more they are at so many steps; the weights of a derivative of sixth order, and of one of fourth.
_OFFSETS = (-3, -2, -1, 1, 2, 3)
_WEIGHTS = {
    2: np.array([-0.5, 0.5]),
    6: np.array([-1.0, 9.0, -45.0, 45.0, -9.0, 1.0]) / 60.0,
}
_FOURTH = np.array([0.0, 1.0, -8.0, 8.0, -1.0, 0.0]) / 12.0

# The first step, as a share of the parameter: rounding of forces, some 1e-16 of what elements pass on to each other,
# falls with it.  It is taken anew, shorter, where the two differ by more than ``_ALIKE``, and there is no derivative
# where they still differ by ``_APART``.
_STEP, _SHORTEST, _ATTEMPTS = 8e-3, 1e-5, 3
_ALIKE, _APART = 3e-8, 1e-2

# A model beside comes into balance by a few steps, to such a share of what it moves by, or where digits end, as near as
# the second.
_BALANCES, _BALANCED, _ROUNDED = 12, 1e-11, 1e-6

# At a kink what lies evenly about it cancels: of second differences what grows with the step, not with its square, is
# the jump of the slope.
_JUMP = np.array([-1.0, 0.0, 9.0, 9.0, 0.0, -1.0]) / 6.0

# Less than so much of the value for the whole parameter counts as none.
_NOTHING = 1e-3


@dataclass(frozen=True)
class Derivatives:
    """Derivatives of what is measured by parameters.

    Attributes
    ----------
    parameters
        Their values, by name.
    values
        What is measured, by name.
    by
        Derivatives, ``by[parameter][measured]`` of the shape of what is measured.
    none
        Parameters by which there is no derivative, and why.
    """

    parameters: Mapping[str, float]
    values: Measured
    by: Mapping[str, Measured]
    none: Mapping[str, str] = field(default_factory=dict)

    def told(self) -> "Derivatives":
        """Return them; raises `InputError` where there is none by one of the parameters."""
        for name, why in self.none.items():
            raise InputError(f"derivative by {name}: there is none here: {why}")
        return self

    def record(self) -> dict[str, dict[str, Any]]:
        """Return them as a record keeps them: of what is measured, by each parameter, with the value that it has."""
        at = self.parameters
        return {
            name: {one: {"at": at[one], "derivative": rates[name].tolist()} for one, rates in self.by.items()}
            for name in self.values
        }


class Beside:
    """Models beside one: of other parameters, on the same discretisation.

    Parameters
    ----------
    make
        Returns the model of parameters by their names.
    at
        Those of the one.
    like
        A model whose unknowns theirs must be.

    Raises
    ------
    InputError
        If a parameter has no size, or the model that is made is another one.
    """

    def __init__(self, make: Callable[[Mapping[str, float]], Model], at: Mapping[str, float], like: Model) -> None:
        for name, value in at.items():
            if not value or not np.isfinite(value):
                raise InputError(f"{name}: got {value:g}: a derivative is found by small shares of it, need a size")
        self.at, self._make, self._like = dict(at), make, like
        with _silently(), choices.kept() as self._choices:
            self._refuse(make(self.at), "parameters")

    def models(self, name: str, steps: Sequence[float]) -> list[Model]:
        """Return the models at steps from a parameter."""
        found = []
        for step in steps:
            with _silently(), choices.repeated(self._choices):
                found.append(self._make(self.at | {name: self.at[name] + step}))
            self._refuse(found[-1], name)
        return found

    def _refuse(self, model: Model, name: str) -> None:
        if not np.array_equal(model.free, self._like.free):
            raise InputError(f"{name}: the discretisation changes with it, or is not that of the answer")

    def derivatives(self, values: Measured, along: Along) -> Derivatives:
        """Return derivatives by all parameters.

        Parameters
        ----------
        values
            What is measured.
        along
            Returns the same at steps from a parameter.
        """
        found = {name: self._by(name, values, along) for name in self.at}
        by = {name: one for name, one in found.items() if not isinstance(one, str)}
        return Derivatives(self.at, values, by, {name: one for name, one in found.items() if isinstance(one, str)})

    def _near(self, name: str, values: Measured, along: Along) -> Measured | None:
        """Return the derivatives of what hardly bends near a parameter, or None."""
        step, found = _NEAR * abs(self.at[name]), {}
        try:
            with _silently():
                before, after = along(name, (-step, step))
        except (InputError, SolveError):
            return None
        for one, value in values.items():
            found[one] = (after[one] - before[one]) / (2.0 * step)
            bent = _largest(after[one] - 2.0 * value + before[one])
            if not bent <= _BENT * 2.0 * step * _scale(found[one], value, abs(self.at[name])):
                return None
        return found

    def _by(self, name: str, values: Measured, along: Along) -> Measured | str:
        """Return the derivatives by a parameter, or why there are none."""
        near = self._near(name, values, along)
        if near is not None:
            return near
        best: Measured = {}
        size, least, jump, share = abs(self.at[name]), np.inf, np.inf, _STEP
        for _ in range(_ATTEMPTS):
            try:
                with _silently():
                    several = along(name, [offset * share * size for offset in _OFFSETS])
            except (InputError, SolveError) as problem:
                why = f"models beside it cannot be had: {problem}"
                apart = np.inf
            else:
                rows = {one: np.array([each[one] for each in several]) for one in values}
                found, fourth = (
                    {one: np.tensordot(weights, row, 1) / (share * size) for one, row in rows.items()}
                    for weights in (_WEIGHTS[6], _FOURTH)
                )
                offs, jumps = {}, []
                for one, value in values.items():
                    scale = _scale(found[one], value, size)
                    offs[one] = _largest(found[one] - fourth[one]) / scale
                    jumps.append(_largest(np.tensordot(_JUMP, rows[one] - value, 1)) / (share * size * scale))
                worst = max(offs, key=lambda one: offs[one])
                why = f"differences of {worst} do not agree, as where the largest of several changes its place"
                apart = offs[worst]
            if apart < least:
                best, least, jump = found, apart, max(jumps)
            if least <= _ALIKE or share == _SHORTEST:
                break
            cut = 0.05 if not apart < np.inf else np.clip(0.7 * (_ALIKE / apart) ** 0.25, 0.03, 0.5)
            share = max(float(cut) * share, _SHORTEST)
        if least <= _APART < jump:
            why = "its slope jumps"
        return best if max(least, jump) <= _APART else why


def _scale(rate: Array, value: Array, size: float) -> float:
    """Return the size of a derivative by a parameter, to which what it misses is compared."""
    return max(_largest(rate), _NOTHING * _largest(value) / size) or 1.0


def _largest(values: Array) -> float:
    """Return the largest size of some values, without bound where one is none."""
    found = np.abs(values).max(initial=0.0)
    return float(found) if np.isfinite(found) else np.inf


@contextmanager
def _destroyed(one: Any) -> Iterator[Any]:
    try:
        yield one
    finally:
        one.destroy()


def _silently() -> warnings.catch_warnings:
    """Say nothing: it was said of the model itself."""
    return warnings.catch_warnings(action="ignore")


def numbers(measured: Mapping[str, object]) -> Measured:
    """Return those of what is measured that are numbers, as arrays."""
    found = {}
    for name, value in measured.items():
        if name == "places" or isinstance(value, str | dict):
            continue
        array = np.asarray(value)
        if array.dtype.kind in "fi":
            found[name] = array.astype(float)
    return found


def refuse(model: Model) -> None:
    """Raise `InputError` for what one back-substitution does not tell."""
    if model.contacts:
        raise InputError("derivatives: not told with contact; isorod sweep varies the parameter")
    if model.remembers or model.times is not None:
        raise InputError("derivatives: not told over time, nor of laws with a memory, whose answer depends on the path")
    if model.solids:
        raise InputError("derivatives: not told with finite element bodies")


class Moving:
    """An equilibrium with the factors of its tangent, which says how it moves.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`; once more brought into balance, as far as digits go.
    """

    def __init__(self, solution: Any) -> None:
        refuse(solution.model)
        self.comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD
        self.solution = solution
        self.assembler = assembler_for(solution.model, self.comm)
        self.x = self.assembler.state(solution.displacement, solution.pressures, solution.solids)
        self._tangent = self.assembler.matrix()
        self.assembler.tangent(self.x, 1.0, self._tangent)
        with defaults(room(self.comm)):
            self._ksp = direct(self._tangent, factorisation(self.assembler))
            self.x.axpy(-1.0, self._solved(self._residual(self.assembler, self.x)))

    def close(self) -> None:
        """Give back matrix and factors."""
        for one in (self._ksp, self._tangent):
            one.destroy()

    @staticmethod
    def _residual(assembler: Assembler, x: PETSc.Vec) -> PETSc.Vec:
        out = assembler.vector()
        assembler.residual(x, 1.0, out)
        return out

    def _solved(self, force: PETSc.Vec) -> PETSc.Vec:
        found = force.duplicate()
        self._ksp.solve(force, found)
        return found

    def states(self, models: Sequence[Model], steps: Sequence[float]) -> list[tuple[Assembler, PETSc.Vec]]:
        """Return assemblers and states of models at steps, on the line along which it moves."""
        several = [assembler_for(model, self.comm) for model in models]
        rate = self.assembler.vector()
        step = 2.0 * steps[-1] / len(steps)
        rate.maxpy((_WEIGHTS[len(steps)] / step).tolist(), [self._residual(one, self.x) for one in several])
        rate = self._solved(rate)
        found = []
        for assembler, one in zip(several, steps, strict=True):
            state = self.x.copy()
            state.axpy(-one, rate)
            self._balance(assembler, state, abs(one) * rate.norm() + _NEAR * self.x.norm())
            found.append((assembler, state))
        return found

    def _balance(self, assembler: Assembler, state: PETSc.Vec, size: float) -> None:
        """Bring a state beside into balance, with the factors that there are, or where these do not suit with its own.

        Parameters
        ----------
        size
            How far it moved, to which changes are compared.

        Raises
        ------
        SolveError
            If it does not come into balance.
        """
        began = state.copy()
        if self._stepped(assembler, state, size, lambda: self._ksp):
            return
        began.copy(state)
        with ExitStack() as stack:
            matrix = stack.enter_context(_destroyed(assembler.matrix()))

            def own() -> PETSc.KSP:
                assembler.tangent(state, 1.0, matrix)
                with defaults(room(self.comm)):
                    return stack.enter_context(_destroyed(direct(matrix, factorisation(assembler))))

            if not self._stepped(assembler, state, size, own):
                raise SolveError("they do not come into balance")

    def _stepped(self, assembler: Assembler, state: PETSc.Vec, size: float, factors: Callable[[], PETSc.KSP]) -> bool:
        """Take steps of Newton's method with some factors; return whether they came to an end."""
        last = np.inf
        for _ in range(_BALANCES):
            change = state.duplicate()
            factors().solve(self._residual(assembler, state), change)
            state.axpy(-1.0, change)
            off = change.norm()
            if off <= _BALANCED * size:
                return True
            if off > 0.5 * last:
                return bool(off <= _ROUNDED * size)
            last = off
        return False

    def equilibrium(self, assembler: Assembler, x: PETSc.Vec) -> Any:
        """Return what answers for a state."""
        own = carried(assembler, x, 1.0)
        return replace(
            self.solution,
            model=assembler.model,
            displacement=assembler.displacement(x, 1.0),
            reactions=own.reactions,
            moments=own.moments,
            work=own.work,
            pressures=assembler.pressures(x),
            ties=at_load(assembler, x, 1.0),
            solids=assembler.solids(x, 1.0),
            path=(),
            in_more_steps=None,
        )


def derivatives(
    solution: Any,
    make: Callable[[Mapping[str, float]], Model],
    at: Mapping[str, float],
    measure: Callable[[Any], Mapping[str, object]],
) -> Derivatives:
    """Return the derivatives of what is measured of an equilibrium by parameters of its model.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`.
    make
        Returns the model of parameters by their names.
    at
        The parameters that it has.
    measure
        Returns numbers, or arrays of them, by their names.

    Raises
    ------
    InputError
        If the model has contact, a memory, times or finite element bodies, or a parameter is zero.
    """
    with closing(Moving(solution)) as moving:
        beside = Beside(make, at, solution.model)
        values = numbers(measure(moving.equilibrium(moving.assembler, moving.x)))

        def along(name: str, steps: Sequence[float]) -> list[Measured]:
            states = moving.states(beside.models(name, steps), steps)
            return [numbers(measure(moving.equilibrium(*one))) for one in states]

        return beside.derivatives(values, along)
