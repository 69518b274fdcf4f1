"""Bodies that touch: a rod and a ring with obstacles, a rod in the crease of a bent one, and what contact says."""

from typing import NamedTuple

import numpy as np
from conftest import straight
from scipy.sparse import coo_matrix

from isorod.contact import force_kernel
from isorod.contact.tables import pack
from isorod.geometry.axis import Axis
from isorod.geometry.center_line import helix
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Cylinder, Model, Plane
from isorod.space import Space

LAW = NeoHookean(1.0, 0.3)
RADIUS = 0.8  # of the ring's wire
RING = 4.0  # of the ring


def moved(rod, shift, turn=None):
    return Rod(
        rod.axis,
        rod.control_points @ (np.eye(3) if turn is None else turn.T) + np.asarray(shift, dtype=float),
        rod.closed,
    )


def ring(shift=(0.0, 0.0, 0.0)):
    return moved(helix(RING, 0.0, 1, 4).sweep(circle(8, RADIUS), closed=True), shift)


def bent(angle=0.6):
    """Two straight pieces that meet at a kink in u = 1: a degree-1 axis in the y-z plane."""
    centers = np.array(
        [[0.0, 2.0 * np.sin(angle), -2.0 * np.cos(angle)], [0, 0, 0], [0, 2.0 * np.sin(angle), 2.0 * np.cos(angle)]]
    )
    return Rod.sweep(circle(8), Axis(1, np.array([0.0, 0, 1, 2, 2]), np.ones(3)), centers)


ACROSS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # z to x


def pair():
    """A straight rod along z, section refined and of order 2, and a ring that cuts into it, both with obstacles."""
    rod = straight(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    first = Space.paper(rod, section_points=16, order=2)
    second = Space.paper(ring((-RING - 1.6, 0.0, 3.1)), elements=8, degree=3)
    contacts = [
        Contact(0, 1, 100.0, points=(3, 4)),
        Contact(0, Plane((0.0, 0.95, 0.0), (0.0, -2.0, 0.0)), 50.0),
        Contact(1, Cylinder((-9.0, 0.0, 3.0), (0.0, 1.0, 0.0), 0.5), 70.0),
    ]
    return Model([Body(first, LAW), Body(second, LAW)], contacts=contacts)


def crease():
    """A thin rod that lies in the hollow of a bent one and touches it along the kink."""
    # An arc, and a point, in the middle below.
    rod = straight(4, radius=0.4, height=2.0)
    thin = moved(rod, (-1.0, 1.3, 0.0), ACROSS)
    return Model(
        [Body(Space.paper(thin), LAW), Body(Space.paper(bent()), LAW)], contacts=[Contact(0, 1, 10.0, points=(5, 12))]
    )


def reference(model):
    return np.concatenate([body.space.positions for body in model.bodies])


def shaken(model, size=0.02):
    """Return random displacements ``(dofs,)`` of a model."""
    return size * np.random.default_rng(0).standard_normal(model.dofs)


class Pressing(NamedTuple):
    """What contact says, by name."""

    energy: float
    force: float
    area: float
    deepest: float


def add_forces(packed, positions, forces):
    return Pressing(*force_kernel.add_forces(packed, positions, forces))


def forces_at(model, displacement):
    packed = pack(model)
    forces = np.zeros_like(reference(model))
    outcome = add_forces(packed, reference(model) + displacement.reshape(-1, 3), forces)
    return packed, outcome, forces


def assert_tangent(operator, displacement, dofs, step, count, error):
    """Its tangent at a displacement is symmetric, and the derivative of its forces in some random directions."""
    values = operator.tangent(displacement)
    K = coo_matrix((values, (operator.rows, operator.columns)), shape=(dofs, dofs)).tocsr()
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()
    rng = np.random.default_rng(5)
    for _ in range(count):
        v = rng.standard_normal(dofs)
        change = (operator.forces(displacement - step * v)[0] - operator.forces(displacement + step * v)[0]) / (
            2.0 * step
        )
        assert np.abs(K @ v - change).max() < error * np.abs(change).max()


def crossing(told=""):
    """Return the file of a scene of two bars that cross; what is told, such as a space, is of the upper one."""
    return f"""
[rod.low]
curve = {{straight = {{start = [0.0, 0.0, -2.0], end = [0.0, 0.0, 2.0]}}}}
section = {{circle = 1.0}}
law = {{LinearElastic = {{E = 1000.0, nu = 0.3}}}}

[rod.high]
curve = {{straight = {{start = [-2.0, 2.0, 0.0], end = [2.0, 2.0, 0.0]}}}}
section = {{circle = 1.0}}
law = {{LinearElastic = {{E = 1000.0, nu = 0.3}}}}
{told}

[contact.bars]
first = "low"
second = "high"

[analysis.statics]
"""
