"""Contact as the assembler sees it: forces and exact tangent on the degrees of freedom of a model, of one rank."""

from typing import TYPE_CHECKING

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.contact.blocks import Blocks
from isorod.contact.force_kernel import add_forces
from isorod.contact.packed import Row
from isorod.contact.result import ContactResult, measure, slave_points
from isorod.contact.tables import pack, smallest_radius
from isorod.contact.tangent_kernel import NODES, PATCH, add_blocks, find_patches, patch_nodes
from isorod.model.contact import Contact, refuse
from isorod.model.model import Model

if TYPE_CHECKING:
    from isorod.contact.friction import FrictionOperator

# Penetration up to which multipliers are added by default, relative to the smallest radius.
_DEEPEST = 1e-3


class ContactOperator:
    """Forces and tangent of all contacts of a model; closest points are sought anew at each call, without history.

    Friction has one (`accept`).

    Attributes
    ----------
    packed
        What the compiled loops take and leave (`isorod.contact.packed`).
    friction
        Friction of the contacts that have some, or None.
    values
        The last tangent, at ``rows`` and ``columns``: repeated entries add up.
    """

    # Whether points may slide far in the step in which they come into contact: then friction asks where they were.
    long_steps = True

    def __init__(self, model: Model) -> None:
        refuse(model.contacts, faces=True)
        self._model = model
        self.packed = pack(model)
        self._stage = PETSc.Log.Stage("contact")
        self._base = np.concatenate([body.space.positions for body in model.bodies])
        self._blocks = Blocks(PATCH, self._nodes)
        self.values = np.empty(0)
        self.friction: FrictionOperator | None = None
        if any(contact.friction for contact in model.contacts):
            from isorod.contact import friction

            self.friction = friction.FrictionOperator(model, self.packed)

    @property
    def rows(self) -> Index:
        """Rows of the last tangent's entries."""
        rows = self._blocks.rows
        return rows if self.friction is None else np.concatenate([rows, self.friction.blocks.rows])

    @property
    def columns(self) -> Index:
        """Their columns."""
        columns = self._blocks.columns
        return columns if self.friction is None else np.concatenate([columns, self.friction.blocks.columns])

    @property
    def version(self) -> int:
        """How often the pattern of the tangent has changed."""
        return self._blocks.version + (0 if self.friction is None else self.friction.blocks.version)

    def _nodes(self, patch: Row) -> tuple[Index, Index]:
        nodes = np.empty(NODES, dtype=np.int64)
        nodes = nodes[: patch_nodes(self.packed, patch, nodes)]
        return nodes, nodes

    def _positions(self, displacement: Array) -> Array:
        return self._base + displacement.reshape(-1, 3)

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces of contact on all degrees of freedom ``(dofs,)``, and its energy."""
        self.packed.forget()
        return self._add_forces(self._positions(displacement))

    def _add_forces(self, positions: Array) -> tuple[Array, float]:
        forces = np.zeros_like(self._base)
        with self._stage:
            energy = add_forces(self.packed, positions, forces).energy
            if self.friction is not None and np.isfinite(energy):
                energy += self.friction.add_forces(positions, forces)
        return forces.ravel(), energy

    def accept(self, displacement: Array) -> float:
        """Let the next step begin at a displacement ``(dofs,)``; return the energy that friction has dissipated."""
        if self.friction is None:
            return 0.0
        self.forces(displacement)
        positions = self._positions(displacement)
        self.friction.before = positions if self.long_steps else None
        return self.friction.accept(positions)

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, minus the derivatives of the forces at ``rows`` and ``columns``.

        Without friction they are the second derivatives of the energy.  Nodes of two sides (three control points by the
        layers of an element) that touch couple with each other.  Where a patch comes that is not in the pattern, the
        pattern is made anew of the patches of this call and the last one, and ``version`` grows.
        """
        packed, positions = self.packed, self._positions(displacement)
        # Where the forces were asked for just before, nothing has moved since: closest points are known.
        if not np.array_equal(packed.before[packed.carriers], positions[packed.carriers]):
            packed.forget()
        self._add_forces(positions)
        active = np.flatnonzero(packed.states["pressure"] > 0.0)
        patches = np.empty(active.size, PATCH)
        find_patches(packed, active, patches)
        begin = self._blocks.begin(patches)
        self.values = np.zeros(self._blocks.rows.size)
        with self._stage:
            add_blocks(packed, positions, active, patches, begin, self.values)
            if self.friction is not None:
                others = self.friction.add_blocks(positions, active, patches, begin, self.values)
                self.values = np.concatenate([self.values, others])
        return self.values

    def product(self, move: Array) -> Array:
        """Return the last tangent times a vector of all degrees of freedom."""
        return np.bincount(self.rows, self.values * move[self.columns], move.size).astype(np.float64, copy=False)

    def results(self, displacement: Array) -> list[ContactResult]:
        """Return the outcome of each contact at a displacement ``(dofs,)``."""
        self.forces(displacement)
        results = measure(self._model, self.packed)
        return results if self.friction is None else self.friction.tell(results)

    def augment(self, displacement: Array) -> str | None:
        """Make pressures of a displacement the new multipliers, unless every contact keeps to its largest penetration.

        Returns
        -------
        What is too deep, in words, or None.
        """
        limits = [self._limit(contact) for contact in self._model.contacts]
        for k, (limit, result) in enumerate(zip(limits, self.results(displacement), strict=True)):
            if result.penetration > limit:
                for own, (_, points) in zip(limits, slave_points(self._model, self.packed), strict=True):
                    if np.isfinite(own):
                        self.packed.multipliers[points] = self.packed.states["pressure"][points]
                return f"contact {k}: penetration {result.penetration:.3g}, wanted {limit:.3g},"
        return None

    def _limit(self, contact: Contact) -> float:
        """Return how deep a point of a contact may be."""
        if contact.penetration is not None:
            return contact.penetration
        return np.inf if contact.penalty is not None else _DEEPEST * smallest_radius(self._model, contact)
