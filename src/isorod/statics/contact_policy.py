"""Contact on the way to an equilibrium: when its penalties, multipliers and points change, asked by load steps.

- A load step fails: penalties that nobody typed fall, and the step is tried again; where bodies went through each other
  since they had fallen, they rise (`ContactPolicy.failed`).
- With friction they fall within the step alone, and those after it begin as low (`ContactPolicy.step`).
- A state is reached: penalties rise again, points are added until patches are resolved, and multipliers until contact
  is as tight as asked for (`ContactPolicy.settle`).
- Updates of multipliers stall: penalties rise above their defaults.

Uzawa's updates make the pressures of a solution the multipliers of the next.  The first ones are those of the plain
penalty; what is added to them is then the same all over a cell (`isorod.contact.cells`), which leaves the surfaces as
free as they are able to move: multipliers of points, of which there are more, take away the gap of each and make of the
pressure the fewer and higher peaks the more often they are updated.  Only where penetration stays too deep, since
control points are far apart, or more is asked for than such surfaces can do, pressures at points follow, and where
these stall a stiffer penalty.
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

# Displacements along a path are kept for derivatives up to so many numbers, 160 MB.
_KEPT = 20_000_000


class Stage(NamedTuple):
    """An equilibrium on the way to the end of a load step in which contact settles, the end itself the last.

    Attributes
    ----------
    displacement : (dofs,)
        Of rods.
    penalties : (passes,)
        With which it is one.
    update
        How multipliers were updated then: with which penalties, whether by cells, and which part of it; None in the
        end.
    """

    displacement: Array
    penalties: Array | None = None
    update: tuple[Array, bool, float] | None = None


class Settling(NamedTuple):
    """How contact settled in a load step, for who takes that once more.

    Attributes
    ----------
    factor
        Load factor at its end.
    ahead : (dofs,)
        Where it was foreseen to lead (`isorod.contact.operator.ContactOperator.predict`).
    penalties : (passes,)
        With which it was.
    points
        Points round an arc and along an element of each pass: when it began, and each time there were more.
    stages
        Equilibria, one after the other.
    """

    factor: float
    ahead: Array
    penalties: Array
    points: list[list[tuple[int, int]]]
    stages: list[Stage]


class Solver(Protocol):
    """What finds equilibria, `isorod.statics.newton.Newton`."""

    assembler: Assembler
    steps: Steps
    x: PETSc.Vec
    stabilisation: Proximal | None

    def advance(self, factor: float, target: float) -> int:
        """Go from the equilibrium at one load factor to that at another."""

    def again(self, factor: float) -> bool:
        """Seek the equilibrium at a load factor once more; return whether it is found."""

    def forget_path(self) -> None:
        """Begin a new path."""


class ContactPolicy:
    """Penalties, multipliers and points of the contacts of a model, on its way to an equilibrium.

    Parameters
    ----------
    solver
        Finds equilibria.
    contact
        Of its assembler.

    Attributes
    ----------
    in_steps
        Whether contact is settled in each load step: with friction, which depends on the path, and over time.
    settlings
        How it settled in each of them, with friction: derivatives along the path are of these.  None where paths are
        too long to be kept.
    """

    def __init__(self, solver: Solver, contact: "ContactOperator") -> None:
        self._solver, self._contact = solver, contact
        self.in_steps = contact.friction is not None or contact.model.times is not None
        # What penalties are multiplied by where a step with friction begins.
        self._begins = 1.0
        self.settlings, self._room = list[Settling](), _KEPT
        self._points, self._stages = list[list[tuple[int, int]]](), list[Stage]()

    @property
    def is_soft(self) -> bool:
        """Whether penalties that nobody typed are lower than their defaults."""
        return self._contact.stiffness < 0.5

    @property
    def may_soften(self) -> bool:
        """Whether penalties that nobody typed may be lower than they are."""
        return self._contact.stiffness > CONTROL.softest and self._contact.has_defaults

    def failed(self, problem: Diverged) -> bool:
        """Change penalties after a load step that failed; return whether the same step is to be tried again."""
        deep = isinstance(problem, TooDeep)
        if not self.in_steps and not deep and self.may_soften:
            self._contact.stiffen(CONTROL.softer)
            return True
        if deep and self.is_soft:
            self._contact.stiffen(1.0 / CONTROL.softer)
        return False

    def step(self, factor: float, target: float) -> tuple[int, int]:
        """Take a load step in which contact settles; return how many linear solves and updates of multipliers it took.

        Friction depends on the path, so penalties and multipliers are right at the end of each step.  Springs of
        friction are as stiff as penalties: where these fall within a step, anchors stay where they were when it began.

        Raises
        ------
        Diverged
            If there is no equilibrium, or none with penalties as high as their defaults; all is then as before.
        """
        solver, contact, softer = self._solver, self._contact, self._begins
        contact.place(factor)
        contact.accept(self._displacement(factor))
        start, undo = solver.x.copy(), contact.keep()
        while True:
            if contact.model.times is not None:
                # Where a patch unloads, the last ones would hold it apart.
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
                # Shorter steps, whose points stick where they have touched, bring it nearer.
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
        """Settle contact at a load factor; return how many updates of multipliers that took.

        Raises
        ------
        Diverged
            If there is no equilibrium with more points, or other multipliers.
        SolveError
            If penetration does not fall to what is asked for.
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
        """Settle contact at the full load, where it must not fail; return how often multipliers were updated."""
        try:
            return self.settle(1.0)
        except Diverged as problem:
            raise SolveError(str(problem)) from None

    def _stay(self, factor: float) -> None:
        """Find the equilibrium once more where contact has changed, or raise `Diverged` and leave the state as it was.

        A slender body that nothing but contact holds may fly off, and is held meanwhile.
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
        """Raise penalties that fell on the way to what they were, or as far as there is an equilibrium.

        Multipliers of a penalty that is too soft take the patch for what that made of it.
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
        """Return the largest penetration over its limit, and in words."""
        return max(self._contact.excess(self._displacement(factor)), default=(0.0, ""))

    def _update(self, factor: float, in_cells: bool, penalties: Array) -> Diverged | None:
        """Update multipliers and find the equilibrium; by half as much each time that fails, and then not at all.

        ``penalties`` are those with which this one was found.
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
        """Update multipliers by cells until that does no more, then at points until penetration is below its limit.

        A small patch may be less deep than the limit, and give way all the same.  Return how many updates there are.
        """
        count, raised, last, in_cells = 0, 0, np.inf, True
        while True:
            (depth, said), penalties = self._deepest(factor), self._contact.settled().penalties
            stalls = depth > CONTROL.stalled * last
            if in_cells and (stalls or depth <= 0.0 or count >= CONTROL.updates):
                in_cells, stalls = False, False
            if not in_cells:
                if depth <= 1.0:
                    return count
                if count >= CONTROL.updates:
                    raise SolveError(
                        f"{said} after {CONTROL.updates} augmented Lagrangian updates; increase the penalty"
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
    """Return the outcome of each contact, and warn of what is not to be trusted."""
    results = contact.results(displacement, check=True)
    warn_of(contact, results)
    return results


def warn_of(contact: "ContactOperator | None", results: "Sequence[ContactResult]") -> None:
    """Warn of what is not to be trusted of the outcome of contacts."""
    if contact is None:
        return
    from isorod.contact.result import doubts

    for doubt in doubts(contact.model, dict(enumerate(results))):
        warnings.warn(doubt, stacklevel=6)
