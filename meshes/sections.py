"""The template of a rod's section, chosen by measures of the section in space, all along the rod."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from isorod.geometry.quadrature import Rule, section_points
from isorod.geometry.rod import Rod
from meshes.annulus import annulus, wrapped
from meshes.mesh import Array, gradients, lexicographic
from meshes.strip import levels, pulled, turned
from meshes.template import Template, o_grid

# The template for a number of cells, relative to that of level 1, and an order.
Maker = Callable[[int, int], Template]

# A section's smallest scaled Jacobian that is good enough not to look for better; a right angle has 1.
_GOOD = 0.25

# How far the area of a section meshed with quadrilaterals of order 2 may be off on level 1.
_AREA = 0.02

# Sections looked at, about.
_STATIONS = 24

# Sections from this ratio of length to height on are meshed with strips too.
_FLAT = 1.8


@dataclass(frozen=True)
class Section:
    """A way to mesh a section: its name in words, the template by level and order, and how good it is on level 1."""

    name: str
    make: Maker
    quality: float
    area: float


def sections(rod: Rod) -> Iterator[Section]:
    """Yield ways to mesh a rod's section: those that are good by rising numbers of cells, then the rest, best first."""
    u = _stations(rod)
    xi, weights = section_points(rod.section_points, Rule(6, 6, 1), rings=rod.rings)
    exact = _areas(rod, xi, u) @ weights
    rest = []
    for name, make in _candidates(rod, u):
        quality, areas = _measure(rod, make(1, 2), u)
        section = Section(name, make, quality, float(np.abs(areas / exact - 1.0).max()))
        if section.quality >= _GOOD and section.area <= _AREA:
            yield section
        else:
            rest.append(section)
    yield from sorted(rest, key=lambda one: 10.0 * max(0.0, one.area - _AREA) - one.quality)


def _stations(rod: Rod) -> Array:
    """Return axis parameters at which sections are looked at, off the knots, where rods may have kinks."""
    inside = np.array([1e-6, 0.5, 1.0 - 1e-6])
    u = (rod.axis.breaks[:-1, None] + np.diff(rod.axis.breaks)[:, None] * inside).ravel()
    return u[:: max(1, u.size // _STATIONS)]


def _areas(rod: Rod, xi: Array, u: Array) -> Array:
    """Return the sections' area elements at disk points, ``(t, q)``."""
    _, jacobian = rod.grid(xi, u)
    area: Array = np.linalg.norm(np.cross(jacobian[..., 0], jacobian[..., 1]), axis=-1)
    return area


def _measure(rod: Rod, template: Template, u: Array) -> tuple[float, Array]:
    """Return the smallest scaled Jacobian of the quadrilaterals in space, and sections' areas ``(t,)``."""
    order = template.order
    x, w = np.polynomial.legendre.leggauss(order + 1)
    s, t = (grid.ravel() for grid in np.meshgrid(0.5 * (x + 1.0), 0.5 * (x + 1.0)))
    weights = 0.25 * np.outer(w, w).ravel()
    positions, _ = rod.grid(template.points, u)
    corners = positions[:, template.quads]
    # The functions of a hexahedron's nodes on its first face are those of a quadrilateral.
    where = np.stack([s, t, np.zeros(s.size)], axis=1)
    derivative = gradients("hexahedron", order, lexicographic(order, 3), where)[:, : (order + 1) ** 2, :2]
    edges = np.einsum("qnb,tcna->tcqab", derivative, corners, optimize=True)
    normal = np.cross(edges[..., 0], edges[..., 1])
    tangent = rod.tangents(u)
    size = np.linalg.norm(normal, axis=-1)
    sign = np.sign(np.einsum("tcqa,ta->tcq", normal, tangent))
    scaled = sign * size / np.linalg.norm(edges, axis=-2).prod(axis=-1)
    return float(scaled.min()), np.einsum("tcq,q->t", sign * size, weights)


def _shape(rod: Rod, u: Array) -> tuple[float, float]:
    """Return the direction on the disk along which sections are longest, degrees, and the largest ratio of extents."""
    count = 360
    angle = 2.0 * np.pi * np.arange(count) / count
    rim, _ = rod.grid(np.stack([np.cos(angle), np.sin(angle)], axis=1), u)
    arms = rim - rim.mean(axis=1, keepdims=True)
    across = np.linalg.norm(rim - np.roll(rim, count // 2, axis=1), axis=2)
    share = (across / across.max(axis=1, keepdims=True)).mean(axis=0)[: count // 2]
    _, _, directions = np.linalg.svd(arms, full_matrices=False)
    extents = np.ptp(arms @ directions[:, :2].swapaxes(1, 2), axis=1)
    return float(np.degrees(angle[np.argmax(share)])), float((extents[:, 0] / extents[:, 1]).max())


def _candidates(rod: Rod, u: Array) -> Iterator[tuple[str, Maker]]:
    """Yield ways to mesh a section, those with fewer cells first."""
    long, ratio = _shape(rod, u)
    radii = rod.rings
    if radii[0] > 0.0:
        for around in (8, 12, 16, 24, 32, 48):
            for turn in (0.0, 180.0 / rod.section_points):
                yield f"annulus of {around} cells", partial(_annulus, around, radii, turn)
        return
    for name, make in _cores(long, ratio):
        yield name, partial(_wrapped, make, radii[1:]) if len(radii) > 2 else make


def _cores(long: float, ratio: float) -> Iterator[tuple[str, Maker]]:
    """Yield ways to mesh the disk."""
    for around, rings in ((4, 1), (8, 1), (8, 2), (12, 2), (16, 2), (16, 4), (24, 4)):
        for turn in (long, long + 45.0):
            yield f"O-grid of {around} cells", partial(_o_grid, around, rings, turn)
        if ratio < _FLAT:
            continue
        across = max(1, around // 8)
        along = max(2, round(min(ratio, 6.0) * across))
        for corners in ((4.0, 10.0), (10.0, 4.0), (10.0, 10.0), (25.0, 25.0), (45.0, 45.0)):
            yield f"strip of {along} x {across} cells", partial(_strip, along, across, corners, long)


def _o_grid(around: int, rings: int, turn: float, level: int, order: int) -> Template:
    return turned(o_grid(around * level, rings * level, order), turn)


def _strip(along: int, across: int, corners: tuple[float, float], turn: float, level: int, order: int) -> Template:
    s, t = levels(order * level * along, 1.0), np.linspace(-1.0, 1.0, order * level * across + 1)
    return pulled(s, t, order, corners, turn)


def _annulus(around: int, radii: tuple[float, ...], turn: float, level: int, order: int) -> Template:
    return annulus(around * level, radii, _rings(radii, around, level), order, turn)


def _wrapped(make: Maker, radii: tuple[float, ...], level: int, order: int) -> Template:
    core = make(level, order)
    return wrapped(core, radii, _rings(radii, len(core.rim) // level, level))


def _rings(radii: tuple[float, ...], around: int, level: int) -> list[int]:
    """Return the numbers of rings between radii, of cells in a round section less than about twice as long as wide."""
    return [level * max(1, round(0.6 * ratio * around / (2.0 * np.pi))) for ratio in np.diff(np.log(radii))]
