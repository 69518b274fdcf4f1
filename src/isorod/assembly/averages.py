"""Supports of mean motions (`isorod.model.mean.MeanSupport`) in terms of a model's nodes."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from isorod.arrays import Array, Index
from isorod.model.mean import MeanSupport
from isorod.model.model import Model


class Mean(NamedTuple):
    """A support of mean motions.

    Attributes
    ----------
    nodes : (n,)
        Nodes of the section.
    rows : (k, n, 3)
        Coefficients of the mean motions in terms of their displacements.
    stiffness : (k,)
        Stiffness of the springs on them; None where they are held.
    """

    nodes: Index
    rows: Array
    stiffness: Array | None

    @property
    def held(self) -> bool:
        """Whether they are held, and no springs act on them."""
        return self.stiffness is None

    def on_dofs(self, scale: Array, dofs: int) -> csr_array:
        """Return the rows, each times a scale, on all degrees of freedom."""
        own = (3 * self.nodes[:, None] + np.arange(3)).ravel()
        count = len(self.rows)
        values = (scale[:, None, None] * self.rows).ravel()
        return csr_array((values, np.tile(own, count), own.size * np.arange(count + 1)), shape=(count, dofs))

    def moved(self, displacement: Array) -> Array:
        """Return the mean motions ``(k,)`` of displacements of all degrees of freedom."""
        return np.asarray(np.einsum("kna,na->k", self.rows, displacement.reshape(-1, 3)[self.nodes]))

    def pushed(self, carried: Array, count: int) -> Array:
        """Return the nodal forces ``(count, 3)`` of generalised forces ``(k,)``."""
        result = np.zeros((count, 3))
        result[self.nodes] = np.einsum("k,kna->na", carried, self.rows)
        return result


def mean_of(model: Model, support: MeanSupport) -> Mean:
    """Return a support in terms of its model's nodes."""
    nodes, rows = support.rows(model.bodies[support.body].space)
    return Mean(int(model.first_node[support.body]) + nodes, rows, support.stiffness)


def apart(means: dict[int, Mean]) -> list[list[int]]:
    """Return the numbers of supports in sets without common nodes."""
    sets: list[tuple[list[int], set[int]]] = []
    for k, one in means.items():
        nodes = set(one.nodes.tolist())
        meeting = [each for each in sets if not nodes.isdisjoint(each[1])]
        sets = [each for each in sets if nodes.isdisjoint(each[1])]
        joined = [j for numbers, _ in meeting for j in numbers]
        sets.append(([*joined, k], nodes.union(*(own for _, own in meeting))))
    return [numbers for numbers, _ in sets]


def centroid_weights(model: Model, support: MeanSupport) -> Array:
    """Return the weights of all nodes in the position of a support's section centroid, ``(nodes,)``."""
    nodes, values = support.middle(model.bodies[support.body].space)
    result = np.zeros(model.dofs // 3)
    result[int(model.first_node[support.body]) + nodes] = values
    return result


def forces_of(model: Model, amounts: dict[int, Array]) -> Array:
    """Return the resultant force of each support of mean motions, zero of others, ``(supports, 3)``."""
    result = np.zeros((max(len(model.supports), 1), 3))
    for k, amount in amounts.items():
        directions = model.means[k].directions
        result[k] = amount[: len(directions)] @ directions
    return result
