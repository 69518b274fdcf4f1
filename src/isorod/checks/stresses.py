"""Change of stresses on a finer space, away from singularities.

At the edges of supported faces and patches, where laws meet at the surface, and where forces act on a section or a
point, stresses are singular; only points farther away than the width of the section, over which such effects decay
(Saint-Venant), count.  At contact the error of stresses is that of the pressure, which is reported separately
(`isorod.contact.result`); points nearly as far from there count.
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

# Sections in each element, elements at most, and points round each section.
_SECTIONS, _MOST, _AROUND = 4, 256, 24

# Factor of the radius where rings meet, at which the outer one is evaluated, for a point in the inner one.
_INSIDE = 1.0 - 1e-9

# Distance from contact from which points count, in widths of the section: the far side of a wire does.
CLEAR = 0.75

# Largest ratio of the error to the change on a finer space: it is 0.3 to 1.25 on the bars of
# `comparisons.stability.stresses`.
_LEFT = 1.25

# Stresses below this fraction of the shear modulus are round-off of strains.
_ROUNDING = 1e-11


def change(
    finer: Finer,
    before: Array,
    after: Array,
    pressures: Sequence[Array | None] = (),
    corrected: Sequence[Array | None] = (),
    contacts: "Sequence[ContactResult]" = (),
) -> float:
    """Return the estimated largest error of Cauchy stress at surfaces and on the axis, over the largest stress there.

    Stresses are measured by their Frobenius norm; the result is NaN where no point is far enough from edges, or
    stresses are round-off.

    Parameters
    ----------
    before, after
        All degrees of freedom of the model, and on the finer spaces.
    pressures, corrected
        Pressure coefficients of mixed bodies, likewise.
    contacts
        Results of contacts.
    """
    largest = changed = 0.0
    for b, (body, fine) in enumerate(zip(finer.coarse.bodies, finer.model.bodies, strict=True)):
        u, rings = away(finer.coarse, b), body.space.rod.rings
        if not u.size:
            continue
        # The axis where there is no hole, and both sides where rings meet.
        sides = [radius * _INSIDE for radius in rings[1:-1]]
        xi = np.concatenate([around((*rings, *sides)), np.zeros((int(rings[0] == 0.0), 2))])
        nodal = finer.coarse.nodal(before, b)
        coarse = _stress(body, nodal, xi, u, pressures[b] if pressures else None)
        refined = _stress(fine, finer.model.nodal(after, b), xi, u, corrected[b] if corrected else None)
        places = body.space.rod.grid(xi, u)[0] + body.space.displacement(nodal, xi, u)[0]
        counts = to_contact(contacts, places) > CLEAR * held.width(finer.coarse, b)
        largest = max(largest, float(np.linalg.norm(refined, axis=(2, 3))[counts].max(initial=0.0)))
        changed = max(changed, float(np.linalg.norm(refined - coarse, axis=(2, 3))[counts].max(initial=0.0)))
    stiffness = max(law.shear_modulus for body in finer.coarse.bodies for law in body.laws)
    return _LEFT * changed / largest if largest > _ROUNDING * stiffness else np.nan


def _stress(body: Body, nodal: Array, xi: Array, u: Array, pressure: Array | None) -> Array:
    return cauchy(body, nodal, xi, u, 1.0, pressure)


def to_contact(contacts: "Sequence[ContactResult]", places: Array) -> Array:
    """Return the distance of present places ``(..., 3)`` to the nearest point in contact, infinite without one."""
    pressed = [contact.positions[contact.pressure > 0.0] for contact in contacts]
    if not sum(map(len, pressed)):
        return np.full(places.shape[:-1], np.inf)
    # Models without contact do not import SciPy's trees.
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(np.concatenate(pressed)).query(places)[0])


def around(radii: Sequence[float], count: int = _AROUND) -> Array:
    """Return ``count`` disk points round the section at each positive radius, shape ``(n, 2)``."""
    angle = 2.0 * np.pi / count * (np.arange(count) + 0.5)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([radius * ring for radius in radii if radius > 0.0])


def away(model: Model, number: int) -> Array:
    """Return axis parameters inside the elements of a body that are farther from edges than its section is wide.

    Sections with mean supports, or with forces on them or on one of their points, count as edges.
    """
    body = model.bodies[number]
    axis, rings = body.space.axis, len(body.space.rod.rings) - 1
    count = min(axis.elements, _MOST)
    first = np.arange(count) * axis.elements // count
    fractions = (np.arange(_SECTIONS) + 0.5) / _SECTIONS
    u = (axis.breaks[first, None] + np.diff(axis.breaks)[first, None] * fractions).ravel()
    laws = np.array([id(law) for law in body.laws]).reshape(-1, rings)
    jumps = axis.breaks[1:-1][(laws[1:] != laws[:-1]).any(axis=1)]
    ends = np.array([]) if body.space.rod.closed else axis.breaks[[0, -1]]
    acting: list[Any] = [*model.means.values(), *model.loads]
    loaded = (getattr(one, "u", None) for one in acting if one.body == number)
    edges = [*ends, *jumps, *(one for one in loaded if one is not None)]
    away = held.distance(model, number, u, edges) > held.width(model, number)
    return np.asarray(u[away])
