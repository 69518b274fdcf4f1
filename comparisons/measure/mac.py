"""Modal assurance criterion."""

import numpy as np

from isorod.arrays import Array


def matrix(first: Array, second: Array) -> Array:
    """Return ``|a.b|^2 / (a.a b.b)`` of every pair of shapes ``(modes, m, 3)``.

    1 where two are the same but for a factor.
    """
    a, b = first.reshape(len(first), -1), second.reshape(len(second), -1)
    return (a @ b.T) ** 2 / np.outer(np.sum(a * a, axis=1), np.sum(b * b, axis=1))
