"""Cauchy and von Mises stress."""

import numpy as np
from numpy.typing import ArrayLike

from isorod.disk import Array
from isorod.model import Body
from isorod.small import determinant


def cauchy(body: Body, nodal: ArrayLike, xi: ArrayLike, u: ArrayLike) -> Array:
    """Return the Cauchy stress ``P F^T / det F`` at a grid of points.

    Parameters
    ----------
    nodal
        Displacements of the body's nodes, shape ``(nodes, 3)``.
    xi, u
        Disk points ``(q, 2)`` and axis parameters ``(t,)``; at a knot the element above it is meant.

    Returns
    -------
    Array of shape ``(t, q, 3, 3)``, force per current area.
    """
    _, F = body.space.displacement(nodal, xi, u)
    return np.einsum("tqaA,tqbA->tqab", body.material.stress(F), F) / determinant(F)[..., None, None]


def von_mises(stress: Array) -> Array:
    """Return ``sqrt(3/2 s:s)`` of the stress deviator ``s``, shape ``stress.shape[:-2]``."""
    mean = np.trace(stress, axis1=-2, axis2=-1) / 3.0
    deviator = stress - mean[..., None, None] * np.eye(3)
    return np.sqrt(1.5 * np.sum(deviator**2, axis=(-2, -1)))
