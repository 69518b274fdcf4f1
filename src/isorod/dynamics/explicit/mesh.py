"""The mesh as explicit steps see it: elements' points and constants, packed."""

from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.compiled import F1, F2, U2
from isorod.model.body import element_laws
from isorod.model.model import Model

# Points in a block: half of those in a section of order 2 with 8 control points.  Measured: blocks of 16 or less are
# unrolled before they are vectorised, and three times slower, those of 24 in part.
POINTS = 32

# Rows of a block's geometry: the inverse Jacobian (9), the volume, the fibre (3), and the fibre seen from the disk x
# axis (3).
GEOMETRY = 16


class Mesh(NamedTuple):
    """The elements of all bodies as plain arrays; made by `isorod.dynamics.explicit.mesh.pack`.

    Attributes
    ----------
    elements
        ``n`` (section functions), blocks in the section, points along the axis, axis functions, and where the element's
        rows begin in ``sections``, ``axial`` and ``geometry``; shape ``(E, 7)``.
    layers
        Where each layer of an element begins in a state vector, shape ``(E, l)``.
    sections
        For each body, block and section function: ``dS/dxi_1, dS/dxi_2, S`` at the points.
    axial
        For each element and point along it: ``R`` of each axis function, then ``dR/du``.
    geometry
        For each element, point along it and block: ``GEOMETRY`` rows.
    laws
        ``mu, lame``, active fibre stress at full activation, ``m1, m2``; shape ``(E, 5)``.
    """

    elements: NDArray[np.uint64]
    layers: NDArray[np.uint64]
    sections: Array
    axial: Array
    geometry: Array
    laws: Array


MESH = types.NamedTuple([U2, U2, F1, F1, F1, F2], Mesh)


def order(model: Model) -> Index:
    """Return the place of each degree of freedom in a state vector (see `isorod.dynamics.explicit.element_kernel`), shape ``(dofs,)``."""
    places = []
    for body, first in zip(model.bodies, model.first_node[:-1], strict=True):
        size = body.space.layer_nodes
        local = np.arange(body.space.nodes)[:, None]
        places.append(3 * first + 3 * size * (local // size) + size * np.arange(3) + local % size)
    return np.concatenate(places).ravel()


def pack(model: Model) -> Mesh:
    """Return the elements of all bodies as plain arrays.

    Raises
    ------
    InputError
        If a law is neither neo-Hookean nor muscle.
    """
    elements, layers, laws = [], [], []
    sections: list[Array] = []
    axial: list[Array] = []
    geometry: list[Array] = []
    longest = max(body.space.axis.degree for body in model.bodies) + 1
    for index, (body, first) in enumerate(zip(model.bodies, model.first_node[:-1], strict=True)):
        space = body.space
        table = space.tabulate(0, space.axis.elements)
        points = table.section.shape[0]
        blocks = -(-points // POINTS)
        along, functions = table.axial.shape[1:]
        rows = np.zeros((space.axis.elements, 7), dtype=np.uint64)
        rows[:, :4] = space.layer_nodes, blocks, along, functions
        each = np.arange(space.axis.elements)
        rows[:, 4] = sum(part.size for part in sections)
        rows[:, 5] = sum(part.size for part in axial) + each * (2 * along * functions)
        rows[:, 6] = sum(part.size for part in geometry) + each * (along * blocks * GEOMETRY * POINTS)
        elements.append(rows)
        layer = np.zeros((space.axis.elements, longest), dtype=np.uint64)
        layer[:, :functions] = 3 * (first + space.layer_nodes * space.element_layers)
        layers.append(layer)
        sections.append(_blocks(table.section.transpose(2, 1, 0)).transpose(2, 0, 1, 3).ravel())
        axial.append(np.stack([table.axial, table.slopes], axis=2).ravel())
        fibres = body.fibres(table)
        inside = np.einsum("etqdA,etqA->etqd", table.inverse, fibres)
        flat = table.inverse.reshape(*table.weights.shape, 9)
        values = np.concatenate([flat, table.weights[..., None], fibres, inside], axis=-1)
        geometry.append(_blocks(np.moveaxis(values, -1, 2)).swapaxes(2, 3).ravel())
        laws.append(element_laws(body, index))
    return Mesh(
        elements=np.concatenate(elements),
        layers=np.concatenate(layers),
        sections=np.concatenate(sections),
        axial=np.concatenate(axial),
        geometry=np.concatenate(geometry),
        laws=np.concatenate(laws),
    )


def _blocks(values: Array) -> Array:
    """Return the last axis cut in blocks of ``POINTS``, the last one filled up with zeros, shape ``(..., blocks, POINTS)``."""
    short = -values.shape[-1] % POINTS
    values = np.concatenate([values, np.zeros((*values.shape[:-1], short))], axis=-1)
    return values.reshape(*values.shape[:-1], -1, POINTS)
