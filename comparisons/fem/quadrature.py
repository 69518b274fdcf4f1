"""Quadrature rules on the brick that dolfinx does not bring along."""

from typing import Any

import numpy as np

from isorod.errors import InputError
from meshes.mesh import Array

RULES = ("irons14",)


def measure(rule: int | str) -> dict[str, Any]:
    """Return the metadata of a UFL measure: a rule of dolfinx's own by its degree, or one of `RULES` by name."""
    if not isinstance(rule, str):
        return {"quadrature_degree": rule}
    if rule != "irons14":
        raise InputError(f"quadrature: got {rule!r}, need a degree or one of {', '.join(RULES)}")
    points, weights = irons14()
    # Lists: UFL compares and prints the metadata to name the form.
    return {
        "quadrature_rule": "custom",
        "quadrature_degree": 5,
        "quadrature_points": points.tolist(),
        "quadrature_weights": weights.tolist(),
    }


def irons14() -> tuple[Array, Array]:
    """Return the 14-point rule of degree 5 on the unit cube, about half the points of the Gauss rule of that degree.

    Irons, "Quadrature rules for brick based finite elements", Int. J. Numer. Methods Eng. 3 (1971) 293-294.
    """
    axes = np.sqrt(19.0 / 30.0) * np.concatenate([np.eye(3), -np.eye(3)])
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.concatenate([axes, np.sqrt(19.0 / 33.0) * signs])
    weights = np.concatenate([np.full(6, 320.0 / 361.0), np.full(8, 121.0 / 361.0)])
    return 0.5 * (points + 1.0), weights / 8.0
