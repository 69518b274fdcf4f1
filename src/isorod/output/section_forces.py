"""Forces and moments that a rod carries through its sections, from the stress."""

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

# Elements that are evaluated at a time: memory stays small.
_CHUNK = 32


@dataclass(frozen=True, eq=False)
class SectionForces:
    """What goes through sections of a rod: the action of what lies beyond (greater ``u``) on what lies before.

    The directions of a section are its normal, which points to greater ``u``, and two in the section: the first where
    the disk's first axis ``xi_1`` points in the mean, the second normal to both; they move with the section.  At the
    end of a rod force and moment are those that support or load exert there, at its start those of the support with
    the opposite sign.

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
    """Return what goes through sections at axis parameters ``u``, of any shape; at a knot the element above is meant.

    Of a slender rod's stress at a single section little more than its bending is right: the axial strain is a small
    difference of large terms.  So the first Piola-Kirchhoff stress is integrated over the rod too, with the space's own
    functions and quadrature: the nodal forces of the layers from the ``k``-th on add up to the mean of
    ``int P N dA`` with the weight ``psi_k'(u)``, ``psi_k = sum_{j >= k} R_j``, and these means are in balance with
    supports and loads to the last digit.  Forces here are the splines of one degree less than the displacement that
    have these means; moments likewise.  Where a support or a load at a single section lets them jump, splines smear it.

    Parameters
    ----------
    nodal
        Displacements of the body's nodes, shape ``(nodes, 3)``.
    factor, pressure
        As for `isorod.output.stress.first_piola`.
    """
    space, where = body.space, u.ravel()
    # The stress of a linear elastic law balances in the places at rest.
    moved = nodal if Laws.of(body.laws).objective else np.zeros_like(nodal)
    table = space.tabulate(0, 1)
    # The weights on the disk, but for a factor.
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
    found = force, moment, centroid, frames(F @ jacobian, area)
    return SectionForces(*(one.reshape(*u.shape, *one.shape[1:]) for one in found))


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
        own = np.einsum("etj,etla->ejla", table.axial, plane) + np.einsum("etj,etla->ejla", table.slopes, along)
        first = axis.first_function[begin : begin + table.elements]
        np.add.at(forces, first[:, None] + np.arange(axis.degree + 1), own)
    return forces


def _recovered(axis: Axis, means: tuple[Array, Array], centres: Array, u: Array) -> tuple[Array, Array]:
    """Return splines at ``u`` ``(t,)``, force and moment about the origin, that have the means given.

    The sum of the nodal forces' moments is that of the work on a rotation of the layers beyond, whose places
    ``sum_{j >= k} R_j x_j`` are not quite ``psi_k x``: what loads along the rod, ``-f'``, do there is taken off.
    """
    # Rational functions want more points than splines.
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
    found = np.einsum("tk,tkc->tc", local, both)
    return found[:, :3], found[:, 3:]


def _beyond(layers: Array) -> Array:
    """Return the sums of the entries ``(m, ...)`` from the first, the second ... on, those of all left out."""
    return np.asarray(np.cumsum(layers[::-1], axis=0)[-2::-1])


def centroids(places: Array, shares: Array) -> Array:
    """Return the centroids ``(t, 3)`` of points ``(t, q, 3)`` with shares of area ``(t, q)``."""
    return np.asarray(np.einsum("tq,tqa->ta", shares, places) / shares.sum(axis=1)[:, None])


def normals(jacobian: Array, area: Array) -> Array:
    """Return the normals of a section times its share of area at quadrature points, shape ``(t, q, 3)``."""
    return np.asarray(np.cross(jacobian[..., 0], jacobian[..., 1]) * area[:, None])


def frames(jacobian: Array, area: Array) -> Array:
    """Return normal, first and second direction of sections, shape ``(t, 3, 3)``."""
    normal = _unit(normals(jacobian, area).sum(axis=1))
    first = np.einsum("q,tqa->ta", area, jacobian[..., 0])
    first = _unit(first - np.einsum("ta,ta->t", first, normal)[:, None] * normal)
    return np.stack([normal, first, np.cross(normal, first)], axis=1)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
