"""Contact along the load path: updates of its penalties, multipliers and points.

- A load step fails: default penalties are reduced, and the step is repeated; where bodies passed through each other
  with reduced ones, they are raised (`ContactPolicy.failed`).
- With friction they are reduced within the step alone, and the next steps begin with the same (`ContactPolicy.step`).
- A state is reached: penalties rise again, points are added until patches are resolved, and multipliers are updated
  until contact is as tight as requested (`ContactPolicy.settle`).
- Updates of multipliers stall: penalties rise above their defaults.

Uzawa's updates make the pressures of a solution the multipliers of the next.  The first ones are those of the plain
penalty; later increments are constant on each cell (`isorod.contact.cells`), which constrains the surfaces no more than
their control points can follow: multipliers at points, of which there are more, close the gap at each, and with each
update turn the pressure into fewer and higher peaks.  Only where penetration remains too large, since control points
are far apart or the limit is small, multipliers at points are updated, and where these stall the penalty is raised.
"""

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.errors import SolveError
from isorod.statics.proximal import Proximal
from isorod.statics.steps import Diverged, Steps, TooDeep
from isorod.statics.tuning import CONTROL

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator
    from isorod.contact.result import ContactResult

# Limit of the displacements along a path that are kept for derivatives: numbers, 160 MB.
_KEPT = 20_000_000


class Stage(NamedTuple):
    """An equilibrium in the load step in which contact settles; the last is the end of the step.

    Attributes
    ----------
    displacement : (dofs,)
        Displacement of rods.
    penalties : (passes,)
        Penalties at this equilibrium.
    update
        The update of multipliers after it: penalties, whether by cells, and the fraction applied; None at the end.
    """

    displacement: Array
    penalties: Array | None = None
    update: tuple[Array, bool, float] | None = None


class Settling(NamedTuple):
    """How contact settled in a load step, from which the step can be repeated.

    Attributes
    ----------
    factor
        Load factor at its end.
    ahead : (dofs,)
        Its predicted end (`isorod.contact.operator.ContactOperator.predict`).
    penalties : (passes,)
        Penalties at its start.
    points
        Points round an arc and along an element of each pass: at its start, and after each addition.
    stages
        Its equilibria in order.
    """

    factor: float
    ahead: Array
    penalties: Array
    points: list[list[tuple[int, int]]]
    stages: list[Stage]


class Solver(Protocol):
    """The solver of equilibria, `isorod.statics.newton.Newton`."""

    assembler: Assembler
    steps: Steps
    x: PETSc.Vec
    stabilisation: Proximal | None

    def advance(self, factor: float, target: float) -> int:
        """Go from the equilibrium at one load factor to that at another."""

    def again(self, factor: float) -> bool:
        """Iterate to equilibrium at the same load factor again; return whether that converges."""

    def forget_path(self) -> None:
        """Begin a new path."""


class ContactPolicy:
    """Penalties, multipliers and points of the contacts of a model along its load path.

    Parameters
    ----------
    solver
        Solver of equilibria.
    contact
        Contact operator of its assembler.

    Attributes
    ----------
    in_steps
        Whether contact is settled in each load step: with friction, which depends on the path, and over time.
    settlings
        How it settled in each step with friction, for derivatives along the path; empty where this is too long.
    """

    def __init__(self, solver: Solver, contact: "ContactOperator") -> None:
        self._solver, self._contact = solver, contact
        self.in_steps = contact.friction is not None or contact.model.times is not None
        # Factor on penalties at the start of a step with friction.
        self._begins = 1.0
        self.settlings, self._room = list[Settling](), _KEPT
        self._points, self._stages = list[list[tuple[int, int]]](), list[Stage]()

    @property
    def is_soft(self) -> bool:
        """Whether default penalties are reduced."""
        return self._contact.stiffness < 0.5

    @property
    def may_soften(self) -> bool:
        """Whether default penalties may be reduced further."""
        return self._contact.stiffness > CONTROL.softest and self._contact.has_defaults

    def failed(self, problem: Diverged) -> bool:
        """Change penalties after a load step that failed; return whether to repeat the same step."""
        deep = isinstance(problem, TooDeep)
        if not self.in_steps and not deep and self.may_soften:
            self._contact.stiffen(CONTROL.softer)
            return True
        if deep and self.is_soft:
            self._contact.stiffen(1.0 / CONTROL.softer)
        return False

    def step(self, factor: float, target: float) -> tuple[int, int]:
        """Take a load step in which contact settles; return the numbers of linear solves and of multiplier updates.

        Friction depends on the path, so penalties and multipliers are final at the end of each step.  The tangential
        stiffness is the penalty: where this is reduced within a step, stick points remain those at its start.

        Raises
        ------
        Diverged
            If there is no equilibrium, or none with the default penalties; the state is then the one before.
        """
        solver, contact, softer = self._solver, self._contact, self._begins
        contact.place(factor)
        contact.accept(self._displacement(factor))
        start, undo = solver.x.copy(), contact.keep()
        while True:
            if contact.model.times is not None:
                # Where a patch unloads, the old ones would keep it open.
                contact.packed.multipliers[:] = 0.0
            self._points, self._stages = [contact.points], []
            contact.stiffen(softer)
            begun = contact.settled().penalties
            try:
                solves = solver.advance(factor, target)
                updates = self.settle(target)
                if self.is_soft:
                    raise Diverged("no equilibrium at the required penalty")
            except Diverged as problem:
                # In shorter steps points stick closer to where they came into contact.
                start.copy(solver.x)
                again = solver.steps.careful and self.may_soften and not isinstance(problem, TooDeep)
                undo()
                solver.forget_path()
                if not again:
                    raise
                softer *= CONTROL.softer
            else:
                self._begins = softer
                if contact.friction is not None and self._room > 0:
                    end = Stage(self._end(target), contact.settled().penalties, None)
                    self.settlings.append(Settling(target, contact.ahead, begun, self._points, [*self._stages, end]))
                    self._room -= np.size(end.displacement) * (len(self._stages) + 2)
                    if self._room <= 0:
                        self.settlings.clear()
                return solves, updates

    def settle(self, factor: float) -> int:
        """Settle contact at a load factor; return the number of multiplier updates.

        Raises
        ------
        Diverged
            If there is no equilibrium with more points, or other multipliers.
        SolveError
            If penetration does not fall to its limit.
        """
        self._harden(factor)
        for _ in range(CONTROL.additions):
            if not self._contact.increase_points(self._displacement(factor), between=factor == 1.0):
                break
            self._points.append(self._contact.points)
            try:
                self._stay(factor)
            except Diverged as problem:
                raise Diverged(f"more points of contact: {problem}") from None
        return self._tighten(factor)

    def settle_in_the_end(self) -> int:
        """Settle contact at the full load, where it must not fail; return the number of multiplier updates."""
        try:
            return self.settle(1.0)
        except Diverged as problem:
            raise SolveError(str(problem)) from None

    def _stay(self, factor: float) -> None:
        """Iterate to equilibrium after a change of contact, or raise `Diverged` and leave the state as it was.

        A slender body held by contact alone may move away, and is stabilised meanwhile.
        """
        solver = self._solver
        try:
            solver.advance(factor, factor)
        except Diverged:
            if solver.stabilisation is None:
                raise
            before, back = solver.x.copy(), solver.stabilisation.keep()
            try:
                solver.stabilisation.hold(lambda: solver.again(factor), solver.x)
            except SolveError as problem:
                before.copy(solver.x)
                back()
                raise Diverged(str(problem)) from None

    def _displacement(self, factor: float) -> Array:
        return self._solver.assembler.touching(self._solver.x, factor)

    def _harden(self, factor: float) -> None:
        """Raise reduced penalties to their defaults, or as far as there is an equilibrium.

        Multipliers of a penalty that is too soft would keep the pressures of too large a patch.
        """
        if not self.is_soft:
            return
        contact = self._contact
        rises = int(np.ceil(np.log(1.0 / contact.stiffness) / np.log(CONTROL.stiffer)))
        times = (1.0 / contact.stiffness) ** (1.0 / rises)
        for _ in range(rises):
            contact.stiffen(times)
            try:
                self._stay(factor)
            except Diverged:
                contact.stiffen(1.0 / times)
                return

    def _end(self, factor: float) -> Array:
        return self._solver.assembler.displacement(self._solver.x, factor).copy()

    def _deepest(self, factor: float) -> tuple[float, str]:
        """Return the largest ratio of penetration to its limit, and a message on it."""
        return max(self._contact.excess(self._displacement(factor)), default=(0.0, ""))

    def _update(self, factor: float, in_cells: bool, penalties: Array) -> Diverged | None:
        """Update multipliers and iterate to equilibrium; halve the update if that fails; return the problem if all do.

        ``penalties`` are those of the present equilibrium.
        """
        contact, here = self._contact, self._end(factor)
        before = contact.packed.multipliers.copy()
        contact.augment(self._displacement(factor), in_cells)
        change = contact.packed.multipliers - before
        for halvings in range(CONTROL.update_halvings + 1):
            contact.packed.multipliers[:] = before + 0.5**halvings * change
            try:
                self._stay(factor)
            except Diverged as why:
                problem = why
            else:
                update = contact.settled().penalties, in_cells, 0.5**halvings
                self._stages.append(Stage(here, penalties, update))
                return None
        contact.packed.multipliers[:] = before
        return problem

    def _tighten(self, factor: float) -> int:
        """Update multipliers by cells until that stalls, then at points until penetration is below its limit.

        Cells are updated below the limit too, where a small patch may still be too compliant.  Return the number of
        updates.
        """
        count, raised, last, in_cells = 0, 0, np.inf, True
        while True:
            (depth, text), penalties = self._deepest(factor), self._contact.settled().penalties
            stalls = depth > CONTROL.stalled * last
            if in_cells and (stalls or depth <= 0.0 or count >= CONTROL.updates):
                in_cells, stalls = False, False
            if not in_cells:
                if depth <= 1.0:
                    return count
                if count >= CONTROL.updates:
                    deepest = max(
                        self._contact.results(self._displacement(factor)),
                        key=lambda contact: contact.relative_penetration,
                    )
                    raise SolveError(
                        f"{text} after {CONTROL.updates} augmented Lagrangian updates, largest pressure on "
                        f"{deepest.peak_place}; a surface held by a support there cannot give way: hold it elsewhere; "
                        "else increase the penalty"
                    )
                if stalls and raised < CONTROL.stiffenings:
                    self._contact.stiffen(CONTROL.stiffer)
                    raised += 1
            problem = self._update(factor, in_cells, penalties)
            if problem is not None:
                if in_cells and depth <= 1.0:
                    return count
                raise Diverged(f"augmented Lagrangian, update {count + 1}: {problem}")
            count, last = count + 1, depth


def outcome(contact: "ContactOperator", displacement: Array) -> "list[ContactResult]":
    """Return the result of each contact, and warn where these are unreliable."""
    results = contact.results(displacement, check=True)
    warn_of(contact, results)
    return results


def warn_of(contact: "ContactOperator | None", results: "Sequence[ContactResult]") -> None:
    """Warn where the results of contacts are unreliable."""
    if contact is None:
        return
    from isorod.contact.result import doubts

    for doubt in doubts(contact.model, dict(enumerate(results))):
        warnings.warn(doubt, stacklevel=6)
