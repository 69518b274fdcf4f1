"""Cholesky factors within the profile (skyline) of a matrix, and what a compiled time step solves with them."""

from typing import NamedTuple

import numpy as np
from numba import b1, types, void
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from isorod.arrays import Array
from isorod.compiled import F1, FAST, U1, U2, njit

_0, _1, _2 = (np.uint64(k) for k in range(3))


class Factors(NamedTuple):
    """Cholesky factors ``L`` of the free parts of all bodies' mass matrices, row by row within their profile.

    Attributes
    ----------
    systems
        Rows, and the first of them below; shape ``(S, 2)``.
    first
        First column of each row that is not zero, shape ``(R,)``.
    starts
        Where a row begins in ``values``, shape ``(R,)``.
    values
        Entries of ``L`` left of the diagonal.
    inverse
        Inverse of the diagonal, shape ``(R,)``.
    order
        Place of each row in a state vector for x, y and z, shape ``(3, R)``; a component that has a matrix of its own
        repeats another.
    """

    systems: NDArray[np.uint64]
    first: NDArray[np.uint64]
    starts: NDArray[np.uint64]
    values: Array
    inverse: Array
    order: NDArray[np.uint64]


FACTORS = types.NamedTuple([U2, U1, U1, F1, F1, U2], Factors)


def factorise(matrix: csr_matrix) -> tuple[NDArray[np.uint64], NDArray[np.uint64], Array, Array] | None:
    """Return ``first``, ``starts``, ``values`` and the diagonal of a matrix's factor; None if not positive definite."""
    if not (matrix.diagonal() > 0.0).all():
        return None
    matrix.sort_indices()
    size = matrix.shape[0]
    first = matrix.indices[matrix.indptr[:-1]].astype(np.int64)
    length = np.arange(size) - first
    starts = np.cumsum(length) - length
    row = np.repeat(np.arange(size), np.diff(matrix.indptr))
    below = matrix.indices < row
    values, diagonal = np.zeros(length.sum()), matrix.diagonal()
    values[(starts - first)[row[below]] + matrix.indices[below]] = matrix.data[below]
    profile = first.astype(np.uint64), starts.astype(np.uint64)
    return (*profile, values, diagonal) if _factorise(*profile, values, diagonal) else None


@njit(b1(U1, U1, F1, F1), **FAST)
def _factorise(first: NDArray[np.uint64], starts: NDArray[np.uint64], values: Array, diagonal: Array) -> bool:
    """Replace a matrix within its profile by its factor; return whether it is positive definite."""
    for i in range(np.uint64(diagonal.size)):
        start, left = starts[i], first[i]
        for j in range(left, i):
            begin = max(left, first[j])
            x = values[start + j - left]
            mine, other = start - left, starts[j] - first[j]
            for k in range(begin, j):
                x -= values[mine + k] * values[other + k]
            values[start + j - left] = x / diagonal[j]
        square = diagonal[i]
        for k in range(i - left):
            square -= values[start + k] ** 2
        # Rounding leaves this much of a singular matrix; NaN fails the comparison.
        if not square > 1e-12 * diagonal[i]:
            return False
        diagonal[i] = np.sqrt(square)
    return True


@njit(void(FACTORS, F1, F1), **FAST)
def solve(factors: Factors, momenta: Array, velocity: Array) -> None:
    """Fill the free part of ``velocity`` with that of momenta divided by the mass; both are state vectors.

    Three components at a time, which read the factor once.
    """
    largest = np.int64(np.max(factors.systems[:, 0]))
    x, y, z = np.empty(largest), np.empty(largest), np.empty(largest)
    order, values = factors.order, factors.values
    for s in range(factors.systems.shape[0]):
        rows, top = factors.systems[s, 0], factors.systems[s, 1]
        for i in range(rows):
            x[i] = momenta[order[_0, top + i]]
            y[i] = momenta[order[_1, top + i]]
            z[i] = momenta[order[_2, top + i]]
        for i in range(rows):
            left, start, inverse = factors.first[top + i], factors.starts[top + i], factors.inverse[top + i]
            a = b = c = 0.0
            for k in range(i - left):
                value = values[start + k]
                a += value * x[left + k]
                b += value * y[left + k]
                c += value * z[left + k]
            x[i] = (x[i] - a) * inverse
            y[i] = (y[i] - b) * inverse
            z[i] = (z[i] - c) * inverse
        for step in range(rows):
            i = rows - _1 - step
            left, start, inverse = factors.first[top + i], factors.starts[top + i], factors.inverse[top + i]
            a, b, c = x[i] * inverse, y[i] * inverse, z[i] * inverse
            x[i], y[i], z[i] = a, b, c
            for k in range(i - left):
                value = values[start + k]
                x[left + k] -= value * a
                y[left + k] -= value * b
                z[left + k] -= value * c
        # Where there are fewer components the others repeat one of them.
        for i in range(rows):
            velocity[order[_0, top + i]] = x[i]
            velocity[order[_1, top + i]] = y[i]
            velocity[order[_2, top + i]] = z[i]
