"""Under-resolved contact patches, and the refined spaces that resolve them (`isorod.space.closer`).

The size of a patch is measured in the solution.  Where that is under-resolved, the size is known roughly: a first
refined space is fine enough to measure it, and a second one is made for the measured size.

Rods that touch along their length do so on strips, resolved by section functions alone where each is at one angle round
the section.  The local compliance of wires there makes a cable softer, by the same amount with each halving of the
distance of control points.
"""

from collections.abc import Sequence

import numpy as np

from isorod.arrays import Array
from isorod.contact.defaults import radii
from isorod.contact.result import ContactResult
from isorod.model.contact import Contact
from isorod.model.model import Model
from isorod.space.closer import Patch
from isorod.space.graded import Graded
from isorod.space.space import Space

# A patch is refined if fewer than this fraction of the requested control points are across: the mean chord of a circle
# is this fraction of its diameter.  Of crossing cylinders radius, by the area, and largest pressure, per
# reference area, err by 1.4 and 2.5 % at most with three of them, by 3 and 2 % with four, by 2 and 3 % with six;
# but once, with 3.6, by 7 %.
ENOUGH = 0.75

# Control points across below which the size is known roughly, and those across in the next space then.
_BLIND, _ROUGHLY = 1.5, 1.7

# Target in motions, whose patches are measured up to a quarter too large at first: an impact of crossing bars with
# three cells across lasts as long as with four and a stiffer penalty, to half a per cent.
_IN_MOTION = 3.5

# Extent of the refined region, in half extents of the patch: pressure ends steeply at the rim.
_RIM = 1.2

# Smallest ratio of the extents of a patch.
_SLIMMEST = 0.2

# A patch longer than so many radii is a line, or several of them.
_COMPACT = 1.5

# Least distance of lines round the section, in radians, and largest extent of a line: helical lines are not refined.
_APART, _WIDEST = 0.3, 1.0

# Points farther off a line than so many times the root of the mean square, as at its ends, do not belong to it.
_OFF = 2.0

# Shortest arcs at lines, in radii, for each rod of the model, to limit run time: a rod between plates, pressed by a
# hundredth and a thousandth of its width, is then 0.4 and 0.6 % too soft, with 0.1 2.8 and 13 %; a cable of three steel
# wires, whose lines are 0.02 wide, is 0.2 % too stiff, with 0.01 for each 0.1 %, in ten times the run time.
# Where the shortest arc exceeds the second value, lines are not refined.
_FINEST, _COARSEST = 1.0 / 30.0, 0.2


def patches(
    model: Model, contacts: Sequence[ContactResult], lines: bool = True, moving: bool = False
) -> dict[int, list[Patch]]:
    """Return, by body, the under-resolved patches of contacts; none where one of them is not a compact patch or line.

    Parameters
    ----------
    model, contacts
        Of a solution.
    lines
        Whether lines of contact are patches.
    moving
        Whether these are the peaks of a motion: each solution takes long, and pressures are not needed.
    """
    result: dict[int, list[Patch]] = {}
    # Contacts with the user's penalty or points are not refined.
    default = [
        (contact, outcome)
        for contact, outcome in zip(model.contacts, contacts, strict=True)
        if not (contact.penalty or contact.points)
    ]
    if all(
        not outcome.points_across or outcome.cells_across >= ENOUGH * _across(contact, moving)
        for contact, outcome in default
    ):
        return {}
    for contact, outcome in default:
        # The mesh of a finite element body is not refined.
        if outcome.on_facets or outcome.wanders:
            return {}
        made = _of_contact(model, contact, outcome, lines, moving)
        if made is None:
            return {}
        for body, here in made.items():
            result.setdefault(body, []).extend(here)
    return result


def _across(contact: Contact, moving: bool) -> float:
    return min(contact.across, _IN_MOTION) if moving else contact.across


def _of_contact(
    model: Model, contact: Contact, result: ContactResult, lines: bool, moving: bool
) -> dict[int, list[Patch]] | None:
    """Return the patches of a contact by body; None where there are several, or lines that wind round a section."""
    requested = _across(contact, moving)
    if result.cells_across < _BLIND and not moving:
        requested = min(requested, _ROUGHLY)
    by_body = {}
    for body in np.unique(result.body[result.pressure > 0.0]).tolist():
        space = model.bodies[body].space
        radius = radii(space)[1]
        here = (result.body == body) & (result.pressure > 0.0)
        sides = 1.0 if contact.obstacle is not None else 2.0
        place, along, around = _seen(space, radius, result, here, sides)
        if max(along, around) > _COMPACT * radius:
            finest = _FINEST * len(model.bodies)
            is_worth = lines and finest < _COARSEST and not isinstance(space.basis, Graded)
            along_it = _lines(space, finest * radius, result, here, (sides, contact.across)) if is_worth else []
            if not along_it:
                return None
            by_body[body] = along_it
            continue
        sizes = 2.0 * along / requested, 2.0 * around / requested
        if moving and min(sizes) < _FINEST * radius:
            return None
        by_body[body] = [Patch(*place, _RIM * along, _RIM * around / radius, *sizes)]
    return by_body


def _lines(
    space: Space, finest: float, result: ContactResult, here: Array, sides_across: tuple[float, float]
) -> list[Patch]:
    """Return the lines of contact of points ``here``, each at one angle round the section; none where one is not.

    Arcs are no shorter than ``finest``; ``sides_across`` is the number of bodies that have points, and of arcs across.
    """
    u, angle = result.parameters[here].T
    areas, load = result.areas[here], (result.areas * result.pressure)[here]
    radius, (sides, across) = radii(space)[1], sides_across
    order = np.argsort(angle)
    cuts = np.flatnonzero(np.diff(angle[order], append=angle[order[0]] + 2.0 * np.pi) > _APART)
    # Contact all round is not a line.
    if not cuts.size:
        return []
    strips = []
    places, whole = space.rod.arc_length(u), float(space.rod.arc_length.total)
    for line in np.split(np.roll(order, -cuts[-1] - 1), cuts[:-1] + angle.size - cuts[-1]):
        direction = complex(load[line] @ np.exp(1j * angle[line]))
        turned = np.angle(np.exp(1j * angle[line]) / direction)
        along = np.sort(places[line])
        length = along[-1] - along[0]
        if np.ptp(turned) > _WIDEST or not np.diff(along, append=along[-1]).max() < _COMPACT * radius < length:
            return []
        spread = np.sqrt(load[line] @ turned**2 / load[line].sum())
        width = sides * areas[line].sum() / length
        reach, arc = max(_OFF * spread, 0.5 * _RIM * width / radius), max(width / across, finest)
        strips.append(Patch(float(u[line].mean()), float(np.angle(direction)), whole, float(reach), whole, float(arc)))
    return strips


def _seen(
    space: Space, radius: float, result: ContactResult, here: Array, sides: float
) -> tuple[tuple[float, float], float, float]:
    """Return the middle of the patch of points ``here``, and half its length and half its width.

    Sizes are from the second moment of the pressure (a fifth of the squared half width for Hertz'), or from the area,
    whichever is more: with few active points both are too small.
    """
    load = (result.areas * result.pressure)[here]
    load = load / load.sum()
    u, angle = result.parameters[here].T
    middle = float(load @ u)
    direction = complex(load @ np.exp(1j * angle))
    _, jacobian = space.rod.grid(np.zeros((1, 2)), [middle])
    stretch = float(np.linalg.norm(jacobian[0, 0, :, 2]))
    turned = np.angle(np.exp(1j * angle) / direction)
    moments = np.array([stretch**2 * (load @ (u - middle) ** 2), radius**2 * (load @ turned**2)])
    widest = float(np.sqrt(sides * result.areas[here].sum() / np.pi))
    sizes = np.sqrt(5.0 * np.maximum(moments, _SLIMMEST**2 * moments.max()))
    mean = float(np.sqrt(sizes.prod()))
    along, around = (sizes * max(1.0, widest / mean) if mean > 0.0 else np.full(2, widest)).tolist()
    return (middle, float(np.angle(direction))), along, around
