"""Contact as the assembler sees it: forces and exact tangent on the degrees of freedom of a model, of one rank."""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array
from isorod.contact.force_kernel import add_forces
from isorod.contact.packed import Table
from isorod.contact.result import ContactResult, measure, slave_points
from isorod.contact.tables import pack, smallest_radius
from isorod.contact.tangent_kernel import NODES, PATCH, add_blocks, find_patches, patch_nodes
from isorod.model.contact import Contact, refuse
from isorod.model.model import Model

# Penetration up to which multipliers are added by default, relative to the smallest radius.
_DEEPEST = 1e-3


class ContactOperator:
    """Forces and tangent of all contacts of a model; closest points are sought anew at each call, without history.

    Attributes
    ----------
    packed
        What the compiled loops take and leave (`isorod.contact.packed`).
    rows, columns, values
        The last tangent: repeated entries add up.
    version
        Counts how often the pattern of the tangent has changed.
    """

    def __init__(self, model: Model) -> None:
        refuse(model.contacts, faces=True)
        self._model = model
        self.packed = pack(model)
        self._stage = PETSc.Log.Stage("contact")
        self._base = np.concatenate([body.space.positions for body in model.bodies])
        self._patches = np.empty(0, PATCH)
        self._last = self._patches
        self.rows = self.columns = np.empty(0, dtype=np.int64)
        self.values = np.empty(0)
        self._begin = np.zeros(1, dtype=np.int64)
        self.version = 0

    def _positions(self, displacement: Array) -> Array:
        return self._base + displacement.reshape(-1, 3)

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces of contact on all degrees of freedom ``(dofs,)``, and its energy."""
        self.packed.forget()
        return self._add_forces(self._positions(displacement))

    def _add_forces(self, positions: Array) -> tuple[Array, float]:
        forces = np.zeros_like(self._base)
        with self._stage:
            pressing = add_forces(self.packed, positions, forces)
        return forces.ravel(), pressing.energy

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, the second derivatives of the energy at ``rows`` and ``columns``.

        Nodes of two sides (three control points by the layers of an element) that touch couple with each other.  Where
        a patch comes that is not in the pattern, the pattern is made anew of the patches of this call and the last one,
        and ``version`` grows.
        """
        packed, positions = self.packed, self._positions(displacement)
        # Where the forces were asked for just before, nothing has moved since: closest points are known.
        if not np.array_equal(packed.before[packed.carriers], positions[packed.carriers]):
            packed.forget()
        self._add_forces(positions)
        active = np.flatnonzero(packed.states["pressure"] > 0.0)
        patches = np.empty(active.size, PATCH)
        find_patches(packed, active, patches)
        touched, which = np.unique(patches, return_inverse=True)
        if not np.isin(touched, self._patches).all():
            self._renew(np.union1d(touched, self._last))
        self._last = touched
        begin = self._begin[np.searchsorted(self._patches, touched)][which]
        self.values = np.zeros(self._begin[-1])
        with self._stage:
            add_blocks(packed, positions, active, patches, begin, self.values)
        return self.values

    def _renew(self, patches: Table) -> None:
        """Make the pattern anew, of dense blocks of the nodes of each of these patches, sorted."""
        self._patches = patches
        self.version += 1
        nodes = np.empty(NODES, dtype=np.int64)
        rows, columns, sizes = [], [], [0]
        for patch in patches:
            count = patch_nodes(self.packed, patch, nodes)
            dofs = (3 * nodes[:count, None] + np.arange(3)).ravel()
            rows.append(np.repeat(dofs, dofs.size))
            columns.append(np.tile(dofs, dofs.size))
            sizes.append(dofs.size**2)
        self.rows, self.columns = np.concatenate(rows), np.concatenate(columns)
        self._begin = np.cumsum(sizes)

    def product(self, move: Array) -> Array:
        """Return the last tangent times a vector of all degrees of freedom."""
        return np.bincount(self.rows, self.values * move[self.columns], move.size).astype(np.float64, copy=False)

    def results(self, displacement: Array) -> list[ContactResult]:
        """Return the outcome of each contact at a displacement ``(dofs,)``."""
        self.forces(displacement)
        return measure(self._model, self.packed)

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
