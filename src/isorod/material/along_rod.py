"""The material laws along one body, evaluated at all its points at once."""

from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple, cast

import numpy as np

from isorod.arrays import Array
from isorod.material.law import Material, Split
from isorod.material.linear_elastic import LinearElastic
from isorod.tensors import inverse


class Piece(NamedTuple):
    """Places ``first .. last - 1`` along the body that have one law."""

    law: Material
    first: int
    last: int


class Laws:
    """A law for each place along a body: entry ``k`` of every array's first axis obeys law ``k``.

    Parameters
    ----------
    pieces
        Consecutive places of one law each, shape of the whole ``(places,)``.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)

    @classmethod
    def of(cls, laws: Sequence[Material]) -> "Laws":
        """Return the laws given one by one."""
        pieces, first = [], 0
        for _, same in groupby(laws, id):
            members = list(same)
            pieces.append(Piece(members[0], first, first + len(members)))
            first += len(members)
        return cls(pieces)

    def along(self, tangents: Array) -> "Laws":
        """Return the laws where the rod's unit tangents are ``tangents``, shape ``(places, ..., 3)``."""
        return Laws([Piece(law.along(tangents[first:last]), first, last) for law, first, last in self.pieces])

    def at(self, factor: float) -> "Laws":
        """Return the laws at a load factor."""
        return Laws([Piece(law.at(factor), first, last) for law, first, last in self.pieces])

    @property
    def follow(self) -> bool:
        """Whether a law asks for the rod's tangents (`along`)."""
        return any(law.follows for law, _, _ in self.pieces)

    @property
    def loaded(self) -> bool:
        """Whether a law changes with the load factor."""
        return any(law.at(0.5) is not law for law, _, _ in self.pieces)

    @property
    def objective(self) -> bool:
        """Whether all laws have a second Piola-Kirchhoff stress that no rotation changes."""
        return not any(isinstance(law, LinearElastic) for law, _, _ in self.pieces)

    @property
    def isotropic(self) -> Array | None:
        """Lame's parameters of each law, shape ``(places, 2)``, if all are linear elastic."""
        found = [
            np.tile((law.lame, law.mu), (last - first, 1))
            for law, first, last in self.pieces
            if isinstance(law, LinearElastic)
        ]
        return self._joined(found) if len(found) == len(self.pieces) else None

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        return self._joined([law.energy(F[first:last]) for law, first, last in self.pieces])

    def stress(self, F: Array) -> Array:
        """Return the first Piola-Kirchhoff stress, shape of ``F``."""
        return self._joined([law.stress(F[first:last]) for law, first, last in self.pieces])

    def discrete(self, F: Array, change: Array, wanted: bool) -> tuple[Array, Array]:
        """Return stresses that do the work of the energy, and their moduli (`Material.discrete`)."""
        found = [law.discrete(F[first:last], change[first:last], wanted) for law, first, last in self.pieces]
        moduli = [np.empty(0) if part is None else part for _, part in found]
        return self._joined([stress for stress, _ in found]), self._joined(moduli)

    def tangent(self, F: Array) -> Array:
        """Return ``dP/dF``, shape ``F.shape + (3, 3)``."""
        return self._joined([law.tangent(F[first:last]) for law, first, last in self.pieces])

    @staticmethod
    def _joined(pieces: Sequence[Array]) -> Array:
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)


def shear_laws(laws: Laws) -> Laws:
    """Return the laws without their bulk terms."""
    return Laws([Piece(cast(Split, law).shear, first, last) for law, first, last in laws.pieces])


def volume_change(laws: Laws, F: Array) -> tuple[Array, Array]:
    """Return ``theta`` and ``d theta / dF`` for ``F`` ``(E, t, q, 3, 3)``; NaN where ``ln J`` has no value."""
    theta, slope = np.empty(F.shape[:-2]), np.empty(F.shape)
    for law, first, last in laws.pieces:
        part = F[first:last]
        if cast(Split, law).logarithmic:
            inverses, det = inverse(part)
            theta[first:last] = np.log(np.where(det > 0.0, det, np.nan))
            slope[first:last] = np.swapaxes(inverses, -1, -2)
        else:
            theta[first:last] = np.trace(part, axis1=-2, axis2=-1) - 3.0
            slope[first:last] = np.eye(3)
    return theta, slope
