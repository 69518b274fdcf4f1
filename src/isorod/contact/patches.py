"""Where contacts press on too few control points, and what spaces would see them (`isorod.space.closer`).

A patch is as large as it is seen to be.  Where control points do not see it at all, that is known roughly, and a space
is made that is fine enough to measure it; the next is made for what that shows.

Rods that touch along their length do so on strips, seen by section functions alone where each is at one angle round the
section.  What wires give way there makes a cable softer, by as much each time that control points are twice as close.
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

# A patch across which there are less than this share of the control points wanted is looked at closer: chords of a
# circle are on average so much of its diameter.  Of crossing cylinders radius, by the area, and largest pressure, per
# reference area, err by 1.4 and 2.5 % at most with three of them seen, by 3 and 2 % with four, by 2 and 3 % with six;
# but once, with 3.6, by 7 %.
ENOUGH = 0.75

# With fewer than so many the size is known roughly; as many as the next space is to have.
_BLIND, _ROUGHLY = 1.5, 1.7

# In motions so many are aimed at, of patches that are seen up to a quarter too large at first: a hit of crossing bars
# with three cells across lasts as long as with four and a stiffer penalty, to half a per cent.
_IN_MOTION = 3.5

# How far control points are as close as in a patch, where pressure ends steeply, in its half extents.
_RIM = 1.2

# Patches are no slimmer.
_SLIMMEST = 0.2

# A patch longer than so many radii is a line, or several of them.
_COMPACT = 1.5

# Lines are as far apart round the section, in radians, and points of one no farther: what winds round it is not looked
# at closer.
_APART, _WIDEST = 0.3, 1.0

# Points off a line by so many times the root of the mean square are none of it, as where it ends.
_OFF = 2.0

# Arcs at lines are no shorter, in radii, for each rod of the model, for time: a rod between plates, pressed by a
# hundredth and a thousandth of its width, is then 0.4 and 0.6 % too soft, with 0.1 2.8 and 13 %; a cable of three steel
# wires, whose lines are 0.02 wide, is 0.2 % too stiff, with 0.01 for each 0.1 %, in ten times as long.  Where they are
# longer than that nothing is gained.
_FINEST, _COARSEST = 1.0 / 30.0, 0.2


def patches(
    model: Model, contacts: Sequence[ContactResult], lines: bool = True, moving: bool = False
) -> dict[int, list[Patch]]:
    """Return, by body, the patches of contacts that control points do not see; none where one of them is no patch.

    Parameters
    ----------
    model, contacts
        Of a solution.
    lines
        Whether lines of contact are patches.
    moving
        Whether these are the peaks of a motion: each solution takes long, and pressures are not asked for.
    """
    found: dict[int, list[Patch]] = {}
    # Whoever gives penalty or points has said what the contact is.
    own = [
        (asked, one) for asked, one in zip(model.contacts, contacts, strict=True) if not (asked.penalty or asked.points)
    ]
    if all(not one.points_across or one.cells_across >= ENOUGH * _across(asked, moving) for asked, one in own):
        return {}
    for asked, one in own:
        # The mesh of a finite element body stays what it is.
        if one.on_facets or one.wanders:
            return {}
        made = _of_contact(model, asked, one, lines, moving)
        if made is None:
            return {}
        for body, here in made.items():
            found.setdefault(body, []).extend(here)
    return found


def _across(asked: Contact, moving: bool) -> float:
    return min(asked.across, _IN_MOTION) if moving else asked.across


def _of_contact(
    model: Model, asked: Contact, result: ContactResult, lines: bool, moving: bool
) -> dict[int, list[Patch]] | None:
    """Return the patches of a contact by body; None where it is on several, or on lines that wind round a section."""
    requested = _across(asked, moving)
    if result.cells_across < _BLIND and not moving:
        requested = min(requested, _ROUGHLY)
    found = {}
    for body in np.unique(result.body[result.pressure > 0.0]).tolist():
        space = model.bodies[body].space
        radius = radii(space)[1]
        here = (result.body == body) & (result.pressure > 0.0)
        shared = 1.0 if asked.obstacle is not None else 2.0
        place, along, around = _seen(space, radius, result, here, shared)
        if max(along, around) > _COMPACT * radius:
            finest = _FINEST * len(model.bodies)
            is_worth = lines and finest < _COARSEST and not isinstance(space.basis, Graded)
            along_it = _lines(space, finest * radius, result, here, (shared, asked.across)) if is_worth else []
            if not along_it:
                return None
            found[body] = along_it
            continue
        sizes = 2.0 * along / requested, 2.0 * around / requested
        if moving and min(sizes) < _FINEST * radius:
            return None
        found[body] = [Patch(*place, _RIM * along, _RIM * around / radius, *sizes)]
    return found


def _lines(space: Space, finest: float, result: ContactResult, here: Array, wanted: tuple[float, float]) -> list[Patch]:
    """Return the lines of contact of points ``here``, each at one angle round the section; none where one is not.

    Arcs are no shorter than ``finest``; ``wanted`` is how many times points share their areas, and arcs across a line.
    """
    u, angle = result.parameters[here].T
    areas, load = result.areas[here], (result.areas * result.pressure)[here]
    radius, (shared, across) = radii(space)[1], wanted
    order = np.argsort(angle)
    cuts = np.flatnonzero(np.diff(angle[order], append=angle[order[0]] + 2.0 * np.pi) > _APART)
    # What touches all round is no line.
    if not cuts.size:
        return []
    found = []
    places, whole = space.rod.arc_length(u), float(space.rod.arc_length.total)
    for line in np.split(np.roll(order, -cuts[-1] - 1), cuts[:-1] + angle.size - cuts[-1]):
        direction = complex(load[line] @ np.exp(1j * angle[line]))
        turned = np.angle(np.exp(1j * angle[line]) / direction)
        way = np.sort(places[line])
        length = way[-1] - way[0]
        if np.ptp(turned) > _WIDEST or not np.diff(way, append=way[-1]).max() < _COMPACT * radius < length:
            return []
        spread = np.sqrt(load[line] @ turned**2 / load[line].sum())
        width = shared * areas[line].sum() / length
        reach, arc = max(_OFF * spread, 0.5 * _RIM * width / radius), max(width / across, finest)
        found.append(Patch(float(u[line].mean()), float(np.angle(direction)), whole, float(reach), whole, float(arc)))
    return found


def _seen(
    space: Space, radius: float, result: ContactResult, here: Array, shared: float
) -> tuple[tuple[float, float], float, float]:
    """Return the middle of the patch of points ``here``, and half its length and half its width.

    That is by the second moment of the pressure, of Hertz' a fifth of its square, or by the area, whichever is more:
    where few points see it, both are too small.
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
    widest = float(np.sqrt(shared * result.areas[here].sum() / np.pi))
    sizes = np.sqrt(5.0 * np.maximum(moments, _SLIMMEST**2 * moments.max()))
    mean = float(np.sqrt(sizes.prod()))
    along, around = (sizes * max(1.0, widest / mean) if mean > 0.0 else np.full(2, widest)).tolist()
    return (middle, float(np.angle(direction))), along, around
