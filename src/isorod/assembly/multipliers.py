"""Multipliers of a weld whose surface ends at a support, where some traces belong to held functions.

Without these traces, multipliers would vanish at the edge, constant tractions would not be among them, and the bodies
would separate between the support and the next functions.  Each is therefore added to the nearest free ones, so that
constants are preserved, along a rod all polynomials of one degree less than the functions' (Bernardi, Maday and Patera
1994, for linear functions on a line).
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.errors import InputError
from isorod.space.space import Space
from isorod.space.trace import Trace

# Coefficients below this fraction of the largest are dropped: they decay exponentially along the surface.
_DROPPED = 1e-13

# Condition number of the slave's functions on its surface from which they count as dependent.
_SINGULAR = 1e10


class Multipliers(NamedTuple):
    """The multipliers of one component of a weld, one for each of its slaves.

    Attributes
    ----------
    values : (q, s)
        At the points of the slave's surface.
    forces : (s, s)
        Forces of each multiplier, a column, on the slaves.
    """

    values: csr_array
    forces: Array


def passed_on_along(space: Space, nodes: Index, free: NDArray[np.bool_]) -> csr_array:
    """Return the weights with which held functions of a rod are added to free ones, ``(held, free)``.

    They are added to those with the same section function.

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
            weights = np.linalg.lstsq(known[:, layer[rest[near]]], known[:, layer[one]], rcond=None)[0]
            row += [k] * near.size
            column += near.tolist()
            value += weights.tolist()
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
    polynomials = np.polynomial.legendre.legvander(2.0 * (u - low) / (high - low) - 1.0, axis.degree - 1)
    return np.asarray(np.linalg.lstsq(functions, polynomials, rcond=None)[0].T)


def passed_on_near(points: Array, weights: Array, traces: csr_array, free: NDArray[np.bool_]) -> csr_array:
    """Return the weights with which held functions of a solid are added to free ones, ``(held, free)``.

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


def projection(jump: csr_array, mine: Index, tests: Array, mass: Array) -> csr_array:
    """Return the coefficients of some of the slave's nodes in terms of all nodes ``(m, nodes)``."""
    left = mass.T
    # The jump without the functions that are solved for.
    drop = np.ones(jump.shape[1])
    drop[mine] = 0.0
    others = csr_array(jump @ csr_array(diags(drop)))
    columns = np.unique(others.indices)
    right = np.asarray((others[:, columns].T @ tests).T)
    # Multipliers that include other traces may be almost orthogonal to their own functions.
    sizes = np.linalg.norm(left, axis=0)
    scale = 1.0 / np.where(sizes > 0.0, sizes, 1.0)
    lengths = np.linalg.norm(left * scale, axis=1)
    rows = 1.0 / np.where(lengths > 0.0, lengths, 1.0)
    scaled = left * scale * rows[:, None]
    if not np.linalg.cond(scaled) < _SINGULAR:
        raise InputError(
            "the slave's functions are not independent on its surface; take the whole surface, or the other as slave"
        )
    coefficients = scale[:, None] * np.linalg.solve(scaled, rows[:, None] * right)
    coefficients[np.abs(coefficients) < _DROPPED * np.abs(coefficients).max(initial=0.0)] = 0.0
    sparse = csr_array(coefficients)
    return csr_array((sparse.data, columns[sparse.indices], sparse.indptr), shape=(mine.size, jump.shape[1]))


def of_component(rows: csr_array, a: int) -> csr_array:
    """Return rows on nodes as rows on degrees of freedom, of one component."""
    return csr_array((rows.data, 3 * rows.indices + a, rows.indptr), shape=(rows.shape[0], 3 * rows.shape[1]))


def tested(kind: str, trace: Trace, own: csr_array) -> Array:
    """Return the multipliers of a tie that is no weld, as vectors times weights, shape ``(k, q, 3)``.

    Of a slide they are the slave's independent functions ``own`` ``(q, m)`` times the normal, else rigid motions.
    """
    weights = trace.weights[:, None]
    if kind == "slide":
        return np.asarray((weights * own.toarray()).T[:, :, None] * trace.normals)
    arms = trace.points - trace.weights @ trace.points / trace.weights.sum()
    shifts = np.broadcast_to(np.eye(3)[:, None], (3, len(arms), 3))
    turns = np.cross(np.eye(3)[:, None], arms[None] / np.abs(arms).max())
    return np.concatenate([shifts, turns]) * weights
