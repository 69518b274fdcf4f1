"""Stiffness against the motion of a support: that of a spring between its ends."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.support import Support
from isorod.tensors import rotation

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class _Motion(NamedTuple):
    """A motion of a support: its size, length or radians, and along it the force of the support, or its moment."""

    size: float
    force: float


def secant(solution: Any, support: int) -> float:
    """Return force over displacement, or moment over turn, of a support."""
    moved = _motion(solution, support)
    return moved.force / moved.size


def tangent(solution: Any, support: int) -> float:
    """Return how fast force grows with displacement, or moment with turn, by the tangent stiffness of the model.

    Where the motion moves degrees of freedom by ``v`` and others, columns of ``y``, are free, it is ``v K v`` less what
    is saved as these adapt, ``v K y (y K y)^-1 y K v``, and what forces do on the second derivative of a turn.
    """
    from isorod.output.matrices import matrices
    from isorod.output.state import State

    moved = _motion(solution, support)
    model = solution.model
    if not isinstance(solution, State):
        raise InputError("stiffness: slope 'tangent' is available for solutions of isorod only; use 'secant'")
    if model.contacts:
        raise InputError("stiffness: slope 'tangent' is not available with contact; use 'secant'")
    from scipy.sparse.linalg import splu

    others = [one for k, one in enumerate(model.supports) if k != support]
    free = replace(model, supports=others)
    whole = matrices(free, State(free, solution.displacement, pressures=solution.pressures))
    own = matrices(model, solution)
    motion = model.motions[support]
    turned = motion.arms @ rotation(motion.turn).T
    rate = np.cross(motion.turn, turned)
    first, second = np.zeros((2, model.dofs))
    k = np.arange(motion.dofs.size)
    first[motion.dofs] = motion.path[-1] + rate[k, motion.dofs % 3]
    second[motion.dofs] = np.cross(motion.turn, rate)[k, motion.dofs % 3]
    restricted = _mean(whole.expansion)
    v = restricted @ first
    y = restricted @ own.expansion + _pressures(whole.expansion, own.expansion)
    pull = whole.stiffness @ v
    adapted = splu(own.stiffness.tocsc()).solve(y.T @ pull)
    # Of the supported model what is out of balance is the supports' own.
    forces = -whole.force
    work = v @ pull - (whole.stiffness.T @ v) @ (y @ adapted) + forces @ (restricted @ second)
    return float(work) / moved.size**2


def _mean(expansion: "csr_array") -> Any:
    """Return the matrix that finds the unknowns that an expansion makes degrees of freedom of."""
    from scipy.sparse import diags

    counts = np.asarray(expansion.sum(axis=0)).ravel()
    return diags(1.0 / np.maximum(counts, 1.0)) @ expansion.T


def _pressures(whole: "csr_array", own: "csr_array") -> Any:
    """Return the matrix from the pressures of one model to those of another, of which both have the same."""
    from scipy.sparse import csr_array

    rows, columns = (np.flatnonzero(np.asarray(one.sum(axis=0)).ravel() == 0.0) for one in (whole, own))
    return csr_array((np.ones(rows.size), (rows, columns)), shape=(whole.shape[1], own.shape[1]))


def _motion(solution: Any, support: int) -> _Motion:
    one: Support = solution.model.supports[support]
    space = solution.model.bodies[one.body].space
    nodes, turn = np.asarray(one.nodes), np.asarray(one.turn, dtype=float)
    control = space.is_control_point[nodes]
    given: Array = np.broadcast_to(np.asarray(one.displacement, dtype=float), (nodes.size, 3))[control].mean(axis=0)
    given = given * np.array([letter in one.components for letter in "xyz"])
    if given.any() and turn.any():
        raise InputError("stiffness: the support has a displacement and a turn, need one of the two")
    if given.any():
        size = float(np.linalg.norm(given))
        return _Motion(size, float(solution.reactions[support] @ given / size))
    if not turn.any():
        raise InputError("stiffness: the support does not move, need one with a displacement or a turn")
    # Moments of a solution are about the middle of the face, which may turn about another point.
    arm = rotation(turn) @ np.asarray(one.arms)[control].mean(axis=0)
    moment = solution.moments[support] + np.cross(arm, solution.reactions[support])
    size = float(np.linalg.norm(turn))
    return _Motion(size, float(moment @ turn / size))
