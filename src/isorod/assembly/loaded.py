"""Loads on this rank's parts of bodies at a load factor."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.assembly.parts import Parts
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.assembly.follower import FollowerLoads


class Loaded(Parts):
    """Parts with the loads on them."""

    def __init__(self, model: Model, comm: PETSc.Comm | None = None) -> None:
        # Load factor, and step, of the present loads.
        self._reached: tuple[float, float | None] | None = None
        super().__init__(model, comm)
        with self._timed():
            self._pressing = self._followers()

    def _followers(self) -> "list[FollowerLoads]":
        """Return the follower loads on each part, if there are any."""
        loads = self.model.following
        if not loads:
            return []
        from isorod.assembly.follower import FollowerLoads

        self.note("following loads")
        return [FollowerLoads(one, [load for load in loads if load.body == one.which]) for one in self.element_ranges]

    def _reach(self, factor: float, step: float | None = None) -> None:
        """Set the loads to those at a load factor, or to their increments in a step."""
        if not self.model.loads or self._reached == (factor, step):
            return
        self._reached = factor, step
        self._external = self._once(self.model.applied(factor, step))
        for pressing in self._pressing:
            pressing.reach(lambda load: self.model.amplitude(load.history, factor, step))

    def _loads(self, local: Array) -> Array:
        """Return the present loads' nodal forces in a state of this rank."""
        if not self._pressing:
            return self._external
        followed = zip(self.parts, self._pressing, strict=True)
        return self._external + self._sums(
            part.padded(pressing.forces(part.nodal(local))) for part, pressing in followed
        )

    def load(self, model: Model, x: PETSc.Vec, factor: float, out: PETSc.Vec) -> None:
        """Fill ``out`` with the forces of a model's loads on the unknowns at load factor 1.

        The model is this one, or the same with other loads, none of them follower loads; ``x`` is a state.
        """
        if model is not self.model:
            self.spread(model.external, out)
            return
        self._reach(1.0)
        self._store(self._loads(self._state(x, factor)), out)

    def spread(self, forces: Array, out: PETSc.Vec) -> None:
        """Fill ``out`` with the forces on the unknowns, given those on all degrees of freedom on all ranks."""
        self._store(self._once(forces), out)

    @cached_property
    def _external(self) -> Array:
        """Nodal forces of the present loads that do not depend on the state."""
        return np.zeros(self._exchange.size)

    def _load_stiffness(self, k: int, local: Array, factor: float, which: Index) -> Array:
        """Return the load stiffness of some elements of a part, of loads that depend on the state."""
        part, spin = self.parts[k], self.model.spin
        stiffness = np.zeros((which.size, part.dofs.shape[1], part.dofs.shape[1]))
        if spin is not None:
            stiffness -= self.model.amplitude(spin.history, factor) * part.masses_of(spin.field)[which]
        if self._pressing:
            whole = part.padded_matrices(self._pressing[k].stiffness(part.nodal(local)))
            stiffness -= whole[which].reshape(stiffness.shape)
        return stiffness

    def _stiffness_of(self, k: int, local: Array, factor: float, which: Index) -> Array:
        """Return the tangents of some elements of a part, load stiffness included, shape of `Part.matrices`."""
        matrices = self.parts[k].matrices(local, factor, which)
        if self.model.spin is not None or self._pressing:
            matrices += self._load_stiffness(k, local, factor, which)
        return matrices

    def _add_product(self, k: int, local: Array, factor: float, move: Array, which: Index, total: Array) -> None:
        """Add the product of the tangents of some elements with a displacement of this rank's degrees of freedom."""
        if which.size:
            slots = self.parts[k].slots_of(which)
            np.add.at(total, slots, np.einsum("eij,ej->ei", self._stiffness_of(k, local, factor, which), move[slots]))

    def acting_along(self, x: PETSc.Vec, factor: float, rates: Sequence[PETSc.Vec]) -> list[Array]:
        """Return the exact directional derivatives of `acting` along ``rates``; without contact and solids."""
        with self._timed():
            local, coupling = self._state(x, factor), self.coupling
            moves, totals = np.zeros((2, local.size, len(rates)))
            for rate, move in zip(rates, moves.T, strict=True):
                self._exchange.add_unknowns(rate if coupling is None else coupling.to_rods(rate), move)
            where = np.sort(self._exchange.bound[1])
            if coupling is not None:
                moved, slots = self._exchange.moved
                where = np.union1d(where, slots[np.isin(moved, coupling.constraints.slaves)])
            for k, part in enumerate(self.parts):
                which = part.elements_of(where)
                if which.size:
                    slots = part.slots_of(which)
                    np.add.at(totals, slots, self._stiffness_of(k, local, factor, which) @ moves[slots])
            if coupling is None:
                return [self._bound(total) for total in totals.T]
            changes, bonds = [self.everywhere(total) for total in totals.T], coupling.bonds
            if bonds is None:
                return changes
            place, rest = self.system_displacement(x, factor), coupling.given(factor)
            return [
                change + bonds.change(place, self.system_displacement(rate, factor) - rest)
                for change, rate in zip(changes, rates, strict=True)
            ]
