"""How far stresses are from balance: a share by which they are wrong at the least."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from isorod.arrays import Array
from isorod.material.along_rod import Laws
from isorod.model.body import Body
from isorod.model.load import Pressure
from isorod.output.section_forces import normals, section_forces
from isorod.output.stress import first_piola
from isorod.tensors import determinant

if TYPE_CHECKING:
    from isorod.output.state import State

# What is this close to the surface is on it.
_ON = 1e-6

# Places round the section whose largest stress errors are a share of.
_ANGLES = 32


def share(state: "State", number: int, u: float, xi: Array) -> float:
    """Return the share of the stress at a place of a body by which it is out of balance.

    In its section (`imbalance`) and, on a surface on which nothing presses, by the traction that is left there, over
    the largest stress round the section.  Zero where contact presses on the body, of which neither is known.
    """
    model = state.model
    if any(body == number for one in model.contacts for body, _ in one.sides):
        return 0.0
    body, fields = model.bodies[number], state.fields(number)
    found = imbalance(body, fields["displacement"], np.array([u]), state.factor, fields.get("pressure"))[0]
    hole, radius = body.space.rod.rings[0], float(np.hypot(*xi))
    pressed = any(isinstance(one, Pressure) and one.body == number for one in model.loads)
    if pressed or (radius < 1.0 - _ON and not (hole and radius < hole + _ON)):
        return float(found)
    angle = 2.0 * np.pi * np.arange(_ANGLES) / _ANGLES
    largest = state.stress(number, u, radius * np.stack([np.cos(angle), np.sin(angle)], axis=1), "von Mises").max()
    _, jacobian = body.space.rod.grid(xi[None], np.array([u]))
    moved = state.deformation_gradient(number, u, xi) @ jacobian[0, 0]
    normal = np.cross(xi[0] * moved[:, 1] - xi[1] * moved[:, 0], moved[:, 2])
    traction = state.stress(number, u, xi) @ normal / np.linalg.norm(normal)
    return float(max(found, np.linalg.norm(traction) / largest)) if largest > 0.0 else 0.0


def imbalance(body: Body, nodal: Array, u: Array, factor: float, pressure: ArrayLike | None) -> Array:
    """Return which share of the stress in single sections is not in balance with `section_forces`, shape ``(t,)``.

    It is what force and moment of that stress lack, the latter over the arm that a bar's bending has, over the sum of
    the sizes of the forces on all parts of the section: a share by which the stress there is wrong at the least.

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
