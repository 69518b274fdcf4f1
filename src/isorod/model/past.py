"""Earlier states of a body, and internal variables of laws with memory from them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.material.along_rod import Laws

if TYPE_CHECKING:
    from isorod.space.space import Space


class Past(NamedTuple):
    """An earlier state.

    Attributes
    ----------
    factor
        Load factor.
    displacement
        Of all degrees of freedom ``(dofs,)``, or of a body's nodes ``(nodes, 3)``.
    """

    factor: float
    displacement: Array


def gone_through(laws: Laws, past: Sequence[Past], space: "Space", u: Array, xi: ArrayLike) -> Laws:
    """Return laws with each point's internal variables after earlier states (`isorod.model.body.Body.laws_at`)."""
    for one in past:
        _, F = space.displacement(one.displacement, xi, u.ravel())
        laws = laws.advanced(F.reshape(*u.shape, *F.shape[1:]), one.factor)
    return laws
