"""Derivatives of what is measured of an equilibrium by numbers of its model.

Of the residual ``R(u, p) = 0`` the equilibrium moves by ``du/dp = - K^-1 dR/dp``: one back-substitution of the factors
of the tangent for each parameter, whatever is measured.  ``dR/dp`` is a difference of residuals at one displacement, of
models beside (`isorod.statics.differences`); and ``dm/dp`` is that of what is measured there, and how that changes
along ``du/dp`` in the model itself.  Forces of supports go with the rows of the tangent there, exactly.
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
    Beside,
    Derivatives,
    Kinked,
    Measured,
    Steps,
    Unavailable,
    largest,
    near,
    scale,
)

if TYPE_CHECKING:
    from isorod.contact.packed import Settled
    from isorod.contact.settled import Tight

# Residuals whose slope jumps by more of it are those of a kink, or noise of what is built; a point of contact that
# leaves is none.
_ROUGH, _LEAVES = 1e-3, 1e-2

# How stiffly cells of contact keep their mean gaps, in penalties: as updates of multipliers leave them, and altogether.
# More than this share of a derivative between both is warned of.
HELD, _UNSURE = (10.0, 1e4), 5e-3

# Share of all displacements on which a tangent is held to residuals, and by how much motions by it may be off.
_SHORT, _INEXACT = 1e-4, 1e-3

# How far along it is measured, of all displacements, one after the other while that bends; nothing moves by less of
# them for the whole parameter, or, where there are none, of the model's size.
_SHARES, _UNMOVED, _STILL = (1e-3, 1e-4, 1e-5, 1e-6), 1e-13, 1e-6


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
    """Raise `Unavailable` where the path of contact counts, and for finite element bodies."""
    if model.solids:
        raise Unavailable("derivatives: not available with finite element bodies")
    if model.contacts and model.remembers:
        raise Unavailable("derivatives: not available with contact of laws with memory")
    if any(one.friction for one in model.contacts):
        raise Unavailable("derivatives: not available with friction where contact alone holds a body")


def as_solved(make: Callable[[Mapping[str, float]], Model], times: Times | None) -> Callable[..., Model]:
    """Return what makes models that follow their histories as long as that of an answer does."""
    return make if times is None else lambda values: until(make(values), times.end)


def equilibrium(solution: Any, assembler: Assembler, x: PETSc.Vec, acting: Array) -> Any:
    """Return what answers for a state of a model beside that of a solution, and for what is acting in it."""
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
    """How an equilibrium moves by a parameter: unknowns, forces on supports as of `Assembler.acting`, multipliers."""

    rate: PETSc.Vec
    change: Array
    pressures: Array


class Pushed(NamedTuple):
    """What a parameter changes at one displacement: forces on unknowns, and how gaps grow by themselves."""

    force: PETSc.Vec
    grown: Array


class Moving:
    """An equilibrium with the factors of its tangent, which says how it moves.

    Parameters
    ----------
    solution
        The `isorod.statics.Equilibrium`; once more brought into balance, as far as digits go.
    times
        How stiffly cells of contact keep their mean gaps, in penalties.

    Attributes
    ----------
    assembler, x, acting, tight
        Its own, the state, forces on what supports hold (`Assembler.acting`), contact whose cells keep their mean gaps.
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
        if any(not one.norm() <= _INEXACT * self.x.norm() for one in wrong):
            raise Unavailable("derivatives: not available with contact and pressures that follow to a free end")
        self.acting = self.assembler.acting(self.x, 1.0, self._rest)
        self._gaps = np.empty(0) if self.tight is None else self.tight.gaps(self.assembler.contact)

    def _inexact(self) -> PETSc.Vec:
        """Return by how much the tangent is off along the displacement, as where pressures follow to a free end."""
        found, change = (self.assembler.vector() for _ in range(2))
        # What is pressed stays so in the tangent, and opens in residuals.
        contact, self.assembler.contact = self.assembler.contact, None
        for step in (-_SHORT, _SHORT):
            self.assembler.residual((1.0 + step) * self.x, 1.0, change)
            found.axpy(0.5 / step, change)
        self.assembler.tangent(self.x, 1.0, self._tangent)
        self._tangent.mult(self.x, change)
        self.assembler.contact = contact
        return found - change

    def _settle(self, solution: Any, times: float) -> None:
        """Let contact be as the solution left it; cells whose gaps multipliers have closed keep these."""
        from isorod.contact.settled import Tight, relative, restore

        contact, left = self.assembler.contact, solution.settled
        if left is None or contact is None:
            raise Unavailable("derivatives: how contact was settled is not known; solve the model anew")
        self._left = relative(contact, left, solution.contacts)
        restore(contact, self._left)
        moved = self.assembler.touching(self.x, 1.0)
        if left.multipliers.any():
            self.tight = Tight(contact, contact.results(moved), moved, self.comm, times)
            self.assembler.contact = self.tight  # type: ignore[assignment]

    def beside(self, model: Model) -> Assembler:
        """Return the assembler of a model, whose contact is as the solution left it."""
        assembler = assembler_for(model, self.comm)
        if self._left is not None and assembler.contact is not None:
            from isorod.contact.settled import restore

            restore(assembler.contact, self._left)
        return assembler

    def close(self) -> None:
        """Give back matrix and factors."""
        for one in (self._ksp, self._tangent):
            one.destroy()

    def motion(self, steps: Steps, models: Sequence[Model]) -> tuple["Motion", list[tuple[Assembler, Array]]]:
        """Return how it moves as models go on, and of each its assembler and what is acting where it is."""
        pushed, several = self.pushed(steps, models)
        return self.motions([pushed])[0], several

    def pushed(self, steps: Steps, models: Sequence[Model]) -> tuple["Pushed", list[tuple[Assembler, Array]]]:
        """Return what pushes it as models go on, and of each its assembler and what is acting where it is.

        Raises
        ------
        Kinked
            If forces have no derivative.
        """
        several, rows, gaps = [], [], []
        for model in models:
            assembler, row = self.beside(model), self.assembler.vector()
            if _gap(assembler) > 2.0 * _gap(self.assembler):
                raise Kinked("surfaces that are tied part, or overlap")
            contact = assembler.contact
            several.append((assembler, assembler.acting(self.x, 1.0, row)))
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
        return Pushed(force, grown), several

    def motions(self, several: Sequence["Pushed"]) -> list["Motion"]:
        """Return how it moves by what pushes it: all of them together, which is most of what each costs alone."""
        rates = refined(self._ksp, [one.force for one in several])
        for rate in rates:
            rate.scale(-1.0)
        changes, contact = self.assembler.acting_along(self.x, 1.0, rates), self.assembler.contact
        if contact is None:
            return [Motion(rate, change, self._gaps) for rate, change in zip(rates, changes, strict=True)]
        found = []
        for (_, grown), rate, change in zip(several, rates, changes, strict=True):
            move = self.assembler.displacement(rate, 1.0) - self.assembler.prescribed(1.0)
            forces, pressures = contact.product(move), np.zeros(contact.packed.areas.size)
            if self.tight is not None:
                forces += self.tight.held(grown)
                pressures = self.tight.pressures(grown, move)
            forces = forces if self.assembler.coupling else forces[self.assembler.model.bound]
            found.append(Motion(rate, change + forces, pressures))
        return found

    def ahead(self, step: float, motion: "Motion") -> tuple[PETSc.Vec, Array]:
        """Let multipliers go a step on, or back, and return the state there, and what is acting in it."""
        if self.assembler.contact is not None:
            self.assembler.contact.packed.multipliers[:] += step * motion.pressures
        return self.x + step * motion.rate, self.acting + step * motion.change


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
    Unavailable
        If the model has friction or finite element bodies.
    InputError
        If a parameter is zero.
    """
    with ExitStack() as stack:
        several = [stack.enter_context(closing(Moving(solution)))]
        if several[0].tight:
            several.append(stack.enter_context(closing(Moving(solution, HELD[1]))))
        beside = Beside(as_solved(make, solution.model.times), at, solution.model)
        moving, unsure = several[0], (0.0, "")

        def ask(assembler: Assembler, x: PETSc.Vec, acting: Array) -> Measured:
            return numbers(measure(equilibrium(solution, assembler, x, acting)))

        values, measured = near(ask, moving.assembler, moving.x, moving.acting)

        def begin(steps: Steps, models: Sequence[Model]) -> tuple[Steps, list[tuple[Pushed, Measured]]]:
            return steps, [_held(one, steps, models, values, measured) for one in several]

        def end(steps: Steps, moves: Sequence[tuple[Motion, Measured]]) -> Measured:
            nonlocal unsure
            found, *others = (_of(one, steps, *own, values, measured) for one, own in zip(several, moves, strict=True))
            for name, other in ((name, one[name]) for one in others for name in values):
                whole = max(largest(found[name]), largest(values[name]) / steps.size) or 1.0
                off = largest(other - found[name]) / whole
                unsure = max(unsure, (off, name))
            return found

        def go_on(begun: Sequence[tuple[Steps, list[tuple[Pushed, Measured]]]]) -> list[Callable[[], Measured]]:
            moves = [one.motions([held[k][0] for _, held in begun]) for k, one in enumerate(several)]
            return [
                partial(end, steps, [(own[k], rates) for own, (_, rates) in zip(moves, held, strict=True)])
                for k, (steps, held) in enumerate(begun)
            ]

        # Further off other points touch.  Where what is held bends too much so far off, as a cone by turns: nearer.
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
    """Return what pushes one model, and the derivatives of what is measured where it is held."""
    pushed, several = moving.pushed(steps, models)
    return pushed, steps.slopes([measured(one, moving.x, acting) for one, acting in several], values)


def _of(
    moving: Moving,
    steps: Steps,
    motion: Motion,
    held: Measured,
    values: Measured,
    measured: Callable[[Assembler, PETSc.Vec, Array], Measured],
) -> Measured:
    """Return the derivatives of what is measured."""
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
    """Return the derivatives of what is measured of one model as it moves, beside those where it is ``held``."""
    norm = motion.rate.norm()
    whole = moving.x.norm() or _STILL * moving.solution.model.size
    if norm * size < _UNMOVED * whole:
        return {name: np.zeros_like(value) for name, value in values.items()}
    why = ""
    for share in _SHARES:
        steps, several = Steps((-2, -1, 1, 2), share * whole / norm, size), []
        for one in steps.steps:
            several.append(measured(moving.assembler, *moving.ahead(one, motion)))
            moving.ahead(-one, motion)
        try:
            found = steps.slopes(several, values, held)
        except Kinked as problem:
            why = str(problem)
            continue
        coarse = {name: (several[2][name] - several[1][name]) / (2.0 * steps.step) for name in values}
        off = [
            largest(coarse[one] - found[one]) / scale(found[one] + held[one], value, size)
            for one, value in values.items()
        ]
        if max(off, default=0.0) <= APART:
            return found
        why = "what is measured does not change evenly as it moves"
    raise Kinked(why)


def _gap(assembler: Assembler) -> float:
    """Return how far the surfaces of ties are apart at rest."""
    return max((one.gap for one in assembler.coupling.constraints.ties), default=0.0) if assembler.coupling else 0.0
