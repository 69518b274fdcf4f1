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
    breaks, parameters = chosen(lambda: _choose(space))
    rod_breaks = space.rod.axis.breaks
    if space.knots is not None and tuple(space.knots) != parameters["knots"]:
        # Given knots are already those of the rod with changed parameters.
        return parameters | {"knots": tuple(space.knots)}
    if np.array_equal(breaks, rod_breaks):
        return parameters
    # At the same places between the breaks of the rod, which a parameter has moved.
    return parameters | {"knots": tuple(np.interp(parameters["knots"], breaks, rod_breaks).tolist())}


def basis(space: Any) -> Any:
    """Return the section functions of a space: polynomials with the directions and number of those kept."""
    if space.section_basis is not None or space.section_degree is None:
        return space.basis
    fresh = None

    def known() -> Any:
        nonlocal fresh
        fresh = space.basis
        return fresh

    kept = chosen(known)
    return kept if fresh is not None else type(kept)(space.rod, space.section_degree, kept)


def _choose(space: Any) -> tuple[Array, dict[str, Any]]:
    given = {name for name in CHOICES if getattr(space, name) is not None}
    parameters = {name: getattr(space, name) for name in CHOICES}
    if space.elements is not None and space.knots is None:
        parameters["knots"] = ()
        given.add("knots")
    if space.section_basis is None and space.section_degree is None and space.order is None:
        # A number of section points means functions of control points, which have an order.
        parameters |= {"order": choice.ORDER} if space.section_points is not None else choice.section(space.rod)
    along = choice.axis(space.rod, space.elements, space.degree, space.continuity, parameters["knots"])
    parameters |= along._asdict()
    space._set(**parameters)
    if space.quadrature is None:
        parameters["quadrature"] = str(choice.rule(space))
    chose = tuple(name for name in CHOICES if name not in given and parameters[name] is not None)
    return space.rod.axis.breaks, parameters | {"chosen": chose}
