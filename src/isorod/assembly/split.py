"""Which elements and degrees of freedom a rank has: elements in equal shares along the axes, body after body."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from isorod.arrays import Index
from isorod.model.body import Body
from isorod.model.model import Model


class Numbers(NamedTuple):
    """An assembler's numbers of degrees of freedom: layer by layer, those of a body from ``first[b]`` on.

    ``layer_dofs`` returns how many a layer of a body has; its displacements come first.
    """

    model: Model
    first: Index
    layer_dofs: Callable[[Body], int]

    def of_model(self) -> Index:
        """Return the number of each of the model's degrees of freedom, ascending."""
        found = [np.empty(0, np.int64)]
        for b, body in enumerate(self.model.bodies):
            layers = np.arange(body.space.layers)[:, None] * self.layer_dofs(body)
            found.append((self.first[b] + layers + np.arange(3 * body.space.layer_nodes)).ravel())
        return np.concatenate(found)


class Share(NamedTuple):
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


class Split:
    """The elements of a model over ranks.

    Parameters
    ----------
    numbers
        The assembler's numbers.
    size
        Number of ranks.
    """

    def __init__(self, numbers: Numbers, size: int) -> None:
        self._numbers = numbers
        counts = [body.space.axis.elements for body in numbers.model.bodies]
        self._first_element = np.concatenate([[0], np.cumsum(counts)])
        self._bounds = self._first_element[-1] * np.arange(size + 1) // size

    def shares(self, rank: int) -> list[Share]:
        """Return the elements of a rank."""
        model, first_dof, layer_dofs = self._numbers
        found = []
        for b, body in enumerate(model.bodies):
            own = self._bounds[rank : rank + 2] - self._first_element[b]
            low, high = (int(x) for x in np.clip(own, 0, body.space.axis.elements))
            if high > low:
                first = int(model.first_node[b]), int(first_dof[b])
                found.append(Share(body, b, *first, layer_dofs(body), low, high))
        return found

    def owners(self) -> Index:
        """Return the rank of each degree of freedom: a layer is the first element's that has it."""
        model, first_dof, layer_dofs = self._numbers
        owner = np.zeros(first_dof[-1], dtype=np.int64)
        for b, body in enumerate(model.bodies):
            layers, count = body.space.element_layers, body.space.axis.elements
            first = np.full(body.space.layers, count)
            np.minimum.at(first, layers.ravel(), np.repeat(np.arange(count), layers.shape[1]))
            ranks = np.searchsorted(self._bounds, self._first_element[b] + first, side="right") - 1
            owner[first_dof[b] : first_dof[b + 1]] = np.repeat(ranks, layer_dofs(body))
        return owner
