"""Multipliers of a weld whose surface ends at a support: what becomes of the traces of functions that are held.

Were they left out, multipliers would vanish at the edge, constant tractions would not be among them, and the bodies
would come apart between the support and the next functions.  Each is added to the nearest ones that are free, so that
constants stay, along a rod all polynomials of one degree less than the functions' (Bernardi, Maday and Patera 1994, for
linear functions on a line).
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.space.space import Space


class Multipliers(NamedTuple):
    """The multipliers of one component of a weld, one for each of its slaves.

    Attributes
    ----------
    values : (q, s)
        At the points of the slave's surface.
    forces : (s, s)
        What each multiplier, a column, puts on the slaves.
    """

    values: csr_array
    forces: Array


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
    powers = _powers(space)
    row, column, value = [], [], []
    for k, one in enumerate(held):
        apart = np.abs(layer[rest] - layer[one])
        if space.rod.closed:
            apart = np.minimum(apart, space.layers - apart)
        same = np.flatnonzero(function[rest] == function[one])
        near = same[np.argsort(apart[same], kind="stable")[: space.axis.degree]]
        if near.size:
            known = powers[: 1 if space.rod.closed else near.size]
            shares = np.linalg.lstsq(known[:, layer[rest[near]]], known[:, layer[one]], rcond=None)[0]
            row += [k] * near.size
            column += near.tolist()
            value += shares.tolist()
    return csr_array((value, (row, column)), shape=(held.size, rest.size))


def _powers(space: Space) -> Array:
    """Return the coefficients along the axis of Legendre's polynomials of degrees 0 to degree - 1, a row each."""
    axis = space.axis
    low, high = axis.breaks[[0, -1]]
    u = np.unique(np.concatenate([np.linspace(a, b, axis.degree + 2) for a, b in pairwise(axis.breaks)]))
    first, values, _ = axis.local(u)
    functions = np.zeros((len(u), space.layers))
    columns = (first[:, None] + np.arange(axis.degree + 1)) % space.layers
    np.add.at(functions, (np.arange(len(u))[:, None], columns), values)
    wanted = np.polynomial.legendre.legvander(2.0 * (u - low) / (high - low) - 1.0, axis.degree - 1)
    return np.asarray(np.linalg.lstsq(functions, wanted, rcond=None)[0].T)


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
