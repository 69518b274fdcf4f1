"""Outlines of displaced sections."""

import numpy as np

from isorod.arrays import Array
from isorod.geometry.disk import circle
from isorod.space.space import Space


def outlines(space: Space, positions: Array, u: Array, count: int, slope: bool = False) -> Array:
    """Return points round sections, or their derivatives by the axis parameter.

    Parameters
    ----------
    space, positions
        Space of a body, and its nodes' positions, shape ``(nodes, 3)``.
    u, count
        Axis parameters, shape ``(t,)``, and the number of points at equal angles.
    slope
        Whether derivatives are returned.

    Returns
    -------
    Array of shape ``(t, count, 3)``.
    """
    values = space.basis.functions(circle(count))[0]
    first, axial, slopes = space.axis.local(u)
    layers = (first[:, None] + np.arange(space.axis.degree + 1)) % space.layers
    near = positions.reshape(space.layers, space.layer_nodes, 3)[layers]
    return np.asarray(values @ np.einsum("tj,tjia->tia", slopes if slope else axial, near))
