"""Where contacts press on too few control points, and what spaces would see them (`isorod.space.closer`)."""

from collections.abc import Sequence

import numpy as np

from isorod.arrays import Array
from isorod.contact.result import ContactResult
from isorod.contact.tables import radii
from isorod.model.model import Model
from isorod.space.closer import Patch
from isorod.space.space import Space

# Control points across a patch below which it is looked at closer, and as many as are then wanted.  Of crossing
# cylinders the largest pressure, per reference area, is 11 % too high with three of them, 4 % with four.
FEWEST, WANTED = 3.3, 4.4

# A patch longer than so many radii is a line, which is not looked at closer.
_COMPACT = 0.6


def patches(model: Model, contacts: Sequence[ContactResult]) -> dict[int, list[Patch]]:
    """Return, by body, the patches of contacts that control points do not see; none where one of them is no patch.

    Parameters
    ----------
    model, contacts
        Of a solution.
    """
    found: dict[int, list[Patch]] = {}
    # Whoever gives penalty or points has said what the contact is.
    own = [one for asked, one in zip(model.contacts, contacts, strict=True) if not (asked.penalty or asked.points)]
    if all(not one.points_across or one.cells_across >= FEWEST for one in own):
        return {}
    for one in own:
        for body in np.unique(one.body[one.pressure > 0.0]):
            here = (one.body == body) & (one.pressure > 0.0)
            shared = 1.0 if (one.body == body).all() else 2.0
            patch = _patch(model.bodies[body].space, one, here, shared)
            if patch is None:
                return {}
            found.setdefault(int(body), []).append(patch)
    return found


def _patch(space: Space, result: ContactResult, here: Array, shared: float) -> Patch | None:
    """Return the patch of points ``here``; None where they are a line, or several patches.

    Half its width is by the second moment of the pressure, of Hertz' a fifth of its square, or by the area, whichever
    is more: where few points see it, both are too small.
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
    widest = float(np.sqrt(shared * result.areas[here].sum() / np.pi))
    along = max(stretch * float(np.sqrt(5.0 * (load @ (u - middle) ** 2))), widest)
    around = max(float(np.sqrt(5.0 * (load @ turned**2))), widest / radius)
    if max(along, around * radius) > _COMPACT * radius:
        return None
    size = 2.0 * min(along, around * radius) / WANTED
    return Patch(middle, float(np.angle(direction)), along, around, size)
