"""Friction as the operator of contact sees it: forces, tangent, and the history from step to step."""

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from isorod.arrays import Array
from isorod.contact.force_kernel import add_forces
from isorod.contact.friction_kernel import add_friction, catch, hang
from isorod.contact.packed import NO_ANCHOR, PLACED, Friction, Packed, Table
from isorod.contact.ranks import Ranks

if TYPE_CHECKING:
    from isorod.model.model import Model


def pack(model: "Model", packed: Packed) -> Friction:
    """Return the friction of a model's contacts, without history."""
    each, passes = [one.friction for one in model.contacts], [one.passes for one in model.contacts]
    return Friction.of(np.repeat(each, passes), packed.areas.size)


class FrictionOperator:
    """Friction between the states of one step, and from step to step, of this rank's points.

    Attributes
    ----------
    history
        Anchors at the start of the step (`isorod.contact.friction_kernel.ANCHOR`).
    before
        Positions at the start of the step, ``(nodes, 3)``: what was not pressed then has its anchor where it has come
        into contact since (`isorod.contact.friction_kernel.catch`).  Where there are none, it has one from the end of
        the step on.
    tables
        What the compiled loops take and leave.
    """

    def __init__(self, model: "Model", packed: Packed, ranks: Ranks) -> None:
        self._model, self._packed, self._ranks = model, packed, ranks
        self.tables = pack(model, packed)
        self.history = self.tables.anchors.copy()
        self.before: Array | None = None
        self._ahead: Array = np.empty((0, 3))
        # With obstacles where they were then.
        self._placed = packed.passes.copy()
        # Anchors of points that were first pressed in this step.
        self._caught = self.history.copy()

    def _then(self) -> Table:
        """Return the passes with obstacles where they were at the start of the step."""
        passes = self._packed.passes.copy()
        passes[[*PLACED]] = self._placed[[*PLACED]]
        return passes

    def keep(self) -> Callable[[], None]:
        """Return what takes the history, and the points it is of, back to what they are now."""
        now, history = dict(vars(self)), self.history.copy()

        def back() -> None:
            vars(self).update(now)
            self.history[:] = history

        return back

    def take(self, packed: Packed) -> None:
        """Let other points of the same sides go on: at the start of the step they hang as the nearest of those did."""
        old, history = self._packed, self.history
        self._packed, self.tables = packed, pack(self._model, packed)
        if self.before is not None:
            now = packed.passes.copy()
            for one in (old, packed):
                one.forget()
                one.look_everywhere()
                one.passes[[*PLACED]] = self._placed[[*PLACED]]
                add_forces(one, self.before, np.zeros_like(self.before))
                # Points of one rank may hang as those of another did.
                self._ranks.gather(one, one.points, one.states)
            self._ranks.gather(old, history)
            tractions = np.where(history["element"][:, None] >= 0, history["traction"], np.nan)
            first = [np.append(one.passes["first_point"], one.areas.size) for one in (old, packed)]
            found = [
                tractions[a:b][cKDTree(old.points[a:b]).query(packed.points[c:d])[1]]
                for (a, b), (c, d) in zip(*(pairwise(ends) for ends in first), strict=True)
            ]
            hang(packed, self.tables, self.before, np.concatenate(found))
            for one in (old, packed):
                one.passes[[*PLACED]] = now[[*PLACED]]
                one.look_everywhere()
        self.history = self.tables.anchors.copy()
        self._caught = np.full(self.history.size, NO_ANCHOR)

    def foresee(self, positions: Array) -> None:
        """Say where, without what comes into contact, the step leads."""
        self._ahead = positions
        self._caught[:] = NO_ANCHOR

    def add_forces(self, positions: Array, forces: Array) -> float:
        """Add the forces after those of the pressure at the same positions, and return the energy."""
        self.tables.anchors[:] = self.history
        if self.before is not None:
            catch(self._packed, self.tables, self._then(), self.before, self._ahead, self._caught)
        return float(add_friction(self._packed, self.tables, positions, False, forces)[0])

    def accept(self, positions: Array) -> float:
        """Make a state, that of the last forces, the start of the next step; return what was dissipated on the way."""
        spent = add_friction(self._packed, self.tables, positions, True, np.zeros_like(positions))
        self.history[:] = self.tables.anchors
        self._placed, self._ahead = self._packed.passes.copy(), positions
        self._caught[:] = NO_ANCHOR
        return float(self._ranks.sums(np.empty(0), spent[1])[1][0])
