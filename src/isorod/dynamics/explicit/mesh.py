"""The mesh of explicit steps: points and constants of the elements, packed into arrays."""

from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from isorod.arrays import Array, Index
from isorod.compiled import F1, U2
from isorod.dynamics.explicit.ranks import Ranks
from isorod.geometry.quadrature import ring_of
from isorod.material.memory import has_memory
from isorod.material.points import POINTS
from isorod.model.model import Model

# Rows of a block's geometry: the inverse Jacobian (9) and the volume.
GEOMETRY = 10

# Record of an element, or of one of its rings where a rod is layered: numbers of section functions, of blocks in the
# section, of points and functions along the axis; first rows in ``sections``, ``axial``, ``geometry`` and ``fibres``,
# and number of fibre rows of a block; its law's constants, their number; the addresses of its law's function of a block
# and, with memory, of that which updates states (`isorod.material.points`); index of the constant that is the time
# since the state.
ELEMENT = np.dtype(
    [
        (name, np.uint64)
        for name in (
            *("functions", "blocks", "points", "along", "sections", "axial", "geometry"),
            *("fibres", "directions"),
            *("constants", "count", "block", "update", "clock"),
        )
    ]
)


class Mesh(NamedTuple):
    """The elements of all bodies, or of a rank, as plain arrays; made by `isorod.dynamics.explicit.mesh.pack`.

    Attributes
    ----------
    elements
        ``ELEMENT`` records, shape ``(E,)``.
    layers
        Start of each layer of an element in a state vector, shape ``(E, l)``.
    sections
        For each body, ring, block and section function: ``dS/dxi_1, dS/dxi_2, S`` at the points.
    axial
        For each element and point along it: ``R`` of each axis function, then ``dR/du``.
    geometry
        For each ring, element, point along it and block: ``GEOMETRY`` rows.
    fibres
        Likewise the components of the fibres' unit vectors, or the state of laws with memory, as many rows as the body
        has.
    constants, stiff
        Constants of all elements' laws, and of these without flow.
    spans
        Begin and end of the entries of these elements in a state vector, shape ``(s, 2)``.
    """

    elements: NDArray[Any]
    layers: NDArray[np.uint64]
    sections: Array
    axial: Array
    geometry: Array
    fibres: Array
    constants: Array
    stiff: Array
    spans: NDArray[np.uint64]


MESH = types.NamedTuple([types.Array(from_dtype(ELEMENT), 1, "C"), U2, F1, F1, F1, F1, F1, F1, U2], Mesh)


def order(model: Model) -> Index:
    """Return the place of each degree of freedom in a state vector (`element_kernel`), shape ``(dofs,)``."""
    positions = []
    for body, first in zip(model.bodies, model.first_node[:-1], strict=True):
        size = body.space.layer_nodes
        local = np.arange(body.space.nodes)[:, None]
        positions.append(3 * first + 3 * size * (local // size) + size * np.arange(3) + local % size)
    return np.concatenate(positions).ravel()


def pack(model: Model, ranks: Ranks | None = None, moves: bool = True) -> Mesh:
    """Return the elements of all bodies, or those of a rank, as plain arrays; those of mixed ones without pressures.

    Without ``moves`` the arrays have no stiffest state, which laws for statics alone do not define.
    """
    records, layers = [], []
    sections: list[Array] = []
    axial: list[Array] = []
    geometry: list[Array] = []
    fibres: list[Array] = []
    constants: list[Array] = []
    stiff: list[Array] = []
    longest = max(body.space.axis.degree for body in model.bodies) + 1
    ranks = Ranks(model, order(model)) if ranks is None else ranks
    for elements in ranks.element_ranges:
        body, space = elements.body, elements.body.space
        table = space.tabulate(elements.first, elements.last)
        points, functions = table.axial.shape[1:]
        each, along = np.arange(table.elements), _size(axial)
        axial.append(np.stack([table.axial, table.slopes], axis=2).ravel())
        layer = np.zeros((table.elements, longest), dtype=np.uint64)
        layer[:, :functions] = 3 * (elements.first_node + space.layer_nodes * elements.layers)
        directions, inside = body.known(table), ring_of(space.rod.rings, table.xi)
        rings = len(space.rod.rings) - 1
        for ring in range(rings):
            own = np.flatnonzero(inside == ring) if rings > 1 else slice(None)
            part = table.part(slice(None), own)
            blocks = -(-part.section.shape[0] // POINTS)
            rows = np.zeros(table.elements, ELEMENT)
            rows["functions"], rows["blocks"] = space.layer_nodes, blocks
            rows["points"], rows["along"] = points, functions
            rows["sections"] = _size(sections)
            rows["axial"] = along + each * (2 * points * functions)
            rows["geometry"] = _size(geometry) + each * (points * blocks * GEOMETRY * POINTS)
            rows["directions"] = body.width
            rows["fibres"] = _size(fibres) + each * (points * blocks * body.width * POINTS)
            for e, law in enumerate(body.shear_laws[rings * elements.first + ring : rings * elements.last : rings]):
                rows["constants"][e], rows["count"][e] = _size(constants), law.constants.size
                rows["block"][e], rows["clock"][e] = law.compiled.block, max(law.clock, 0)
                rows["update"][e] = law.compiled.update if law.remembers else 0
                constants.append(law.constants)
                stiff.append(law.frozen.constants if moves and has_memory(law) else law.constants)
            records.append(rows)
            layers.append(layer)
            sections.append(_blocks(part.section.transpose(2, 1, 0)).transpose(2, 0, 1, 3).ravel())
            inverses = part.inverse.reshape(*part.weights.shape, 9)
            geometry.append(_rows(np.concatenate([inverses, part.weights[..., None]], axis=-1)))
            fibres.append(_rows(directions[:, :, own]))
    return Mesh(
        # A rank may have no elements.
        elements=np.concatenate([np.zeros(0, ELEMENT), *records]),
        layers=np.concatenate([np.zeros((0, longest), dtype=np.uint64), *layers]),
        sections=np.concatenate([np.empty(0), *sections]),
        axial=np.concatenate([np.empty(0), *axial]),
        geometry=np.concatenate([np.empty(0), *geometry]),
        fibres=np.concatenate([np.empty(0), *fibres]),
        constants=np.concatenate([np.empty(0), *constants]),
        stiff=np.concatenate([np.empty(0), *stiff]),
        spans=ranks.spans,
    )


def digests(mesh: Mesh) -> list[bytes]:
    """Return a digest of each element but for its law, which `identity` covers."""
    results = []
    for row, layers in zip(mesh.elements, mesh.layers, strict=True):
        along, points, blocks = (int(row[name]) for name in ("along", "points", "blocks"))
        sizes = {
            "sections": (mesh.sections, 3 * blocks * int(row["functions"]) * POINTS),
            "axial": (mesh.axial, 2 * points * along),
            "geometry": (mesh.geometry, points * blocks * GEOMETRY * POINTS),
            "fibres": (mesh.fibres, points * blocks * int(row["directions"]) * POINTS),
        }
        digest = sha256(layers.tobytes())
        for name, (values, size) in sizes.items():
            digest.update(values[int(row[name]) :][:size].tobytes())
        results.append(digest.digest())
    return results


def _size(parts: list[Array]) -> int:
    return sum(part.size for part in parts)


def _rows(values: Array) -> Array:
    """Return values ``(E, t, q, m)`` at points as rows of blocks, concatenated."""
    return _blocks(np.moveaxis(values, -1, 2)).swapaxes(2, 3).ravel()


def _blocks(values: Array) -> Array:
    """Return the last axis cut into blocks, the last one padded with zeros, shape ``(..., blocks, POINTS)``."""
    short = -values.shape[-1] % POINTS
    values = np.concatenate([values, np.zeros((*values.shape[:-1], short))], axis=-1)
    return values.reshape(*values.shape[:-1], values.shape[-1] // POINTS, POINTS)
