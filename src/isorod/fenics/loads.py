"""What holds and loads a finite element body, by the names of its groups of facets; nothing here knows dolfinx."""

from collections.abc import Sequence
from typing import NamedTuple


class Held(NamedTuple):
    """What holds the facets of a group.

    Attributes
    ----------
    group
        Its name.
    components
        Letters of ``"xyz"``.
    displacement
        At load factor 1, shape ``(3,)``, units of length.
    """

    group: str
    components: str
    displacement: Sequence[float]


class Load(NamedTuple):
    """A load at load factor 1, which stays as it is while the body moves.

    Attributes
    ----------
    group
        Name of the facets that it is on; None: it is a force per reference volume.
    vector
        Force per reference area, per volume, or ``total``, shape ``(3,)``.
    pressure
        Along the normal at rest, into the body.
    total
        Whether ``vector`` is the force on all of the group.
    """

    group: str | None
    vector: Sequence[float] = (0.0, 0.0, 0.0)
    pressure: float = 0.0
    total: bool = False
