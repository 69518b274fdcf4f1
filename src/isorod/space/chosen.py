"""Default parameters of a space, kept for models near that of a solution (`isorod.choices`)."""

from typing import Any

import numpy as np

from isorod.arrays import Array
from isorod.choices import chosen
from isorod.space import choice

# Parameters that have a chosen default.
CHOICES = ("order", "section_points", "section_degree", "elements", "degree", "continuity", "knots", "quadrature")


def choices(space: Any) -> dict[str, Any]:
    """Return all parameters of a space, given or chosen, and under ``chosen`` the names of the latter."""
    breaks, made = chosen(lambda: _choose(space))
    own = space.rod.axis.breaks
    if space.knots is not None and tuple(space.knots) != made["knots"]:
        # Given knots are already those of the rod with changed parameters.
        return made | {"knots": tuple(space.knots)}
    if np.array_equal(breaks, own):
        return made
    # At the same places between the breaks of the rod, which a parameter has moved.
    return made | {"knots": tuple(np.interp(made["knots"], breaks, own).tolist())}


def basis(space: Any) -> Any:
    """Return the section functions of a space: polynomials with the directions and number of those kept."""
    if space.section_basis is not None or space.section_degree is None:
        return space.basis
    own = None

    def known() -> Any:
        nonlocal own
        own = space.basis
        return own

    kept = chosen(known)
    return kept if own is not None else type(kept)(space.rod, space.section_degree, kept)


def _choose(space: Any) -> tuple[Array, dict[str, Any]]:
    given = {name for name in CHOICES if getattr(space, name) is not None}
    made = {name: getattr(space, name) for name in CHOICES}
    if space.elements is not None and space.knots is None:
        made["knots"] = ()
        given.add("knots")
    if space.section_basis is None and space.section_degree is None and space.order is None:
        # A number of section points means functions of control points, which have an order.
        made |= {"order": choice.ORDER} if space.section_points is not None else choice.section(space.rod)
    along = choice.axis(space.rod, space.elements, space.degree, space.continuity, made["knots"])
    made |= along._asdict()
    space._set(**made)
    if space.quadrature is None:
        made["quadrature"] = str(choice.rule(space))
    chose = tuple(name for name in CHOICES if name not in given and made[name] is not None)
    return space.rod.axis.breaks, made | {"chosen": chose}
