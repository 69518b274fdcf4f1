"""Quadrilateral templates of sections with a hole or in layers: rings of quadrilaterals between circles of the disk."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from meshes.mesh import Array, Index
from meshes.template import Template, blocks, edges


def annulus(around: int, radii: Sequence[float], rings: Sequence[int], order: int = 2, turn: float = 0.0) -> Template:
    """Return rings of ``around`` quadrilaterals from a hole to the circle.

    Parameters
    ----------
    around
        Number of quadrilaterals in a ring, at least 3.
    radii
        Radii of circles that are mesh lines, rising from that of the hole to 1.
    rings
        Numbers of rings between each two of them.
    order
        Polynomial order, 1 to 4.
    turn
        Angle of the first mesh line across the rings, degrees.
    """
    angle = np.radians(turn) + 2.0 * np.pi * np.arange(order * around) / (order * around)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points, circles = _circles(circle, radii, rings, order)
    nodes = np.concatenate([radii[0] * circle, points])
    numbers = np.concatenate([np.arange(len(circle))[None], len(circle) + circles])
    hole = edges(numbers[0], order)[:, ::-1]
    return Template(order, nodes, _quads(numbers, order), edges(numbers[-1], order), hole)


def wrapped(core: Template, radii: Sequence[float], rings: Sequence[int]) -> Template:
    """Return a template shrunk to a core, and rings round it that its edges on the rim are continued by.

    Parameters
    ----------
    core
        Mesh of a disk without a hole.
    radii
        Radii of circles that are mesh lines, rising from that of the core to 1.
    rings
        Numbers of rings between each two of them.
    """
    rim = core.rim[:, :-1].ravel()
    points, circles = _circles(core.points[rim], radii, rings, core.order)
    numbers = np.concatenate([rim[None], len(core.points) + circles])
    return Template(
        core.order,
        np.concatenate([radii[0] * core.points, points]),
        np.concatenate([core.quads, _quads(numbers, core.order)]),
        edges(numbers[-1], core.order),
    )


def _circles(circle: Array, radii: Sequence[float], rings: Sequence[int], order: int) -> tuple[Array, Index]:
    """Return nodes on circles outside of the first radius, at the angles of a unit circle's nodes, and their numbers.

    Between two radii the circles grow by equal factors, so that in a round section all its rings have cells of one
    shape.
    """
    circles = [
        inner * (outer / inner) ** (np.arange(1, order * count + 1) / (order * count))
        for (inner, outer), count in zip(pairwise(radii), rings, strict=True)
    ]
    outward = np.concatenate(circles)
    points = (outward[:, None, None] * circle).reshape(-1, 2)
    return points, np.arange(len(points)).reshape(outward.size, len(circle))


def _quads(circles: Index, order: int) -> Index:
    """Return the cells between circles of node numbers ``(circles, nodes)``: radius first, counter-clockwise."""
    return blocks(np.concatenate([circles, circles[:, :1]], axis=1).T, order)
