"""Imbalance of stresses: a lower bound of their relative error."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.geometry.disk import circle
from isorod.material.along_rod import Laws
from isorod.model.body import Body
from isorod.model.load import Pressure
from isorod.output.section_forces import normals, section_forces
from isorod.output.stress import first_piola
from isorod.tensors import determinant

if TYPE_CHECKING:
    from isorod.output.state import State

# Distance in disk radii within which points are on the surface.
_ON = 1e-6

# Points round the section whose largest stress errors are relative to.
_ANGLES = 32


def relative_imbalance(state: "State", number: int, u: float, xi: Array) -> float:
    """Return the relative imbalance of the stress at a place of a body.

    It is the imbalance of the section (`imbalance`) or, on a free surface, the traction left there over the largest
    stress round the section if that is larger.  Zero for bodies with contact, where neither is known.
    """
    model = state.model
    if any(body == number for contact in model.contacts for body, _ in contact.sides):
        return 0.0
    body, fields = model.bodies[number], state.fields(number)
    error = imbalance(body, fields["displacement"], np.array([u]), state.factor, fields.get("pressure"))[0]
    hole, radius = body.space.rod.rings[0], float(np.hypot(*xi))
    pressed = any(isinstance(load, Pressure) and load.body == number for load in model.loads)
    if pressed or (radius < 1.0 - _ON and not (hole and radius < hole + _ON)):
        return float(error)
    largest = state.stress(number, u, radius * circle(_ANGLES), "von Mises").max()
    _, jacobian = body.space.rod.grid(xi[None], np.array([u]))
    moved = state.deformation_gradient(number, u, xi) @ jacobian[0, 0]
    normal = np.cross(xi[0] * moved[:, 1] - xi[1] * moved[:, 0], moved[:, 2])
    traction = state.stress(number, u, xi) @ normal / np.linalg.norm(normal)
    return float(max(error, np.linalg.norm(traction) / largest)) if largest > 0.0 else 0.0


def imbalance(body: Body, nodal: Array, u: Array, factor: float, pressure: ArrayLike | None) -> Array:
    """Return the relative imbalance of the stress in sections with `section_forces`, shape ``(t,)``.

    It is the error of the stress's resultant force and moment, the latter over the mean arm of the forces, relative to
    the sum of the magnitudes of the forces on all parts of the section: a lower bound of the error of the stress.

    Parameters
    ----------
    u
        Axis parameters, shape ``(t,)``.
    """
    space, table = body.space, body.space.tabulate(0, 1)
    area = table.weights[0, 0] * determinant(table.inverse[0, 0])
    area *= np.pi * (1.0 - space.rod.rings[0] ** 2) / area.sum()
    moved = nodal if Laws.of(body.laws).objective else np.zeros_like(nodal)
    rest, jacobian = space.rod.grid(table.xi, u)
    change, _ = space.displacement(moved, table.xi, u)
    stress, _ = first_piola(body, nodal, table.xi, u, factor, pressure)
    pull = np.einsum("tqaA,tqA->tqa", stress, normals(jacobian, area))
    carried = section_forces(body, nodal, u, factor, pressure)
    arms = rest + change - carried.centroid[:, None]
    force = np.linalg.norm(pull.sum(axis=1) - carried.force, axis=1)
    moment = np.linalg.norm(np.cross(arms, pull).sum(axis=1) - carried.moment, axis=1)
    sizes = np.linalg.norm(pull, axis=2)
    arm = np.einsum("tq,tq->t", sizes, np.linalg.norm(arms, axis=2)) / sizes.sum(axis=1)
    return np.asarray((force + moment / arm) / sizes.sum(axis=1))
