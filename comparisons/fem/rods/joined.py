"""A scene's rods and bodies, tied, as the parts of one solid for `meshes.joined`."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from isorod.files.msh import Grid
from isorod.files.solid import OfBody
from isorod.model.model import Model
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Surface
from isorod.space.trace import end_trace, lateral_trace
from meshes.joined import BodyPart, Join, Part, RodPart
from meshes.joined_mesh import Groups
from meshes.mesh import Array, Index

# Corners of the facets of cells, in gmsh's order.
_FACETS = {
    "tetrahedron": ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}


class Assembled(NamedTuple):
    """The arguments of `meshes.joined_mesh.build`."""

    parts: Sequence[Part]
    joins: Sequence[Join]
    groups: dict[int, Groups]


def assembled(
    model: Model, bodies: Sequence[OfBody], names: Sequence[str], cuts: Sequence[Sequence[float]]
) -> Assembled:
    """Return the parts of a model with ties.

    Parameters
    ----------
    model
        Rods, bodies, ties.
    bodies
        Of the file's bodies.
    names
        Of the rods.
    cuts
        Axis parameters where each rod's laws, or what holds it, may change.
    """
    parts: list[Part] = [
        RodPart(f"rod {k}", f"rod {name}", body.space.rod, _radii(body), cuts[k])
        for k, (name, body) in enumerate(zip(names, model.bodies, strict=True))
    ]
    groups = {}
    for k, (body, solid) in enumerate(zip(bodies, model.solids, strict=True)):
        assert body.geometry is not None
        box = np.array([body.grid.points.min(axis=0), body.grid.points.max(axis=0)])
        groups[len(parts)] = _groups(body)
        name = f"solid {body.name}"
        parts.append(BodyPart(f"solid {k}", name, body.geometry.name, body.geometry.content, box, float(solid.volume)))
    joins = []
    for k, tie in enumerate(model.ties):
        points, area = _surface(model, tie.slave)
        slave, master = (_part(model, one) for one in (tie.slave, tie.master))
        joins.append(Join(f"tie {k}", slave, master, area, points))
    return Assembled(parts, joins, groups)


def _radii(body: Any) -> tuple[float, ...]:
    """Return the radii of the disk between which a rod's laws differ, with those of its surfaces."""
    rings, laws = body.space.rod.rings, np.empty(len(body.laws), dtype=object)
    laws[:] = list(body.laws)
    table, densities = laws.reshape(-1, len(rings) - 1), body.densities.reshape(-1, len(rings) - 1)
    inner = [
        rings[k]
        for k in range(1, len(rings) - 1)
        if any(table[e, k - 1] != table[e, k] or densities[e, k - 1] != densities[e, k] for e in range(len(table)))
    ]
    return (rings[0], *inner, rings[-1])


def _part(model: Model, surface: Surface) -> int:
    return len(model.bodies) + surface.solid if isinstance(surface, SolidSurface) else surface.body


def _surface(model: Model, surface: Surface) -> tuple[Array, float]:
    """Return points ``(m, 3)`` of a surface, and its area."""
    trace: Any
    if isinstance(surface, EndFace):
        trace = end_trace(model.bodies[surface.body].space, surface.which)
    elif isinstance(surface, LateralSurface):
        trace = lateral_trace(model.bodies[surface.body].space, surface.along, surface.surface)
    else:
        trace = model.solids[surface.solid].trace(surface.facets)
    return np.asarray(trace.points), float(trace.weights.sum())


def _groups(body: OfBody) -> Groups:
    """Return the surface of a body's mesh in triangles, with its groups, as far as they are of it."""
    grid = body.grid
    names = {*(one.group for one in body.held), *(one.group for one in body.loads if one.group is not None)}
    facets = _exterior(grid)
    key = {tuple(row): k for k, row in enumerate(np.sort(facets, axis=1).tolist())}
    corners = facets.shape[1]
    split = [(0, k, k + 1) for k in range(1, corners - 1)]
    triangles = grid.points[facets[:, split]].reshape(-1, 3, 3)
    members = {}
    for name in grid.groups:
        own = np.zeros(len(facets), dtype=bool)
        own[[key[row] for row in map(tuple, np.sort(grid.groups[name], axis=1).tolist()) if row in key]] = True
        members[name] = np.repeat(own, len(split))
    return Groups(triangles, members, sorted(names))


def _exterior(grid: Grid) -> Index:
    """Return the corners ``(f, 3 or 4)`` of the facets of a mesh's surface."""
    every = np.concatenate([grid.cells[:, corners] for corners in _FACETS[grid.shape]])
    _, first, count = np.unique(np.sort(every, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(every[first[count == 1]])
