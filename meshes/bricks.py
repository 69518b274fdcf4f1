"""Curved bricks of a Rod: a template of its section, tensored with layers along its axis."""

import numpy as np

from isorod.errors import InputError
from isorod.geometry.rod import Rod
from meshes.mesh import Array, Mesh, lexicographic
from meshes.template import Template


def bricks(rod: Rod, template: Template, layers: int, grading: float = 1.0) -> Mesh:
    """Return bricks of the template's order, every node where the Rod's map puts it.

    Parameters
    ----------
    rod
        An open rod.
    template
        Mesh of the disk.
    layers
        Number of bricks along the rod, a multiple of its axis elements so that none reaches over a knot.
    grading
        See `axis_positions`.

    Raises
    ------
    InputError
        If the rod is closed, or the layers do not fit its elements, or a brick is inverted.
    """
    order = template.order
    u = axis_positions(rod, layers, order, grading)
    positions, _ = rod.grid(template.points, u)
    count = len(template.points)

    along = count * np.arange(order + 1)
    start = count * order * np.arange(layers)
    cells = start[:, None, None, None] + along[:, None] + template.quads[:, None, :]
    side = start[:, None, None, None] + along[:, None] + template.rim[:, None, :]
    # The start face looks against the axis: transposed, its quadrilaterals turn the other way round.
    square = np.arange((order + 1) ** 2).reshape(order + 1, order + 1)
    faces = {
        "start": template.quads[:, square.T.ravel()],
        "end": count * order * layers + template.quads,
        "lateral": side.reshape(-1, (order + 1) ** 2),
    }
    mesh = Mesh(
        "hexahedron",
        order,
        positions.reshape(-1, 3),
        cells.reshape(-1, (order + 1) ** 3),
        lexicographic(order, 3),
        faces,
        lexicographic(order, 2),
        np.concatenate([np.tile(template.points, (u.size, 1)), np.repeat(u, count)[:, None]], axis=1),
    )
    mesh.check()
    return mesh


def axis_positions(rod: Rod, layers: int, order: int, grading: float = 1.0) -> Array:
    """Return the axis parameters of the nodes, shape ``(order * layers + 1,)``, the same number in every axis element.

    Parameters
    ----------
    grading
        1 for equal layers; ``g > 1`` makes them thinner towards the start: layer ``k`` of ``N`` begins at ``(k / N)^g``
        of the way (rods of one axis element only).
    """
    elements = rod.axis.elements
    if rod.closed:
        raise InputError("mesh: the rod is closed; only rods with two ends are meshed")
    if layers < 1 or layers % elements:
        raise InputError(f"layers: got {layers}, need a positive multiple of the rod's {elements} axis elements")
    if not 1.0 <= grading <= 10.0 or (grading != 1.0 and elements > 1):
        raise InputError(f"grading: got {grading:g}, need 1 to 10, and 1 on a rod of several axis elements")
    per_element = layers // elements
    ends = (np.arange(per_element + 1) / per_element) ** grading
    inside = (ends[:-1, None] + np.diff(ends)[:, None] * np.arange(order) / order).ravel()
    u = rod.axis.breaks[:-1, None] + np.diff(rod.axis.breaks)[:, None] * inside
    return np.append(u.ravel(), rod.axis.breaks[-1])
