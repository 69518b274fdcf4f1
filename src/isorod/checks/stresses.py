"""How much stresses change on a finer space, away from where they have no limit.

At the edges of held faces and patches, where laws meet at the surface, and where forces are on a section or a point,
stresses grow without bound on finer spaces; what counts is farther off than the section is wide, within which such
effects decay (Saint-Venant).  Where something touches the error of stresses is that of the pressure, which is told
beside it (`isorod.contact.result`); what counts is nearly as far from there.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from isorod.arrays import Array
from isorod.checks.finer import Finer
from isorod.model.body import Body
from isorod.model.model import Model
from isorod.output import held
from isorod.output.stress import cauchy

if TYPE_CHECKING:
    from isorod.contact.result import ContactResult

# Sections looked at in an element, elements looked at, and points round each section.
_SECTIONS, _MOST, _AROUND = 4, 256, 24

# At the radius where rings meet the outer one is meant; next to it is the inner one.
_INSIDE = 1.0 - 1e-9

# Distance from contact from which on places count, in widths of the section: the far side of a wire does.
CLEAR = 0.75

# The error over what a finer space changes, at most.  Measured on the bars of `comparisons.stability.stresses`, whose
# errors are 0.3 to 1.25 times that.
_LEFT = 1.25

# Stresses that are a smaller share of the shear modulus are round-off of strains.
_ROUNDING = 1e-11


def change(
    finer: Finer,
    before: Array,
    after: Array,
    pressures: Sequence[Array | None] = (),
    corrected: Sequence[Array | None] = (),
    contacts: "Sequence[ContactResult]" = (),
) -> float:
    """Return the largest error of Cauchy stress at surfaces and in the middle, about, over the largest stress there.

    Stresses are measured by their Frobenius norm; the answer is NaN where no place is far enough from edges, or
    stresses are round-off.

    Parameters
    ----------
    before, after
        All degrees of freedom of the model, and on the finer spaces.
    pressures, corrected
        The same of the coefficients of mixed bodies.
    contacts
        Their outcome.
    """
    largest = changed = 0.0
    for b, (body, fine) in enumerate(zip(finer.coarse.bodies, finer.model.bodies, strict=True)):
        u, rings = away(finer.coarse, b), body.space.rod.rings
        if not u.size:
            continue
        # The middle of what has no hole, and both sides where rings meet.
        sides = [radius * _INSIDE for radius in rings[1:-1]]
        xi = np.concatenate([around((*rings, *sides)), np.zeros((int(rings[0] == 0.0), 2))])
        nodal = finer.coarse.nodal(before, b)
        there = _stress(body, nodal, xi, u, pressures[b] if pressures else None)
        better = _stress(fine, finer.model.nodal(after, b), xi, u, corrected[b] if corrected else None)
        places = body.space.rod.grid(xi, u)[0] + body.space.displacement(nodal, xi, u)[0]
        counts = to_contact(contacts, places) > CLEAR * held.width(finer.coarse, b)
        largest = max(largest, float(np.linalg.norm(better, axis=(2, 3))[counts].max(initial=0.0)))
        changed = max(changed, float(np.linalg.norm(better - there, axis=(2, 3))[counts].max(initial=0.0)))
    stiffness = max(law.shear_modulus for body in finer.coarse.bodies for law in body.laws)
    return _LEFT * changed / largest if largest > _ROUNDING * stiffness else np.nan


def _stress(body: Body, nodal: Array, xi: Array, u: Array, pressure: Array | None) -> Array:
    return cauchy(body, nodal, xi, u, 1.0, pressure)


def to_contact(contacts: "Sequence[ContactResult]", places: Array) -> Array:
    """Return how far present places ``(..., 3)`` are from the nearest point under pressure, infinite without one."""
    pressed = [one.positions[one.pressure > 0.0] for one in contacts]
    if not sum(map(len, pressed)):
        return np.full(places.shape[:-1], np.inf)
    # Models without contact need none of it.
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(np.concatenate(pressed)).query(places)[0])


def around(radii: Sequence[float], count: int = _AROUND) -> Array:
    """Return so many disk points round the section at each of some radii but the centre, shape ``(n, 2)``."""
    angle = 2.0 * np.pi / count * (np.arange(count) + 0.5)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([radius * ring for radius in radii if radius > 0.0])


def away(model: Model, number: int) -> Array:
    """Return axis parameters inside the elements of a body that are farther from edges than its section is wide.

    Sections held in the mean and such with forces on them, or on a point of theirs, count as edges.
    """
    body = model.bodies[number]
    axis, rings = body.space.axis, len(body.space.rod.rings) - 1
    count = min(axis.elements, _MOST)
    first = np.arange(count) * axis.elements // count
    share = (np.arange(_SECTIONS) + 0.5) / _SECTIONS
    u = (axis.breaks[first, None] + np.diff(axis.breaks)[first, None] * share).ravel()
    laws = np.array([id(law) for law in body.laws]).reshape(-1, rings)
    jumps = axis.breaks[1:-1][(laws[1:] != laws[:-1]).any(axis=1)]
    ends = np.array([]) if body.space.rod.closed else axis.breaks[[0, -1]]
    pushing: list[Any] = [*model.means.values(), *model.loads]
    pushed = (getattr(one, "u", None) for one in pushing if one.body == number)
    edges = [*ends, *jumps, *(one for one in pushed if one is not None)]
    away = held.distance(model, number, u, edges) > held.width(model, number)
    return np.asarray(u[away])
