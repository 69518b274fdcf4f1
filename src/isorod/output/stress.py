"""First Piola-Kirchhoff, Cauchy and von Mises stress."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.errors import InputError
from isorod.model.body import Body
from isorod.output.words import Component
from isorod.tensors import determinant


def first_piola(
    body: Body,
    nodal: ArrayLike,
    xi: ArrayLike,
    u: ArrayLike,
    factor: float = 1.0,
    pressure: ArrayLike | None = None,
) -> tuple[Array, Array]:
    """Return the first Piola-Kirchhoff stress and the deformation gradient at a grid of points.

    Parameters
    ----------
    nodal
        Displacements of the body's nodes, shape ``(nodes, 3)``.
    xi, u
        Disk points ``(q, 2)`` and axis parameters ``(t,)``; a knot belongs to the element above, a radius where two
        rings meet to the outer one.
    factor
        Load factor, which scales a muscle's activation.
    pressure
        Pressure coefficients of a body with the mixed formulation (`isorod.statics.Equilibrium.pressures`).

    Returns
    -------
    stress, deformation_gradient
        Both of shape ``(t, q, 3, 3)``; force per reference area.

    Raises
    ------
    InputError
        If a mixed body's pressure is missing.
    """
    _, F = body.space.displacement(nodal, xi, u)
    laws = body.laws_at(np.asarray(u, dtype=float), xi).at(factor)
    if body.pressures is None:
        return laws.stress(F), F
    if pressure is None:
        raise InputError("stress of a body with the mixed formulation: its pressure is missing")
    from isorod.material.along_rod import shear_laws, volume_change

    p = body.pressures.evaluate(pressure, xi, u)
    return shear_laws(laws).stress(F) + p[..., None, None] * volume_change(laws, F)[1], F


def cauchy(
    body: Body,
    nodal: ArrayLike,
    xi: ArrayLike,
    u: ArrayLike,
    factor: float = 1.0,
    pressure: ArrayLike | None = None,
) -> Array:
    """Return the Cauchy stress ``P F^T / det F``, force per current area, as `first_piola` does."""
    stress, F = first_piola(body, nodal, xi, u, factor, pressure)
    return np.einsum("tqaA,tqbA->tqab", stress, F) / determinant(F)[..., None, None]


def known(
    body: Body, nodal: ArrayLike, xi: ArrayLike, u: ArrayLike, factor: float, names: Sequence[str]
) -> dict[str, Array]:
    """Return state variables of laws with memory at a grid of points (`first_piola`), shape ``(t, q, count)`` each.

    They follow the history of deformation of each point, and are NaN where a law has no such variable.
    """
    _, F = body.space.displacement(nodal, xi, u)
    laws = body.laws_at(np.asarray(u, dtype=float), xi).advanced(F, factor)
    return {name: laws.state(name, F.shape[:-2]) for name in names}


def of_six(values: Array, name: str) -> Array:
    """Return a scalar of symmetric tensors ``(..., 6)``, components 00, 01, 02, 11, 12, 22, shape ``(...)``.

    Parameters
    ----------
    name
        A component, ``"xx"`` ... ``"yz"``, or ``"equivalent"``, ``sqrt(2/3 e:e)``.
    """
    if name == "equivalent":
        return np.sqrt(2.0 / 3.0 * (values**2) @ np.array([1.0, 2.0, 2.0, 1.0, 2.0, 1.0]))
    return np.asarray(values[..., ("xx", "xy", "xz", "yy", "yz", "zz").index(name)])


def von_mises(stress: Array) -> Array:
    """Return ``sqrt(3/2 s:s)`` of the stress deviator ``s``, shape ``stress.shape[:-2]``."""
    mean = np.trace(stress, axis1=-2, axis2=-1) / 3.0
    deviator = stress - mean[..., None, None] * np.eye(3)
    return np.sqrt(1.5 * np.sum(deviator**2, axis=(-2, -1)))


def component(stress: Array, name: Component, normal: Array) -> Array:
    """Return a scalar of Cauchy stresses ``(..., 3, 3)``, shape ``(...)``.

    Parameters
    ----------
    name
        The scalar (`Component`).
    normal
        Normals of the sections, of any length, shape ``(..., 3)``; used by ``along`` and ``shear``.
    """
    if name == "von_mises":
        return von_mises(stress)
    if name in ("max_principal", "min_principal"):
        return np.asarray(np.linalg.eigvalsh(stress)[..., -1 if name == "max_principal" else 0])
    if name in ("along", "shear"):
        unit = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        traction = np.einsum("...ab,...b->...a", stress, unit)
        along = np.einsum("...a,...a->...", traction, unit)
        return along if name == "along" else np.linalg.norm(traction - along[..., None] * unit, axis=-1)
    row, column = ("xyz".index(letter) for letter in name)
    return stress[..., row, column]
