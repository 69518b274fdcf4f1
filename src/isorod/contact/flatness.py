"""Distance of flat facets from the curved surface that they represent."""

from typing import TYPE_CHECKING

import numpy as np

from isorod.arrays import Array
from isorod.contact.facets import SQUARES

if TYPE_CHECKING:
    from isorod.model.contact import Contact
    from isorod.model.model import Model

# Angle between facets above which their joint is an edge of the body.
_EDGE = 0.6


def unevenness(model: "Model", contact: "Contact") -> Array:
    """Return distances of flat facets from the curved surface that they represent, ``(f,)``.

    That is the sagitta of an arc whose angle along a facet is the jump of normals over its edges.
    """
    assert contact.facets is not None
    solid = model.solids[contact.facets.solid]
    trace = solid.trace(contact.facets.facets, 1)
    count = trace.nodes.shape[1]
    corners = trace.nodes[:: trace.each, : 4 if count in SQUARES else 3]
    if solid.curved:
        return np.zeros(len(corners))
    normals = trace.normals[:: trace.each]
    places = np.concatenate(solid.comm.allgather(solid.positions))
    around = ((0, 1), (1, 3), (3, 2), (2, 0)) if corners.shape[1] == 4 else ((0, 1), (1, 2), (2, 0))
    edges = np.sort(np.concatenate([corners[:, list(pair)] for pair in around]), axis=1)
    facet = np.tile(np.arange(len(corners)), len(around))
    order = np.lexsort(edges.T)
    pairs = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    first, second = facet[order[pairs]], facet[order[pairs + 1]]
    angle = np.arccos(np.clip(np.einsum("ea,ea->e", normals[first], normals[second]), -1.0, 1.0))
    angle = np.where(angle < _EDGE, angle, 0.0)
    ends = places[edges[order[pairs]]]
    along = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    areas = trace.weights.reshape(-1, trace.each).sum(axis=1) * (1.0 if corners.shape[1] == 4 else 2.0)
    result = np.zeros(len(corners))
    for own in (first, second):
        np.maximum.at(result, own, angle * areas[own] / along / 8.0)
    return result
