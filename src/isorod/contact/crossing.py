"""Tunnelling of centre lines of rods through facets of finite element bodies."""

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from isorod.arrays import Array, Index
from isorod.contact.facets import SQUARES, facets, nodes_of

if TYPE_CHECKING:
    from isorod.model.contact import Contact
    from isorod.model.model import Model

# Corners of the two triangles of a quadrilateral, whose corners are numbered as in a tensor product; of a triangle one.
_TRIANGLES = {3: ((0, 1, 2),), 4: ((0, 1, 2), (1, 3, 2))}

# Relative enlargement of triangles: each has a motion of its own, and no gaps may open between them.
_EDGE = 0.1


class Crossing:
    """Facets of one contact, as triangles between their corners.

    Parameters
    ----------
    model, contact
        The model, and its contact with facets.
    """

    def __init__(self, model: "Model", contact: "Contact") -> None:
        known, self._places = nodes_of(model)
        own = facets(model, contact, 1, known)
        corners = 4 if own.nodes.shape[1] in SQUARES else 3
        self._corners: Index = np.concatenate([own.nodes[:, list(one)] for one in _TRIANGLES[corners]])

    def first(self, points: tuple[Array, Array], moved: tuple[Array, Array], ahead: Array) -> int | None:
        """Return the number of a point that goes through a facet, if there is one.

        Parameters
        ----------
        points
            Their positions before and after, shape ``(p, 3)`` each.
        moved
            Displacements of `nodes_of` before and after, shape ``(3 k,)`` each.
        ahead
            Distance by which its body reaches ahead of each point, on its path relative to a facet, ``(p,)``.
        """
        before, after = ((self._places + one.reshape(-1, 3))[self._corners] for one in moved)
        middle = before.mean(axis=1)
        size = np.linalg.norm(before - middle[:, None], axis=2).max(axis=1)
        reach = np.linalg.norm(points[1] - points[0], axis=1) + ahead
        drift = np.linalg.norm((after - before).mean(axis=1), axis=1)
        near = cKDTree(middle).query_ball_point(points[0], reach + drift.max() + size.max())
        which = np.repeat(np.arange(reach.size), [len(one) for one in near])
        if not which.size:
            return None
        facet = np.concatenate([np.array(one, dtype=np.int64) for one in near])
        # The path relative to the facet.
        start = points[0][which]
        path = points[1][which] - start - (after[facet] - before[facet]).mean(axis=1)
        length = np.linalg.norm(path, axis=1)[:, None]
        path = path * (1.0 + ahead[which, None] / np.where(length > 0.0, length, np.inf))
        hit = _cross(start, path, before[facet])
        return int(which[hit.argmax()]) if hit.any() else None


def _cross(start: Array, path: Array, corners: Array) -> Array:
    """Return which paths cross their triangles (Moeller & Trumbore, J. Graph. Tools 2 (1997) 21-28)."""
    first, second, offset = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], start - corners[:, 0]
    normal = np.cross(first, second)
    det = -np.einsum("ma,ma->m", path, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ma,ma->m", offset, normal) / det
        turned = np.cross(offset, path)
        u, v = np.einsum("ma,ma->m", second, turned) / det, -np.einsum("ma,ma->m", first, turned) / det
        return np.asarray((t >= 0.0) & (t <= 1.0) & (np.minimum(u, v) >= -_EDGE) & (u + v <= 1.0 + _EDGE))
