"""Friction as the operator of contact sees it: forces, tangent, and the history from step to step."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.contact.blocks import Blocks
from isorod.contact.force_kernel import add_forces
from isorod.contact.friction_kernel import NO_ANCHOR, Friction, add_friction, catch, hang
from isorod.contact.friction_tangent_kernel import HANGING, add_friction_blocks, anchor_nodes, find_hangings
from isorod.contact.packed import FUNCTIONS, START, Packed, Row, Table
from isorod.contact.ranks import Ranks
from isorod.contact.result import ContactResult, slave_points
from isorod.contact.tangent_kernel import NODES, PATCH, patch_nodes

if TYPE_CHECKING:
    from isorod.model.model import Model


def pack(model: "Model", packed: Packed) -> Friction:
    """Return the friction of a model's contacts, without history."""
    coefficients = np.repeat(
        [contact.friction for contact in model.contacts], [len(contact.sides) for contact in model.contacts]
    )
    points = packed.areas.size
    return Friction(
        coefficients=coefficients,
        anchors=np.full(points, NO_ANCHOR),
        tractions=np.zeros((points, 3)),
        slipping=np.zeros(points, dtype=bool),
        start=np.zeros(1, START),
    )


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
    blocks
        Pattern of the tangent by anchors that are not where the feet are.
    """

    def __init__(self, model: "Model", packed: Packed, ranks: Ranks) -> None:
        self._model, self._packed, self._ranks = model, packed, ranks
        self._friction = pack(model, packed)
        self.history = self._friction.anchors.copy()
        self.before: Array | None = None
        self._ahead: Array = np.empty((0, 3))
        # Where obstacles were then.
        self._places = packed.passes["point"].copy()
        # Anchors of points that were first pressed in this step.
        self._caught = self.history.copy()
        self.blocks = Blocks(HANGING)

    def _nodes(self, hanging: Row) -> tuple[Index, Index]:
        nodes, others = np.empty(NODES, dtype=np.int64), np.empty(3 * FUNCTIONS, dtype=np.int64)
        patch = np.array([tuple(hanging)[:-2]], PATCH)[0]
        return nodes[: patch_nodes(self._packed, patch, nodes)], others[: anchor_nodes(self._packed, hanging, others)]

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
        self._packed, self._friction = packed, pack(self._model, packed)
        if self.before is not None:
            for one in (old, packed):
                one.forget()
                one.look_everywhere()
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
            hang(packed, self._friction, self.before, np.concatenate(found))
        self.history = self._friction.anchors.copy()
        self._caught = np.full(self.history.size, NO_ANCHOR)

    def foresee(self, positions: Array) -> None:
        """Say where, without what comes into contact, the step leads."""
        self._ahead = positions
        self._caught[:] = NO_ANCHOR

    def add_forces(self, positions: Array, forces: Array) -> float:
        """Add the forces after those of the pressure at the same positions, and return the energy."""
        self._friction.anchors[:] = self.history
        if self.before is not None:
            passes = self._packed.passes
            moved = np.einsum("pa,pa->p", passes["point"] - self._places, passes["direction"])
            catch(self._packed, self._friction, moved, self.before, self._ahead, self._caught)
        return float(add_friction(self._packed, self._friction, positions, False, forces)[0])

    def accept(self, positions: Array) -> float:
        """Make a state, that of the last forces, the start of the next step; return what was dissipated on the way."""
        spent = add_friction(self._packed, self._friction, positions, True, np.zeros_like(positions))
        self.history[:] = self._friction.anchors
        self._places, self._ahead = self._packed.passes["point"].copy(), positions
        self._caught[:] = NO_ANCHOR
        return float(self._ranks.sums(np.empty(0), spent[1])[1][0])

    def add_blocks(self, positions: Array, active: Index, patches: Table, begin: Index, values: Array) -> Array:
        """Add to the blocks of the patches of active points, and return the entries of ``blocks``.

        Parameters
        ----------
        positions, active, patches, begin, values
            As for `isorod.contact.tangent_kernel.add_blocks`.
        """
        hangings = np.empty(active.size, HANGING)
        for name in PATCH.names or ():
            hangings[name] = patches[name]
        find_hangings(self._packed, self._friction, active, hangings)
        elsewhere = hangings["anchor_element"] >= 0
        aside = np.zeros(active.size, dtype=np.int64)
        aside[elsewhere] = self.blocks.begin(hangings[elsewhere], self._nodes) if elsewhere.any() else 0
        others = np.zeros(self.blocks.room)
        add_friction_blocks(self._packed, self._friction, positions, active, hangings, begin, values, aside, others)
        return self.blocks.merge(others)

    def tell(self, results: Sequence[ContactResult]) -> list[ContactResult]:
        """Return results with what the last forces say of friction."""
        told = []
        friction = self._friction
        self._ranks.gather(self._packed, friction.tractions, friction.slipping)
        for result, (contact, points) in zip(results, slave_points(self._model, self._packed), strict=True):
            slips = friction.slipping[points]
            sides = np.isin(result.body, contact.groups[0]) * 1.0
            if len(contact.groups) == 2:
                sides = 2.0 * sides - 1.0
            elif contact.obstacle is None:
                sides[:] = 0.0
            told.append(
                replace(
                    result,
                    friction=(sides * result.areas) @ friction.tractions[points],
                    tractions=friction.tractions[points],
                    slips=slips.copy(),
                    slipping=int(slips.sum()),
                    sticking=int(((result.pressure > 0.0) & ~slips).sum()) if contact.friction else 0,
                )
            )
        return told
