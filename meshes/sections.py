"""The template of a rod's section, chosen by measures of the section in space, all along the rod.

Sections with a hole get rings of quadrilaterals.  Others, or their cores, get an O-grid where they are about as high as
long, and where they are flat a grid laid out in space (`meshes.flat`): of those tried the one with the fewest cells
that is good enough.  Good is a scaled Jacobian, the sine of the angle between a quadrilateral's lines, near 1: its
harmonic mean over the section goes with the error in torsion, as its smallest value does not.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.annulus import annulus, wrapped
from meshes.flat import Plane, circle, laid_out, plane, tips
from meshes.mesh import Array, gradients, lexicographic
from meshes.strip import turned
from meshes.template import Template, o_grid

# The template of a level and an order.
Maker = Callable[[int, int], Template]

# A mean scaled Jacobian that is good enough not to look for a better one.
_GOOD = 0.7

# The least at any Gauss point; edges that a smooth outline continues have 0 where they meet.
_LEAST = 0.02

# How far the outline may be off on level 1: the area between it and edges of order 2, as a fraction of the section's.
_OFF = 0.015

# Levels on which grids are tried beside the first.
_LEVELS = (2, 3, 4)

# Sections looked at, at most.
_STATIONS = 8

# Sections are flat from this ratio of length to height on.
_FLAT = 1.8

# Numbers of cells round the disk, and of their rings, that are tried in turn; round a hole in a round or flat section.
_O_GRIDS = ((4, 1), (8, 1), (8, 2), (12, 2), (16, 2), (16, 4), (24, 4))
_AROUND = (8, 12, 16, 24, 32, 48)
_AROUND_FLAT = (16, 24, 32, 48)

# The corners of a quadrilateral, first and second coordinate.
_ENDS = np.array([[0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]])

# A corner at which two edges go on in one line may look inverted by rounding.
_ROUNDING = 1e-9

# Angles between the tips of a flat section and the corners of its grid, degrees.
_CORNERS = (2.0, 4.0, 8.0, 16.0, 30.0, 45.0)

# Powers by which nodes go away from corners, tried in turn until none is inverted.
_POWERS = (0.85, 0.7)


@dataclass(frozen=True)
class Section:
    """A template of a section's mesh.

    Attributes
    ----------
    name
        In words.
    make
        Returns the template of a level and an order.
    quality, off
        On level 1: the mean scaled Jacobian, of the core where there are layers, and the fraction of the area that lies
        between the outline and edges of order 2.
    """

    name: str
    make: Maker
    quality: float
    off: float


def parts(level: int, order: int) -> int:
    """Return in how many parts a direction of a cell of level 1 is cut.

    Cells of order 1 are half as long as others: their nodes are as many as those of order 2.
    """
    return 2 * level if order == 1 else level


def sections(rod: Rod, order: int) -> Iterator[Section]:
    """Yield templates of a rod's section: those that are good by rising numbers of cells, then the rest, best first."""
    u = _stations(rod)
    hollow = rod.rings[0] > 0.0
    # Rings round a core go on from its edges.
    radius, layers = (1.0, ()) if hollow else (rod.rings[1], rod.rings[1:])
    rest = []
    for name, make in _rings_round(rod, u) if hollow else _cores(rod, order, u, radius):
        try:
            template = make(1, order)
        except InputError:
            continue
        quality, areas = _measure(rod, template, radius, u)
        if quality.min() <= 0.0:
            continue
        off = _off(rod, make(1, 2), radius, u)
        made = partial(_wrapped, make, layers) if len(layers) > 1 else make
        section = Section(name, made, _mean(quality, areas), off)
        # The directions of rings are given.
        if off <= _OFF and (hollow or section.quality >= _GOOD):
            yield section
        else:
            rest.append(section)
    yield from sorted(rest, key=lambda one: 10.0 * max(0.0, one.off - _OFF) - one.quality)


def counted(rod: Rod, around: int, across: int) -> Maker:
    """Return the section of a rod with a hole or layers, of so many cells round it and across each ring.

    A core has one ring of cells less round the square in its middle.

    Raises
    ------
    InputError
        If the section has neither.
    """
    if len(rod.rings) == 2 and not rod.rings[0]:
        raise InputError("mesh: numbers of cells are for sections with a hole or layers")
    rings = [across] * (len(rod.rings) - 1)
    if not rod.rings[0]:
        return lambda level, order: wrapped(
            o_grid(level * around, level * (across - 1), order), rod.rings[1:], [level * one for one in rings[1:]]
        )
    turn = _tip(rod, _stations(rod))
    return lambda level, order: annulus(level * around, rod.rings, [level * one for one in rings], order, turn)


def _tip(rod: Rod, u: Array) -> float:
    """Return the angle of a section's tip, degrees."""
    return float(np.degrees(tips(plane(rod, float(u[u.size // 2])))[0][0]))


def _stations(rod: Rod) -> Array:
    """Return axis parameters at which sections are looked at, off the knots, where rods may have kinks."""
    inside = np.array([1e-6, 0.5, 1.0 - 1e-6])
    u = (rod.axis.breaks[:-1, None] + np.diff(rod.axis.breaks)[:, None] * inside).ravel()
    return u[np.linspace(0, u.size - 1, min(u.size, _STATIONS)).astype(int)]


def _off(rod: Rod, template: Template, radius: float, u: Array) -> float:
    """Return the area between the outline and the template's edges of order 2 as a fraction of what these enclose."""
    angle = np.unwrap(np.arctan2(*template.points[template.rim].T[::-1]), axis=0)
    a, b, c = radius * circle(angle)
    nodes = [rod.grid(xi, u)[0] for xi in (a, b, c)]
    apart, length, inside = 0.0, nodes[2] - nodes[0], nodes[0] - rod.grid([[0.0, 0.0]], u)[0]
    for position in (0.25, 0.75):
        functions = (
            (1.0 - position) * (1.0 - 2.0 * position),
            4.0 * position * (1.0 - position),
            position * (2.0 * position - 1.0),
        )
        edge = sum(function * node for function, node in zip(functions, nodes, strict=True))
        # The places on the outline amid the nodes' angles.
        low, high = (angle[0], angle[1]) if position < 0.5 else (angle[1], angle[2])
        exact, _ = rod.grid(radius * circle(0.5 * (low + high)), u)
        apart = apart + 0.5 * np.linalg.norm(np.cross(edge - exact, length), axis=2).sum(axis=1)
    area = 0.5 * np.linalg.norm(np.cross(inside, length).sum(axis=1), axis=1)
    return float((apart / area).max())


def _measure(rod: Rod, template: Template, radius: float, u: Array) -> tuple[Array, Array]:
    """Return what a template shrunk to a radius makes in space: quadrilaterals' quality and area, ``(t, quads)``.

    Quality is the harmonic mean of the scaled Jacobian, or -1 if that is too small at a Gauss point or the
    quadrilateral inverted at a corner.
    """
    order = template.order
    x, w = np.polynomial.legendre.leggauss(order + 1)
    s, t = (
        np.append(grid.ravel(), ends)
        for grid, ends in zip(np.meshgrid(0.5 * (x + 1.0), 0.5 * (x + 1.0)), _ENDS, strict=True)
    )
    weights = 0.25 * np.outer(w, w).ravel()
    # The functions of a hexahedron's nodes on its first face are those of a quadrilateral.
    where = np.stack([s, t, np.zeros(s.size)], axis=1)
    slopes = gradients("hexahedron", order, lexicographic(order, 3), where)[:, : (order + 1) ** 2, :2]
    positions, _ = rod.grid(radius * template.points, u)
    edges = np.einsum("qnb,tcna->tcqab", slopes, positions[:, template.quads], optimize=True)
    sizes = np.einsum("tcqa,ta->tcq", np.cross(edges[..., 0], edges[..., 1]), rod.tangents(u))
    inner = sizes[..., : weights.size]
    scaled = inner / np.linalg.norm(edges[..., : weights.size, :, :], axis=-2).prod(axis=-1)
    bad = (scaled < _LEAST).any(axis=2) | (sizes[..., weights.size :] < -_ROUNDING * sizes.max()).any(axis=2)
    area = inner @ weights
    return np.where(bad, -1.0, area / (inner / np.maximum(scaled, _LEAST) @ weights)), area


def _mean(quality: Array, area: Array) -> float:
    """Return the mean quality in the worst of sections, ``(t, quads)``, or -1 if a quadrilateral is not to be used."""
    if quality.min() <= 0.0:
        return -1.0
    return float((area.sum(axis=1) / (area / quality).sum(axis=1)).min())


def _ratio(rod: Rod, u: Array) -> float:
    """Return the largest ratio of a section's length to its height."""
    rim, _ = rod.grid(circle(2.0 * np.pi * np.arange(360) / 360), u)
    arms = rim - rim.mean(axis=1, keepdims=True)
    _, _, directions = np.linalg.svd(arms, full_matrices=False)
    extents = np.ptp(arms @ directions[:, :2].swapaxes(1, 2), axis=1)
    return float((extents[:, 0] / extents[:, 1]).max())


def _rings_round(rod: Rod, u: Array) -> Iterator[tuple[str, Maker]]:
    """Yield templates of a section with a hole, a mesh line at its tip."""
    turn = _tip(rod, u)
    for around in _AROUND if _ratio(rod, u) < _FLAT else _AROUND_FLAT:
        yield f"annulus of {around} cells", partial(_annulus, around, rod.rings, turn)


def _cores(rod: Rod, order: int, u: Array, radius: float) -> Iterator[tuple[str, Maker]]:
    """Yield templates of a section without a hole, or its core inside of a radius: those that fit its shape first."""
    ratio, section = _ratio(rod, u), plane(rod, float(u[u.size // 2]), radius)
    ends = tips(section)
    round_ones = [
        (f"O-grid of {around} cells", partial(_o_grid, around, rings, float(np.degrees(ends[0][0])) + turn))
        for around, rings in _O_GRIDS
        for turn in (0.0, 45.0)
    ]
    if ratio < _FLAT:
        yield from round_ones
    along = int(np.clip(round(0.75 * ratio), 2, 8))
    for count, across in ((along, 1), (along + 2, 1), (2 * along, 2)):
        for power, both in product(_POWERS, ends):
            make = partial(_grid, section, both, count, across, power)
            corners = _corners(rod, make, count, order, radius, u)
            if corners is not None:
                yield f"grid of {count} x {across} cells", partial(make, corners)
                break
    if ratio >= _FLAT:
        yield from round_ones


def _corners(
    rod: Rod,
    make: Callable[[tuple[float, float], int, int], Template],
    along: int,
    order: int,
    radius: float,
    u: Array,
) -> tuple[float, float] | None:
    """Return the corners of a grid of ``along`` cells that make the best quadrilaterals in each of its halves.

    None if there are none with which finer levels can be used as well.
    """
    best, columns = [(-1.0, _CORNERS[0])] * 2, along * parts(1, order)
    for corner in _CORNERS:
        try:
            quality, area = _measure(rod, make((corner, corner), 1, order), radius, u)
        except InputError:
            continue
        for k, half in enumerate((slice(None, (columns + 1) // 2), slice(columns // 2, None))):
            own = (one.reshape(len(u), -1, columns)[..., half].reshape(len(u), -1) for one in (quality, area))
            best[k] = max(best[k], (_mean(*own), corner))
    corners = best[0][1], best[1][1]
    if min(best)[0] <= 0.0:
        return None
    try:
        finer = [_measure(rod, make(corners, level, order), radius, u)[0].min() for level in _LEVELS]
    except InputError:
        return None
    return corners if min(finer) > 0.0 else None


def _grid(
    section: Plane,
    ends: tuple[float, float],
    along: int,
    across: int,
    power: float,
    corners: tuple[float, float],
    level: int,
    order: int,
) -> Template:
    count = parts(level, order)
    return laid_out(section, ends, along * count, across * count, order, corners, power)


def _o_grid(around: int, rings: int, turn: float, level: int, order: int) -> Template:
    count = parts(level, order)
    return turned(o_grid(around * count, rings * count, order), turn)


def _annulus(around: int, radii: tuple[float, ...], turn: float, level: int, order: int) -> Template:
    count = parts(level, order)
    return annulus(around * count, radii, _rings(radii, around, count), order, turn)


def _wrapped(make: Maker, radii: tuple[float, ...], level: int, order: int) -> Template:
    core, count = make(level, order), parts(level, order)
    return wrapped(core, radii, _rings(radii, len(core.rim) // count, count))


def _rings(radii: tuple[float, ...], around: int, count: int) -> list[int]:
    """Return the numbers of rings between radii, of cells in a round section less than about twice as long as wide."""
    # More than 8 cells go round a flat or uneven section, which is no thicker for that.
    width = 2.0 * np.pi / min(around, 8)
    return [count * max(1, round(0.6 * ratio / width)) for ratio in np.diff(np.log(radii))]
