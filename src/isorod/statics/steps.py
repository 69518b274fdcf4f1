"""Limits of load steps: distortion, rotation, and bodies that pass through each other."""

from typing import TYPE_CHECKING

from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.checks.turning import Turning
from isorod.statics.convergence import squeezed

if TYPE_CHECKING:
    from isorod.contact.tunnelling import Tunnelling


class Diverged(Exception):
    """A load step did not converge."""


class TooDeep(Diverged):
    """A load step converged, but bodies passed through each other, or nearly did."""


class Steps:
    """Checks the steps of a model from one load factor to the next.

    Attributes
    ----------
    turning
        Limits of rotating supports on steps and states.
    watched
        Whether Newton's steps are checked by `free`.
    careful
        Whether they are so short that bodies never pass through each other.
    """

    def __init__(self, assembler: Assembler) -> None:
        self._assembler = assembler
        self.turning = Turning(assembler.model)
        self.watched = self.careful = False
        self._tunnelling: Tunnelling | None = None
        if assembler.contact is not None:
            from isorod.contact import tunnelling

            self._tunnelling = tunnelling.Tunnelling(assembler.model)

    def free(self, start: PETSc.Vec, end: PETSc.Vec, before: float, factor: float) -> float:
        """Return the fraction of an increment without bodies passing through each other: 1 where not ``careful``."""
        if self._tunnelling is None or not self.careful:
            return 1.0
        state = self._assembler.touching
        return self._tunnelling.free(state(start, before), state(end, factor), (before, factor))

    def refuse_squeezed(self, before: list[Array], trial: PETSc.Vec, factor: float) -> None:
        """Raise `Diverged` if an element has lost most of its volume."""
        problem = squeezed(self._assembler, before, trial, factor)
        if problem is not None:
            raise Diverged(problem)

    def refuse(self, start: PETSc.Vec, before: float, end: PETSc.Vec, factor: float) -> None:
        """Raise `Diverged` if rotating supports turned a body too far, or bodies passed through each other."""
        watches, contact = self.turning.watches, self._assembler.contact
        if not watches and self._tunnelling is None:
            return
        states = self._assembler.touching(start, before), self._assembler.touching(end, factor)
        problem = self.turning.lost(*(state[: self._assembler.model.dofs] for state in states)) if watches else None
        if problem is not None:
            raise Diverged(problem)
        if self._tunnelling is not None and contact is not None:
            # In careful steps each iteration was checked; their sum need not be straight.
            passed = None if self.careful else self._tunnelling.passed(*states, (before, factor))
            problem = self._tunnelling.deep(contact.packed) or passed
            if problem is not None:
                raise TooDeep(f"{problem} at the minimum step size; increase the penalty, or add a support")
