"""Laws of small strains lifted to large ones by the logarithmic strain, compiled.

The strain ``E = ln(C)/2`` has no rotation.  In the frame of the principal directions of ``C``, principal values ``c``,

    S_ij = f_ij T_ij,    dS_ij = f_ij dT_ij + 2 sum_k f_ikj (T_ik dG_kj + dG_ik T_kj),    dE_ij = f_ij dG_ij,

where ``T`` is the stress that the small-strain law has for ``E``, ``G`` Green's strain, ``f_ij`` and ``f_ijk`` the
first and second divided differences of the logarithm at the ``c`` (C. Miehe, N. Apel & M. Lambrecht, CMAME 191 (2002)
5383-5425).  Symmetric tensors are six numbers: 00, 01, 02, 11, 12, 22.
"""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.compiled import FAST, njit
from isorod.material.functions import SPECTRAL, log, principals
from isorod.material.points import DETERMINANT, GRADIENT, MODULI, POINTS, ROWS, SQUARES

# Where principal values are among the rows of `isorod.material.functions.principals`.
VALUE = np.array([0, 3, 5])

# Where the components of a symmetric tensor are, and how often each is in a sum over all nine.
PLACE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
FIRST, SECOND = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])
TWICE = np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0])

_W, _3, _6 = np.uint64(POINTS), np.uint64(3), np.uint64(6)

# Principal values that are nearer to each other, relative, have their differences from a series.
_NEAR = 1e-3


@njit(**FAST)
def principal_strains(work: Array) -> Array:
    """Return principal values of ``F^T F`` and directions of a block (`isorod.material.functions.principals`)."""
    spectral = np.empty(SPECTRAL * POINTS)
    for k in range(np.uint64(POINTS)):
        f00, f01, f02 = work[ROWS[GRADIENT] + k], work[ROWS[GRADIENT + 1] + k], work[ROWS[GRADIENT + 2] + k]
        f10, f11, f12 = work[ROWS[GRADIENT + 3] + k], work[ROWS[GRADIENT + 4] + k], work[ROWS[GRADIENT + 5] + k]
        f20, f21, f22 = work[ROWS[GRADIENT + 6] + k], work[ROWS[GRADIENT + 7] + k], work[ROWS[GRADIENT + 8] + k]
        spectral[k] = f00 * f00 + f10 * f10 + f20 * f20
        spectral[ROWS[1] + k] = f00 * f01 + f10 * f11 + f20 * f21
        spectral[ROWS[2] + k] = f00 * f02 + f10 * f12 + f20 * f22
        spectral[ROWS[3] + k] = f01 * f01 + f11 * f11 + f21 * f21
        spectral[ROWS[4] + k] = f01 * f02 + f11 * f12 + f21 * f22
        spectral[ROWS[5] + k] = f02 * f02 + f12 * f12 + f22 * f22
    principals(spectral, POINTS)
    return spectral


@njit(**FAST)
def take_frame(spectral: Array, k: Any, c: Array, frame: Array) -> None:
    """Fill in a point's principal values ``(3,)``, and directions, a row each."""
    for i in range(3):
        c[i] = spectral[np.uint64(POINTS * VALUE[i]) + k]
        for A in range(3):
            frame[i, A] = spectral[np.uint64(POINTS * (6 + 3 * i + A)) + k]


@njit(**FAST)
def take_strains(spectral: Array, principal: Array, strain: Array, trace: Array) -> None:
    """Fill in the principal strains of a block, ``(3, POINTS)``, the strains ``(6, POINTS)``, and their traces."""
    for i in range(3):
        row = np.uint64(POINTS * VALUE[i])
        for k in range(_W):
            principal[i, k] = 0.5 * log(spectral[row + k])
    for k in range(_W):
        trace[k] = principal[0, k] + principal[1, k] + principal[2, k]
    for m in range(6):
        left, right = np.uint64(POINTS * (6 + FIRST[m])), np.uint64(POINTS * (6 + SECOND[m]))
        for k in range(_W):
            strain[m, k] = (
                principal[0, k] * spectral[left + k] * spectral[right + k]
                + principal[1, k] * spectral[left + ROWS[3] + k] * spectral[right + ROWS[3] + k]
                + principal[2, k] * spectral[left + ROWS[6] + k] * spectral[right + ROWS[6] + k]
            )


@njit(**FAST)
def turn(tensor: Array, spectral: Array, turned: Array) -> None:
    """Fill in what symmetric tensors of a block are in the frames of its points, both ``(6, POINTS)``."""
    for m in range(6):
        for k in range(_W):
            turned[m, k] = 0.0
        for A in range(3):
            left = np.uint64(POINTS * (6 + 3 * FIRST[m] + A))
            for B in range(3):
                right, row = np.uint64(POINTS * (6 + 3 * SECOND[m] + B)), np.uint64(PLACE[A, B])
                for k in range(_W):
                    turned[m, k] += spectral[left + k] * tensor[row, k] * spectral[right + k]


@njit(**FAST)
def _first_difference(a: float, b: float) -> float:
    """Return ``(ln a - ln b)/(a - b)``."""
    z = (a - b) / (a + b)
    if abs(z) > 0.05:
        return (log(a) - log(b)) / (a - b)
    s = z * z
    return 2.0 / (a + b) * (1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * (1 / 11 + s / 13))))))


@njit(**FAST)
def _second_difference(a: float, b: float, c: float) -> float:
    """Return the second divided difference of the logarithm."""
    # The first and the last are to be those farthest apart.
    if abs(a - b) > abs(a - c):
        b, c = c, b
    if abs(b - c) > abs(a - c):
        a, b = b, a
    mean = (a + b + c) / 3.0
    if abs(a - c) > _NEAR * mean:
        return (_first_difference(a, b) - _first_difference(b, c)) / (a - c)
    x, y, z = a / mean - 1.0, b / mean - 1.0, c / mean - 1.0
    return (-0.5 - (x * x + y * y + z * z) / 8.0 + (x * x * x + y * y * y + z * z * z) / 15.0) / (mean * mean)


@njit(**FAST)
def _carried(work: Array, k: Any, frame: Array, carried: Array) -> None:
    """Fill in ``F`` times the principal directions, a row each."""
    for i in range(3):
        for a in range(3):
            total = 0.0
            for A in range(3):
                total += work[np.uint64(POINTS * (GRADIENT + 3 * a + A)) + k] * frame[i, A]
            carried[i, a] = total


@njit(**FAST)
def _turned_back(turned: Array, frame: Array, tensor: Array) -> None:
    """Fill in a symmetric tensor from its components in a frame."""
    for m in range(6):
        A, B = FIRST[m], SECOND[m]
        total = 0.0
        for i in range(3):
            for j in range(3):
                total += frame[i, A] * turned[PLACE[i, j]] * frame[j, B]
        tensor[m] = total


@njit(**FAST)
def _second_stress(c: Array, stress: Array, second: Array) -> None:
    """Fill in the second Piola-Kirchhoff stress of a stress that belongs to ``E``, both in the principal frame."""
    for m in range(6):
        second[m] = _first_difference(c[FIRST[m]], c[SECOND[m]]) * stress[m]


@njit(**FAST)
def put_stress(work: Array, spectral: Array, principal: Array, stress: Array) -> None:
    """Fill the rows of ``P`` from the stress ``(6, POINTS)`` that belongs to ``E``, and principal strains."""
    carried, second, mixed = np.empty((9, POINTS)), np.empty((6, POINTS)), np.empty((9, POINTS))
    turn(stress, spectral, second)
    for m in range(6):
        p, q = np.uint64(FIRST[m]), np.uint64(SECOND[m])
        one, other = np.uint64(POINTS * VALUE[FIRST[m]]), np.uint64(POINTS * VALUE[SECOND[m]])
        for k in range(_W):
            a, b = spectral[one + k], spectral[other + k]
            total = a + b
            apart = (a - b) / total
            s = apart * apart
            far = s > 0.0025
            quotient = 2.0 * (principal[p, k] - principal[q, k]) / (a - b if far else 1.0)
            series = 2.0 / total * (1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * (1 / 11 + s / 13))))))
            second[m, k] *= quotient if far else series
    for i in range(3):
        for a in range(3):
            place = np.uint64(3 * i + a)
            f, g = np.uint64(POINTS * (GRADIENT + 3 * a)), np.uint64(POINTS * (6 + 3 * i))
            s0, s1, s2 = np.uint64(PLACE[i, 0]), np.uint64(PLACE[i, 1]), np.uint64(PLACE[i, 2])
            h = np.uint64(POINTS * (6 + a))
            for k in range(_W):
                carried[place, k] = (
                    work[f + k] * spectral[g + k]
                    + work[f + ROWS[1] + k] * spectral[g + ROWS[1] + k]
                    + work[f + ROWS[2] + k] * spectral[g + ROWS[2] + k]
                )
                mixed[place, k] = (
                    second[s0, k] * spectral[h + k]
                    + second[s1, k] * spectral[h + ROWS[3] + k]
                    + second[s2, k] * spectral[h + ROWS[6] + k]
                )
    for a in range(3):
        for A in range(3):
            row = np.uint64(POINTS * (3 * a + A))
            p, q = np.uint64(a), np.uint64(A)
            for k in range(_W):
                valid = 1.0 if work[ROWS[DETERMINANT] + k] > 0.0 else np.nan
                work[row + k] = valid * (
                    carried[p, k] * mixed[q, k]
                    + carried[p + _3, k] * mixed[q + _3, k]
                    + carried[p + _6, k] * mixed[q + _6, k]
                )


@njit(**FAST)
def add_moduli(work: Array, k: Any, c: Array, frame: Array, stress: Array, moduli: Array) -> None:
    """Add to the moduli at a point from stress and moduli ``dT/dE`` ``(6, 6)``, not to be used again, in that frame."""
    second = np.empty(6)
    _second_stress(c, stress, second)
    for m in range(6):
        f = _first_difference(c[FIRST[m]], c[SECOND[m]])
        for n in range(6):
            moduli[m, n] *= f
            moduli[n, m] *= f
    for m in range(6):
        i, j = FIRST[m], SECOND[m]
        for n in range(6):
            p, q = FIRST[n], SECOND[n]
            total, one, other = 0.0, 0.0, 0.0
            if q == j or p == i or q == i or p == j:
                one = _second_difference(c[i], c[p], c[j])
                other = _second_difference(c[i], c[q], c[j])
            if q == j:
                total += one * stress[PLACE[i, p]]
            if p == j:
                total += other * stress[PLACE[i, q]]
            if q == i:
                total += one * stress[PLACE[p, j]]
            if p == i:
                total += other * stress[PLACE[q, j]]
            moduli[m, n] += total
    add_second(work, k, frame, second, moduli)


@njit(**FAST)
def add_second(work: Array, k: Any, frame: Array, second: Array, moduli: Array) -> None:
    """Add to the moduli at a point from ``S`` and ``dS_ij/dG_kl`` ``(6, 6)``, ``G`` Green's strain, in a frame."""
    carried, back = np.empty((3, 3)), np.empty(6)
    _carried(work, k, frame, carried)
    # dP/dF = d_ab S_AB + sum M_mn G_m G_n, G what a change of F makes of Green's strain.
    slopes, products = np.empty((6, 9)), np.empty((6, 9))
    for m in range(6):
        i, j = FIRST[m], SECOND[m]
        for a in range(3):
            for A in range(3):
                value = carried[i, a] * frame[j, A]
                slopes[m, 3 * a + A] = value if i == j else value + carried[j, a] * frame[i, A]
    for m in range(6):
        for r in range(9):
            total = 0.0
            for n in range(6):
                total += moduli[m, n] * slopes[n, r]
            products[m, r] = total
    _turned_back(second, frame, back)
    for a in range(3):
        row = SQUARES + 6 * a
        for m in range(6):
            A, B = FIRST[m], SECOND[m]
            total = back[m]
            for n in range(6):
                total += slopes[n, 3 * a + A] * products[n, 3 * a + B]
            work[np.uint64(POINTS * (row + m)) + k] += total
        for b in range(a + 1, 3):
            row = MODULI + 9 * (a + b - 1)
            for A in range(3):
                for B in range(3):
                    total = 0.0
                    for n in range(6):
                        total += slopes[n, 3 * a + A] * products[n, 3 * b + B]
                    work[np.uint64(POINTS * (row + 3 * A + B)) + k] += total
