"""How supports move what they hold: displacements that grow with the load factor, rotations by any angle, and tied translations.

A held degree of freedom has its displacement from the support.  Tied ones share one unknown, the displacement of the first of them, to
which the rotation adds what is different between them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from isorod.arrays import Array, Index
from isorod.errors import InputError

# Two supports agree on a degree of freedom if they do at these load factors.
_SAMPLES = (1.0, 0.37)


def rotation(vector: ArrayLike) -> Array:
    """Return the matrix ``(3, 3)`` of the rotation about ``vector`` by its length, radians (Rodrigues).

    Its entries for directions in the axis are exact: a rotation about ``y`` leaves ``y`` components as they are.
    """
    return np.eye(3) + turning(vector)


def turning(vector: ArrayLike) -> Array:
    """Return `rotation` less the identity, accurate for small angles too."""
    x, y, z = np.asarray(vector, dtype=float)
    angle = float(np.sqrt(x * x + y * y + z * z))
    if angle == 0.0:
        return np.zeros((3, 3))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    return np.sin(angle) * cross + 2.0 * np.sin(0.5 * angle) ** 2 * (cross @ cross)


class Motion(NamedTuple):
    """What one support does with degrees of freedom ``dofs`` ``(m,)``.

    At load factor ``f`` component ``a`` of ``f rate + (R(f turn) - 1) arm`` is the displacement of those that are held, and what
    those that are ``tied`` have more than the unknown they share (one a component).
    """

    dofs: Index
    rates: Array
    arms: Array
    turn: Array
    tied: NDArray[np.bool_]

    def at(self, factor: float) -> Array:
        """Return the prescribed part of the displacements at a load factor, shape ``(m,)``."""
        result = factor * self.rates
        if self.turn.any():
            rows = turning(factor * self.turn)[self.dofs % 3]
            result = result + np.einsum("ma,ma->m", rows, self.arms)
        return result


class Numbering(NamedTuple):
    """Which degrees of freedom are held (``held``) or held or tied (``bound``, by support ``support_of``); ``free`` maps each to its unknown or -1."""

    held: Index
    bound: Index
    support_of: Index
    free: Index


def number(motions: Sequence[Motion], dofs: int) -> Numbering:
    """Return the numbering of ``dofs`` degrees of freedom under the supports' motions.

    Raises
    ------
    InputError
        If two supports contradict each other.
    """
    owner = np.full(dofs, -1)
    tied = np.zeros(dofs, dtype=bool)
    leader = np.arange(dofs)
    values = np.full((len(_SAMPLES), dofs), np.nan) if len(motions) > 1 else None
    for k, motion in enumerate(motions):
        if values is not None:
            wanted = np.stack([motion.at(factor) for factor in _SAMPLES])
            before = owner[motion.dofs] >= 0
            differs = (values[:, motion.dofs] != wanted).any(axis=0)
            clash = before & (differs | tied[motion.dofs] | motion.tied)
            if clash.any():
                dof = motion.dofs[np.argmax(clash)]
                raise InputError(
                    f"support {k}: node {dof // 3}, component {'xyz'[dof % 3]} is held elsewhere at another displacement"
                )
            values[:, motion.dofs] = wanted
        owner[motion.dofs] = k
        if motion.tied.any():
            for a in range(3):
                together = motion.dofs[motion.tied & (motion.dofs % 3 == a)]
                leader[together] = together.min(initial=dofs)
                tied[together] = True
    bound = owner >= 0
    held = bound & ~tied
    leads = ~held & (leader == np.arange(dofs))
    free = np.where(held, -1, (np.cumsum(leads) - 1)[leader])
    return Numbering(np.flatnonzero(held), np.flatnonzero(bound), owner[bound], free)
