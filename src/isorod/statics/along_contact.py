"""Contact of models that repeat the load steps of a solution, settled in each step as it was there.

`isorod.statics.contact_policy` gives the initial state of a load step and the kind of updates of multipliers and
points; their amounts follow from the model.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from petsc4py import PETSc

from isorod.arrays import Array
from isorod.assembly.assembler import Assembler
from isorod.statics.contact_policy import Settling
from isorod.statics.newton import DELTA
from isorod.statics.predictor import Before

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator

# Fraction of the increment over which the path's slope is differenced, and whether the predictor is cubic: where
# contact has changed at the last load factor, and where the path continues.
PREDICTORS = ((1.0, False), (DELTA, True), (DELTA, False))


class Touching:
    """Contact of a model on a path, if any.

    Parameters
    ----------
    assembler
        Assembler of the model.
    first
        How contact settled in the first load step; empty without contact.

    Attributes
    ----------
    penalties : (passes,)
        Initial penalties.
    """

    def __init__(self, assembler: Assembler, first: Sequence[Settling]) -> None:
        self._assembler = assembler
        self._before: Before | None = None
        self._here: Before | None = None
        if first:
            self._contact.look(first[0].points[0])
            self.penalties = self._contact.settled().penalties

    @property
    def _contact(self) -> "ContactOperator":
        assert self._assembler.contact is not None
        return self._assembler.contact

    @property
    def rubs(self) -> bool:
        """Whether there is friction."""
        return self._contact.friction is not None

    def begin(self, x: PETSc.Vec, factor: float) -> None:
        """Begin a load step at the last equilibrium."""
        contact = self._contact
        contact.place(factor)
        contact.accept(self._assembler.touching(x, factor))
        if contact.model.times is not None:
            contact.packed.multipliers[:] = 0.0

    def ahead(
        self,
        x: PETSc.Vec,
        factor: float,
        step: float,
        solved: Callable[[PETSc.Vec], PETSc.Vec],
        like: tuple[float, bool],
    ) -> Array:
        """Return the predicted end of the load step, as of `isorod.statics.newton`, ``(dofs,)``.

        Parameters
        ----------
        x, factor, step
            Equilibrium where it begins, and the change of the load factor.
        solved
            Returns the displacement by a force.
        like
            One of `PREDICTORS`.
        """
        (fraction, bends), rate = like, self._assembler.vector()
        self._assembler.load_forces(x, factor, fraction * step, rate)
        rate = solved(rate)
        rate.scale(-1.0 / (fraction * step))
        end = x + step * rate
        if bends and self._before is not None:
            end.axpy(1.0, self._before.bend(x, rate, step))
        self._here = Before(step, x.copy(), rate)
        return self._assembler.touching(end, factor + step)

    def go(self, ahead: Array, points: Sequence[list[tuple[int, int]]]) -> None:
        """Take the step, with its predicted end ``(dofs,)`` and the points of contact, initial and after changes."""
        self._before = self._here
        self._contact.predict(ahead)
        for each in points[1:]:
            self._contact.take(each)

    def harden(self, times: Array) -> None:
        """Set penalties to multiples of the initial ones."""
        self._contact.packed.passes["penalty"][:] = times * self.penalties

    def update(self, x: PETSc.Vec, factor: float, in_cells: bool, part: float) -> None:
        """Update multipliers at an equilibrium (`isorod.statics.contact_policy.Stage`)."""
        multipliers = self._contact.packed.multipliers
        before = multipliers.copy()
        self._contact.augment(self._assembler.touching(x, factor), in_cells)
        multipliers[:] = before + part * (multipliers - before)
