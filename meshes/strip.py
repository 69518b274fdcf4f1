"""Quadrilateral templates of the unit disk for flat sections.

A rectangular grid, long along one diameter, short across it.
"""

from dataclasses import replace

import numpy as np

from isorod.errors import InputError
from meshes.mesh import Array, Index
from meshes.template import Template, blocks, edges


def strip(
    along: int,
    across: int = 1,
    order: int = 2,
    corners: tuple[float, float] = (4.0, 10.0),
    clustering: float = 1.0,
    turn: float = 0.0,
) -> Template:
    """Return a grid of ``along x across`` quadrilaterals whose four corners lie on the circle.

    A section flat as a blade's is thin where this grid is short, so its cells are nearly square in space, where those
    of an O-grid become slivers.  At a corner two edges are tangent to the circle: the Jacobian vanishes there, at no
    quadrature point.

    Parameters
    ----------
    along, across
        Numbers of quadrilaterals along the diameter and across it.
    order
        Polynomial order, 1 to 4.
    corner
        Angle of the corners off the diameter, degrees, between 0 and 90.
    clustering
        0 for cells equally long along the diameter, 1 for cells as long as those of equal angles, short near the ends.
    turn
        Angle of the diameter, degrees.

    Raises
    ------
    InputError
        If a number is out of its range.
    """
    if along < 1 or across < 1:
        raise InputError(f"cells of the section: got {along} along and {across} across, need at least 1")
    if not 1 <= order <= 4:
        raise InputError(f"order of the cells: got {order}, need 1 to 4")
    if not all(0.0 < corner < 90.0 for corner in corners):
        raise InputError(f"corners of the section: got {corners} degrees, need more than 0 and less than 90")
    if not 0.0 <= clustering <= 1.0:
        raise InputError(f"clustering: got {clustering:g}, need 0 to 1")
    s = _nodes(levels(along, clustering), order)
    t = _nodes(np.linspace(-1.0, 1.0, across + 1), order)
    disk = _pull(s[None, :], t[:, None], *np.radians(corners))
    return turned(grid(disk, order), turn)


def grid(points: Array, order: int) -> Template:
    """Return the template whose nodes are a grid of points of the disk ``(rows, columns, 2)``, its border the rim."""
    number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    return Template(order, points.reshape(-1, 2), blocks(number, order), edges(_border(number), order))


def paper_section(turn: float = 0.0) -> Template:
    """Return straight quadrilaterals with the counts of Lu & Zhou (2011, section 4.3): 69 nodes and 49 quadrilaterals.

    The paper shows no section.  69 nodes and 49 quadrilaterals of a disk have 38 edges on the rim (Euler), which
    neither a grid nor an O-grid has.  A strip of 16 by 3 lacks one node and one quadrilateral: it is put round a node
    of the front end.
    """
    plain = strip(16, 3, 1, (4.0, 10.0), 0.0)
    low, inner, high = (17 * (row + 1) - 1 for row in range(3))
    points = plain.points.copy()
    # The node that the cap takes off the rim moves inward, so that no two of the three cells at it are in line.
    neighbour = points[inner - 1]
    outside = points[inner].copy()
    points[inner] = 0.5 * (outside + neighbour)
    points = np.concatenate([points, outside[None]])
    cap = len(points) - 1
    quads = np.concatenate([plain.quads, [[low, cap, inner, high]]])
    rim = plain.rim.copy()
    rim[rim == inner] = cap
    return turned(Template(1, points, quads, rim), turn)


def levels(along: int, clustering: float) -> Array:
    """Return the ends of ``along`` cells of the interval (-1, 1), shape ``(along + 1,)``.

    ``clustering`` as in `strip`.
    """
    v = np.linspace(-1.0, 1.0, along + 1)
    return (1.0 - clustering) * v + clustering * np.sin(0.5 * np.pi * v)


def _nodes(levels: Array, order: int) -> Array:
    """Return the levels and ``order - 1`` equally spaced nodes between two of them."""
    inside = levels[:-1, None] + np.diff(levels)[:, None] * np.arange(order) / order
    return np.append(inside.ravel(), levels[-1])


def _pull(s: Array, t: Array, back: float, front: float) -> Array:
    """Map the square ``(-1, 1)^2`` of ``s``, in a row, and ``t``, in a column, onto the disk.

    Its corners go to the angles ``back`` and ``front`` off the diameter.
    """
    fraction = 0.5 * (s + 1.0)
    low, high = -np.cos(back), np.cos(front)
    x = low + fraction * (high - low)
    y = t * np.sqrt(1.0 - x * x)
    # The short sides bulge onto the circle, and the lines between them the less the farther they are away.
    x = x + fraction * (np.sqrt(1.0 - (t * np.sin(front)) ** 2) - high)
    x = x - (1.0 - fraction) * (np.sqrt(1.0 - (t * np.sin(back)) ** 2) + low)
    return np.stack([x, y], axis=-1)


def _border(number: Index) -> Index:
    """Return the border of a grid counter-clockwise."""
    sides = [number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]]
    return np.concatenate(sides)


def turned(template: Template, degrees: float) -> Template:
    """Return a template turned counter-clockwise."""
    return replace(template, points=template.points @ rotation(degrees))


def rotation(degrees: float) -> Array:
    """Return the matrix that turns row vectors ``(m, 2)`` counter-clockwise."""
    angle = np.radians(degrees)
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
