"""Moments of sections (`isorod.model.load.SectionLoad`): ``f_i = w x int R_i r dA`` with present positions ``r``.

With nodal positions ``x`` and ``B_ij = int R_i R_j dA - int R_i dA int R_j dA / A`` they are ``f = w x B x``, where
``J w = moment``, ``J = tr(P) 1 - P``, ``P = x^T B x``.  The derivative is not symmetric, since a moment fixed in space
has no potential.
"""

import numpy as np

from isorod.arrays import Array
from isorod.assembly.partition import ElementRange
from isorod.model.load import SectionLoad
from isorod.tensors import cross


def spread_of(weights: Array, values: Array) -> Array:
    """Return ``B`` ``(m, m)`` of functions ``(q, m)`` at points of a section with weights ``(q,)``."""
    mean = weights @ values
    return np.asarray((weights[:, None] * values).T @ values - np.outer(mean, mean) / weights.sum())


class SectionMoment:
    """The moment of a load on an element that a rank assembles.

    Attributes
    ----------
    element
        Number of the element among the rank's; negative where another rank has it.
    """

    def __init__(self, element_range: ElementRange, load: SectionLoad) -> None:
        space = element_range.body.space
        trace, axis = load.trace(space), space.axis
        u = axis.breaks[-1] if load.u is None else load.u
        element = int(np.clip(np.searchsorted(axis.breaks, u, "right") - 1, 0, axis.elements - 1))
        self.element = element - element_range.first if element_range.first <= element < element_range.last else -1
        self._moment = np.array(load.moment)
        nodes = space.element_nodes[element]
        order = np.argsort(nodes)
        values = np.zeros((len(trace.weights), nodes.size))
        values[:, order[np.searchsorted(nodes, trace.nodes[0], sorter=order)]] = trace.values
        self._spread = spread_of(trace.weights, values)

    def _turned(self, places: Array) -> tuple[Array, Array, Array]:
        """Return ``B x``, ``J^-1`` and ``w``."""
        arms = self._spread @ places
        second = places.T @ arms
        inverse = np.linalg.inv(second.trace() * np.eye(3) - second)
        return arms, inverse, inverse @ self._moment

    def forces(self, places: Array) -> Array:
        """Return the forces at load factor 1 on the element's nodes, shape ``(m, 3)`` of their present positions."""
        arms, _, turn = self._turned(places)
        return np.cross(turn, arms)

    def derivatives(self, places: Array) -> Array:
        """Return the derivatives of the forces by the places, shape ``(3 m, 3 m)``."""
        arms, inverse, turn = self._turned(places)
        # Derivative of J w by the positions at constant w.
        change = 2.0 * np.einsum("jb,a->ajb", arms, turn) - np.einsum("ja,b->ajb", arms, turn)
        change -= np.einsum("ab,j->ajb", np.eye(3), arms @ turn)
        pushed = np.array([cross(arm) for arm in arms]) @ inverse
        result = np.einsum("iac,cjb->iajb", pushed, change, optimize=True)
        result += np.einsum("ij,ab->iajb", self._spread, cross(turn))
        return result.reshape(arms.size, arms.size)
