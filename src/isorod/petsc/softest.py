"""Inverse iteration towards the softest motion of a matrix."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from petsc4py import PETSc

from isorod.arrays import Array


def noise(vector: PETSc.Vec, seed: int = 0) -> PETSc.Vec:
    """Return a random vector with the layout of a vector, the same on any number of ranks."""
    result = vector.duplicate()
    result.array_w[:] = _normal(result.getSize(), seed)[slice(*result.getOwnershipRange())]
    return result


@lru_cache(maxsize=1)
def _normal(size: int, seed: int) -> Array:
    """Return normally distributed random numbers; kept, since the models of a sweep need the same."""
    return np.random.default_rng(seed).normal(size=size)


def soften(
    ksp: PETSc.KSP,
    weight: PETSc.Vec,
    shape: PETSc.Vec,
    iterations: int,
    purge: Callable[[PETSc.Vec], None] = lambda shape: None,
) -> tuple[float, PETSc.Vec]:
    """Iterate a shape towards the lowest eigenvector of ``K v = l D v``, in place.

    Parameters
    ----------
    ksp
        Solver with ``K``.
    weight
        The diagonal ``D``, not negative.
    shape
        Start and result of the iteration.
    iterations
        Number of iterations.
    purge
        Called with the shape before each iteration.

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
