"""What a body has gone through, and what laws with memory make of it at any of its points."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.material.along_rod import Laws

if TYPE_CHECKING:
    from isorod.space.space import Space


class Past(NamedTuple):
    """A state gone through.

    Attributes
    ----------
    factor
        Load factor.
    displacement
        Of all degrees of freedom ``(dofs,)``, or of a body's nodes ``(nodes, 3)``.
    share
        How far, of the way from the state before to the displacement.
    """

    factor: float
    displacement: Array
    share: float = 1.0

    def of(self, part: Callable[[Array], Array]) -> "Past":
        """Return the same of another displacement, which is made of its own."""
        return self._replace(displacement=part(self.displacement))


def halved(past: Sequence[Past]) -> list[Past]:
    """Return states with one in the middle of each step, all but the last of them."""
    found, before = list[Past](), 0.0
    for one in past:
        found += [Past(0.5 * (before + one.factor), one.displacement, 0.5), one]
        before = one.factor
    return found[:-1]


def gone_through(laws: Laws, past: Sequence[Past], space: "Space", u: Array, xi: ArrayLike) -> Laws:
    """Return laws with the state that each point has after what it went through (`isorod.model.body.Body.laws_at`)."""
    before = np.eye(3)
    for one in past:
        _, F = space.displacement(one.displacement, xi, u.ravel())
        F = F.reshape(*u.shape, *F.shape[1:])
        laws = laws.advanced(F if one.share == 1.0 else _between(before, F, one.share), one.factor)
        before = F if one.share == 1.0 else before
    return laws


def _between(first: Array, last: Array, share: float) -> Array:
    """Return stretches whose logarithm is between those of two deformation gradients, shape of the last."""
    strains = []
    for F in (first, last):
        squares, ways = np.linalg.eigh(np.swapaxes(F, -1, -2) @ F)
        strains.append((ways * np.log(squares)[..., None, :]) @ np.swapaxes(ways, -1, -2))
    twice, ways = np.linalg.eigh((1.0 - share) * strains[0] + share * strains[1])
    return np.asarray((ways * np.exp(0.5 * twice)[..., None, :]) @ np.swapaxes(ways, -1, -2))
