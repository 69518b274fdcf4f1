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
    mesh = tensored(rod, template, axis_positions(rod, layers, template.order, grading))
    mesh.check()
    return mesh


def tensored(rod: Rod, template: Template, u: Array) -> Mesh:
    """Return bricks whose nodes have the axis parameters ``u``, ``(order * layers + 1,)``, unchecked.

    Faces are ``start`` and ``end``, ``lateral``, and ``inner`` round a hole.  The last layer of a closed rod ends in
    the nodes that the first begins with, whose parameter is that of the start; it has neither start nor end.
    """
    order, count = template.order, len(template.points)
    layers = (u.size - 1) // order
    sections = u[:-1] if rod.closed else u
    positions, _ = rod.grid(template.points, sections)

    along = count * ((order * np.arange(layers)[:, None] + np.arange(order + 1)) % sections.size)
    cells = along[:, None, :, None] + template.quads[:, None, :]
    # A start face looks against the axis: transposed, its quadrilaterals turn in the opposite sense.
    square = np.arange((order + 1) ** 2).reshape(order + 1, order + 1)
    ends = {"start": template.quads[:, square.T.ravel()], "end": along[-1, -1] + template.quads}
    edges = {"lateral": template.rim, "inner": template.hole}
    sides = {name: along[:, None, :, None] + edge[:, None, :] for name, edge in edges.items() if edge.size}
    return Mesh(
        "hexahedron",
        order,
        positions.reshape(-1, 3),
        cells.reshape(-1, (order + 1) ** 3),
        lexicographic(order, 3),
        ({} if rod.closed else ends) | {name: side.reshape(-1, square.size) for name, side in sides.items()},
        lexicographic(order, 2),
        np.concatenate(
            [np.tile(template.points, (sections.size, 1)), np.repeat(sections, count)[:, None]],
            axis=1,
        ),
    )


def axis_positions(rod: Rod, layers: int, order: int, grading: float = 1.0) -> Array:
    """Return the axis parameters of the nodes, shape ``(order * layers + 1,)``, the same number in every axis element.

    Parameters
    ----------
    grading
        1 for equal layers; ``g > 1`` makes them thinner towards the start: layer ``k`` of ``N`` begins at ``(k / N)^g``
        of the length (rods of one axis element only).
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
