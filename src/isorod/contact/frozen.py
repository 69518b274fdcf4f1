"""Contact as it is in an equilibrium, linear about it: what presses where, on spaces that need not be the same.

Points keep their partners and normals and, as springs, the penalty: one whose gap grows by ``g`` presses by
``p - eps g``.  What the curvature of surfaces would add is less by the ratio of penetration and radius.
"""

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc
from scipy.sparse import csr_matrix, vstack

from isorod.arrays import Array, Index
from isorod.contact.result import ContactResult
from isorod.model.contact import Contact, Plane
from isorod.model.model import Model

# Section functions below that are none on a surface.
_NONE = 1e-12


class Frozen:
    """Forces and tangent of contacts about an equilibrium, as `isorod.contact.operator.ContactOperator` has them.

    Parameters
    ----------
    model
        Bodies, on any spaces.
    contacts, results
        Contacts without friction, and their outcome.
    displacement
        The equilibrium on the spaces of the model, shape ``(dofs,)``.
    comm
        The ranks, each of which has a share of the tangent.
    """

    friction, version = None, 0

    def __init__(
        self,
        model: Model,
        contacts: Sequence[Contact],
        results: Sequence[ContactResult],
        displacement: Array,
        comm: PETSc.Comm,
    ) -> None:
        self._start = displacement
        gaps, loads, springs, ways = [csr_matrix((0, model.dofs))], [np.empty(0)], [np.empty(0)], [np.empty(0)]
        for contact, one in zip(contacts, results, strict=True):
            here = one.pressure > 0.0
            normals, obstacle = one.normals[here], contact.obstacle
            own = _rows(model, one.body[here], one.parameters[here], normals)
            gaps.append(own + _rows(model, one.partners[here], one.feet[here], -normals))
            loads.append((one.areas * one.pressure)[here])
            springs.append(one.penalty * one.areas[here])
            way = np.zeros(3)
            if isinstance(obstacle, Plane):
                way = contact.travel * np.array(obstacle.normal) / np.linalg.norm(obstacle.normal)
            ways.append(normals @ way)
        self._gaps = csr_matrix(vstack(gaps))
        self._loads, self._springs, self._ways = (np.concatenate(one) for one in (loads, springs, ways))
        share = np.where(np.arange(self._loads.size) % comm.getSize() == comm.getRank(), self._springs, 0.0)
        stiffness = (self._gaps.T @ self._gaps.multiply(share[:, None])).tocoo()
        self.rows, self.columns = stiffness.row.astype(np.int64), stiffness.col.astype(np.int64)
        self._values = np.asarray(stiffness.data, dtype=float)

    def place(self, factor: float) -> None:
        """Leave obstacles where they are."""

    def push(self) -> float:
        """Return what obstacles that move press: it is among the forces."""
        return 0.0

    def _pressed(self, displacement: Array) -> Array:
        return np.asarray(self._loads - self._springs * (self._gaps @ (displacement - self._start)))

    def forces(self, displacement: Array) -> tuple[Array, float]:
        """Return the forces on all degrees of freedom ``(dofs,)``, and no energy."""
        return np.asarray(self._gaps.T @ self._pressed(displacement)), 0.0

    def tangent(self, displacement: Array) -> Array:
        """Return minus the derivatives of the forces at ``rows`` and ``columns``: a share of each rank."""
        return self._values

    def work(self, displacement: Array) -> Array:
        """Return the work of each point's force on the way that its obstacle moves."""
        return self._pressed(displacement) * self._ways


def _rows(model: Model, bodies: Index, places: Array, directions: Array) -> csr_matrix:
    """Return how far points of surfaces move in some directions, as rows over all degrees of freedom.

    Parameters
    ----------
    bodies, places
        Body of each point, -1 where it is an obstacle's, its axis parameter and its angle, shapes ``(m,)``, ``(m, 2)``.
    directions
        Shape ``(m, 3)``.
    """
    values, rows, columns = [np.empty(0)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    for b, body in enumerate(model.bodies):
        here, space = np.flatnonzero(bodies == b), body.space
        if not here.size:
            continue
        u, angle = places[here].T
        across = space.basis.functions(np.stack([np.cos(angle), np.sin(angle)], axis=1))[0]
        first, along, _ = space.axis.local(u)
        layers = (first[:, None] + np.arange(along.shape[1])) % space.layers
        nodes = int(model.first_node[b]) + layers[:, :, None] * space.layer_nodes + np.arange(across.shape[1])
        entries = along[:, :, None, None] * across[:, None, :, None] * directions[here, None, None, :]
        kept = np.broadcast_to(np.abs(across[:, None, :, None]) > _NONE, entries.shape)
        values.append(entries[kept])
        rows.append(np.broadcast_to(here[:, None, None, None], entries.shape)[kept])
        columns.append((3 * nodes[..., None] + np.arange(3))[kept])
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_matrix(entries, shape=(bodies.size, model.dofs))
