"""Quadrilateral templates of the unit disk: a square core in rings that turn it into the circle (an O-grid)."""

from dataclasses import dataclass, field

import numpy as np

from isorod.errors import InputError
from meshes.mesh import Array, Index

# How far the sides of the core bulge from the straight square (0) towards its circumscribed circle (1).
BULGE = 0.35


@dataclass(frozen=True, eq=False)
class Template:
    """A mesh of the unit disk, with or without a hole.

    Attributes
    ----------
    order
        Polynomial order of the quadrilaterals.
    points
        Nodes, shape ``(nodes, 2)``; those of the rim lie on the unit circle to rounding.
    quads
        Node numbers, shape ``(quads, (order + 1)^2)``, lexicographic in the quadrilateral, counter-clockwise.
    rim
        Node numbers of the outer boundary's edges, shape ``(around, order + 1)``, counter-clockwise.
    hole
        Those of the edges round a hole, clockwise; no row if there is none.
    """

    order: int
    points: Array
    quads: Index
    rim: Index
    hole: Index = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))


def o_grid(around: int, rings: int = 1, order: int = 2, core: float | None = None) -> Template:
    """Return an O-grid: a core of ``(around / 4)^2`` quadrilaterals and ``rings`` rings of ``around``.

    ``around = 24, rings = 2, order = 1`` has the 97 nodes and 84 quadrilaterals that the counts of Lu & Zhou (2011,
    section 4.2) give away.  Without rings the core itself is pulled onto the circle; the corners of the square then
    have a flat angle.

    Parameters
    ----------
    around
        Number of quadrilaterals round the rim, a positive multiple of 4.
    rings
        Number of rings; 0 for none.
    order
        Polynomial order, at least 1.
    core
        Radius of the corners of the core; 0.5 to 0.65 by the number of rings if not given.

    Raises
    ------
    InputError
        If a number is out of its range.
    """
    if around < 4 or around % 4:
        raise InputError(f"cells round the section: got {around}, need a positive multiple of 4")
    if rings < 0:
        raise InputError(f"rings: got {rings}, need 0 or more")
    if not 1 <= order <= 4:
        raise InputError(f"order of the cells: got {order}, need 1 to 4")
    if core is None:
        core = _balanced_core(around // 4, rings)
    if not 0.0 < core <= 1.0 or (rings > 0 and core == 1.0):
        raise InputError(f"radius of the core: got {core:g}, need more than 0 and less than 1")

    side = order * (around // 4)
    bulge = BULGE if rings else 1.0
    s, t = np.meshgrid(*[np.linspace(-1.0, 1.0, side + 1)] * 2, indexing="xy")
    square = np.stack([s, t], axis=-1) * np.sqrt(0.5)
    disk = np.stack([s * np.sqrt(1.0 - 0.5 * t**2), t * np.sqrt(1.0 - 0.5 * s**2)], axis=-1)
    inner = core * ((1.0 - bulge) * square + bulge * disk)
    if rings == 0:
        inner *= 1.0 / core
    number = np.arange((side + 1) ** 2).reshape(side + 1, side + 1)
    # Counter-clockwise round the core from its corner at -135 degrees.
    border = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])

    points = [inner.reshape(-1, 2)]
    circles = [border]
    angle = -0.75 * np.pi + 2.0 * np.pi * np.arange(4 * side) / (4 * side)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    for k in range(1, rings * order + 1):
        fraction = k / (rings * order)
        points.append((1.0 - fraction) * inner.reshape(-1, 2)[border] + fraction * circle)
        circles.append(number.size + (k - 1) * 4 * side + np.arange(4 * side))
    radial = np.stack(circles)
    nodes = np.concatenate(points)
    if rings == 0:
        rim_nodes = nodes[border]
        nodes[border] = rim_nodes / np.linalg.norm(rim_nodes, axis=1, keepdims=True)

    quads = [blocks(number, order)]
    if rings:
        # Radius first, angle second: counter-clockwise.
        closed = np.concatenate([radial, radial[:, :1]], axis=1)
        quads.append(blocks(closed.T, order))
    return Template(order, nodes, np.concatenate(quads), edges(radial[-1], order))


def _balanced_core(cells: int, rings: int) -> float:
    """Return the core's radius that makes cells of the core and of the rings about equally wide."""
    # Half diagonal of the core is cells / sqrt(2) cell widths, each ring is one more.
    return float(np.clip(cells * np.sqrt(0.5) / (cells * np.sqrt(0.5) + rings), 0.5, 0.75)) if rings else 1.0


def blocks(grid: Index, order: int) -> Index:
    """Return the cells ``(count, (order + 1)^2)`` of a grid of node numbers, second index of the grid fastest."""
    rows, columns = ((size - 1) // order for size in grid.shape)
    inside = np.arange(order + 1)
    i = order * np.arange(rows)[:, None, None, None] + inside[:, None]
    j = order * np.arange(columns)[:, None, None] + inside
    return grid[i, j].reshape(rows * columns, (order + 1) ** 2)


def edges(circle: Index, order: int) -> Index:
    """Return the edges ``(count, order + 1)`` of a circle of node numbers, of which the first is not repeated."""
    closed = np.append(circle, circle[0])
    return closed[order * np.arange(circle.size // order)[:, None] + np.arange(order + 1)]
