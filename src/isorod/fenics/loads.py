"""Supports and loads of a finite element body on named groups of facets, without dolfinx."""

from collections.abc import Sequence
from typing import NamedTuple


class Held(NamedTuple):
    """A support of the facets of a group.

    Attributes
    ----------
    group
        Name of the group.
    components
        Letters of ``"xyz"``.
    displacement
        Displacement at load factor 1, shape ``(3,)``, units of length.
    """

    group: str
    components: str
    displacement: Sequence[float]


class Load(NamedTuple):
    """A dead load at load factor 1.

    Attributes
    ----------
    group
        Name of its group of facets; None for a force per reference volume.
    vector
        Force per reference area, per volume, or ``total``, shape ``(3,)``.
    pressure
        Pressure along the normal at rest, positive into the body.
    total
        Whether ``vector`` is the total force on the group.
    """

    group: str | None
    vector: Sequence[float] = (0.0, 0.0, 0.0)
    pressure: float = 0.0
    total: bool = False
