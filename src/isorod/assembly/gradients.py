"""Gradients of displacements at quadrature points, and stresses there on disk x axis, some elements at once."""

import numpy as np

from isorod.arrays import Array, Index
from isorod.assembly.element_kernel import pull_stress, push_forward
from isorod.assembly.field_kernel import add_resultants
from isorod.space.space import Table


def coefficients(axial: Array, slopes: Array, nodal: Array) -> tuple[Array, Array]:
    """Return the section coefficients of nodal displacements ``(E, l, n, 3)``, and their derivatives along the axis.

    Shapes are ``(3 E t, n)``, component by component of each place; functions along the axis and their derivatives have
    shapes ``(E, t, l)``.
    """
    elements, _, n, _ = nodal.shape
    values = np.ascontiguousarray(np.swapaxes(nodal, 2, 3)).reshape(elements, -1, 3 * n)
    return (axial @ values).reshape(-1, n), (slopes @ values).reshape(-1, n)


def displacement_gradients(table: Table, nodal: Array) -> Array:
    """Return ``du/dx``, shape ``(E, t, q, 3, 3)``, of nodal displacements ``(E, l, n, 3)``.

    The sums are factorised: along the axis first, for each section function, then over these.
    """
    elements, along, points = table.weights.shape
    places = elements * along
    values, slopes = coefficients(table.axial, table.slopes, nodal)
    # Derivatives by both coordinates of the disk, one behind the other, and by the axis'.
    across = np.concatenate([table.section[:, 0], table.section[:, 1]])
    plane, axis = values @ across.T, slopes @ np.ascontiguousarray(table.section[:, 2]).T
    out = np.empty((places * points, 3, 3))
    inverse = np.ascontiguousarray(table.inverse).reshape(-1, 9)
    push_forward(inverse, plane.reshape(places, 3, -1), axis.reshape(places, 3, -1), out)
    return out.reshape(elements, along, points, 3, 3)


def deformation_gradients(table: Table, nodal: Array) -> Array:
    """Return ``F = 1 + du/dx`` (`displacement_gradients`)."""
    F = displacement_gradients(table, nodal)
    F += np.eye(3)
    return F


def pulled_stress(table: Table, stress: Array) -> tuple[Array, Array]:
    """Return stresses ``(E, t, q, 3, 3)`` on disk x axis times the volume, a row each of each place and component.

    Those of the directions across, one behind the other, ``(3 E t, 2 q)``, and those along the axis, ``(3 E t, q)``.
    """
    points = table.weights.shape[2]
    weights = np.ascontiguousarray(table.weights).reshape(-1, points)
    inverse, places = np.ascontiguousarray(table.inverse).reshape(-1, 9), weights.shape[0]
    across, along = np.empty((places, 3, 2 * points)), np.empty((places, 3, points))
    pull_stress(weights, inverse, np.ascontiguousarray(stress).reshape(-1, 3, 3), across, along)
    return across.reshape(3 * places, -1), along.reshape(3 * places, -1)


def add_stress(table: Table, stress: Array, starts: Index, forces: Array) -> None:
    """Add the nodal forces of stresses ``(E, t, q, 3, 3)`` to those of layers that begin at ``starts`` ``(E, l)``."""
    across, along = pulled_stress(table, stress)
    functions = np.concatenate([table.section[:, 0], table.section[:, 1]])
    sums = across @ functions, along @ np.ascontiguousarray(table.section[:, 2])
    add_resultants(table, *sums, 0, table.elements, starts, forces)
