"""Contact as the assembler sees it: forces and exact tangent on the degrees of freedom of a model, of one rank."""

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array, Index
from isorod.contact.force_kernel import add_forces
from isorod.contact.result import ContactResult, measure, slave_points
from isorod.contact.tables import pack
from isorod.contact.tangent_kernel import _NODES, _add_blocks, _nodes, _patches
from isorod.model.model import Model


class ContactOperator:
    """Forces and tangent of all contacts of a model; closest points are sought anew at each call, so that nothing depends on history.

    Attributes
    ----------
    packed
        Arrays of the compiled loops, states of the last call included.
    version
        Counts how often the pattern of the tangent has changed.
    """

    def __init__(self, model: Model) -> None:
        self._model = model
        self.packed = pack(model, augmented=True)
        self._stage = PETSc.Log.Stage("contact")
        self._base = np.concatenate([body.space.positions for body in model.bodies])
        self._keys = np.empty((0, 5), dtype=np.int64)
        self._last = self._keys
        self.rows = self.columns = np.empty(0, dtype=np.int64)
        self.values = np.empty(0)
        self._begin = np.zeros(1, dtype=np.int64)
        self.version = 0

    def _positions(self, displacement: Array) -> Array:
        return self._base + displacement.reshape(-1, 3)

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces of contact on all degrees of freedom ``(dofs,)``, and its energy."""
        forces = np.zeros_like(self._base)
        self.packed.starts[:] = -1.0
        self.packed.clear[:] = -np.inf
        with self._stage:
            energy, _, _, _ = add_forces(self.packed, self._positions(displacement), forces)
        return forces.ravel(), energy

    def tangent(self, displacement: Array) -> Array:
        """Set and return ``values``, the second derivatives of the energy at ``rows`` and ``columns`` (repeated ones add up).

        Nodes of two patches (three control points by the layers of an element) that touch couple with each other.
        Where a pair comes that is not in the pattern, the pattern is made anew of the pairs of this call and the last
        one, and ``version`` grows.
        """
        self.forces(displacement)
        packed = self.packed
        active = np.flatnonzero(packed.states[:, 1] > 0.0)
        keys = np.empty((active.size, 5), dtype=np.int64)
        _patches(packed, active, keys)
        pairs = np.unique(keys, axis=0)
        known = {tuple(key) for key in self._keys.tolist()}
        if not all(tuple(key) in known for key in pairs.tolist()):
            self._renew(np.unique(np.concatenate([pairs, self._last]), axis=0))
        self._last = pairs
        place = {tuple(key): m for m, key in enumerate(self._keys.tolist())}
        which = np.array([place[tuple(key)] for key in keys.tolist()], dtype=np.int64)
        self.values = np.zeros(self._begin[-1])
        with self._stage:
            _add_blocks(packed, self._positions(displacement), active, keys, which, self._begin, self.values)
        return self.values

    def _renew(self, keys: Index) -> None:
        self._keys = keys
        self.version += 1
        nodes = np.empty(_NODES, dtype=np.int64)
        rows, columns, sizes = [], [], [0]
        for key in keys:
            count = _nodes(self.packed, key, nodes)
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
        """Make the pressures of a displacement the new multipliers, unless every contact keeps to its largest penetration.

        Returns
        -------
        What is too deep, in words, or None.
        """
        for k, (contact, result) in enumerate(zip(self._model.contacts, self.results(displacement), strict=True)):
            if contact.penetration is not None and result.penetration > contact.penetration:
                for own, points in slave_points(self._model, self.packed):
                    if own.penetration is not None:
                        self.packed.multipliers[points] = self.packed.states[points, 1]
                return f"contact {k}: penetration {result.penetration:.3g}, wanted {contact.penetration:.3g},"
        return None
