"""Facets of finite element bodies in contact: each an element with the shape functions of its nodes.

Their points are the slaves, and the lateral surfaces of rods the masters: these are smooth, so that normals do not jump
from facet to facet.  The number of points follows from the rods' curvature, however coarse the mesh is.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_matrix

from isorod.arrays import Array, Index
from isorod.contact.cells import functions
from isorod.contact.packed import FUNCTIONS
from isorod.errors import InputError
from isorod.space.choice import AROUND

if TYPE_CHECKING:
    from isorod.fenics.solid import Trace
    from isorod.model.contact import Contact
    from isorod.model.model import Model

# Most points of all facets of a contact.
MOST = 2_000_000

# Numbers of nodes of quadrilaterals.
SQUARES = (4, 9)


class Facets(NamedTuple):
    """Facets of a contact, ``f``, with ``n`` points on each and ``m`` nodes.

    Attributes
    ----------
    body
        Number of the body; finite element bodies come after the rods.
    nodes
        Numbers of nodes among `nodes_of`, shape ``(f, m)``.
    values
        Shape functions at the points, ``(f, n, m)``.
    areas
        Reference areas of the points, ``(f, n)``.
    size
        Mean distance of nodes: square root of the area per node.
    """

    body: int
    nodes: Index
    values: Array
    areas: Array
    size: float


def nodes_of(model: "Model") -> tuple[Index, Array]:
    """Return the nodes of all facets in contact, and their positions at rest; on every rank.

    Returns
    -------
    nodes : (k,)
        Numbers, ascending: finite element bodies, one after the other, come after the rods.
    positions : (k, 3)
    """
    firsts = np.cumsum([model.dofs // 3, *(solid.nodes for solid in model.solids)])
    nodes, places = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for k, solid in enumerate(model.solids):
        own = [contact.facets for contact in model.contacts if contact.facets is not None and contact.facets.solid == k]
        if own:
            numbers = np.unique(np.concatenate([solid.trace(contact.facets).nodes.ravel() for contact in own]))
            nodes.append(firsts[k] + numbers)
            places.append(np.concatenate(solid.comm.allgather(solid.positions))[numbers])
    return np.concatenate(nodes), np.concatenate(places)


def facets(model: "Model", contact: "Contact", points: int, known: Index) -> Facets:
    """Return the facets of a contact, with at least so many points along a side; ``known`` are `nodes_of`."""
    assert contact.facets is not None
    k = contact.facets.solid
    parts = max(1, -(-points // 2))
    trace = model.solids[k].trace(contact.facets.facets, parts)
    n, count = trace.each, trace.nodes.shape[1]
    first = model.dofs // 3 + sum(solid.nodes for solid in model.solids[:k])
    # All points of a facet have the same nodes.
    nodes = np.searchsorted(known, first + trace.nodes[::n])
    area = float(trace.weights.sum()) / np.unique(nodes).size
    return Facets(
        len(model.bodies) + k, nodes, trace.values.reshape(-1, n, count), trace.weights.reshape(-1, n), np.sqrt(area)
    )


def values_of(model: "Model", contact: "Contact", known: Index, points: int) -> csr_matrix:
    """Return the shape functions of so many points of a contact's facets, rows over all nodes of rods and ``known``."""
    assert contact.facets is not None
    trace = model.solids[contact.facets.solid].trace(contact.facets.facets, 1)
    # Each facet has the points of its rule once for each of its parts.
    own = facets(model, contact, 2 * round(np.sqrt(points / len(trace.weights))), known)
    nodes = model.dofs // 3 + np.repeat(own.nodes, own.values.shape[1], axis=0)
    places = np.arange(0, nodes.size + 1, nodes.shape[1])
    return csr_matrix((own.values.ravel(), nodes.ravel(), places), shape=(points, model.dofs // 3 + known.size))


def points_of(model: "Model", contact: "Contact", radius: float) -> tuple[int, int]:
    """Return the points along the sides of facets: two between nodes at least, and as dense as those of rods.

    That is `AROUND` on a circle of a ``radius``, and two for each function of the rods that are touched.
    """
    assert contact.facets is not None
    solid = model.solids[contact.facets.solid]
    trace = solid.trace(contact.facets.facets, 1)
    count = trace.nodes.shape[1]
    if count > FUNCTIONS:
        raise InputError(
            f"facets of solid {contact.facets.solid}: got {count} nodes on each, contact takes {FUNCTIONS} at most; "
            "use elements of second degree"
        )
    spacing = min([2.0 * np.pi * radius / AROUND, *(_spacing(model, *side) for side in contact.sides)])
    along = max(2 * solid.degree, int(np.ceil(_longest(trace) / spacing)))
    many = along**2 * trace.weights.size / trace.each
    if many > MOST:
        raise InputError(
            f"facets of solid {contact.facets.solid}: {many:.2g} points are needed to see a rod of radius "
            f"{radius:.3g}; name a group of fewer or smaller facets, those that may be touched"
        )
    return along, along


def _longest(trace: "Trace") -> float:
    """Return the largest distance between points of a facet."""
    points = trace.points.reshape(-1, trace.each, 3)
    apart = np.linalg.norm(points[:, :, None] - points[:, None], axis=3).max(initial=0.0)
    # The ratio of the diagonal of a facet to the distance of points of its rule, which is of degree 2.
    return float(apart * (2.0 if trace.each == 3 else np.sqrt(1.5)))


def _spacing(model: "Model", body: int, elements: Sequence[int] | None) -> float:
    """Return half the shortest length along the axis of a rod per function."""
    space = model.bodies[body].space
    lengths = np.diff(space.rod.arc_length(space.axis.breaks))
    return 0.5 * float((lengths if elements is None else lengths[list(elements)]).min()) / functions(space)
