"""Derivatives of what is measured of an equilibrium by numbers of its model.

Of the residual ``R(u, p) = 0`` the equilibrium moves by ``du/dp = - K^-1 dR/dp``: one back-substitution of the factors
of the tangent for each parameter, whatever is measured.  ``dR/dp`` is a difference of residuals at one displacement, of
models beside (`isorod.statics.differences`), and so is what is measured, where these are in balance, to which they come
from there with the same factors.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks.reactions import carried
from isorod.checks.tie_result import at_load
from isorod.errors import InputError, SolveError
from isorod.model.model import Model
from isorod.options import defaults
from isorod.petsc.direct import direct, room
from isorod.statics.differences import NEAR, Beside, Derivatives, Measured, silently, weights

# A model beside comes into balance by a few steps, to such a share of what it moves by, or where digits end, as near as
# the second.
_BALANCES, _BALANCED, _ROUNDED = 12, 1e-11, 1e-6

# What does not move at all still has digits of a displacement of this share of the model's size.
_STILL = 1e-6


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
        step = abs(steps[0])
        share = weights([one / step for one in steps]) / step
        rate.maxpy(share.tolist(), [self._residual(one, self.x) for one in several])
        rate = self._solved(rate)
        found = []
        for assembler, one in zip(several, steps, strict=True):
            state = self.x.copy()
            state.axpy(-one, rate)
            moved = abs(one) * rate.norm() + NEAR * self.x.norm() + _STILL * self.solution.model.size
            self._balance(assembler, state, moved)
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
        own = moving.equilibrium(moving.assembler, moving.x)
        gaps = dict[str, float]()
        with silently():
            values = numbers(measure(own))

        def along(name: str, steps: Sequence[float]) -> list[Measured]:
            several = [moving.equilibrium(*one) for one in moving.states(beside.models(name, steps), steps)]
            gaps[name] = max(map(_gap, several))
            return [numbers(measure(one)) for one in several]

        found = beside.derivatives(values, along)
        none = {
            name: "surfaces that are tied part, or overlap" if gaps.get(name, 0.0) > 2.0 * _gap(own) else why
            for name, why in found.none.items()
        }
        return replace(found, none=none)


def _gap(solution: Any) -> float:
    """Return how far the surfaces of ties are apart at rest."""
    return max((one.gap for one in solution.ties), default=0.0)


@contextmanager
def _destroyed(one: Any) -> Iterator[Any]:
    try:
        yield one
    finally:
        one.destroy()
