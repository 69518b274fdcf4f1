"""Where along a rod its mesh has to have planes: laws change, a section is loaded or held, a surface begins or ends."""

import numpy as np

from isorod.geometry.rod import Rod
from isorod.model.load import PointLoad, SectionLoad
from isorod.model.model import Model
from isorod.model.support import Support
from isorod.model.tie import LateralSurface
from isorod.space.space import Space
from isorod.space.trace import elements_along


def cut(model: Model, b: int) -> Rod:
    """Return a body's rod with knots where its mesh has to have planes."""
    rod = model.bodies[b].space.rod
    low, high = rod.axis.breaks[[0, -1]]
    for u in planes(model, b):
        if np.abs(rod.axis.breaks - u).min() > 1e-9 * (high - low):
            rod = rod.insert(u)
    return rod


def planes(model: Model, b: int) -> list[float]:
    """Return the axis parameters within a body's rod at which its mesh has to have planes."""
    body = model.bodies[b]
    axis, rod = body.space.axis, body.space.rod
    rings = len(rod.rings) - 1
    rows = [body.laws[e * rings : (e + 1) * rings] for e in range(axis.elements)]
    densities = body.densities.reshape(axis.elements, -1)
    where = [
        float(axis.breaks[e])
        for e in range(1, axis.elements)
        if rows[e] != rows[e - 1] or (densities[e] != densities[e - 1]).any()
    ]
    at_u = [load for load in model.loads if isinstance(load, PointLoad | SectionLoad) and load.body == b]
    where += [float(load.u) for load in at_u if load.u]
    where += [float(one.u) for one in model.means.values() if one.body == b]
    for contact in model.contacts:
        for side, chosen in contact.sides:
            if side == b and chosen is not None:
                where += [float(axis.breaks[e + end]) for e in chosen for end in (0, 1)]
    for support in model.supports:
        if isinstance(support, Support) and support.body == b:
            where += _ends_of(support, body.space)
    for tie in model.ties:
        for one in (tie.slave, tie.master):
            if isinstance(one, LateralSurface) and one.body == b:
                where += [*between(body.space, one)]
    low, high = axis.breaks[[0, -1]]
    return [u for u in sorted(set(where)) if low < u < high]


def between(space: Space, surface: LateralSurface) -> tuple[float, float]:
    """Return the axis parameters from which and to which a lateral surface is tied."""
    chosen = elements_along(space, surface.along)
    return float(space.axis.breaks[chosen[0]]), float(space.axis.breaks[chosen[-1] + 1])


def _ends_of(support: Support, space: Space) -> list[float]:
    """Return where along the axis a patch begins and ends: whose elements have all their layers held."""
    layers = np.unique(np.asarray(support.nodes) // space.layer_nodes)
    held = np.isin(space.element_layers, layers).all(axis=1).astype(int)
    return [float(u) for u in space.axis.breaks[np.flatnonzero(np.diff(held, prepend=0, append=0))]]
