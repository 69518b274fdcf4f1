"""Where contacts press on too few control points, and what spaces would see them (`isorod.space.closer`).

How large a patch is that control points do not see is told by the force (`isorod.contact.hertz`), and a space is made
that sees it roughly; in the end it is as large as it is seen to be.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from isorod.arrays import Array
from isorod.contact import hertz
from isorod.contact.result import ContactResult
from isorod.contact.tables import radii
from isorod.model.contact import Contact
from isorod.model.model import Model
from isorod.space.closer import Patch
from isorod.space.space import Space

# A patch across which there are less than this share of the control points wanted is looked at closer: chords of a
# circle are on average so much of its diameter.  Of crossing cylinders radius, by the area, and largest pressure, per
# reference area, err by 1.4 and 2.5 % at most with three of them seen, by 3 and 2 % with four, by 2 and 3 % with six;
# but once, with 3.6, by 7 %.
ENOUGH = 0.75

# Fewer than so many know its force alone; as many as are then wanted.
_BLIND, _ROUGHLY = 1.5, 2.6

# How far control points are as close as in a patch, where pressure ends steeply, in its half extents.
_RIM = 1.2

# Patches are no slimmer.
_SLIMMEST = 0.2

# A patch longer than so many radii is a line, which is not looked at closer.
_COMPACT = 1.5


def patches(model: Model, contacts: Sequence[ContactResult]) -> dict[int, list[Patch]]:
    """Return, by body, the patches of contacts that control points do not see; none where one of them is no patch.

    Parameters
    ----------
    model, contacts
        Of a solution.
    """
    found: dict[int, list[Patch]] = {}
    # Whoever gives penalty or points has said what the contact is.
    own = [
        (asked, one) for asked, one in zip(model.contacts, contacts, strict=True) if not (asked.penalty or asked.points)
    ]
    if all(not one.points_across or one.cells_across >= ENOUGH * asked.across for asked, one in own):
        return {}
    for asked, one in own:
        made = _of_contact(model, asked, one)
        if made is None:
            return {}
        for body, patch in made.items():
            found.setdefault(body, []).append(patch)
    return found


def _of_contact(model: Model, asked: Contact, result: ContactResult) -> dict[int, Patch] | None:
    """Return the patches of a contact by body; None where it is on a line, or on several patches."""
    places, sizes = {}, {}
    bodies = np.unique(result.body[result.pressure > 0.0])
    for body in bodies:
        here = (result.body == body) & (result.pressure > 0.0)
        places[int(body)], sizes[int(body)] = _seen(
            model.bodies[body].space, result, here, 1.0 if (result.body == body).all() else 2.0
        )
    if _is_long(model, sizes):
        return None
    wanted = asked.across
    if result.cells_across < _BLIND and len(places) == (1 if asked.obstacle is not None else 2):
        by_force = hertz.extents(model, asked, result, places)
        if by_force:
            sizes, wanted = by_force, min(wanted, _ROUGHLY)
    if _is_long(model, sizes):
        return None
    return {
        body: Patch(
            *places[body],
            _RIM * along,
            _RIM * around / _radius(model, body),
            2.0 * along / wanted,
            2.0 * around / wanted,
        )
        for body, (along, around) in sizes.items()
    }


def _is_long(model: Model, sizes: Mapping[int, tuple[float, float]]) -> bool:
    """Whether a patch is a line, or more than one."""
    return any(max(size) > _COMPACT * _radius(model, body) for body, size in sizes.items())


def _radius(model: Model, body: int) -> float:
    space = model.bodies[body].space
    return radii(space, range(space.axis.elements))[1]


def _seen(
    space: Space, result: ContactResult, here: Array, shared: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the middle of the patch of points ``here``, and half its length and half its width.

    That is by the second moment of the pressure, of Hertz' a fifth of its square, or by the area, whichever is more:
    where few points see it, both are too small.
    """
    load = (result.areas * result.pressure)[here]
    load = load / load.sum()
    u, angle = result.parameters[here].T
    middle = float(load @ u)
    direction = complex(load @ np.exp(1j * angle))
    radius = radii(space, range(space.axis.elements))[1]
    _, jacobian = space.rod.grid(np.zeros((1, 2)), [middle])
    stretch = float(np.linalg.norm(jacobian[0, 0, :, 2]))
    turned = np.angle(np.exp(1j * angle) / direction)
    moments = np.array([stretch**2 * (load @ (u - middle) ** 2), radius**2 * (load @ turned**2)])
    widest = float(np.sqrt(shared * result.areas[here].sum() / np.pi))
    sizes = np.sqrt(5.0 * np.maximum(moments, _SLIMMEST**2 * moments.max()))
    mean = float(np.sqrt(sizes.prod()))
    along, around = (sizes * max(1.0, widest / mean) if mean > 0.0 else np.full(2, widest)).tolist()
    return (middle, float(np.angle(direction))), (along, around)
