"""Derivatives of results of an equilibrium by parameters of its model: direct differentiation.

From the residual ``R(u, p) = 0`` follows ``du/dp = - K^-1 dR/dp``: one back-substitution with the tangent's factors for
each parameter, however many results there are.  ``dR/dp`` is a finite difference of residuals at fixed displacement, of
models with perturbed parameters (`isorod.statics.differences`).  The derivative of a result is its difference by these
models at fixed displacement plus its change along ``du/dp``.  Reactions follow exactly from rows of the tangent.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.assembly.factorisation import factorisation
from isorod.assembly.formulation import assembler_for
from isorod.checks.reactions import carried
from isorod.checks.tie_result import at_load
from isorod.model.history import Times
from isorod.model.model import Model
from isorod.model.times import until
from isorod.options import defaults
from isorod.petsc.direct import direct, refined, room
from isorod.statics.differences import (
    APART,
    BY,
    NEAR,
    WIDE,
    Derivatives,
    Kinked,
    Measured,
    PerturbedModels,
    Steps,
    Unavailable,
    largest,
    near,
    scale,
)

if TYPE_CHECKING:
    from isorod.contact.packed import Settled
    from isorod.contact.settled import Tight

# Residuals whose slope jumps by more than this fraction of it have a kink, or noise of the models; the second allows
# for a point of contact that opens.
_ROUGH, _LEAVES = 1e-3, 1e-2

# Stiffness with which cells of contact keep their mean gaps, in penalties: as after updates of multipliers, and nearly
# rigid.  If derivatives differ by more than this fraction between both, a warning is given.
HELD, _UNSURE = (10.0, 1e4), 5e-3

# A tangent is compared to differences of residuals over this fraction of the displacements; the relative error allowed.
_SHORT, _INEXACT = 1e-4, 1e-3

# Steps along the motion relative to all displacements, tried in this order while results are nonlinear there.  Motions
# smaller than the second count as zero; the third, of the model's size, replaces displacements that are zero.
_SHARES, _UNMOVED, _STILL = (1e-3, 1e-4, 1e-5, 1e-6), 1e-13, 1e-6


def numbers(measured: Mapping[str, object]) -> Measured:
    """Return the results that are numbers, as arrays."""
    arrays = {}
    for name, value in measured.items():
        if name == "places" or isinstance(value, str | dict):
            continue
        array = np.asarray(value)
        if array.dtype.kind in "fi":
            arrays[name] = array.astype(float)
    return arrays


def refuse(model: Model) -> None:
    """Raise `Unavailable` where contact depends on the path, and for finite element bodies."""
    if model.solids:
        raise Unavailable("derivatives: not available with finite element bodies")
    if model.contacts and model.remembers:
        raise Unavailable("derivatives: not available with contact of laws with memory")
    if any(contact.friction for contact in model.contacts):
        raise Unavailable("derivatives: not available with friction where contact alone holds a body")


def as_solved(make: Callable[[Mapping[str, float]], Model], times: Times | None) -> Callable[..., Model]:
    """Return a function that makes models whose histories end at the time of a solution."""
    return make if times is None else lambda values: until(make(values), times.end)


def equilibrium(solution: Any, assembler: Assembler, x: PETSc.Vec, acting: Array) -> Any:
    """Return the results of a state of another model, with its acting forces, as those of a solution."""
    own, contact = carried(assembler, x, 1.0, acting), assembler.contact
    return replace(
        solution,
        model=assembler.model,
        displacement=assembler.displacement(x, 1.0),
        reactions=own.reactions,
        moments=own.moments,
        work=own.work,
        pressures=assembler.pressures(x),
        ties=at_load(assembler, x, 1.0, acting),
        contacts=() if contact is None else contact.results(assembler.touching(x, 1.0)),
        solids=assembler.solids(x, 1.0),
        path=(),
        in_more_steps=None,
    )


class Motion(NamedTuple):
    """Derivatives of an equilibrium by a parameter: unknowns, forces as of `Assembler.acting`, multipliers."""

    rate: PETSc.Vec
    change: Array
    pressures: Array


class Pushed(NamedTuple):
    """Derivatives by a parameter at fixed displacement: forces on unknowns, and gaps."""

    force: PETSc.Vec
    grown: Array


class Moving:
    """An equilibrium with the factors of its tangent, from which its derivatives follow.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`; it is iterated once more, to round-off level.
    times
        Stiffness with which cells of contact keep their mean gaps, in penalties.

    Attributes
    ----------
    assembler, x, acting, tight
        Its assembler, state, forces on held unknowns (`Assembler.acting`), contact whose cells keep their mean gaps.
    """

    def __init__(self, solution: Any, times: float = HELD[0]) -> None:
        refuse(solution.model)
        self.comm = PETSc.COMM_SELF if solution.ranks == 1 else PETSc.COMM_WORLD
        self.solution = solution
        self.assembler = assembler_for(solution.model, self.comm)
        self.x = self.assembler.state(solution.displacement, solution.pressures, solution.solids)
        self._left: Settled | None = None
        self.tight: Tight | None = None
        if solution.model.contacts:
            self._settle(solution, times)
        self._tangent = self.assembler.matrix()
        off = [self._inexact()] if solution.model.following and solution.model.has_potential else []
        self.assembler.tangent(self.x, 1.0, self._tangent)
        self._rest = self.assembler.vector()
        with defaults(room(self.comm)):
            self._ksp = direct(self._tangent, factorisation(self.assembler))
            self.assembler.residual(self.x, 1.0, self._rest)
            move, *wrong = refined(self._ksp, [self._rest, *off])
            self.x.axpy(-1.0, move)
        if any(not error.norm() <= _INEXACT * self.x.norm() for error in wrong):
            raise Unavailable("derivatives: not available with contact and pressures that follow to a free end")
        self.acting = self.assembler.acting(self.x, 1.0, self._rest)
        self._gaps = np.empty(0) if self.tight is None else self.tight.gaps(self.assembler.contact)

    def _inexact(self) -> PETSc.Vec:
        """Return the tangent's error along the displacement, as with follower pressures up to a free end."""
        error, change = (self.assembler.vector() for _ in range(2))
        # Contact that is closed stays so in the tangent, but opens in residuals.
        contact, self.assembler.contact = self.assembler.contact, None
        for step in (-_SHORT, _SHORT):
            self.assembler.residual((1.0 + step) * self.x, 1.0, change)
            error.axpy(0.5 / step, change)
        self.assembler.tangent(self.x, 1.0, self._tangent)
        self._tangent.mult(self.x, change)
        self.assembler.contact = contact
        return error - change

    def _settle(self, solution: Any, times: float) -> None:
        """Restore contact as the solution left it; cells with multipliers keep their gaps."""
        from isorod.contact.settled import Tight, relative, restore

        contact, left = self.assembler.contact, solution.settled
        if left is None or contact is None:
            raise Unavailable("derivatives: how contact settled is not known; solve the model again")
        self._left = relative(contact, left, solution.contacts)
        restore(contact, self._left)
        moved = self.assembler.touching(self.x, 1.0)
        if left.multipliers.any():
            self.tight = Tight(contact, contact.results(moved), moved, self.comm, times)
            self.assembler.contact = self.tight  # type: ignore[assignment]

    def perturbed(self, model: Model) -> Assembler:
        """Return the assembler of a model, whose contact is as the solution left it."""
        assembler = assembler_for(model, self.comm)
        if self._left is not None and assembler.contact is not None:
            from isorod.contact.settled import restore

            restore(assembler.contact, self._left)
        return assembler

    def close(self) -> None:
        """Give back matrix and factors."""
        self._ksp.destroy()
        self._tangent.destroy()

    def motion(self, steps: Steps, models: Sequence[Model]) -> tuple["Motion", list[tuple[Assembler, Array]]]:
        """Return the motion from perturbed models, and of each its assembler and the acting forces at the state."""
        pushed, acting = self.pushed(steps, models)
        return self.motions([pushed])[0], acting

    def pushed(self, steps: Steps, models: Sequence[Model]) -> tuple["Pushed", list[tuple[Assembler, Array]]]:
        """Return the force from perturbed models, and of each its assembler and the acting forces at the state.

        Raises
        ------
        Kinked
            If forces have no derivative.
        """
        acting, rows, gaps = [], [], []
        for model in models:
            assembler, row = self.perturbed(model), self.assembler.vector()
            if _gap(assembler) > 2.0 * _gap(self.assembler):
                raise Kinked("surfaces that are tied part, or overlap")
            contact = assembler.contact
            acting.append((assembler, assembler.acting(self.x, 1.0, row)))
            if self.tight is not None and contact is not None:
                gaps.append(self.tight.gaps(contact))
            row.axpy(-1.0, self._rest)
            rows.append(row)
        force, jump = self.assembler.vector(), self.assembler.vector()
        force.maxpy(steps.weights.tolist(), rows)
        jump.maxpy(steps.jumps.tolist(), rows)
        most = max(force.norm(), float(np.linalg.norm(self.acting)) / steps.size)
        if not jump.norm() <= (_ROUGH if self._left is None else _LEAVES) * most:
            raise Kinked("its slope jumps")
        grown = steps.weights @ (np.array(gaps) - self._gaps) if self.tight is not None else self._gaps
        if self.tight is not None:
            self.assembler.spread(self.tight.held(grown), jump)
            force.axpy(1.0, jump)
        return Pushed(force, grown), acting

    def motions(self, pushed: Sequence["Pushed"]) -> list["Motion"]:
        """Return the motions by several forces together, which cost little more than one."""
        rates = refined(self._ksp, [push.force for push in pushed])
        for rate in rates:
            rate.scale(-1.0)
        changes, contact = self.assembler.acting_along(self.x, 1.0, rates), self.assembler.contact
        if contact is None:
            return [Motion(rate, change, self._gaps) for rate, change in zip(rates, changes, strict=True)]
        motions = []
        for (_, grown), rate, change in zip(pushed, rates, changes, strict=True):
            move = self.assembler.displacement(rate, 1.0) - self.assembler.prescribed(1.0)
            forces, pressures = contact.product(move), np.zeros(contact.packed.areas.size)
            if self.tight is not None:
                forces += self.tight.held(grown)
                pressures = self.tight.pressures(grown, move)
            forces = forces if self.assembler.coupling else forces[self.assembler.model.bound]
            motions.append(Motion(rate, change + forces, pressures))
        return motions

    def ahead(self, step: float, motion: "Motion") -> tuple[PETSc.Vec, Array]:
        """Change multipliers by a step of a motion, and return the state there, and the forces acting in it."""
        if self.assembler.contact is not None:
            self.assembler.contact.packed.multipliers[:] += step * motion.pressures
        return self.x + step * motion.rate, self.acting + step * motion.change


def derivatives(
    solution: Any,
    make: Callable[[Mapping[str, float]], Model],
    at: Mapping[str, float],
    measure: Callable[[Any], Mapping[str, object]],
) -> Derivatives:
    """Return the derivatives of results of an equilibrium by parameters of its model.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`.
    make
        Returns the model of parameters by their names.
    at
        Its parameters.
    measure
        Returns the results: numbers, or arrays of them, by their names.

    Raises
    ------
    Unavailable
        If the model has friction or finite element bodies.
    InputError
        If a parameter is zero.
    """
    with ExitStack() as stack:
        equilibria = [stack.enter_context(closing(Moving(solution)))]
        if equilibria[0].tight:
            equilibria.append(stack.enter_context(closing(Moving(solution, HELD[1]))))
        beside = PerturbedModels(as_solved(make, solution.model.times), at, solution.model)
        moving, unsure = equilibria[0], (0.0, "")

        def ask(assembler: Assembler, x: PETSc.Vec, acting: Array) -> Measured:
            return numbers(measure(equilibrium(solution, assembler, x, acting)))

        values, measured = near(ask, moving.assembler, moving.x, moving.acting)

        def begin(steps: Steps, models: Sequence[Model]) -> tuple[Steps, list[tuple[Pushed, Measured]]]:
            return steps, [_held(each, steps, models, values, measured) for each in equilibria]

        def end(steps: Steps, moves: Sequence[tuple[Motion, Measured]]) -> Measured:
            nonlocal unsure
            pairs = zip(equilibria, moves, strict=True)
            rates, *others = (_of(each, steps, *own, values, measured) for each, own in pairs)
            for name, other in ((name, stiff[name]) for stiff in others for name in values):
                size = max(largest(rates[name]), largest(values[name]) / steps.size) or 1.0
                unsure = max(unsure, (largest(other - rates[name]) / size, name))
            return rates

        def go_on(begun: Sequence[tuple[Steps, list[tuple[Pushed, Measured]]]]) -> list[Callable[[], Measured]]:
            moves = [each.motions([held[k][0] for _, held in begun]) for k, each in enumerate(equilibria)]
            return [
                partial(end, steps, [(own[k], rates) for own, (_, rates) in zip(moves, held, strict=True)])
                for k, (steps, held) in enumerate(begun)
            ]

        # With larger steps other points touch.  Where results are too nonlinear over the largest, a smaller follows.
        found = beside.derivatives(values, begin, [NEAR] if solution.model.contacts else [NEAR, WIDE, BY], go_on)
    if unsure[0] > _UNSURE:
        warnings.warn(
            f"derivatives of {unsure[1]} are known to {100.0 * unsure[0]:.2g} %: where a patch of contact rolls or "
            "tips, points of its rim hold more or less; a finer space sees better",
            stacklevel=3,
        )
    return found


def _held(
    moving: Moving,
    steps: Steps,
    models: Sequence[Model],
    values: Measured,
    measured: Callable[[Assembler, PETSc.Vec, Array], Measured],
) -> tuple[Pushed, Measured]:
    """Return the force from perturbed models, and the derivatives of results at fixed displacement."""
    pushed, acting = moving.pushed(steps, models)
    return pushed, steps.slopes([measured(assembler, moving.x, forces) for assembler, forces in acting], values)


def _of(
    moving: Moving,
    steps: Steps,
    motion: Motion,
    held: Measured,
    values: Measured,
    measured: Callable[[Assembler, PETSc.Vec, Array], Measured],
) -> Measured:
    """Return the derivatives of results."""
    moved = _along(moving, motion, steps.size, values, held, measured)
    return {name: held[name] + moved[name] for name in values}


def _along(
    moving: Moving,
    motion: "Motion",
    size: float,
    values: Measured,
    held: Measured,
    measured: Callable[[Assembler, PETSc.Vec, Array], Measured],
) -> Measured:
    """Return the derivatives of results along a motion, with those ``held`` at fixed displacement for scale."""
    norm = motion.rate.norm()
    extent = moving.x.norm() or _STILL * moving.solution.model.size
    if norm * size < _UNMOVED * extent:
        return {name: np.zeros_like(value) for name, value in values.items()}
    why = ""
    for fraction in _SHARES:
        steps, perturbed = Steps((-2, -1, 1, 2), fraction * extent / norm, size), []
        for step in steps.steps:
            perturbed.append(measured(moving.assembler, *moving.ahead(step, motion)))
            moving.ahead(-step, motion)
        try:
            rates = steps.slopes(perturbed, values, held)
        except Kinked as problem:
            why = str(problem)
            continue
        coarse = {name: (perturbed[2][name] - perturbed[1][name]) / (2.0 * steps.step) for name in values}
        off = [
            largest(coarse[name] - rates[name]) / scale(rates[name] + held[name], value, size)
            for name, value in values.items()
        ]
        if max(off, default=0.0) <= APART:
            return rates
        why = "results are nonlinear even over the smallest steps"
    raise Kinked(why)


def _gap(assembler: Assembler) -> float:
    """Return the largest distance of tied surfaces at rest."""
    return max((tie.gap for tie in assembler.coupling.constraints.ties), default=0.0) if assembler.coupling else 0.0
