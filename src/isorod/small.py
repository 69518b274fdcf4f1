"""Determinant and inverse of many 3 x 3 matrices at once; LAPACK's, one by one, takes far longer."""

from typing import Any

import numpy as np
from numba import njit

from isorod.disk import Array

_OPTIONS: Any = {"cache": True, "error_model": "numpy"}


def cofactors(matrices: Array) -> Array:
    """Return the cofactors of matrices ``(..., 3, 3)``."""
    flat = _flat(matrices)
    result, det = np.empty_like(flat), np.empty(flat.shape[0])
    _cofactors(flat, result, det)
    return result.reshape(matrices.shape)


def determinant(matrices: Array) -> Array:
    """Return the determinants of matrices ``(..., 3, 3)``."""
    flat = _flat(matrices)
    det = np.empty(flat.shape[0])
    _determinants(flat, det)
    return det.reshape(matrices.shape[:-2])


def inverse(matrices: Array) -> tuple[Array, Array]:
    """Return the inverses (C order) and determinants of matrices ``(..., 3, 3)``."""
    flat = _flat(matrices)
    result, det = np.empty_like(flat), np.empty(flat.shape[0])
    _inverses(flat, result, det)
    return result.reshape(matrices.shape), det.reshape(matrices.shape[:-2])


def _flat(matrices: Array) -> Array:
    return np.ascontiguousarray(matrices, dtype=float).reshape(-1, 9)


@njit("f8(f8[::1], i8, i8, i8, i8)", inline="always", **_OPTIONS)
def _minor(m: Array, a: int, d: int, b: int, c: int) -> float:
    return float(m[a] * m[d] - m[b] * m[c])


@njit("void(f8[:,::1], f8[::1])", **_OPTIONS)
def _determinants(matrices: Array, det: Array) -> None:
    for k in range(matrices.shape[0]):
        m = matrices[k]
        det[k] = m[0] * _minor(m, 4, 8, 5, 7) + m[1] * _minor(m, 5, 6, 3, 8) + m[2] * _minor(m, 3, 7, 4, 6)


@njit("void(f8[:,::1], f8[:,::1], f8[::1])", **_OPTIONS)
def _cofactors(matrices: Array, result: Array, det: Array) -> None:
    for k in range(matrices.shape[0]):
        m, c = matrices[k], result[k]
        c[0], c[1], c[2] = _minor(m, 4, 8, 5, 7), _minor(m, 5, 6, 3, 8), _minor(m, 3, 7, 4, 6)
        c[3], c[4], c[5] = _minor(m, 7, 2, 8, 1), _minor(m, 8, 0, 6, 2), _minor(m, 6, 1, 7, 0)
        c[6], c[7], c[8] = _minor(m, 1, 5, 2, 4), _minor(m, 2, 3, 0, 5), _minor(m, 0, 4, 1, 3)
        det[k] = m[0] * c[0] + m[1] * c[1] + m[2] * c[2]


@njit("void(f8[:,::1], f8[:,::1], f8[::1])", **_OPTIONS)
def _inverses(matrices: Array, result: Array, det: Array) -> None:
    _cofactors(matrices, result, det)
    for k in range(matrices.shape[0]):
        c = result[k]
        for i in range(9):
            c[i] /= det[k]
        c[1], c[3] = c[3], c[1]
        c[2], c[6] = c[6], c[2]
        c[5], c[7] = c[7], c[5]
