"""Multipliers of a weld whose surface ends at a support: what becomes of the traces of functions that are held.

Were they left out, multipliers would vanish at the edge, constant tractions would not be among them, and the bodies
would come apart between the support and the next functions.  Each is added to the nearest one that is free, so that
constants stay (Bernardi, Maday and Patera 1994, for linear functions on a line).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.space.space import Space


def passed_on_along(space: Space, nodes: Index, free: NDArray[np.bool_]) -> csr_array:
    """Return to which free functions of a rod those that are held are added, ``(held, free)``: of the same one across.

    Parameters
    ----------
    space
        That of the rod.
    nodes
        The functions, nodes of the space.
    free
        Which of them no support holds.
    """
    held, rest = np.flatnonzero(~free), np.flatnonzero(free)
    layer, function = np.divmod(nodes, space.layer_nodes)
    apart = np.abs(layer[held][:, None] - layer[rest]).astype(float)
    if space.rod.closed:
        apart = np.minimum(apart, space.layers - apart)
    apart[function[held][:, None] != function[rest]] = np.inf
    to = apart.argmin(axis=1)
    found = np.flatnonzero(np.isfinite(apart[np.arange(held.size), to]))
    return csr_array((np.ones(found.size), (found, to[found])), shape=(held.size, rest.size))


def passed_on_near(points: Array, weights: Array, traces: csr_array, free: NDArray[np.bool_]) -> csr_array:
    """Return to which free functions of a solid those that are held are added, ``(held, free)``.

    Parameters
    ----------
    points, weights
        Points of quadrature on the surface ``(q, 3)`` and areas ``(q,)``.
    traces
        The functions there, ``(q, k)``.
    free
        Which of them no support holds.
    """
    held, rest = np.flatnonzero(~free), np.flatnonzero(free)
    square = traces.power(2).T
    middle = square @ (weights[:, None] * points) / (square @ weights)[:, None]
    to = cKDTree(middle[rest]).query(middle[held])[1]
    return csr_array((np.ones(held.size), (np.arange(held.size), to)), shape=(held.size, rest.size))
