"""Section forces and moments of a rod, from the stress."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from isorod.arrays import Array
from isorod.geometry import bspline
from isorod.geometry.axis import Axis
from isorod.geometry.quadrature import axis_points
from isorod.material.along_rod import Laws
from isorod.model.body import Body
from isorod.output.stress import first_piola
from isorod.tensors import determinant

# Elements evaluated at a time, to limit memory.
_CHUNK = 32


@dataclass(frozen=True, eq=False)
class SectionForces:
    """Forces and moments in sections of a rod: the action of the part beyond (greater ``u``) on the part before.

    The directions of a section are its normal, towards greater ``u``, and two in the section: the first along the mean
    direction of the disk's axis ``xi_1``, the second normal to both; they move with the section.  At the end of a rod
    force and moment are those of support or load there, at its start those of the support with the opposite sign.

    Attributes
    ----------
    N
        Normal force, positive in tension, shape that of ``u``.
    Q
        Shear forces along the first and the second direction, shape ``(..., 2)``.
    M
        Torsion, about the normal, and bending moments about the first and the second direction, right-handed, shape
        ``(..., 3)``.
    force, moment
        The same as vectors in space, shape ``(..., 3)``.
    centroid
        Points about which the moments are: the sections' centroids in their present places, shape ``(..., 3)``.
    frame
        Normal, first and second direction, a row each, shape ``(..., 3, 3)``.
    """

    force: Array
    moment: Array
    centroid: Array
    frame: Array

    @property
    def N(self) -> Array:
        """Normal force, positive in tension, shape that of ``u``."""
        return np.asarray(np.einsum("...a,...a->...", self.frame[..., 0, :], self.force))

    @property
    def Q(self) -> Array:
        """Shear forces along the first and the second direction of the section, shape ``(..., 2)``."""
        return np.asarray(np.einsum("...ia,...a->...i", self.frame[..., 1:, :], self.force))

    @property
    def M(self) -> Array:
        """Torsion and the bending moments about the first and the second direction, shape ``(..., 3)``."""
        return np.asarray(np.einsum("...ia,...a->...i", self.frame, self.moment))

    def __repr__(self) -> str:
        rows = (f"{name} {getattr(self, name).tolist()}" for name in ("N", "Q", "M"))
        largest = (f"{name} up to {np.abs(getattr(self, name)).max(initial=0.0):.6g}" for name in ("N", "Q", "M"))
        count = self.force.size // 3
        return f"SectionForces of {count} sections: {', '.join(largest)}" if count > 1 else "\n".join(rows)


def section_forces(body: Body, nodal: Array, u: Array, factor: float, pressure: ArrayLike | None) -> SectionForces:
    """Return section forces at axis parameters ``u``, of any shape; at a knot those of the element above.

    Of a slender rod's stress in a single section little more than its bending is accurate: the axial strain is a small
    difference of large terms.  So the first Piola-Kirchhoff stress is integrated along the rod too, with the space's
    functions and quadrature: the nodal forces of the layers from the ``k``-th on add up to the mean of
    ``int P N dA`` with the weight ``psi_k'(u)``, ``psi_k = sum_{j >= k} R_j``, and these means balance supports and
    loads to round-off.  Forces here are the splines of one degree less than the displacement that have these means;
    moments likewise.  Jumps at supports or loads in a single section are smeared by the splines.

    Parameters
    ----------
    nodal
        Displacements of the body's nodes, shape ``(nodes, 3)``.
    factor, pressure
        As for `isorod.output.stress.first_piola`.
    """
    space, where = body.space, u.ravel()
    # The stress of a small-strain law balances in the positions at rest.
    moved = nodal if Laws.of(body.laws).objective else np.zeros_like(nodal)
    table = space.tabulate(0, 1)
    # The quadrature weights on the disk, up to a factor.
    area = table.weights[0, 0] * determinant(table.inverse[0, 0])
    rest, jacobian = space.rod.grid(table.xi, where)
    change, F = space.displacement(moved, table.xi, where)
    centroid = centroids(rest + change, np.linalg.norm(normals(jacobian, area), axis=2))

    layers = np.arange(space.axis.count) % space.layers
    places = (space.positions + moved).reshape(space.layers, -1, 3)[layers]
    origin = centroid.mean(axis=0)
    places = places - space.basis.is_control_point[:, None] * origin
    forces = _nodal_forces(body, nodal, factor, pressure)
    means = _beyond(forces[:, space.basis.is_control_point].sum(axis=1)), _beyond(np.cross(places, forces).sum(axis=1))
    centres = np.einsum("q,ql,jla->ja", area / area.sum(), table.section[:, 2], places)
    force, about_origin = _recovered(space.axis, means, centres, where)
    moment = about_origin - np.cross(centroid - origin, force)
    fields = force, moment, centroid, frames(F @ jacobian, area)
    return SectionForces(*(field.reshape(*u.shape, *field.shape[1:]) for field in fields))


def _nodal_forces(body: Body, nodal: Array, factor: float, pressure: ArrayLike | None) -> Array:
    """Return ``int P grad(S_l R_j) dV`` by the space's quadrature, shape ``(axis functions, section functions, 3)``."""
    space = body.space
    axis = space.axis
    forces = np.zeros((axis.count, space.layer_nodes, 3))
    for begin in range(0, axis.elements, _CHUNK):
        table = space.tabulate(begin, min(begin + _CHUNK, axis.elements))
        stress, _ = first_piola(body, nodal, table.xi, table.u.ravel(), factor, pressure)
        pull = stress.reshape(table.inverse.shape) @ table.inverse.swapaxes(-1, -2) * table.weights[..., None, None]
        plane = np.einsum("etqad,qdl->etla", pull[..., :2], table.section[:, :2])
        along = np.einsum("etqa,ql->etla", pull[..., 2], table.section[:, 2])
        by_element = np.einsum("etj,etla->ejla", table.axial, plane) + np.einsum("etj,etla->ejla", table.slopes, along)
        first = axis.first_function[begin : begin + table.elements]
        np.add.at(forces, first[:, None] + np.arange(axis.degree + 1), by_element)
    return forces


def _recovered(axis: Axis, means: tuple[Array, Array], centres: Array, u: Array) -> tuple[Array, Array]:
    """Return splines at ``u`` ``(t,)``, force and moment about the origin, with the given means.

    The moment of the nodal forces is their virtual work in a rotation of the layers beyond, whose positions
    ``sum_{j >= k} R_j x_j`` are not exactly ``psi_k x``: the work of distributed loads ``-f'`` on the difference is
    subtracted.
    """
    # Rational functions need more quadrature points than splines.
    points, weights = (one.ravel() for one in axis_points(axis, axis.degree + 6))
    first, values, slopes = axis.local(points)
    number = first[:, None] + np.arange(axis.degree)
    _, splines, rates = bspline.table(axis.knots[1:-1], axis.degree - 1, points)
    products = np.einsum("t,tk,tl->tkl", weights, _beyond(slopes.T).T, splines)
    rows, columns = np.broadcast_arrays(number[:, :, None], number[:, None, :])
    solve = splu(coo_matrix((products.ravel(), (rows.ravel(), columns.ravel()))).tocsc()).solve

    force = solve(means[0])
    near = centres[first[:, None] + np.arange(axis.degree + 1)]
    gaps = values[..., None] * (near - np.einsum("tj,tja->ta", values, near)[:, None])
    gaps = _beyond(gaps.swapaxes(0, 1)).swapaxes(0, 1)
    growth = np.einsum("t,tk,tka->ta", weights, rates, force[number])
    moment = means[1].copy()
    np.add.at(moment, number, np.cross(gaps, growth[:, None]))

    begin, local, _ = bspline.table(axis.knots[1:-1], axis.degree - 1, u)
    both = np.concatenate([force, solve(moment)], axis=1)[begin[:, None] + np.arange(axis.degree)]
    splines_at = np.einsum("tk,tkc->tc", local, both)
    return splines_at[:, :3], splines_at[:, 3:]


def _beyond(layers: Array) -> Array:
    """Return the sums of the entries ``(m, ...)`` from the second, the third ... on."""
    return np.asarray(np.cumsum(layers[::-1], axis=0)[-2::-1])


def centroids(places: Array, areas: Array) -> Array:
    """Return the centroids ``(t, 3)`` of points ``(t, q, 3)`` with areas ``(t, q)``."""
    return np.asarray(np.einsum("tq,tqa->ta", areas, places) / areas.sum(axis=1)[:, None])


def normals(jacobian: Array, area: Array) -> Array:
    """Return the normals of sections times the area of quadrature points, shape ``(t, q, 3)``."""
    return np.asarray(np.cross(jacobian[..., 0], jacobian[..., 1]) * area[:, None])


def frames(jacobian: Array, area: Array) -> Array:
    """Return normal, first and second direction of sections, shape ``(t, 3, 3)``."""
    normal = _unit(normals(jacobian, area).sum(axis=1))
    first = np.einsum("q,tqa->ta", area, jacobian[..., 0])
    first = _unit(first - np.einsum("ta,ta->t", first, normal)[:, None] * normal)
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
