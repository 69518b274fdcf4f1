"""Polyharmonic functions of the section: ``T_i`` and, for ``1 <= k < K``, ``(1 - s) P_{k-1}(s) W_m`` with ``s = |xi|^2``.

The first are the harmonic functions of the paper.  By Almansi's theorem ``(1 - s)^k T_i``, ``k < K``, spans what is
polyharmonic of order ``K``, and displacements of an elastic body without body force are biharmonic.  The others here
span the same, but are made for conditioning: ``W_m`` is the discrete Fourier wave of order ``m`` over the ``T_i``, and
``P_{k-1}`` the Jacobi polynomial ``P^{(1, m)}_{k-1}(2 s - 1)``.  With the continuous wave ``r^m exp(i m theta)`` in the
place of ``W_m`` the gradients of all of them are orthogonal on the disk, to each other and to every harmonic function
(those with another radial factor, the same for all waves, are not: a wave of high order lives near the circle, where
all factors look alike, and the condition number explodes). All vanish on the circle but the ``T_i``.
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import eval_jacobi

from isorod.arrays import Array
from isorod.errors import whole_number
from isorod.geometry.disk import harmonic_functions

MAX_ORDER = 6


def check_order(order: int) -> int:
    """Return ``order`` if it can be a polyharmonic order (an integer from 1 to 6), or raise `InputError`."""
    return whole_number("polyharmonic order", order, 1, MAX_ORDER)


@cache
def _waves(n: int) -> tuple[Array, Array]:
    """Return the orthonormal real Fourier matrix ``(n, n)``, a wave a column, and the order of each wave."""
    angle = 2.0 * np.pi * np.arange(n) / n
    columns = [(m, wave(m * angle)) for m in range(n // 2 + 1) for wave in (np.cos, np.sin)]
    # The sines of order 0 and n / 2 are zero.
    columns = [(m, column) for m, column in columns if np.abs(column).max() > 1e-6]
    matrix = np.stack([column for _, column in columns], axis=1)
    return matrix / np.linalg.norm(matrix, axis=0), np.array([float(m) for m, _ in columns])


def _radial(k: int, m: Array, s: Array) -> tuple[Array, Array]:
    """Return ``(1 - s) P^{(1, m)}_{k-1}(2 s - 1)`` and its derivative by ``s``, shape ``(len(s), len(m))``."""
    x = (2.0 * s - 1.0)[:, None]
    value = eval_jacobi(k - 1, 1.0, m, x)
    slope = (k + 1.0 + m) * eval_jacobi(k - 2, 2.0, m + 1.0, x) if k > 1 else 0.0
    rest = (1.0 - s)[:, None]
    return rest * value, rest * slope - value


def functions(n: int, order: int, xi: ArrayLike, turn: float = 0.0) -> tuple[Array, Array]:
    """Return the functions of all ``k < order`` and their gradients.

    Parameters
    ----------
    n
        Number of control points round the section, at least 3.
    order
        Polyharmonic order ``K``, at least 1.
    xi
        Points of the closed unit disk, shape ``(m, 2)``.
    turn
        Angle of the first control point, radians.

    Returns
    -------
    values, gradients
        Shapes ``(m, K n)`` and ``(m, K n, 2)``; function ``i`` is ``T_i``, function ``k n + j`` the ``j``-th wave's of
        that ``k``.
    """
    check_order(order)
    points = np.asarray(xi, dtype=float).reshape(-1, 2)
    cos, sin = np.cos(turn), np.sin(turn)
    back = np.array([[cos, -sin], [sin, cos]])
    harmonic, slopes = harmonic_functions(n, points @ back if turn else points)
    if turn:
        slopes = slopes @ back.T
    if order == 1:
        return harmonic, slopes
    matrix, orders = _waves(n)
    waves = harmonic @ matrix
    wave_slopes = np.einsum("qib,ij->qjb", slopes, matrix)
    s = np.sum(points**2, axis=1)
    values, gradients = [harmonic], [slopes]
    for k in range(1, order):
        radial, derivative = _radial(k, orders, s)
        values.append(radial * waves)
        gradients.append(radial[..., None] * wave_slopes + (2.0 * derivative * waves)[..., None] * points[:, None, :])
    return np.concatenate(values, axis=1), np.concatenate(gradients, axis=1)
