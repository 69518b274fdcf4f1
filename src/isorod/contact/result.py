"""What comes out of a contact: forces, area, penetration, and the pressure at each point."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from isorod.arrays import Array, Index
from isorod.contact.packed import Packed
from isorod.contact.tables import smallest_radius
from isorod.model.contact import Contact
from isorod.model.model import Model


@dataclass(frozen=True, eq=False)
class ContactResult:
    """The outcome of one contact.

    Attributes
    ----------
    force
        Total normal force, the integral of the pressure.
    area
        Reference area in contact (the mean of both surfaces, if there are two).
    penetration
        Depth of the deepest point, length, not negative.
    relative_penetration
        The same, relative to the smallest radius of the elements that take part (mean distance of a section's outline
        from its centre).
    body
        Body whose surface each point belongs to, shape ``(q,)``; points of both bodies are listed.
    positions
        Present positions of the points, shape ``(q, 3)``.
    pressure
        Pressure at the points, force per reference area, zero out of contact, shape ``(q,)``.
    areas
        Reference areas of the points; where both bodies have points, each half counted, shape ``(q,)``.
    friction
        Resultant of friction on the first side, shape ``(3,)``; zero where there are no two sides.
    sticking, slipping
        Number of points in contact, with friction, that stick and that slip.
    """

    force: float
    area: float
    penetration: float
    relative_penetration: float
    body: Index
    positions: Array
    pressure: Array
    areas: Array
    friction: Array = field(default_factory=lambda: np.zeros(3))
    sticking: int = 0
    slipping: int = 0


def slave_points(model: Model, packed: Packed) -> Iterator[tuple[Contact, Index]]:
    """Yield each contact of a model with the numbers of its slave points."""
    first = [*packed.passes["first_point"], packed.areas.size]
    k = 0
    for contact in model.contacts:
        begin, k = k, k + len(contact.sides)
        yield contact, np.arange(first[begin], first[k])


def measure(model: Model, packed: Packed) -> list[ContactResult]:
    """Return the outcome of each contact of a model, as the last forces left it (`isorod.contact.packed`)."""
    results = []
    sides = [body for contact in model.contacts for body, _ in contact.sides]
    bodies = np.repeat(sides, np.diff([*packed.passes["first_point"], packed.areas.size]))
    for contact, chosen in slave_points(model, packed):
        gap, pressure = packed.states["gap"][chosen], packed.states["pressure"][chosen]
        areas = packed.areas[chosen]
        touching = pressure > 0.0
        depth = float(max(0.0, -gap[touching].min(initial=0.0)))
        results.append(
            ContactResult(
                force=float(areas @ pressure),
                area=float(areas[touching].sum()),
                penetration=depth,
                relative_penetration=depth / smallest_radius(model, contact),
                body=bodies[chosen],
                positions=packed.points[chosen].copy(),
                pressure=pressure.copy(),
                areas=areas.copy(),
            )
        )
    return results
