"""Meshes of any rods: curved hexahedra whose templates and layers follow from the rods themselves.

What a section is meshed with is chosen by `meshes.sections`; here it is tensored with layers along the rod.  On level 1
a layer turns by no more than `TURN` with the centre line and the section's twist, and its cells are 1.5 times as long
as wide; where that makes more than `CELLS` cells of a rod, they are up to 6 times as long, or twice as long as the
section, since bending varies slowly along slender rods.  Layers of order 3 are half as long.  Every element of the axis
has layers of its own, because laws may change from one to the next (a space with more elements has its laws on those:
give `Rod.refine`'s).  Level L has L times as many cells as level 1 in all three directions, and its nodes are among
those of level 2 L.

Of order 2, the volume of the spring (3 coils) is off by 1.3e-2 on level 1, 8.4e-4 on level 2 and 5.3e-5 on level 4,
which has 195,000 unknowns.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from isorod.errors import InputError, whole_number
from isorod.geometry.rod import Rod
from meshes.bricks import tensored
from meshes.flat import circle
from meshes.mesh import Array, Index, Mesh, join
from meshes.sections import Maker, counted, parts, sections
from meshes.template import Template

# Cells of a rod on level 1 from which longer ones are tried; of order 2 level 4 then has about 200,000 unknowns.
CELLS = 130

# The highest level: of order 2, it has 10 million unknowns and more.
MOST = 16

# How far a layer turns on level 1, degrees: 8 layers make a coil.
TURN = 45.0

# Cells of order 3 are so many times as short: of torsion and clock springs stresses are 17 and 8 % too high with layers
# of the others' length, beside held ends and on curved surfaces, which their rates, right to 0.6 %, do not include.
_CUBIC = 2

# A little more than that, in layers, is no reason for one more: helices turn by a little more than circles.
_ROUNDING = 0.1

# Where an element turns unevenly, this fraction of it is taken to turn as where it turns most.
_UNEVEN = 0.6

# Lengths of cells that are tried in turn, as multiples of their width; the longest in these, and in extents of the
# section, whichever is more.
_LENGTHS = (1.5, 2.0, 3.0, 4.5, 6.0, 9.0, 12.0)
_LONGEST = 6.0
_EXTENTS = 2.0

# Layers of an open rod on level 1, at least.
_FEWEST = 4

# Places along each element of the axis where the rod is measured, and round it.
_PLACES, _ROUND = 9, 24

# A layer that turns by less is straight, radians.
_STRAIGHT = 1e-6


class Cells(NamedTuple):
    """Numbers of cells on level 1: round a section, across each of its rings, and along the rod."""

    around: int
    across: int
    layers: int


def build(rods: Sequence[Rod], level: int = 1, order: int = 2, cells: Cells | None = None) -> Mesh:
    """Return one mesh of hexahedra of all rods, which have no node in common.

    Regions are named ``rod 0``, ``rod 1`` ...; faces ``rod 0 start`` and ``rod 0 end`` of a rod that is not closed,
    ``rod 0 lateral``, and ``rod 0 inner`` of one with a hole.  Circles between the rings of a section are mesh lines,
    and ends of axis elements mesh planes.  Nodes and cells stand rod by rod.

    Parameters
    ----------
    rods
        The rods.
    level
        How many times as many cells there are in each direction as on level 1, 1 to 16.
    order
        Polynomial order of the geometry, 1 to 3.  Cells of order 1 are half as long in each direction as those of
        order 2: their nodes are as many.
    cells
        Numbers of cells in the place of those that are chosen here, of rods with a hole or layers.

    Raises
    ------
    InputError
        If a number is out of range, a rod folds, or its section is one that no template fits.
    """
    if not rods:
        raise InputError("mesh: no rod is given, need at least one")
    whole_number("mesh: level", level, 1, MOST)
    whole_number("mesh: order of the cells", order, 1, 3)
    return join(*(named(_mesh(rod, f"rod {k}", level, order, cells), f"rod {k}") for k, rod in enumerate(rods)))


def locking(rod: Rod) -> float:
    """Return the largest ``L^2 / (R t)`` of a layer on level 1: its length, radius of curvature, and thickness in it.

    The stiffness in bending of cells of order 2 is too high by about 7 % of its square: 28 % for a torsion spring whose
    wire is a quarter as thick as its coils' radius, 150 % for a clock spring.
    """
    _, layers = _chosen(rod, 2)
    u = _positions(rod, layers, 1)
    ends, tangents = rod.points([[0.0, 0.0]], u), rod.tangents(u)
    bent, length = np.diff(tangents, axis=0), np.linalg.norm(np.diff(ends, axis=0), axis=1)
    turn = np.linalg.norm(bent, axis=1)
    rim, _ = rod.grid(circle(2.0 * np.pi * np.arange(_ROUND) / _ROUND), 0.5 * (u[1:] + u[:-1]))
    thickness = np.ptp(np.einsum("tqa,ta->tq", rim, bent), axis=1)
    bends = turn > _STRAIGHT
    return float(max(length[bends] * turn[bends] ** 2 / thickness[bends], default=0.0))


def places(mesh: Mesh, rods: Sequence[Rod]) -> Index:
    """Return the rod, the axis element and the ring that each cell of a mesh of `build` is in, shape ``(cells, 3)``."""
    assert mesh.parameters is not None
    result = np.empty((len(mesh.cells), 3), dtype=np.int64)
    for k, (rod, cells) in enumerate(zip(rods, mesh.regions.values(), strict=True)):
        own = mesh.parameters[mesh.cells[cells]]
        u, breaks = own[:, :, 2], rod.axis.breaks
        if rod.closed:
            # The last layer ends in nodes of the start.
            last = np.ptp(u, axis=1, keepdims=True) > 0.5 * np.ptp(breaks)
            u = np.where(last & (u == breaks[0]), breaks[-1], u)
        radius = np.linalg.norm(own[:, :, :2], axis=2).mean(axis=1)
        result[cells] = np.stack(
            [
                np.full(len(cells), k),
                np.searchsorted(breaks, u.mean(axis=1)) - 1,
                np.searchsorted(rod.rings[1:-1], radius),
            ],
            axis=1,
        )
    return result


def owners(mesh: Mesh) -> Index:
    """Return the number of the rod that each node of a mesh of `build` belongs to, shape ``(nodes,)``."""
    result = np.empty(len(mesh.points), dtype=np.int64)
    for k, cells in enumerate(mesh.regions.values()):
        result[mesh.cells[cells]] = k
    return result


def _mesh(rod: Rod, name: str, level: int, order: int, cells: Cells | None) -> Mesh:
    """Return the mesh of one rod."""
    try:
        if cells is None:
            make, layers = _chosen(rod, order)
            layers = parts(level, order) * layers
        else:
            make, layers = counted(rod, cells.around, cells.across), level * _evenly(rod, cells.layers)
        mesh = tensored(rod, make(level, order), _positions(rod, layers, order))
        mesh.check()
    except InputError as problem:
        raise type(problem)(f"mesh: {name}: {str(problem).removeprefix('mesh: ')}") from None
    return mesh


def _evenly(rod: Rod, layers: int) -> Index:
    """Return as many layers in each element of the axis, so many in all."""
    elements = rod.axis.elements
    if layers < elements or layers % elements:
        raise InputError(f"layers: got {layers}, need a multiple of the {elements} elements of the axis")
    return np.full(elements, layers // elements)


@lru_cache(maxsize=16)
def _chosen(rod: Rod, order: int) -> tuple[Maker, Index]:
    """Return the first template whose cells are all positive on level 1, and the layers in each axis element there."""
    rod.check()
    reason = "its outline is too uneven"
    for section in sections(rod, order):
        layers = _layers(rod, section.make(1, 2)) * (_CUBIC if order == 3 else 1)
        try:
            tensored(rod, section.make(1, order), _positions(rod, parts(1, order) * layers, order)).check()
        except InputError as problem:
            reason = str(problem).removeprefix("mesh: ").split("; ")[0]
            continue
        return section.make, layers
    raise InputError(f"no template fits its section ({reason}); take a smoother or thicker outline")


def named(mesh: Mesh, name: str) -> Mesh:
    """Return a mesh of one rod that is one region of a name, with which its faces' names begin."""
    faces = {f"{name} {key}": face for key, face in mesh.faces.items()}
    return replace(mesh, faces=faces, regions={name: np.arange(len(mesh.cells))})


def _layers(rod: Rod, template: Template) -> Index:
    """Return the number of layers on level 1 in each element of the axis."""
    length, width, extent, turn = _measures(rod, template)
    least = np.maximum(1.0, turn / np.radians(TURN) - _ROUNDING)
    longest = np.maximum(_LONGEST * width, _EXTENTS * extent)
    for multiple in _LENGTHS:
        layers = np.ceil(np.maximum(least, length / np.minimum(multiple * width, longest)) - 1e-6).astype(np.int64)
        if layers.sum() * len(template.quads) <= CELLS:
            break
    if not rod.closed:
        layers *= -(-_FEWEST // int(layers.sum()))
    return layers


def _measures(rod: Rod, template: Template) -> tuple[Array, Array, Array, Array]:
    """Return of each axis element its length, the width of the template's cells, the section's extent, and its turn.

    The turn is the angle by which the section turns, by bending and twist together, or what it would be if it were as
    much everywhere as where it is most, radians, some of that.
    """
    breaks = rod.axis.breaks
    inside = np.linspace(0.0, 1.0, _PLACES)
    # Both sides of every knot: the axis may have a kink there.
    inside[0], inside[-1] = 1e-6, 1.0 - 1e-6
    u = breaks[:-1, None] + np.diff(breaks)[:, None] * inside
    places, _ = rod.grid(template.points, u.ravel())
    places = places.reshape(*u.shape, -1, 3)
    length = np.linalg.norm(np.diff(places, axis=1), axis=-1).sum(axis=1).mean(axis=1)
    corners = places[:, :, template.quads[:, [0, template.order, -1, -1 - template.order]]]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=3), axis=-1)
    width = np.median(sides.max(axis=-1), axis=-1).mean(axis=1)
    arms = places - places.mean(axis=2, keepdims=True)
    extent = 2.0 * np.linalg.norm(arms, axis=-1).max(axis=2).mean(axis=1)

    _, jacobian = rod.grid([[0.0, 0.0]], u.ravel())
    columns = jacobian[:, 0] / np.linalg.norm(jacobian[:, 0], axis=-2, keepdims=True)
    left, _, right = np.linalg.svd(columns)
    frames = (left @ right).reshape(*u.shape, 3, 3)
    trace = np.einsum("etab,etab->et", frames[:, 1:], frames[:, :-1])
    angles = np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
    turn = np.maximum(angles.sum(axis=1), _UNEVEN * angles.shape[1] * angles.max(axis=1))
    return length, width, extent, turn


def _positions(rod: Rod, layers: Index, order: int) -> Array:
    """Return the axis parameters of the nodes, evenly spaced in each element of the axis."""
    ends = rod.axis.breaks
    each = [
        low + (high - low) * np.arange(order * count) / (order * count)
        for low, high, count in zip(ends[:-1], ends[1:], layers, strict=True)
    ]
    return np.append(np.concatenate(each), ends[-1])
