"""Projection of displacements from one space of a rod to another."""

import numpy as np

from isorod.arrays import Array
from isorod.geometry.quadrature import axis_points
from isorod.space.space import Space


def transfer(nodal: Array, old: Space, new: Space) -> Array:
    """Return nodal displacements on a new space, the least-squares fit at its quadrature points to those on an old one.

    The transfer to a space that contains the old one is exact.

    Parameters
    ----------
    nodal
        Nodal displacements, shape ``(nodes, 3)`` of the old space.
    old, new
        Of the same rod, refined or not.
    """
    xi, _ = new.section_rule(new.rule)
    u = axis_points(new.axis, new.axis.degree + 1)[0].ravel()
    displacements = old.displacement(nodal, xi, u)[0]
    first, near, _ = new.axis.local(u)
    along = np.zeros((u.size, new.layers))
    columns = (first[:, None] + np.arange(new.axis.degree + 1)) % new.layers
    np.add.at(along, (np.arange(u.size)[:, None], columns), near)
    layers = np.linalg.lstsq(along, displacements.reshape(u.size, -1), rcond=None)[0].reshape(new.layers, -1, 3)
    section = new.basis.functions(xi)[0]
    coefficients = np.linalg.lstsq(section, layers.swapaxes(0, 1).reshape(len(xi), -1), rcond=None)[0]
    return np.ascontiguousarray(coefficients.reshape(-1, new.layers, 3).swapaxes(0, 1)).reshape(-1, 3)
