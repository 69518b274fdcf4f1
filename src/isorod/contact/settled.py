"""Contact state of a solution, transferred to nearby models, where surfaces keep the mean gaps of their cells."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.contact.defaults import smallest_radius
from isorod.contact.frozen import Frozen
from isorod.contact.packed import Settled
from isorod.contact.result import ContactResult, of_contacts

if TYPE_CHECKING:
    from isorod.contact.operator import ContactOperator

# Gap from which inactive points become active, in smallest radii.
_AWAY = 1e-2

# Points below this fraction of the largest pressure count as inactive: a small change takes them out of contact.
_RIM = 2e-3


def relative(contact: "ContactOperator", left: Settled, results: Sequence[ContactResult]) -> Settled:
    """Return a contact state relative to the initial penalties of a model's contact, and their pressures.

    Inactive points of the results, and those that are nearly so, get a gap.
    """
    contact.look(left.points)
    begun = contact.packed.passes["penalty"].copy()
    contact.packed.passes["penalty"][:] = left.penalties
    pressed = np.concatenate([result.pressure > _RIM * result.peak for result in results])
    multipliers = np.where(pressed, left.multipliers / _pressures(contact), -_AWAY)
    contact.packed.passes["penalty"][:] = begun
    return Settled(left.points, multipliers, left.penalties / begun)


def restore(contact: "ContactOperator", left: Settled) -> None:
    """Set contact at its start to a state of `relative`."""
    contact.look(left.points)
    contact.packed.passes["penalty"] *= left.penalties
    contact.packed.multipliers[:] = left.multipliers * _pressures(contact)


def _pressures(contact: "ContactOperator") -> Array:
    """Return the penalty pressure at each point at a penetration of the smallest radius, ``(Q,)``."""
    pressures = np.empty(contact.packed.areas.size)
    for definition, passes, points in of_contacts(contact.model, contact.packed):
        pressures[points] = contact.packed.passes["penalty"][passes.start] * smallest_radius(contact.model, definition)
    return pressures


class Tight:
    """A `ContactOperator` whose tangent holds the mean gaps of cells, as multipliers by cells do (`Frozen`).

    Parameters
    ----------
    contact, results, displacement
        The operator, its results, and their displacement ``(dofs,)``.
    comm
        The ranks.
    times
        Stiffness, in penalties.
    """

    def __init__(
        self,
        contact: "ContactOperator",
        results: Sequence[ContactResult],
        displacement: Array,
        comm: PETSc.Comm,
        times: float,
    ) -> None:
        self._contact, model = contact, contact.model
        # Contacts without multipliers keep the compliance of their penalty.
        multipliers, parts = contact.packed.multipliers, [one[2] for one in of_contacts(model, contact.packed)]
        which = [k for k, points in enumerate(parts) if (multipliers[points] > 0.0).any()]
        frozen = Frozen(
            model, [model.contacts[k] for k in which], [results[k] for k in which], displacement, comm, tight=True
        )
        self._means, self._cells, self._times = frozen.means, frozen.cells, times
        pressed = np.zeros(contact.packed.areas.size, dtype=bool)
        for k in which:
            pressed[parts[k]] = results[k].pressure > 0.0
        self._pressed = np.flatnonzero(pressed)
        entries = (times * (self._means.T @ self._means)).tocoo()
        mine = np.arange(entries.nnz) % comm.getSize() == comm.getRank()
        self._entries = entries.row.astype(np.int64), entries.col.astype(np.int64), np.where(mine, entries.data, 0.0)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._contact, name)

    def tangent(self, displacement: Array) -> Array:
        """Return the values of both, at ``rows`` and ``columns``."""
        own = self._contact.tangent(displacement)
        self.rows = np.append(self._contact.rows, self._entries[0])
        self.columns = np.append(self._contact.columns, self._entries[1])
        self.values = np.append(own, self._entries[2])
        return self.values

    def product(self, move: Array) -> Array:
        """Return the last tangent times a vector of all degrees of freedom."""
        return np.asarray(self._contact.product(move) + self._times * (self._means.T @ (self._means @ move)))

    def gaps(self, contact: "ContactOperator") -> Array:
        """Return the gaps of the points that are held, of the last forces of ``contact``, in smallest radii."""
        gaps = contact.packed.states["gap"].copy()
        for definition, _, points in of_contacts(contact.model, contact.packed):
            gaps[points] /= smallest_radius(contact.model, definition)
        return gaps[self._pressed]

    def held(self, gaps: Array) -> Array:
        """Return the internal forces ``(dofs,)`` by which cells resist gaps of `gaps`."""
        return np.asarray(self._times * (self._means.T @ (self._cells @ self._of_lengths(gaps))))

    def pressures(self, gaps: Array, move: Array) -> Array:
        """Return the multipliers ``(Q,)`` of such gaps and of a motion ``(dofs,)``."""
        mean = self._means @ move + self._cells @ self._of_lengths(gaps)
        pressures = np.zeros(self._contact.packed.areas.size)
        pressures[self._pressed] = -self._times * (self._cells.T @ mean) / self._contact.packed.areas[self._pressed]
        return pressures

    def _of_lengths(self, gaps: Array) -> Array:
        sizes = np.empty(self._contact.packed.areas.size)
        for contact, _, points in of_contacts(self._contact.model, self._contact.packed):
            sizes[points] = smallest_radius(self._contact.model, contact)
        return gaps * sizes[self._pressed]
