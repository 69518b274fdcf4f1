"""The material laws along and across one body, evaluated at all its points at once."""

from collections.abc import Sequence
from functools import cache
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from isorod.arrays import Array, Index
from isorod.compiled import flat
from isorod.errors import InputError
from isorod.material.discrete_gradient_kernel import discrete_gradient
from isorod.material.law import Material
from isorod.material.memory import has_memory
from isorod.material.places import Places
from isorod.tensors import inverse

if TYPE_CHECKING:
    from isorod.material.energy import Energy


class Piece(NamedTuple):
    """Places ``first .. last - 1`` along the body with one law, at all points of the section or some."""

    law: Material
    first: int
    last: int
    points: slice | Index = slice(None)

    @property
    def whole(self) -> bool:
        """Whether it is the law of all points of the section."""
        return isinstance(self.points, slice)

    def at(self, axes: int) -> tuple[slice | Index, ...]:
        """Return the index of its points in arrays whose first ``axes`` axes are ``(places, ..., points)``."""
        places = slice(self.first, self.last)
        return (places,) if self.whole else (places, *[slice(None)] * (axes - 2), self.points)

    def of(self, F: Array) -> Array:
        """Return the part of an array ``(places, ..., points, 3, 3)`` at its points."""
        return F[self.at(F.ndim - 2)]

    def places(self, places: Places) -> Places:
        """Return its places among those of a rod."""
        return places.part(slice(self.first, self.last), self.points)


class Laws:
    """A law for each place along a body: entry ``k`` of every array's first axis obeys law ``k``.

    If laws also differ across the section, the third axis from the end is that of the section's points.

    Parameters
    ----------
    pieces
        Consecutive places of one law each, together ``(places,)``; in rings, for each ring.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = tuple(pieces)

    @classmethod
    def of(cls, laws: Sequence[Material]) -> "Laws":
        """Return the laws from a list with one for each place."""
        return cls(_runs(laws))

    @classmethod
    def in_rings(cls, laws: Sequence[Sequence[Material]], ring: Index) -> "Laws":
        """Return the laws from a list for each ring; ``ring`` ``(q,)`` are the rings of the section's points."""
        return cls(
            [piece._replace(points=np.flatnonzero(ring == r)) for r, own in enumerate(laws) for piece in _runs(own)]
        )

    def some(self, places: Index) -> "Laws":
        """Return the laws at some places, ascending."""
        segments = []
        for piece in self.pieces:
            first, last = (int(k) for k in np.searchsorted(places, (piece.first, piece.last)))
            if last > first:
                law = piece.law.some(places[first:last] - piece.first)
                segments.append(Piece(law, first, last, piece.points))
        return Laws(segments)

    def placed(self, places: Places) -> "Laws":
        """Return the laws at places of a rod, of shape ``(places, ..., points)``."""
        return Laws([piece._replace(law=piece.law.placed(piece.places(places))) for piece in self.pieces])

    def at(self, factor: float) -> "Laws":
        """Return the laws at a load factor."""
        return Laws([piece._replace(law=piece.law.reached(factor)) for piece in self.pieces])

    def advanced(self, F: Array, factor: float) -> "Laws":
        """Return the laws with their states at the end of a step, of ``F`` at the points and load factor there."""
        return Laws([piece._replace(law=piece.law.advanced(piece.of(F), factor)) for piece in self.pieces])

    def lasting(self, step: float) -> "Laws":
        """Return the laws with memory in a step of a motion of some time, others as they are."""
        given = [piece.law.lasting(step) if has_memory(piece.law) else piece.law for piece in self.pieces]
        return Laws([piece._replace(law=law) for piece, law in zip(self.pieces, given, strict=True)])

    def knowing(self, states: Array) -> "Laws":
        """Return the laws with states ``(places, t, q, m)``, those without memory as they are."""
        segments = []
        for piece in self.pieces:
            law = piece.law
            if has_memory(law):
                law = law.knowing(states[piece.at(3)])
            segments.append(piece._replace(law=law))
        return Laws(segments)

    @property
    def frozen(self) -> "Laws":
        """The laws without flow."""
        given = [piece.law.frozen if has_memory(piece.law) else piece.law for piece in self.pieces]
        return Laws([piece._replace(law=law) for piece, law in zip(self.pieces, given, strict=True)])

    def told(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return a state variable at points, shape ``(*shape, count)``, NaN for laws without it.

        Raises
        ------
        InputError
            If no law has one.
        """
        known = {one: count for piece in self.pieces for one, count in piece.law.states.items()}
        if name not in known:
            public = [one for one in known if one[0] != "_"]
            raise InputError(f"state: got {name!r}, laws here have {', '.join(map(repr, public)) or 'none'}")
        result = np.full((*shape, known[name]), np.nan)
        for piece in self.pieces:
            if name in piece.law.states:
                at = piece.at(len(shape))
                result[at] = _part(piece.law, name, result[at].shape[:-1])
        return result

    @property
    def remember(self) -> bool:
        """Whether a law has memory."""
        return any(piece.law.remembers for piece in self.pieces)

    @property
    def follow(self) -> bool:
        """Whether a law needs the rod's places (`placed`)."""
        return any(piece.law.follows for piece in self.pieces)

    @property
    def loaded(self) -> bool:
        """Whether a law changes with the load factor."""
        return any(piece.law.at(0.5) is not piece.law for piece in self.pieces)

    @property
    def tabled(self) -> bool:
        """Whether a law grows by a table over time."""
        return any(piece.law.grows is not None for piece in self.pieces)

    @property
    def objective(self) -> bool:
        """Whether all laws are frame-invariant."""
        return all(piece.law.objective for piece in self.pieces)

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        return self._joined(F, [piece.law.energy(piece.of(F)) for piece in self.pieces])

    def stress(self, F: Array) -> Array:
        """Return the first Piola-Kirchhoff stress, shape of ``F``."""
        return self._joined(F, [piece.law.stress(piece.of(F)) for piece in self.pieces])

    def discrete(self, F: Array, change: Array, with_moduli: bool) -> tuple[Array, Array]:
        """Return stresses whose work is the change of the energy, and their moduli (`Material.discrete`)."""
        results = [piece.law.discrete(piece.of(F), piece.of(change), with_moduli) for piece in self.pieces]
        stress = self._joined(F, [stress for stress, _ in results])
        moduli = [part for _, part in results if part is not None]
        return stress, self._joined(F, moduli) if moduli else np.empty(0)

    def tangent(self, F: Array) -> Array:
        """Return ``dP/dF``, shape ``F.shape + (3, 3)``."""
        return self._joined(F, [piece.law.tangent(piece.of(F)) for piece in self.pieces])

    def _joined(self, F: Array, values: Sequence[Array]) -> Array:
        """Return values of each segment at the points of ``F``."""
        if all(piece.whole for piece in self.pieces):
            return values[0] if len(values) == 1 else np.concatenate(values)
        ahead = F.ndim - 2
        result = np.empty(F.shape[:ahead] + values[0].shape[ahead:])
        for piece, part in zip(self.pieces, values, strict=True):
            result[piece.at(ahead)] = part
        return result


def _part(law: Material, name: str, shape: tuple[int, ...]) -> Array:
    """Return a state variable of a law at points, shape ``(*shape, count)``."""
    names = list(law.states)
    first = sum(law.states[one] for one in names[: names.index(name)])
    return law.known(shape)[..., first : first + law.states[name]]


def _runs(laws: Sequence[Material]) -> list[Piece]:
    """Return a segment for each run of one law."""
    pieces, first = [], 0
    for _, same in groupby(laws, id):
        members = list(same)
        pieces.append(Piece(members[0], first, first + len(members)))
        first += len(members)
    return pieces


def shear_laws(laws: Laws) -> Laws:
    """Return the laws without their bulk terms."""
    return Laws([piece._replace(law=piece.law.shear) for piece in laws.pieces])


def volume_change(laws: Laws, F: Array) -> tuple[Array, Array]:
    """Return ``theta`` and ``d theta / dF`` for ``F`` ``(E, t, q, 3, 3)``; NaN where ``ln J`` has no value."""
    theta, slope = np.empty(F.shape[:-2]), np.empty(F.shape)
    for piece in laws.pieces:
        part, at = piece.of(F), piece.at(theta.ndim)
        if piece.law.logarithmic:
            # Newton's iterations try inverted states, and step back.
            with np.errstate(divide="ignore", invalid="ignore"):
                inverses, det = inverse(part)
            theta[at] = np.log(np.where(det > 0.0, det, np.nan))
            slope[at] = np.swapaxes(inverses, -1, -2)
        else:
            theta[at] = np.trace(part, axis1=-2, axis2=-1) - 3.0
            slope[at] = np.eye(3)
    return theta, slope


def complementary(laws: Laws, p: Array) -> tuple[Array, Array, Array]:
    """Return `isorod.material.law.Material.complementary` of pressures ``(E, t, q)``, of the same shape."""
    result = np.empty((3, *p.shape))
    for piece in laws.pieces:
        at = piece.at(p.ndim)
        for row, part in zip(result, piece.law.complementary(p[at]), strict=True):
            row[at] = part
    return result[0], result[1], result[2]


@cache
def _logarithm() -> "Energy":
    """Return ``theta = ln J`` as an energy."""
    from sympy import log

    from isorod.material.energy import Energy
    from isorod.material.symbols import J

    return Energy(log(J), ())


def volume_between(laws: Laws, F: Array, change: Array, with_moduli: bool) -> tuple[Array, Array | None]:
    """Return the discrete gradient of ``theta``, and on demand its slope.

    Parameters
    ----------
    laws
        The laws of elements.
    F, change, with_moduli
        As for `Material.discrete`, of the energy ``theta``.
    """
    from isorod.material.written import named

    gradient = np.empty(F.shape)
    slope = np.zeros((*F.shape, 3, 3)) if with_moduli else None
    for piece in laws.pieces:
        at = piece.at(F.ndim - 2)
        if piece.law.logarithmic:
            kernels, start = named(_logarithm), F[at]
            stress = np.empty(start.shape)
            bend = np.empty((*start.shape, 3, 3) if with_moduli else (0, 3, 3, 3, 3))
            given = flat(start), flat(change[at]), np.empty(0), np.empty((stress.size // 9, 0))
            out = stress.reshape(-1, 3, 3), bend.reshape(-1, 3, 3, 3, 3)
            discrete_gradient(kernels.block, kernels.tangent, False, -1, *given, *out)
            gradient[at] = stress
            if slope is not None:
                slope[at] = bend
        else:
            # The gradient of the trace.
            gradient[at] = np.eye(3)
    return gradient, slope
