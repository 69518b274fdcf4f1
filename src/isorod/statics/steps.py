"""What a load step must not do, and what fraction of an increment bodies may go."""

from typing import TYPE_CHECKING

from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks.turning import Turning
from isorod.statics.convergence import squeezed

if TYPE_CHECKING:
    from isorod.contact.passing import Tunnelling


class Diverged(Exception):
    """A load step did not converge."""


class TooDeep(Diverged):
    """A load step converged, but bodies went through each other, or nearly."""


class Steps:
    """Looks at the steps of a model from one load factor to the next.

    Attributes
    ----------
    turning
        What supports that turn ask of steps and states.
    watched
        Whether Newton's steps ask how much of them is free.
    careful
        Whether they are made so short that bodies do not go through each other on the way.
    """

    def __init__(self, assembler: Assembler) -> None:
        self._assembler = assembler
        self.turning = Turning(assembler.model)
        self.watched = self.careful = False
        self._passing: Tunnelling | None = None
        if assembler.contact is not None:
            from isorod.contact import passing

            self._passing = passing.Tunnelling(assembler.model)

    def free(self, start: PETSc.Vec, end: PETSc.Vec, before: float, factor: float) -> float:
        """Return the fraction of an increment on which no bodies go through each other: all where nobody is careful."""
        if self._passing is None or not self.careful:
            return 1.0
        state = self._assembler.touching
        return self._passing.free(state(start, before), state(end, factor), (before, factor))

    def refuse_squeezed(self, before: list[Array], trial: PETSc.Vec, factor: float) -> None:
        """Raise `Diverged` if an element has lost most of its volume."""
        problem = squeezed(self._assembler, before, trial, factor)
        if problem is not None:
            raise Diverged(problem)

    def refuse(self, start: PETSc.Vec, before: float, end: PETSc.Vec, factor: float) -> None:
        """Raise `Diverged` if a body that supports turn went too far to be followed, or bodies in contact passed."""
        watches, contact = self.turning.watches, self._assembler.contact
        if not watches and self._passing is None:
            return
        states = self._assembler.touching(start, before), self._assembler.touching(end, factor)
        problem = self.turning.lost(*(one[: self._assembler.model.dofs] for one in states)) if watches else None
        if problem is not None:
            raise Diverged(problem)
        if self._passing is not None and contact is not None:
            # Whoever is careful has looked at each piece of the way, which need not be straight.
            passed = None if self.careful else self._passing.passed(*states, (before, factor))
            problem = self._passing.deep(contact.packed) or passed
            if problem is not None:
                raise TooDeep(f"{problem} at the minimum step size; increase the penalty, or add a support")
