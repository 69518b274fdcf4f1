"""Default penalty and points of contacts, and the sizes of surfaces from which they follow."""

from collections.abc import Sequence
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from isorod.contact import facets
from isorod.contact.traces import trace
from isorod.model.contact import MAX_POINTS, Contact
from isorod.space.choice import touching_points
from isorod.space.graded import Graded

if TYPE_CHECKING:
    from isorod.model.model import Model
    from isorod.space.space import Space

# The penalty by default, in moduli of the surface (`isorod.material.law.Material.surface_modulus`) per distance between
# control points round the section: of the order of what a surface has against its shortest waves.  Measured on a
# cylinder pressed on a plane with 1.9 to 3.2 control points across the patch: with 2 the half width (by the pressure's
# second moment) errs by 4 % at most and the largest pressure by 11 %, with 4 by 7 and 47 %.
_STIFF = 2.0

# Where a space is refined at a patch, the default penalty times this over the control points across: the surfaces'
# misfit, times the penalty, is a wave in the pressure.  Of crossing cylinders with four and six across, the largest
# pressure errs by 1 and 2 % so, with twice the penalty by 1 and 3 %, with the default one by 1 and 5 %.
_REFINED = 1.8

# In motions, which have no multipliers, penetration makes impacts longer: twice the default penalty there.  Of
# crossing bars with four across it is 1.3 % too long by the default one, 0.4 % by four times that.
_REFINED_IN_MOTION = 2.0


def radii(space: "Space", elements: Sequence[int] | None = None) -> tuple[float, float]:
    """Return mean and largest distance of a section's outline from its centre, of the elements where it is smallest.

    Outlines are those at the middles of elements, by default of all.
    """
    breaks = space.axis.breaks
    middles = 0.5 * (breaks[1:] + breaks[:-1])
    chosen = middles if elements is None else middles[list(elements)]
    mean, largest = space.rod.radii(chosen, 8 * space.points_around)
    return float(mean.min()), float(largest.min())


def smallest_radius(model: "Model", contact: Contact) -> float:
    """Return the smallest mean radius of the elements that take part in a contact."""
    result = []
    for body, elements in contact.sides:
        space = model.bodies[body].space
        result.append(contact.disk_radius(body, space.rod) * radii(space, elements)[0])
    return min(result)


def deepest(space: "Space", inner: bool) -> float:
    """Return the largest penetration into an inner surface, half of the wall at its thinnest; 0 for an outer one."""
    return 0.5 * (1.0 - space.rod.rings[0]) * radii(space)[0] if inner else 0.0


def penalty(model: "Model", contact: Contact, in_motion: bool = False) -> float:
    """Return the penalty of a contact, pressure per depth: the user's, or the default, another in motions."""
    if contact.penalty is not None:
        return contact.penalty
    stiffness = []
    for body, elements in contact.sides:
        space = model.bodies[body].space
        own = trace(space, contact.is_inner(body))
        radius = own.radius * radii(space, elements)[0]
        softest = min(law.surface_modulus for law in model.bodies[body].laws)
        count = space.points_around if own.lift is None else own.dimension
        stiffness.append(softest * count / (2.0 * np.pi * radius))
    if contact.facets is not None:
        law = model.solids[contact.facets.solid].law
        if law is not None:
            size = facets.facets(model, contact, 1, facets.nodes_of(model)[0]).size
            stiffness.append(law.surface_modulus / size)
    if any(isinstance(model.bodies[body].space.basis, Graded) for body, _ in contact.sides):
        stiffness = [(_REFINED_IN_MOTION if in_motion else _REFINED / contact.across) * one for one in stiffness]
    return _STIFF * min(stiffness)


def points_of(model: "Model") -> list[tuple[int, int]]:
    """Return the points round an arc and along an element of each pass of the contacts of a model, of facets alike.

    By default they are as dense along as round (`isorod.space.choice.touching_points`), at least 3 on an arc, or for
    each function on a surface without control points.  Where elements are short only at patches
    (`isorod.space.graded`), 3 on an arc and degree + 1 along each element are dense enough there.
    """
    result = []
    for contact in model.contacts:
        if contact.facets is not None:
            result.append(contact.points or facets.points_of(model, contact, smallest_radius(model, contact)))
            continue
        for body, _ in contact.sides:
            space = model.bodies[body].space
            surface = trace(space, contact.is_inner(body))
            n = space.points_around if surface.lift is None else len(surface.arcs)
            least = 3 if surface.lift is None else ceil(3 * surface.dimension / n)
            own = least, space.axis.degree + 1
            if not isinstance(space.basis, Graded):
                own = touching_points(space.rod, n, space.axis.elements, space.axis.degree, least, MAX_POINTS)
            result.append(contact.points or own)
    return result
