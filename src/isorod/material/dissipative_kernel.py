"""Common parts of the compiled functions of laws of two potentials (`isorod.material.dissipative_source`)."""

from typing import Any

import numpy as np

from isorod.arrays import Array, Index
from isorod.compiled import FAST, njit
from isorod.material.points import FIBRE, POINTS


@njit(**FAST)
def read_state(work: Array, k: Any, places: Index, old: Array) -> None:
    """Fill in the internal variables at the start of the step."""
    for i in range(old.size):
        old[i] = work[np.uint64(POINTS * (FIBRE + places[i])) + k]


@njit(**FAST)
def write_state(work: Array, k: Any, places: Index, traces: Index, a: Array) -> None:
    """Write internal variables to the state, with the last component of traceless ones."""
    for i in range(a.size):
        work[np.uint64(POINTS * (FIBRE + places[i])) + k] = a[i]
    for i in range(traces.shape[0]):
        if traces[i, 0] >= 0:
            total = work[np.uint64(POINTS * (FIBRE + traces[i, 1])) + k]
            total += work[np.uint64(POINTS * (FIBRE + traces[i, 2])) + k]
            work[np.uint64(POINTS * (FIBRE + traces[i, 0])) + k] = -total


@njit(**FAST)
def squared(a: Array) -> float:
    """Return the sum of squares."""
    total = 0.0
    for i in range(a.size):
        total += a[i] * a[i]
    return total


@njit(**FAST)
def factor(a: Array) -> bool:
    """Replace the lower triangle of a matrix by its Cholesky factor; return whether it is positive definite."""
    for j in range(a.shape[0]):
        for i in range(j, a.shape[0]):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k]
            if i > j:
                a[i, j] = total / a[j, j]
            elif total > 0.0 and total < np.inf:
                a[j, j] = np.sqrt(total)
            else:
                return False
    return True


@njit(**FAST)
def solved(lower: Array, right: Array, solution: Array) -> None:
    """Fill in the solution of a system whose matrix has a Cholesky factor."""
    count = right.size
    for i in range(count):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * solution[k]
        solution[i] = total / lower[i, i]
    for i in range(count - 1, -1, -1):
        total = solution[i]
        for k in range(i + 1, count):
            total -= lower[k, i] * solution[k]
        solution[i] = total / lower[i, i]


@njit(**FAST)
def condensed(stiff: Array, crossed: Array, lower: Array) -> None:
    """Subtract ``crossed K^-1 crossed^T`` from ``stiff`` (6, 6), ``K`` given by its Cholesky factor."""
    count = crossed.shape[1]
    half = np.empty((6, count))
    for m in range(6):
        for i in range(count):
            total = crossed[m, i]
            for k in range(i):
                total -= lower[i, k] * half[m, k]
            half[m, i] = total / lower[i, i]
    for m in range(6):
        for n in range(6):
            total = 0.0
            for i in range(count):
                total += half[m, i] * half[n, i]
            stiff[m, n] -= total
