"""Newton's method with the stress as a variable of its own at the quadrature points.

In a slender body that turns, the quadratic part of a linear step is spurious stretch, hence a large axial stress, hence
a geometric stiffness that spoils the next step.  With stresses as unknowns beside the displacements, eliminated point
by point, the step extrapolates them linearly instead: Newton's iterates differ, their limit does not (Magisano,
Leonetti & Garcea, How to improve efficiency and robustness of the Newton method in geometrically non-linear structural
problems discretized via displacement-based finite elements, Comput. Methods Appl. Mech. Engrg. 313 (2017) 986-1005).
"""

import numpy as np
from numba import void

from isorod.arrays import Array
from isorod.compiled import F2, F3, FAST, cofactors, njit
from isorod.geometry.rod import Rod

# Length over radius of the section from which on it pays; a stubby body that is strained, not turned, takes more
# iterations.
SLENDER = 20.0


def pays(rod: Rod) -> bool:
    """Whether a rod is slender: `SLENDER` times as long as its largest section is wide from its centre, or longer."""
    centers = rod.control_points.mean(axis=1)
    length = np.linalg.norm(np.diff(centers, axis=0), axis=1).sum()
    radius = np.linalg.norm(rod.control_points - centers[:, None], axis=2).max()
    return bool(length >= SLENDER * radius)


class Extrapolation:
    """The second Piola-Kirchhoff stress at the points of one part, as the last tangent extrapolates it."""

    def __init__(self) -> None:
        self._last: tuple[Array, Array, Array, Array] | None = None

    def tangent(self, F: Array, stress: Array, moduli: Array) -> Array:
        """Return ``dP/dF``, changed in place, with the geometric part of the extrapolated stress.

        With ``P = F S``, ``S' = S0 + F0^-1 (A0 : dF - dF S0)`` at the last state ``F0`` and ``dF = F - F0``, the
        tangent is ``A_aAbB + delta_ab (S' - S)_AB``.  Arrays have shapes ``(..., 3, 3)`` and ``(..., 3, 3, 3, 3)``,
        rows contiguous.
        """
        here = np.ascontiguousarray(F).reshape(-1, 3, 3)
        force = np.ascontiguousarray(stress).reshape(-1, 3, 3)
        square = moduli.reshape(-1, 9, 9)
        excess = np.zeros_like(here)
        if self._last is not None:
            before, force_before, square_before, excess_before = self._last
            _extrapolate(here, force, square, before, force_before, square_before, excess_before, excess)
        self._last = (here, force, square, excess)
        return moduli


@njit(void(F2, F2, F2), **FAST)
def _solve(F: Array, P: Array, S: Array) -> None:
    """Fill ``S`` with ``F^-1 P``."""
    c = np.empty((3, 3))
    det = cofactors(F, c)
    for a in range(3):
        for b in range(3):
            S[a, b] = (c[0, a] * P[0, b] + c[1, a] * P[1, b] + c[2, a] * P[2, b]) / det


@njit(void(*[F3] * 8), **FAST)
def _extrapolate(
    F: Array, P: Array, moduli: Array, F0: Array, P0: Array, moduli0: Array, excess0: Array, excess: Array
) -> None:
    """Fill ``excess`` with ``S' - S`` and add it to moduli ``(m, 9, 9)``; those of the last state hold their own."""
    S, S0, step = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    grown, gained = np.empty((3, 3)), np.empty((3, 3))
    for q in range(F.shape[0]):
        _solve(F[q], P[q], S)
        _solve(F0[q], P0[q], S0)
        for a in range(3):
            for b in range(3):
                step[a, b] = F[q, a, b] - F0[q, a, b]
        for a in range(3):
            for A in range(3):
                value = 0.0
                for b in range(3):
                    for B in range(3):
                        value += moduli0[q, 3 * a + A, 3 * b + B] * step[b, B]
                for B in range(3):
                    value -= step[a, B] * (S0[B, A] + excess0[q, B, A])
                grown[a, A] = value
        _solve(F0[q], grown, gained)
        for A in range(3):
            for B in range(3):
                both = S0[A, B] + gained[A, B] - S[A, B] + S0[B, A] + gained[B, A] - S[B, A]
                excess[q, A, B] = 0.5 * both
        for a in range(3):
            for A in range(3):
                for B in range(3):
                    moduli[q, 3 * a + A, 3 * a + B] += excess[q, A, B]
