"""Compiled: what ranks tell each other in a step, and the mass that they divide by together.

Each eliminates the nodes inside its part, as `isorod.dynamics.explicit.cholesky` has it.  What is left of all parts is
added up, one sum a step, and every rank solves for the nodes on all edges.
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

# Numbers that are added up behind those of the edges: points that are inverted, and twice the kinetic energy after the
# last step.
INVERTED_POINTS, ENERGY, NUMBERS = 0, 1, 2


class TieFactors(NamedTuple):
    """What ties take off a velocity (`isorod.dynamics.explicit.ties`), of none unless it is told.

    Attributes
    ----------
    first, columns, values
        Rows of ``G`` in compressed form, of this rank's degrees of freedom: places in a state vector.
    places, starts, which, spread
        Where a velocity changes on this rank, ``(n,)``, and by how much of each entry of ``G v``, in compressed form.
    own, all
        ``G v``: what this rank has of it, and the sums, ``(ties,)``.
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
        """Return those of no ties."""
        whole, nothing = np.zeros(1, dtype=np.uint64), np.empty(0)
        return cls(whole, whole[:0], nothing, whole[:0], whole, whole[:0], nothing, nothing, nothing)


class MassFactors(NamedTuple):
    """Factors of the mass, and what ranks exchange to divide by it.

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
        Which of this rank's rows are on edges, and which of the ``G`` they are.
    reduced, left
        Work space: this rank's rows, shape ``(3, R)``, and those of the edges, shape ``(3, G)``.
    own, all
        Three components of the ``G`` rows and ``NUMBERS`` behind: what this rank gives, and the sums.
    ties
        What ties take off.
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
    """Fill ``sums`` with those over all ranks of ``own``."""
    if call[0] == 0:
        sums[:] = own
        return
    _call(call[0], (own.ctypes.data, sums.ctypes.data, np.int32(own.size), call[1], call[2], call[3]))


@njit(void(MASS_FACTORS, F1), **FAST)
def eliminate(mass: MassFactors, momenta: Array) -> None:
    """Eliminate what is inside this rank's part, of its momenta, a state vector, and say what is left to add up."""
    reduce(mass.inside, momenta, mass.reduced)
    rows, places, edges = mass.rows, mass.places, 3 * mass.left.shape[1]
    mass.own[:edges] = 0.0
    for k in range(rows.size):
        for c in range(3):
            mass.own[3 * places[k] + np.uint64(c)] = mass.reduced[c, rows[k]]


@njit(void(TIE_FACTORS, U1, F1), **FAST)
def tie(ties: TieFactors, call: NDArray[np.uint64], velocity: Array) -> None:
    """Take off a velocity, a state vector, what ties do not let be."""
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
    """Fill this rank's part of a velocity, a state vector, from what `eliminate` left and was added up."""
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
