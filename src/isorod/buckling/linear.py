"""Load factors of the state of rest, linear buckling: ``K x = -mu K' x``, the lowest positive ``mu``.

Slender rods are far stiffer axially than in bending, so that in the inner product of ``K`` shapes are lost to rounding.
Therefore subspace iteration by ``K^-1 K'`` in the inner product of the mass, with a Rayleigh-Ritz projection each time,
from the lowest vibration modes by SLEPc and random ones; the inertia of ``K + mu K'`` proves that no ``mu`` is missed.
"""

from typing import NamedTuple

import numpy as np
from petsc4py import PETSc
from scipy.linalg import eigh

from isorod.arrays import Array
from isorod.buckling.tangents import Tangents
from isorod.checks.correction import reduced
from isorod.errors import InputError, SolveError
from isorod.petsc import inertia
from isorod.petsc.softest import noise

# Minimum and maximum number of iterations, and relative change at convergence.
_LEAST, _MOST, _SETTLED = 5, 200, 1e-10

# Factors are counted up to this (relative) above the last one.
_ABOVE = 1e-6

# Reciprocals of factors below this fraction of the largest in size are rounding, as with tensile loads.
_PULLS = 1e-4


class Linear(NamedTuple):
    """Factors of the state of rest, ascending.

    Attributes
    ----------
    factors, residuals : (m,)
        Factors, and ``|K x + mu K' x| / |mu K' x|`` of each.
    shapes
        On the unknowns.
    """

    factors: Array
    residuals: Array
    shapes: list[PETSc.Vec]


def linear(tangents: Tangents, mass: PETSc.Mat, block: list[PETSc.Vec], count: int, pressures: int) -> Linear:
    """Return the ``count`` lowest positive factors, or fewer where there are no more.

    Parameters
    ----------
    tangents
        At rest.
    mass
        Mass matrix.
    block
        Initial shapes, more than ``count``; their entries are changed.
    pressures
        Number of pressures among the unknowns.

    Raises
    ------
    InputError
        If the load reduces the stiffness nowhere.
    SolveError
        If the iteration does not settle, or the count shows that a factor is missed.
    """
    before = np.full(count, np.inf)
    # The lowest vibration modes may be orthogonal to the buckling shapes, as of a pipe that becomes oval.
    block = [*block, *(noise(tangents.rate, seed) for seed in range(count + 1))]
    for iteration in range(_MOST):
        forces = [tangents.derivative * shape for shape in block]
        for shape, force in zip(block, forces, strict=True):
            tangents.ksp.solve(force, shape)
        held, basis = reduced(mass, forces, block)
        pushed = [tangents.derivative * shape for shape in block]
        lost = np.array([[a.dot(b) for b in block] for a in pushed])
        rates, small = eigh(-0.5 * basis.T @ (lost + lost.T) @ basis, held)
        turns = basis @ small[:, ::-1]
        block, forces, pushed = (_combined(vectors, turns) for vectors in (block, forces, pushed))
        reciprocals = rates[::-1][:count]
        reciprocals = reciprocals[reciprocals > _PULLS * np.abs(rates).max()]
        moved = np.abs(reciprocals - before).max(initial=0.0) if reciprocals.size == before.size else np.inf
        before = reciprocals
        if iteration < _LEAST or not moved <= _SETTLED * np.abs(reciprocals).max(initial=0.0):
            continue
        if not reciprocals.size:
            raise InputError("buckling: these loads never make the tangent stiffness singular: they pull, or stiffen")
        factors = 1.0 / reciprocals
        below = _count(tangents, factors[-1]) - pressures
        # The second of two equal factors may converge later.
        if below == int((rates * (1.0 + _ABOVE) * factors[-1] >= 1.0).sum()):
            break
    else:
        raise SolveError("buckling: the linear factors do not settle, or one is missed; ask for other numbers of modes")
    residuals = []
    for factor, force, push in zip(factors, forces, pushed, strict=False):
        force.axpy(factor, push)
        residuals.append(force.norm() / (factor * push.norm()))
    return Linear(factors, np.array(residuals), block[: reciprocals.size])


def _combined(vectors: list[PETSc.Vec], turns: Array) -> list[PETSc.Vec]:
    """Return linear combinations of vectors, one for each column of the matrix; destroy the vectors."""
    combinations = []
    for column in turns.T:
        combination = vectors[0].duplicate()
        combination.zeroEntries()
        combination.maxpy(column, vectors)
        combinations.append(combination)
    for vector in vectors:
        vector.destroy()
    return combinations


def _count(tangents: Tangents, factor: float) -> int:
    """Return the number of negative eigenvalues of the tangent just above a factor."""
    matrix = tangents.stiffness.copy()
    matrix.axpy(factor * (1.0 + _ABOVE), tangents.derivative, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    negative = inertia.negative_eigenvalues(matrix)
    matrix.destroy()
    return negative
