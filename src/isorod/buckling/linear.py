"""Load factors of the state of rest: ``K x = -mu K' x``, the ``mu`` least above zero.

Slender rods are far stiffer along than across, and the inner product of ``K`` drowns shapes in rounding.  So a block of
shapes, at first the lowest vibration modes by SLEPc and random ones, is taken through ``K^-1 K'`` in the inner product
of the mass, with a Rayleigh-Ritz projection each time; the inertia of ``K + mu K'`` proves that no ``mu`` is missed.
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

# Iterations at least and at most, and relative changes that are none.
_LEAST, _MOST, _SETTLED = 5, 200, 1e-10

# How far (relative) above the last factor they are counted.
_ABOVE = 1e-6

# Reciprocals of factors that are smaller than this share of the largest, of loads that pull, are none.
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


def linear(tangents: Tangents, mass: PETSc.Mat, block: list[PETSc.Vec], wanted: int, pressures: int) -> Linear:
    """Return the ``wanted`` least factors above zero, fewer where the load makes fewer.

    Parameters
    ----------
    tangents
        At rest.
    mass
        Mass matrix.
    block
        Shapes to begin with, more than are wanted; their entries are changed.
    pressures
        Number of pressures among the unknowns.

    Raises
    ------
    InputError
        If the load takes no stiffness away, however large it is.
    SolveError
        If the iteration does not settle, or the count shows that a factor is missed.
    """
    before = np.full(wanted, np.inf)
    # Lowest vibration modes may have nothing of what buckles, as of a pipe's ovals.
    block = [*block, *(noise(tangents.rate, seed) for seed in range(wanted + 1))]
    for count in range(_MOST):
        forces = [tangents.derivative * one for one in block]
        for one, force in zip(block, forces, strict=True):
            tangents.ksp.solve(force, one)
        held, basis = reduced(mass, forces, block)
        pushed = [tangents.derivative * one for one in block]
        lost = np.array([[a.dot(b) for b in block] for a in pushed])
        rates, small = eigh(-0.5 * basis.T @ (lost + lost.T) @ basis, held)
        turns = basis @ small[:, ::-1]
        block, forces, pushed = (_combined(several, turns) for several in (block, forces, pushed))
        found = rates[::-1][:wanted]
        found = found[found > _PULLS * np.abs(rates).max()]
        moved = np.abs(found - before).max(initial=0.0) if found.size == before.size else np.inf
        before = found
        if count < _LEAST or not moved <= _SETTLED * np.abs(found).max(initial=0.0):
            continue
        if not found.size:
            raise InputError("buckling: these loads never make the tangent stiffness singular: they pull, or stiffen")
        factors = 1.0 / found
        below = _count(tangents, factors[-1]) - pressures
        # The other one of two that are the same may take longer.
        if below == int((rates * (1.0 + _ABOVE) * factors[-1] >= 1.0).sum()):
            break
    else:
        raise SolveError("buckling: the linear factors do not settle, or one is missed; ask for other numbers of modes")
    residuals = []
    for factor, force, push in zip(factors, forces, pushed, strict=False):
        force.axpy(factor, push)
        residuals.append(force.norm() / (factor * push.norm()))
    return Linear(factors, np.array(residuals), block[: found.size])


def _combined(several: list[PETSc.Vec], turns: Array) -> list[PETSc.Vec]:
    """Return combinations of vectors, a column of the matrix each."""
    found = []
    for column in turns.T:
        one = several[0].duplicate()
        one.zeroEntries()
        one.maxpy(column, several)
        found.append(one)
    for one in several:
        one.destroy()
    return found


def _count(tangents: Tangents, factor: float) -> int:
    """Return the number of negative eigenvalues of the tangent just above a factor."""
    matrix = tangents.stiffness.copy()
    matrix.axpy(factor * (1.0 + _ABOVE), tangents.derivative, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
    found = inertia.negative_eigenvalues(matrix)
    matrix.destroy()
    return found
