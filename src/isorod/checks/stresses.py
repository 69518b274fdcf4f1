"""How much stresses change on a finer space, away from where they have no limit.

At the edges of held faces and patches, and where laws meet at the surface, stresses grow without bound on finer spaces;
what counts is farther off than the section is wide, within which such effects decay (Saint-Venant).
"""

from collections.abc import Sequence

import numpy as np

from isorod.arrays import Array
from isorod.checks.finer import Finer
from isorod.model.body import Body
from isorod.model.model import Model
from isorod.output import held
from isorod.output.stress import cauchy

# Sections looked at in an element, elements looked at, and points round each section.
_SECTIONS, _MOST, _AROUND = 4, 256, 8

# At the radius where rings meet the outer one is meant; next to it is the inner one.
_INSIDE = 1.0 - 1e-9

# Stresses that are a smaller share of the shear modulus are round-off of strains.
_ROUNDING = 1e-11


def change(
    finer: Finer,
    before: Array,
    after: Array,
    pressures: Sequence[Array | None] = (),
    corrected: Sequence[Array | None] = (),
) -> float:
    """Return the largest change of Cauchy stress at surfaces and in the middle, relative to the largest stress there.

    Stresses are measured by their Frobenius norm; the answer is NaN where no place is far enough from edges, or
    stresses are round-off.

    Parameters
    ----------
    before, after
        All degrees of freedom of the model, and on the finer spaces.
    pressures, corrected
        The same of the coefficients of mixed bodies.
    """
    largest = changed = 0.0
    for b, (body, fine) in enumerate(zip(finer.coarse.bodies, finer.model.bodies, strict=True)):
        u, rings = away(finer.coarse, b), body.space.rod.rings
        if not u.size:
            continue
        # The middle of what has no hole, and both sides where rings meet.
        sides = [radius * _INSIDE for radius in rings[1:-1]]
        xi = np.concatenate([around((*rings, *sides)), np.zeros((int(rings[0] == 0.0), 2))])
        there = _stress(body, finer.coarse.nodal(before, b), xi, u, pressures[b] if pressures else None)
        better = _stress(fine, finer.model.nodal(after, b), xi, u, corrected[b] if corrected else None)
        largest = max(largest, float(np.linalg.norm(better, axis=(2, 3)).max()))
        changed = max(changed, float(np.linalg.norm(better - there, axis=(2, 3)).max()))
    stiffness = max(law.shear_modulus for body in finer.coarse.bodies for law in body.laws)
    return changed / largest if largest > _ROUNDING * stiffness else np.nan


def _stress(body: Body, nodal: Array, xi: Array, u: Array, pressure: Array | None) -> Array:
    return cauchy(body, nodal, xi, u, 1.0, pressure)


def around(radii: Sequence[float], count: int = _AROUND) -> Array:
    """Return so many disk points round the section at each of some radii but the centre, shape ``(n, 2)``."""
    angle = 2.0 * np.pi / count * (np.arange(count) + 0.5)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([radius * ring for radius in radii if radius > 0.0])


def away(model: Model, number: int) -> Array:
    """Return axis parameters inside the elements of a body that are farther from edges than its section is wide."""
    body = model.bodies[number]
    axis, rings = body.space.axis, len(body.space.rod.rings) - 1
    count = min(axis.elements, _MOST)
    first = np.arange(count) * axis.elements // count
    share = (np.arange(_SECTIONS) + 0.5) / _SECTIONS
    u = (axis.breaks[first, None] + np.diff(axis.breaks)[first, None] * share).ravel()
    laws = np.array([id(law) for law in body.laws]).reshape(-1, rings)
    jumps = axis.breaks[1:-1][(laws[1:] != laws[:-1]).any(axis=1)]
    ends = np.array([]) if body.space.rod.closed else axis.breaks[[0, -1]]
    away = held.distance(model, number, u, np.append(ends, jumps)) > held.width(model, number)
    return np.asarray(u[away])
