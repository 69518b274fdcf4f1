"""Modal assurance criterion between isorod's modes and modes given at points of the rod."""

import numpy as np

from isorod.arrays import Array
from isorod.modal import Modes


def shapes_at(found: Modes, xi: Array, u: Array) -> Array:
    """Return mode shapes of the first body at parameters ``xi`` ``(m, 2)``, ``u`` ``(m,)``, shape ``(modes, m, 3)``."""
    space = found.model.bodies[0].space
    result = np.empty((len(found.vectors), len(u), 3))
    # Points come in layers of equal u; a layer is one evaluation.
    for height in np.unique(u):
        here = u == height
        for k, vector in enumerate(found.vectors):
            values, _ = space.displacement(found.model.nodal(vector), xi[here], [height])
            result[k, here] = values[0]
    return result


def matrix(first: Array, second: Array) -> Array:
    """Return ``|a.b|^2 / (a.a b.b)`` of every pair of shapes ``(modes, m, 3)``.

    1 where two are the same but for a factor.
    """
    a, b = first.reshape(len(first), -1), second.reshape(len(second), -1)
    return (a @ b.T) ** 2 / np.outer(np.sum(a * a, axis=1), np.sum(b * b, axis=1))
