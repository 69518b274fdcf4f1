"""Bodies that touch, what contact says of them, and that searches left out change nothing of it."""

from typing import NamedTuple

import numpy as np
from conftest import straight
from scipy.sparse import coo_matrix

from isorod import Axis, LinearElastic, NeoHookean, Rod, Space, circle, helix
from isorod.contact import force_kernel, lift_kernel
from isorod.contact.tables import pack
from isorod.model import Body, Contact, Cylinder, Model, Plane, Support

LAW = NeoHookean(1.0, 0.3)
STIFF = NeoHookean(1000.0, 0.3)
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
    return among([first, second], *contacts)


def crease():
    """A thin rod that lies in the hollow of a bent one and touches it along the kink."""
    # An arc, and a point, in the middle below.
    rod = straight(4, radius=0.4, height=2.0)
    thin = moved(rod, (-1.0, 1.3, 0.0), ACROSS)
    return among([Space.paper(thin), Space.paper(bent())], Contact(0, 1, 10.0, points=(5, 12)))


def among(spaces, *contacts):
    return Model([Body(space, LAW) for space in spaces], contacts=list(contacts))


def across(shift, points=(3, 3)):
    """A rod along z, and a thin one along x."""
    rod = straight(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    thin = moved(straight(6, radius=0.5, height=4.0), shift, ACROSS)
    return among([Space.paper(rod), Space.paper(thin)], Contact(0, 1, 10.0, points=points))


def bar(length, turn=None, lift=0.0):
    """A bar of radius 1 about the origin, along z or turned."""
    rod = straight(8, breaks=(0.0, 1.0, 2.0), height=length)
    centered = moved(moved(rod, (0.0, 0.0, -0.5 * length)), (0.0, lift, 0.0), turn)
    return Space.paper(centered, degree=2, order=2, quadrature="auto")


def bars(press, gap=0.0, section_points=None, **contact):
    """Two crossing bars of radius 1 and length 8, clamped; the ends of the second are pressed down on the first."""
    rod = moved(straight(8, breaks=(0.0, 1.0, 2.0, 3.0, 4.0), height=8.0), (0.0, 0.0, -4.0))
    low, high = (
        Space.paper(one, degree=3, order=2, quadrature="auto", section_points=section_points)
        for one in (rod, moved(rod, (0.0, 2.0 + gap, 0.0), ACROSS))
    )
    supports = [Support.end(low, "start"), Support.end(low, "end")]
    supports += [Support.end(high, end, displacement=(0.0, -press, 0.0), body=1) for end in ("start", "end")]
    return Model([Body(low, STIFF), Body(high, STIFF)], supports, contacts=[Contact(0, 1, **contact)])


def strip(n=64, law=None, radial="8x1x1", press=0.02, **contact):
    """A cylinder of radius 1 in plane strain that is pressed on a rigid plane by its back; half width about 0.1.

    One element of degree 1 along the axis, all axial displacements held: sections move in their plane and stay alike.
    The surface nodes within 1.2 rad of the top are pressed down, far from the contact.
    """
    space = Space.paper(straight(8, degree=1), degree=1, order=2, section_points=n, quadrature=radial)
    angle = space.turn + 2.0 * np.pi / n * np.arange(n)
    top = np.flatnonzero(np.cos(angle - 0.5 * np.pi) > np.cos(1.2))
    back = np.concatenate([top, space.layer_nodes + top])
    supports = [Support(np.arange(space.nodes), "z"), Support(back, "xy", (0.0, -press, 0.0))]
    plane = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    law = LinearElastic(1.0, 0.3) if law is None else law
    return Model([Body(space, law)], supports, contacts=[Contact(0, plane, **contact)])


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
    """Add forces on the model's nodes, through control points where surfaces have others."""
    behind = ((0, len(packed.before) - len(positions)), (0, 0))
    places, found = np.pad(positions, behind), np.pad(forces, behind)
    lift_kernel.lift(packed, places)
    said = Pressing(*force_kernel.add_forces(packed, places, found))
    lift_kernel.lower(packed, found)
    forces[:] = found[: len(forces)]
    return said


def forces_at(model, displacement):
    packed = pack(model)
    forces = np.zeros_like(reference(model))
    outcome = add_forces(packed, reference(model) + displacement.reshape(-1, 3), forces)
    return packed, outcome, forces


def stiffness(operator, displacement):
    """Return its tangent at a displacement as a matrix."""
    values, dofs = operator.tangent(displacement), operator.model.dofs
    return coo_matrix((values, (operator.rows, operator.columns)), shape=(dofs, dofs)).tocsr()


def assert_tangent(operator, displacement, step, count, error, symmetric=True):
    """Its tangent is the derivative of its forces in some random directions, and symmetric."""
    K = stiffness(operator, displacement)
    assert bool(abs(K - K.T).max() < 1e-13 * abs(K).max()) is symmetric
    rng = np.random.default_rng(5)
    for _ in range(count):
        v = rng.standard_normal(displacement.size)
        sides = [operator.forces(displacement + side * step * v)[0] for side in (-1.0, 1.0)]
        change = (sides[0] - sides[1]) / (2.0 * step)
        assert np.abs(K @ v - change).max() < error * np.abs(change).max()
        np.testing.assert_allclose(operator.product(v), K @ v, atol=1e-12 * np.abs(change).max())


def assert_as_fresh(packed, fresh, x, deepest=-np.inf, rtol=1e-9):
    """What is found with searches left out is what all searches find, but where bodies are deep in each other.

    There a point may have two closest points.  Returns whether they touch, and how many searches were left out.
    """
    kept, expected = np.zeros_like(x), np.zeros_like(x)
    fresh.forget()
    fresh.clear[:] = fresh.listed[1] = -np.inf
    until = packed.clear.copy()
    found, known = add_forces(packed, x, kept), add_forces(fresh, x, expected)
    if known.deepest > deepest:
        np.testing.assert_allclose(found, known, rtol=rtol, atol=1e-12)
        np.testing.assert_allclose(kept, expected, atol=0.1 * rtol * (1.0 + np.abs(expected).max()))
    return np.array([known.deepest > deepest and known.force > 0.0, (until > packed.travel[0]).sum()])


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
