"""Inverse iteration towards the softest motion of a matrix."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array


def noise(vector: PETSc.Vec, seed: int = 0) -> PETSc.Vec:
    """Return a random vector of a layout, the same on any number of ranks."""
    found = vector.duplicate()
    found.array_w[:] = _normal(found.getSize(), seed)[slice(*found.getOwnershipRange())]
    return found


@lru_cache(maxsize=1)
def _normal(size: int, seed: int) -> Array:
    """Return so many random numbers; of models of a sweep the same."""
    return np.random.default_rng(seed).normal(size=size)


def soften(
    ksp: PETSc.KSP,
    weight: PETSc.Vec,
    shape: PETSc.Vec,
    iterations: int,
    purge: Callable[[PETSc.Vec], None] = lambda shape: None,
) -> tuple[float, PETSc.Vec]:
    """Take a shape towards the lowest eigenvector of ``K v = l D v``, in place.

    Parameters
    ----------
    ksp
        Solver with ``K``.
    weight
        The diagonal ``D``, not negative.
    shape
        Where the iteration starts, and ends.
    iterations
        How many there are.
    purge
        Called with the shape before each.

    Returns
    -------
    value, push
        Estimate of ``l``, infinite where the solve underflows, and the force ``K v``.
    """
    push, value = shape.duplicate(), 0.0
    for _ in range(iterations):
        purge(shape)
        shape.scale(1.0 / np.sqrt(shape.dot(weight * shape)))
        push.pointwiseMult(weight, shape)
        ksp.solve(push, shape)
        work = push.dot(shape)
        value = 1.0 / work if work else np.inf
    return value, push
