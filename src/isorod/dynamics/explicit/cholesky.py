"""Cholesky factors within the profile (skyline) of a matrix, and compiled solves with them.

Of a matrix ``[[A, B^T], [B, C]]`` the rows of ``A`` may be factorised alone, ``A = L L^T``; those of ``B`` become ``W =
B L^-T``, and the Schur complement ``C - W W^T`` is returned.
"""

from typing import NamedTuple

import numpy as np
from numba import b1, types, void
from numba import u8 as _u
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from isorod.arrays import Array
from isorod.compiled import F1, F2, FAST, U1, U2, njit

_0, _1, _2, _3, _4 = (np.uint64(k) for k in range(5))


class Factors(NamedTuple):
    """Cholesky factors ``L`` of the free parts of all bodies' mass matrices, row by row within their profile.

    Attributes
    ----------
    systems
        Rows of ``L``, the first of them below, rows of ``W`` after them, and how many components each row has: three,
        or one of a matrix that couples them; shape ``(S, 4)``.
    first
        First column of each row that is not zero, shape ``(R,)``.
    starts
        Where a row begins in ``values``, shape ``(R,)``.
    values
        Entries of ``L`` left of the diagonal, and of ``W``.
    inverse
        Inverse of the diagonal, one for rows of ``W``, shape ``(R,)``.
    order
        Place of each row in a state vector for x, y and z, shape ``(3, R)``; a component that has a matrix of its own
        repeats another.  Of a row of one component the first is read alone.
    """

    systems: NDArray[np.uint64]
    first: NDArray[np.uint64]
    starts: NDArray[np.uint64]
    values: Array
    inverse: Array
    order: NDArray[np.uint64]


FACTORS = types.NamedTuple([U2, U1, U1, F1, F1, U2], Factors)


class Factor(NamedTuple):
    """Factor of one matrix: ``first``, ``starts``, ``values`` and ``inverse`` as of `Factors`.

    ``left`` is ``C - W W^T``, of the rows that were not eliminated.
    """

    first: NDArray[np.uint64]
    starts: NDArray[np.uint64]
    values: Array
    inverse: Array
    left: Array


def factorise(matrix: csr_matrix, rows: int) -> Factor | None:
    """Return the factor of the first rows of a matrix; None if these are not positive definite."""
    diagonal = matrix.diagonal()
    if not (diagonal > 0.0).all():
        return None
    matrix.sort_indices()
    size = matrix.shape[0]
    end = np.minimum(np.arange(size), rows)
    # Rows of W may be none.
    first = np.minimum(matrix.indices[matrix.indptr[:-1]].astype(np.int64), end)
    length = end - first
    starts = np.cumsum(length) - length
    row = np.repeat(np.arange(size), np.diff(matrix.indptr))
    below = matrix.indices < end[row]
    values = np.zeros(length.sum())
    values[(starts - first)[row[below]] + matrix.indices[below]] = matrix.data[below]
    profile = first.astype(np.uint64), starts.astype(np.uint64)
    if not _factorise(*profile, values, diagonal[:rows]):
        return None
    diagonal[rows:] = 1.0
    W = np.zeros((size - rows, rows))
    for k, i in enumerate(range(rows, size)):
        W[k, first[i] :] = values[starts[i] :][: length[i]]
    return Factor(*profile, values, 1.0 / diagonal, matrix[rows:, rows:].toarray() - W @ W.T)


@njit(b1(U1, U1, F1, F1), **FAST)
def _factorise(first: NDArray[np.uint64], starts: NDArray[np.uint64], values: Array, diagonal: Array) -> bool:
    """Replace a matrix within its profile by its factor; return whether it is positive definite.

    Rows that have no diagonal, the last, are those of ``W``.
    """
    rows = np.uint64(diagonal.size)
    for i in range(np.uint64(first.size)):
        start, left = starts[i], first[i]
        for j in range(left, i if i < rows else rows):
            begin = max(left, first[j])
            x = values[start + j - left]
            mine, other = start - left, starts[j] - first[j]
            for k in range(begin, j):
                x -= values[mine + k] * values[other + k]
            values[start + j - left] = x / diagonal[j]
        if i >= rows:
            continue
        square = diagonal[i]
        for k in range(i - left):
            square -= values[start + k] ** 2
        # Rounding leaves this much of a singular matrix; NaN fails the comparison.
        if not square > 1e-12 * diagonal[i]:
            return False
        diagonal[i] = np.sqrt(square)
    return True


@njit(b1(FACTORS, _u, _u, _u), **FAST)
def _four(factors: Factors, top: int, i: int, rows: int) -> bool:
    """Return whether four rows from ``i`` on, of those that have a diagonal, begin at the same column."""
    if i + _4 > rows:
        return False
    first = factors.first[top + i]
    return first == factors.first[top + i + _1] == factors.first[top + i + _2] == factors.first[top + i + _3]


@njit(void(FACTORS, _u, F1), **FAST)
def _reduce_one(factors: Factors, s: int, x: Array) -> None:
    """Do what `reduce` does with a system of one component: four rows at a time where they are equally long."""
    rows, top, edge = factors.systems[s, 0], factors.systems[s, 1], factors.systems[s, 2]
    values, inverse = factors.values, factors.inverse
    i = _0
    while i < rows + edge:
        r = top + i
        left, p = factors.first[r], factors.starts[r]
        begin = top + left
        if not _four(factors, top, i, rows):
            a = 0.0
            for k in range(min(i, rows) - left):
                a += values[p + k] * x[begin + k]
            x[r] = (x[r] - a) * inverse[r]
            i += _1
            continue
        q, u, v = factors.starts[r + _1], factors.starts[r + _2], factors.starts[r + _3]
        a = b = c = d = 0.0
        for k in range(i - left):
            y = x[begin + k]
            a += values[p + k] * y
            b += values[q + k] * y
            c += values[u + k] * y
            d += values[v + k] * y
        m = i - left
        a = (x[r] - a) * inverse[r]
        b = (x[r + _1] - b - values[q + m] * a) * inverse[r + _1]
        c = (x[r + _2] - c - values[u + m] * a - values[u + m + _1] * b) * inverse[r + _2]
        d -= x[r + _3]
        d += values[v + m] * a + values[v + m + _1] * b + values[v + m + _2] * c
        x[r], x[r + _1], x[r + _2], x[r + _3] = a, b, c, -d * inverse[r + _3]
        i += _4


@njit(void(FACTORS, _u, F1, F1), **FAST)
def _substitute_one(factors: Factors, s: int, x: Array, velocity: Array) -> None:
    """Do what `substitute` does with a system of one component, four rows at a time."""
    rows, top, edge = factors.systems[s, 0], factors.systems[s, 1], factors.systems[s, 2]
    values, inverse = factors.values, factors.inverse
    # Rows from here on are done.
    end = rows + edge
    while end > _0:
        if end < _4 or not _four(factors, top, end - _4, rows):
            i = end - _1
            r = top + i
            left, p = factors.first[r], factors.starts[r]
            a = x[r] * inverse[r]
            x[r] = a
            for k in range(min(i, rows) - left):
                x[top + left + k] -= values[p + k] * a
            end -= _1
            continue
        end -= _4
        r = top + end
        left, p = factors.first[r], factors.starts[r]
        q, u, v = factors.starts[r + _1], factors.starts[r + _2], factors.starts[r + _3]
        begin, m = top + left, end - left
        d = x[r + _3] * inverse[r + _3]
        c = (x[r + _2] - values[v + m + _2] * d) * inverse[r + _2]
        b = (x[r + _1] - values[v + m + _1] * d - values[u + m + _1] * c) * inverse[r + _1]
        a = (x[r] - values[v + m] * d - values[u + m] * c - values[q + m] * b) * inverse[r]
        for k in range(m):
            x[begin + k] -= values[p + k] * a + values[q + k] * b + values[u + k] * c + values[v + k] * d
        x[r], x[r + _1], x[r + _2], x[r + _3] = a, b, c, d
    for i in range(top, top + rows + edge):
        velocity[factors.order[_0, i]] = x[i]


@njit(void(FACTORS, F1, F2), **FAST)
def reduce(factors: Factors, momenta: Array, reduced: Array) -> None:
    """Fill ``reduced``, ``(3, R)``, with momenta, a state vector, from which the rows before are eliminated.

    Three components at a time, which read the factor once.
    """
    order, values = factors.order, factors.values
    x, y, z = reduced[0], reduced[1], reduced[2]
    for s in range(np.uint64(factors.systems.shape[0])):
        if factors.systems[s, 3] == _1:
            top = factors.systems[s, 1]
            for i in range(top, top + factors.systems[s, 0] + factors.systems[s, 2]):
                x[i] = momenta[order[_0, i]]
            # Without edges to exchange, `substitute` does both, and reads the factor once from memory.
            if factors.systems[s, 2] > _0:
                _reduce_one(factors, s, x)
            continue
        rows, top, edge = factors.systems[s, 0], factors.systems[s, 1], factors.systems[s, 2]
        for i in range(top, top + rows + edge):
            x[i] = momenta[order[_0, i]]
            y[i] = momenta[order[_1, i]]
            z[i] = momenta[order[_2, i]]
        for i in range(rows + edge):
            left, start, inverse = factors.first[top + i], factors.starts[top + i], factors.inverse[top + i]
            a = b = c = 0.0
            for k in range(min(i, rows) - left):
                value = values[start + k]
                a += value * x[top + left + k]
                b += value * y[top + left + k]
                c += value * z[top + left + k]
            x[top + i] = (x[top + i] - a) * inverse
            y[top + i] = (y[top + i] - b) * inverse
            z[top + i] = (z[top + i] - c) * inverse


@njit(void(FACTORS, F2, F1), **FAST)
def substitute(factors: Factors, reduced: Array, velocity: Array) -> None:
    """Fill the free part of ``velocity``, a state vector, from what `reduce` left, on edges solved for; change that."""
    order, values = factors.order, factors.values
    x, y, z = reduced[0], reduced[1], reduced[2]
    for s in range(np.uint64(factors.systems.shape[0])):
        if factors.systems[s, 3] == _1:
            if factors.systems[s, 2] == _0:
                _reduce_one(factors, s, x)
            _substitute_one(factors, s, x, velocity)
            continue
        rows, top, edge = factors.systems[s, 0], factors.systems[s, 1], factors.systems[s, 2]
        for step in range(rows + edge):
            i = rows + edge - _1 - step
            left, start, inverse = factors.first[top + i], factors.starts[top + i], factors.inverse[top + i]
            a, b, c = x[top + i] * inverse, y[top + i] * inverse, z[top + i] * inverse
            x[top + i], y[top + i], z[top + i] = a, b, c
            for k in range(min(i, rows) - left):
                value = values[start + k]
                x[top + left + k] -= value * a
                y[top + left + k] -= value * b
                z[top + left + k] -= value * c
        # Where there are fewer components the others repeat one of them.
        for i in range(top, top + rows + edge):
            velocity[order[_0, i]] = x[i]
            velocity[order[_1, i]] = y[i]
            velocity[order[_2, i]] = z[i]
