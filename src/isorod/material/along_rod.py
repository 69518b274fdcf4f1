"""The material laws along and across one body, evaluated at all its points at once."""

from collections.abc import Callable, Sequence
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


class Segment(NamedTuple):
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
    segments
        Consecutive places of one law each, together ``(places,)``; in rings, for each ring.
    """

    def __init__(self, segments: Sequence[Segment]) -> None:
        self.segments = tuple(segments)

    @classmethod
    def of(cls, laws: Sequence[Material]) -> "Laws":
        """Return the laws from a list with one for each place."""
        return cls(_runs(laws))

    @classmethod
    def in_rings(cls, laws: Sequence[Sequence[Material]], ring: Index) -> "Laws":
        """Return the laws from a list for each ring; ``ring`` ``(q,)`` are the rings of the section's points."""
        return cls(
            [segment._replace(points=np.flatnonzero(ring == r)) for r, own in enumerate(laws) for segment in _runs(own)]
        )

    def some(self, places: Index) -> "Laws":
        """Return the laws at some places, ascending."""
        segments = []
        for segment in self.segments:
            first, last = (int(k) for k in np.searchsorted(places, (segment.first, segment.last)))
            if last > first:
                law = segment.law.some(places[first:last] - segment.first)
                segments.append(Segment(law, first, last, segment.points))
        return Laws(segments)

    def placed(self, places: Places) -> "Laws":
        """Return the laws at places of a rod, of shape ``(places, ..., points)``."""
        return self._replaced(lambda segment: segment.law.placed(segment.places(places)))

    def at(self, factor: float) -> "Laws":
        """Return the laws at a load factor."""
        return self._replaced(lambda segment: segment.law.reached(factor))

    def advanced(self, F: Array, factor: float) -> "Laws":
        """Return the laws with their states at the end of a step, of ``F`` at the points and load factor there."""
        return self._replaced(lambda segment: segment.law.advanced(segment.of(F), factor))

    def lasting(self, step: float) -> "Laws":
        """Return the laws with memory in a step of a motion of some time, others as they are."""
        return self._replaced(lambda segment: segment.law.lasting(step) if has_memory(segment.law) else segment.law)

    def knowing(self, states: Array) -> "Laws":
        """Return the laws with states ``(places, t, q, m)``, those without memory as they are."""
        return self._replaced(lambda own: own.law.knowing(states[own.at(3)]) if has_memory(own.law) else own.law)

    @property
    def frozen(self) -> "Laws":
        """The laws without flow."""
        return self._replaced(lambda segment: segment.law.frozen if has_memory(segment.law) else segment.law)

    def _replaced(self, law: Callable[[Segment], Material]) -> "Laws":
        """Return the laws with that of each segment replaced."""
        return Laws([segment._replace(law=law(segment)) for segment in self.segments])

    def state(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return a state variable at points, shape ``(*shape, count)``, NaN for laws without it.

        Raises
        ------
        InputError
            If no law has one.
        """
        known = {one: count for segment in self.segments for one, count in segment.law.states.items()}
        if name not in known:
            public = [one for one in known if one[0] != "_"]
            raise InputError(f"state: got {name!r}, laws here have {', '.join(map(repr, public)) or 'none'}")
        result = np.full((*shape, known[name]), np.nan)
        for segment in self.segments:
            if name in segment.law.states:
                at = segment.at(len(shape))
                result[at] = _part(segment.law, name, result[at].shape[:-1])
        return result

    @property
    def remember(self) -> bool:
        """Whether a law has memory."""
        return any(segment.law.remembers for segment in self.segments)

    @property
    def follow(self) -> bool:
        """Whether a law needs the rod's places (`placed`)."""
        return any(segment.law.follows for segment in self.segments)

    @property
    def loaded(self) -> bool:
        """Whether a law changes with the load factor."""
        return any(segment.law.at(0.5) is not segment.law for segment in self.segments)

    @property
    def tabled(self) -> bool:
        """Whether a law grows by a table over time."""
        return any(segment.law.grows is not None for segment in self.segments)

    @property
    def objective(self) -> bool:
        """Whether all laws are frame-invariant."""
        return all(segment.law.objective for segment in self.segments)

    def energy(self, F: Array) -> Array:
        """Return the stored energy per reference volume, shape ``F.shape[:-2]``."""
        return self._joined(F, [segment.law.energy(segment.of(F)) for segment in self.segments])

    def stress(self, F: Array) -> Array:
        """Return the first Piola-Kirchhoff stress, shape of ``F``."""
        return self._joined(F, [segment.law.stress(segment.of(F)) for segment in self.segments])

    def discrete(self, F: Array, change: Array, with_moduli: bool) -> tuple[Array, Array]:
        """Return stresses whose work is the change of the energy, and their moduli (`Material.discrete`)."""
        results = [segment.law.discrete(segment.of(F), segment.of(change), with_moduli) for segment in self.segments]
        stress = self._joined(F, [stress for stress, _ in results])
        moduli = [part for _, part in results if part is not None]
        return stress, self._joined(F, moduli) if moduli else np.empty(0)

    def tangent(self, F: Array) -> Array:
        """Return ``dP/dF``, shape ``F.shape + (3, 3)``."""
        return self._joined(F, [segment.law.tangent(segment.of(F)) for segment in self.segments])

    def _joined(self, F: Array, values: Sequence[Array]) -> Array:
        """Return values of each segment at the points of ``F``."""
        if all(segment.whole for segment in self.segments):
            return values[0] if len(values) == 1 else np.concatenate(values)
        ahead = F.ndim - 2
        result = np.empty(F.shape[:ahead] + values[0].shape[ahead:])
        for segment, part in zip(self.segments, values, strict=True):
            result[segment.at(ahead)] = part
        return result


def _part(law: Material, name: str, shape: tuple[int, ...]) -> Array:
    """Return a state variable of a law at points, shape ``(*shape, count)``."""
    names = list(law.states)
    first = sum(law.states[one] for one in names[: names.index(name)])
    return law.known(shape)[..., first : first + law.states[name]]


def _runs(laws: Sequence[Material]) -> list[Segment]:
    """Return a segment for each run of one law."""
    segments, first = [], 0
    for _, same in groupby(laws, id):
        members = list(same)
        segments.append(Segment(members[0], first, first + len(members)))
        first += len(members)
    return segments


def shear_laws(laws: Laws) -> Laws:
    """Return the laws without their bulk terms."""
    return laws._replaced(lambda segment: segment.law.shear)


def volume_change(laws: Laws, F: Array) -> tuple[Array, Array]:
    """Return ``theta`` and ``d theta / dF`` for ``F`` ``(E, t, q, 3, 3)``; NaN where ``ln J`` has no value."""
    theta, slope = np.empty(F.shape[:-2]), np.empty(F.shape)
    for segment in laws.segments:
        part, at = segment.of(F), segment.at(theta.ndim)
        if segment.law.logarithmic:
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
    for segment in laws.segments:
        at = segment.at(p.ndim)
        for row, part in zip(result, segment.law.complementary(p[at]), strict=True):
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
    for segment in laws.segments:
        at = segment.at(F.ndim - 2)
        if segment.law.logarithmic:
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
