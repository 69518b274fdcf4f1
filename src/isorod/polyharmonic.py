"""Polyharmonic functions of the section: ``g_k(|xi|^2) T_i(xi)``, ``k < K``.

``g_0 = 1`` gives the harmonic functions of the paper.  By Almansi's theorem ``(1 - |xi|^2)^k T_i``, ``k < K``, spans what is
polyharmonic of order ``K``; displacements of an elastic body without body force are biharmonic.  Any polynomials ``g_k`` of
degree ``k`` in ``s = |xi|^2`` that vanish on the circle span the same space.  Those taken here have ``dg_k/ds`` orthogonal with
weight ``s`` on [0, 1] (Jacobi polynomials (0, 1)): the gradients of ``g_k(|xi|^2)`` are then orthogonal on the disk, and the
condition number of a stiffness matrix does not explode with ``K``.  On the circle only ``k = 0`` acts.
"""

from functools import cache

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike
from scipy.special import jacobi

from isorod.disk import Array, harmonic_functions
from isorod.errors import whole_number

MAX_ORDER = 6


def check_order(order: int) -> int:
    """Return ``order`` if it can be a polyharmonic order (an integer from 1 to 6), or raise `InputError`."""
    return whole_number("polyharmonic order", order, 1, MAX_ORDER)


@cache
def _radial(k: int) -> tuple[Polynomial, Polynomial]:
    """Return ``g_k(s)`` and its derivative; the gradient of ``g_k(|xi|^2)`` has unit norm on the disk."""
    slope = Polynomial(jacobi(k - 1, 0.0, 1.0).coef[::-1])(Polynomial([-1.0, 2.0]))
    # The integral of |grad g|^2 over the disk is 4 pi times that of g'^2 s over [0, 1].
    square = (slope * slope * Polynomial([0.0, 1.0])).integ()
    slope = slope / np.sqrt(4.0 * np.pi * (square(1.0) - square(0.0)))
    value = slope.integ()
    return value - value(1.0), slope


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
        Shapes ``(m, K n)`` and ``(m, K n, 2)``; function ``k n + i`` is ``g_k T_i``.
    """
    check_order(order)
    points = np.asarray(xi, dtype=float).reshape(-1, 2)
    cos, sin = np.cos(turn), np.sin(turn)
    back = np.array([[cos, -sin], [sin, cos]])
    harmonic, slopes = harmonic_functions(n, points @ back if turn else points)
    if turn:
        slopes = slopes @ back.T
    s = np.sum(points**2, axis=1)
    values, gradients = [harmonic], [slopes]
    for k in range(1, order):
        radial, derivative = (polynomial(s)[:, None] for polynomial in _radial(k))
        values.append(radial * harmonic)
        gradients.append(radial[..., None] * slopes + (2.0 * derivative * harmonic)[..., None] * points[:, None, :])
    return np.concatenate(values, axis=1), np.concatenate(gradients, axis=1)
