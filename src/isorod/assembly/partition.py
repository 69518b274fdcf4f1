"""Partition of elements and degrees of freedom over ranks: equal numbers of elements along the axes, body by body."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isorod.arrays import Index
from isorod.model.body import Body
from isorod.model.model import Model


class ElementRange(NamedTuple):
    """The elements ``first .. last - 1`` of a body of the model, number ``which``.

    Its degrees of freedom start at ``first_dof``, ``width`` a layer, its nodes at ``first_node``.
    """

    body: Body
    which: int
    first_node: int
    first_dof: int
    width: int
    first: int
    last: int

    @property
    def layers(self) -> Index:
        """Layers of each element, shape ``(E, l)``."""
        return self.body.space.element_layers[self.first : self.last]

    @property
    def dofs(self) -> Index:
        """Degrees of freedom of each element, shape ``(E, l width)``."""
        dofs = self.first_dof + self.width * self.layers[:, :, None] + np.arange(self.width)
        return dofs.reshape(dofs.shape[0], -1)

    @property
    def couplings(self) -> int:
        """Approximate number of pairs of degrees of freedom with a common element."""
        layers = np.unique(self.layers).size
        return int(layers * min(2 * self.layers.shape[1] - 1, layers) * self.width**2)


class Partition:
    """Partition of a model's elements over ranks.

    Parameters
    ----------
    model
        The model.
    first_dof
        An assembler's first degree of freedom of each body, and their number.
    widths
        Number of degrees of freedom of each body's layers, displacements first.
    size
        Number of ranks.
    """

    def __init__(self, model: Model, first_dof: Index, widths: Sequence[int], size: int) -> None:
        self._model, self._first_dof, self._widths = model, first_dof, widths
        counts = [body.space.axis.elements for body in model.bodies]
        self._first_element = np.concatenate([[0], np.cumsum(counts)])
        self._bounds = self._first_element[-1] * np.arange(size + 1) // size

    def numbers(self) -> Index:
        """Return the assembler's number of each of the model's degrees of freedom, ascending."""
        result = [np.empty(0, np.int64)]
        for body, first, width in zip(self._model.bodies, self._first_dof[:-1], self._widths, strict=True):
            layers = first + np.arange(body.space.layers)[:, None] * width
            result.append((layers + np.arange(3 * body.space.layer_nodes)).ravel())
        return np.concatenate(result)

    def element_ranges(self, rank: int) -> list[ElementRange]:
        """Return the elements of a rank, one range for each body with any."""
        nodes, dofs = self._model.first_node, self._first_dof
        result = []
        for b, body in enumerate(self._model.bodies):
            own = self._bounds[rank : rank + 2] - self._first_element[b]
            low, high = (int(x) for x in np.clip(own, 0, body.space.axis.elements))
            if high > low:
                result.append(ElementRange(body, b, int(nodes[b]), int(dofs[b]), self._widths[b], low, high))
        return result

    def owners(self) -> Index:
        """Return the rank of each degree of freedom: a layer belongs to its first element."""
        owner = np.zeros(self._first_dof[-1], dtype=np.int64)
        for b, body in enumerate(self._model.bodies):
            layers, count = body.space.element_layers, body.space.axis.elements
            first = np.full(body.space.layers, count)
            np.minimum.at(first, layers.ravel(), np.repeat(np.arange(count), layers.shape[1]))
            ranks = np.searchsorted(self._bounds, self._first_element[b] + first, side="right") - 1
            owner[self._first_dof[b] : self._first_dof[b + 1]] = np.repeat(ranks, self._widths[b])
        return owner
