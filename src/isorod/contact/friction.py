"""Friction for the contact operator: forces, tangent, and the history from step to step."""

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
        Anchors at the start of the step (`isorod.contact.packed.ANCHOR`).
    before
        Positions at the start of the step, ``(nodes, 3)``: points that were inactive then get anchors where they came
        into contact (`isorod.contact.friction_kernel.catch`).  If None, they get anchors at the end of the step.
    tables
        Tables of the compiled loops.
    """

    def __init__(self, model: "Model", packed: Packed, ranks: Ranks) -> None:
        self._model, self._packed, self._ranks = model, packed, ranks
        self.tables = pack(model, packed)
        self.history = self.tables.anchors.copy()
        self.before: Array | None = None
        self._ahead: Array = np.empty((0, 3))
        # With obstacles at the start of the step.
        self._placed = packed.passes.copy()
        # Anchors of points that were first pressed in this step.
        self._caught = self.history.copy()

    def _then(self) -> Table:
        """Return the passes with obstacles as at the start of the step."""
        passes = self._packed.passes.copy()
        passes[[*PLACED]] = self._placed[[*PLACED]]
        return passes

    def keep(self) -> Callable[[], None]:
        """Return a function that resets the history, and the points that it belongs to, to their present state."""
        now, history = dict(vars(self)), self.history.copy()

        def back() -> None:
            vars(self).update(now)
            self.history[:] = history

        return back

    def take(self, packed: Packed) -> None:
        """Continue with other points of the same sides, with the tractions of the nearest former ones."""
        old, history = self._packed, self.history
        self._packed, self.tables = packed, pack(self._model, packed)
        if self.before is not None:
            now = packed.passes.copy()
            for tables in (old, packed):
                tables.forget()
                tables.look_everywhere()
                tables.passes[[*PLACED]] = self._placed[[*PLACED]]
                add_forces(tables, self.before, np.zeros_like(self.before))
                # The nearest former point may be another rank's.
                self._ranks.gather(tables, tables.points, tables.states)
            self._ranks.gather(old, history)
            tractions = np.where(history["element"][:, None] >= 0, history["traction"], np.nan)
            first = [np.append(tables.passes["first_point"], tables.areas.size) for tables in (old, packed)]
            nearest = [
                tractions[a:b][cKDTree(old.points[a:b]).query(packed.points[c:d])[1]]
                for (a, b), (c, d) in zip(*(pairwise(ends) for ends in first), strict=True)
            ]
            hang(packed, self.tables, self.before, np.concatenate(nearest))
            for tables in (old, packed):
                tables.passes[[*PLACED]] = now[[*PLACED]]
                tables.look_everywhere()
        self.history = self.tables.anchors.copy()
        self._caught = np.full(self.history.size, NO_ANCHOR)

    def foresee(self, positions: Array) -> None:
        """Set the predicted positions at the end of the step, without new contacts."""
        self._ahead = positions
        self._caught[:] = NO_ANCHOR

    def add_forces(self, positions: Array, forces: Array) -> float:
        """Add the forces after those of the pressure at the same positions, and return the energy."""
        self.tables.anchors[:] = self.history
        if self.before is not None:
            catch(self._packed, self.tables, self._then(), self.before, self._ahead, self._caught)
        return float(add_friction(self._packed, self.tables, positions, False, forces)[0])

    def accept(self, positions: Array) -> float:
        """Start the next step from the state of the last forces; return the energy dissipated in this one."""
        spent = add_friction(self._packed, self.tables, positions, True, np.zeros_like(positions))
        self.history[:] = self.tables.anchors
        self._placed, self._ahead = self._packed.passes.copy(), positions
        self._caught[:] = NO_ANCHOR
        return float(self._ranks.sums(np.empty(0), spent[1])[1][0])
