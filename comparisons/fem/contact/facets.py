"""Points on the facets of a mesh: their functions, quadrature, areas; numbered as the mesh."""

import numpy as np

from comparisons.fem.contact.closest_kernel import Facet, Points
from meshes.mesh import Array, Index, Mesh


def facet_of(mesh: Mesh) -> Facet:
    """Return the functions of the mesh's facets."""
    triangle = mesh.shape == "tetrahedron"
    powers = np.stack(np.meshgrid(*[np.arange(mesh.order + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    if triangle:
        powers = powers[powers.sum(axis=1) <= mesh.order]
    monomials = np.prod(mesh.face_reference[:, None, :] ** powers, axis=2)
    return Facet(np.ascontiguousarray(np.linalg.inv(monomials)), np.ascontiguousarray(powers), triangle)


def values_and_slopes(like: Facet, where: Array) -> tuple[Array, Array]:
    """Return a facet's functions ``(m, n)`` and their gradients ``(m, n, 2)`` at points ``(m, 2)``."""
    coefficients, powers, _ = like
    values = np.prod(where[:, None, :] ** powers, axis=2) @ coefficients
    slopes = np.empty((len(where), coefficients.shape[1], 2))
    for a in range(2):
        lowered = powers.copy()
        lowered[:, a] = np.maximum(lowered[:, a] - 1, 0)
        slopes[:, :, a] = (powers[:, a] * np.prod(where[:, None, :] ** lowered, axis=2)) @ coefficients
    return values, slopes


def surface_points(mesh: Mesh, face: str, parts: int) -> tuple[Index, Array]:
    """Return points on a named face as in `Points`, ``(m, n)`` nodes and their functions.

    A lattice of ``parts`` to an edge on each facet.
    """
    like, nodes = facet_of(mesh), mesh.faces[face]
    a, b = (grid.ravel() for grid in np.meshgrid(*[np.arange(parts + 1) / parts] * 2, indexing="ij"))
    where = np.stack([a, b], axis=1)
    values, _ = values_and_slopes(like, where[a + b < 1.0 + 0.5 / parts] if like.triangle else where)
    functions = np.broadcast_to(values, (len(nodes), *values.shape)).reshape(-1, values.shape[1])
    return np.repeat(nodes, len(values), axis=0), functions


def gauss(mesh: Mesh, like: Facet, face: Index, parts: int = 1) -> Points:
    """Return Gauss points, weighted by reference area."""
    where, weights = _split(*_rule(mesh.order, like.triangle), parts, like.triangle)
    values, slopes = values_and_slopes(like, where)
    areas = np.linalg.norm(_area_vectors(mesh, face, slopes), axis=2) * weights
    functions = np.broadcast_to(values, (len(face), *values.shape)).reshape(-1, values.shape[1])
    supports = np.repeat(face, len(where), axis=0)
    return Points(supports, np.ascontiguousarray(functions), areas.ravel())


def outward(mesh: Mesh, like: Facet, face: Index) -> Array:
    """Return the outward normal times the weight of each of the points that `gauss` returns, shape ``(m, 3)``."""
    where, weights = _rule(mesh.order, like.triangle)
    vectors = _area_vectors(mesh, face, values_and_slopes(like, where)[1])
    return (vectors * weights[:, None]).reshape(-1, 3)


def nodal(mesh: Mesh, like: Facet, face: Index) -> Points:
    """Return the nodes, weighted by their fraction of the facets' areas."""
    _, slopes = values_and_slopes(like, mesh.face_reference)
    areas = np.linalg.norm(_area_vectors(mesh, face, slopes), axis=2) * (0.5 if like.triangle else 1.0) / face.shape[1]
    nodes, where = np.unique(face, return_inverse=True)
    weights = np.asarray(np.bincount(where.ravel(), areas.ravel()), dtype=float)
    return Points(nodes[:, None].astype(np.int64), np.ones((nodes.size, 1)), weights)


def _area_vectors(mesh: Mesh, face: Index, slopes: Array) -> Array:
    """Return the outward normal times the area per area of the reference facet, shape ``(facets, points, 3)``."""
    tangents = np.einsum("qna,fni->fqai", slopes, mesh.points[face])
    return np.asarray(np.cross(tangents[:, :, 0], tangents[:, :, 1]))


def _rule(order: int, triangle: bool) -> tuple[Array, Array]:
    """Return a rule of degree ``2 order`` or more on the unit square.

    On the unit triangle 3 or 6 points (Dunavant 1985).
    """
    if not triangle:
        x, w = np.polynomial.legendre.leggauss(order + 1)
        a, b = (grid.ravel() for grid in np.meshgrid(0.5 * (x + 1.0), 0.5 * (x + 1.0), indexing="ij"))
        return np.stack([a, b], axis=1), 0.25 * np.outer(w, w).ravel()
    if order == 1:
        orbits = [(1.0 / 6.0, 1.0 / 3.0)]
    else:
        orbits = [(0.445948490915965, 0.223381589678011), (0.091576213509771, 0.109951743655322)]
    where = [[(r, r), (1.0 - 2.0 * r, r), (r, 1.0 - 2.0 * r)] for r, _ in orbits]
    return np.array(where).reshape(-1, 2), np.repeat([0.5 * w for _, w in orbits], 3)


def _split(where: Array, weights: Array, parts: int, triangle: bool) -> tuple[Array, Array]:
    """Return a rule repeated on each of the ``parts^2`` equal parts of its square or triangle."""
    grid = [(i, j) for i in range(parts) for j in range(parts)]
    if not triangle:
        copies = [where + np.array(corner) for corner in grid]
    else:
        copies = [where + np.array([i, j]) for i, j in grid if i + j < parts]
        # Between those upright, the ones that stand on their heads.
        copies += [np.array([i + 1, j + 1]) - where for i, j in grid if i + j < parts - 1]
    return np.concatenate(copies) / parts, np.tile(weights, len(copies)) / parts**2
