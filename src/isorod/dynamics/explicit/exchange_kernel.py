"""Compiled: exchange between ranks in a step, and division by the mass (static condensation).

Each rank eliminates the nodes inside its part (`isorod.dynamics.explicit.cholesky`).  The remainders on edges are
summed over ranks, once a step, and every rank solves for the nodes on all edges.
"""

from typing import NamedTuple

import numpy as np
from numba import i4, types, u8, void
from numpy.typing import NDArray

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, STRICT, U1, njit
from isorod.dynamics.explicit.cholesky import FACTORS, Factors, reduce, substitute
from isorod.material.points import caller

_call = caller(i4(u8, u8, i4, u8, u8, u8))

# Numbers summed together with the edges, at the end: inverted points, and twice the kinetic energy after the last step.
INVERTED_POINTS, ENERGY, NUMBERS = 0, 1, 2


class TieFactors(NamedTuple):
    """Constraint of velocities by ties (`isorod.dynamics.explicit.ties`).

    Attributes
    ----------
    first, columns, values
        Rows of ``G`` in compressed form, of this rank's degrees of freedom: places in a state vector.
    places, starts, which, spread
        Places where a velocity changes on this rank, ``(n,)``, and the matrix of ``G v`` there, in compressed form.
    own, all
        ``G v``: this rank's part, and the sums, ``(ties,)``.
    """

    first: NDArray[np.uint64]
    columns: NDArray[np.uint64]
    values: Array
    places: NDArray[np.uint64]
    starts: NDArray[np.uint64]
    which: NDArray[np.uint64]
    spread: Array
    own: Array
    all: Array

    @classmethod
    def none(cls) -> "TieFactors":
        """Return the factors without ties."""
        integers, reals = np.zeros(1, dtype=np.uint64), np.empty(0)
        return cls(integers, integers[:0], reals, integers[:0], integers, integers[:0], reals, reals, reals)


class MassFactors(NamedTuple):
    """Factors of the mass, and the data that ranks exchange to divide by it.

    Attributes
    ----------
    inside
        Factors of this rank's rows.
    call
        Address of MPI's ``MPI_Allreduce``, zero where this rank is alone, and its handles of double, sum and the
        communicator; shape ``(4,)``.
    edges
        Factors of the rows on edges, for state vectors ``(3 G,)``.
    rows, places
        This rank's rows on edges, and their places among the ``G``.
    reduced, left
        Work space: this rank's rows, shape ``(3, R)``, and those of the edges, shape ``(3, G)``.
    own, all
        Three components of the ``G`` rows followed by ``NUMBERS``: this rank's, and the sums.
    ties
        Constraint of velocities by ties.
    """

    inside: Factors
    call: NDArray[np.uint64]
    edges: Factors
    rows: NDArray[np.uint64]
    places: NDArray[np.uint64]
    reduced: Array
    left: Array
    own: Array
    all: Array
    ties: TieFactors


TIE_FACTORS = types.NamedTuple([U1, U1, F1, U1, U1, U1, F1, F1, F1], TieFactors)
MASS_FACTORS = types.NamedTuple([FACTORS, U1, FACTORS, U1, U1, F2, F2, F1, F1, TIE_FACTORS], MassFactors)


@njit(void(U1, F1, F1), **STRICT)
def all_sums(call: NDArray[np.uint64], own: Array, sums: Array) -> None:
    """Fill ``sums`` with the sums of ``own`` over all ranks."""
    if call[0] == 0:
        sums[:] = own
        return
    _call(call[0], (own.ctypes.data, sums.ctypes.data, np.int32(own.size), call[1], call[2], call[3]))


@njit(void(MASS_FACTORS, F1), **FAST)
def eliminate(mass: MassFactors, momenta: Array) -> None:
    """Eliminate the inside of this rank's part from its momenta, a state vector, and fill ``own`` with the edges."""
    reduce(mass.inside, momenta, mass.reduced)
    rows, places, edges = mass.rows, mass.places, 3 * mass.left.shape[1]
    mass.own[:edges] = 0.0
    for k in range(rows.size):
        for c in range(3):
            mass.own[3 * places[k] + np.uint64(c)] = mass.reduced[c, rows[k]]


@njit(void(TIE_FACTORS, U1, F1), **FAST)
def tie(ties: TieFactors, call: NDArray[np.uint64], velocity: Array) -> None:
    """Project a velocity, a state vector, onto those that ties allow."""
    for k in range(ties.own.size):
        apart = 0.0
        for j in range(ties.first[k], ties.first[k + 1]):
            apart += ties.values[j] * velocity[ties.columns[j]]
        ties.own[k] = apart
    all_sums(call, ties.own, ties.all)
    for i in range(ties.places.size):
        change = 0.0
        for j in range(ties.starts[i], ties.starts[i + 1]):
            change += ties.spread[j] * ties.all[ties.which[j]]
        velocity[ties.places[i]] -= change


@njit(void(MASS_FACTORS, F1), **FAST)
def divide(mass: MassFactors, velocity: Array) -> None:
    """Fill this rank's part of a velocity, a state vector, from the sums of the edges after `eliminate`."""
    rows, places = mass.rows, mass.places
    if mass.left.size:
        reduce(mass.edges, mass.all, mass.left)
        substitute(mass.edges, mass.left, mass.all)
        for k in range(rows.size):
            for c in range(3):
                mass.reduced[c, rows[k]] = mass.all[3 * places[k] + np.uint64(c)]
    substitute(mass.inside, mass.reduced, velocity)
    if mass.ties.own.size:
        tie(mass.ties, mass.call, velocity)
