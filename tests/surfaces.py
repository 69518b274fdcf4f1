"""Bodies whose sections have no control points on the surface that touches, and whose inner surfaces touch."""

from dataclasses import replace

import numpy as np
from conftest import straight
from touching import ACROSS, LAW, moved, ring

from isorod import Body, Contact, Cylinder, LinearElastic, Model, NeoHookean, Plane, Space
from isorod.model import Support

THREE = (0.0, 1.0, 2.0, 3.0)
HOLE = 0.6


def tube(degree=3, hole=HOLE, radius=1.0, height=6.0, breaks=THREE, **more):
    """A straight tube along z."""
    rod = straight(8, breaks=breaks, radius=radius, height=height).with_rings((hole, 1.0))
    return Space.paper(rod, section_degree=degree, quadrature="auto", **more)


def polynomials():
    """A rod by polynomials and a ring by control points that cuts into it, and obstacles."""
    first = Space.paper(straight(8, breaks=THREE, height=6.0), section_degree=4, quadrature="auto")
    second = Space.paper(ring((-5.6, 0.0, 3.1)), elements=8, degree=3)
    contacts = [
        Contact(0, 1, 100.0, points=(2, 4)),
        Contact(0, Plane((0.0, 0.95, 0.0), (0.0, -2.0, 0.0)), 50.0),
    ]
    return Model([Body(space, LAW) for space in (first, second)], contacts=contacts)


def layered():
    """A layered rod across a tube, both without control points."""
    core = straight(8, breaks=THREE, height=6.0).with_rings((0.0, 0.6, 1.0))
    across = moved(straight(8, breaks=THREE, radius=0.8, height=6.0), (-3.0, 1.75, 3.0), ACROSS).with_rings((0.5, 1.0))
    spaces = [Space.paper(rod, section_degree=3, quadrature="auto") for rod in (core, across)]
    return Model([Body(spaces[0], [LAW, LAW]), Body(spaces[1], LAW)], contacts=[Contact(0, 1, 80.0, points=(2, 5))])


def inside(order=2, gap=-0.03, tilt=0.04, **contact):
    """A rod in a tube, tilted, whose surface cuts into the tube's inner one by ``-gap``."""
    c, s = np.cos(tilt), np.sin(tilt)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    rod = straight(8, breaks=(0.0, 1.0, 2.0), radius=0.4, height=4.0)
    rod = moved(moved(rod, (0.0, 0.0, -2.0)), (0.02, HOLE - 0.4 - gap - 2.0 * s, 3.0), turn)
    spaces = [tube(), Space.paper(rod, order=order, section_points=16)]
    asked = {"penalty": 60.0, "points": (3, 5), "first_surface": "inner"} | contact
    return Model([Body(space, LAW) for space in spaces], contacts=[Contact(0, 1, **asked)])


def mandrel():
    """A tube about a rigid cylinder that cuts into its inner surface."""
    pin = Cylinder((0.05, 0.12, 0.0), (0.0, 0.02, 1.0), 0.5)
    return Model([Body(tube(), LAW)], contacts=[Contact(0, pin, 60.0, points=(3, 5), first_surface="inner")])


SCENES = [polynomials, layered, inside, mandrel]


def rubbing(model, friction):
    return replace(model, contacts=[replace(one, friction=friction) for one in model.contacts])


def shaken(model, size=0.004):
    """Return random displacements ``(dofs,)`` of a model, small beside its clearances."""
    return size * np.random.default_rng(0).standard_normal(model.dofs)


# A press fit: radii of the inside of the shaft, the fit, and the outside of the hub, the interference, and the laws.
INNER, FIT, OUTER, DELTA = 4.0, 10.0, 20.0, 0.01
SHAFT, HUB = LinearElastic(210e3, 0.3), LinearElastic(70e3, 0.33)


def fit_pressure(hollow):
    """Lame: the pressure of a shaft, with a hole or without, in a hub of its length, whose ends are free."""
    (a, b, c), (hub, shaft) = (FIT, OUTER, INNER if hollow else 0.0), (HUB, SHAFT)
    wide = ((b**2 + a**2) / (b**2 - a**2) + hub.nu) / hub.E
    slim = ((a**2 + c**2) / (a**2 - c**2) - shaft.nu) / shaft.E
    return DELTA / (a * (wide + slim))


def press_fit(hollow=False, slide=0.0, friction=0.0, degrees=(4, 4), reach=1.0, **contact):
    """A shaft in a hub, which may stand out and be pushed on by ``slide``."""
    hub = Space.paper(
        straight(8, radius=OUTER, height=10.0).with_rings((FIT / OUTER, 1.0)),
        section_degree=degrees[0],
        quadrature="auto",
    )
    size = FIT + DELTA
    rod = straight(8, radius=size, height=10.0 * reach)
    if hollow:
        rod = rod.with_rings((INNER / size, 1.0))
    shaft = Space.paper(rod, section_degree=degrees[1], quadrature="auto")
    supports = []
    for b, space in enumerate((hub, shaft)):
        # Held are a face, the mean of its displacements, and its turning: the coefficient of a coordinate.
        ways = np.outer(space.is_control_point[: space.layer_nodes], [0.0, 0.0, b * slide])
        supports.append(Support(np.arange(space.layer_nodes), "z", ways, body=b))
        supports += [Support([0], "xy", body=b), Support([1], "y", body=b)]
    asked = Contact(1, 0, second_surface="inner", friction=friction, **contact)
    return Model([Body(hub, HUB), Body(shaft, SHAFT)], supports, contacts=[asked])


def pin(degrees=(6, 8), push=0.02, clearance=0.01, friction=0.0, outer=6.0):
    """A pin in a wide hole of its own material, in plane strain, pushed sideways; patches are wide, half angle 45."""
    hole = Space.paper(
        straight(8, degree=1, radius=outer).with_rings((1.0 / outer, 1.0)),
        degree=1,
        section_degree=degrees[1],
        quadrature="20x4x1",
    )
    solid = straight(8, degree=1, radius=1.0 - clearance)
    round_it = Space.paper(solid, degree=1, section_degree=degrees[0], quadrature="12x4x1")
    supports = []
    for b, space in enumerate((hole, round_it)):
        means = [0, space.layer_nodes]
        supports.append(Support(np.arange(space.nodes), "z", body=b))
        supports += [Support(means, "xy", (0.0, -b * push, 0.0), body=b), Support(np.add(means, 1), "y", body=b)]
    law = LinearElastic(1.0, 0.3)
    asked = Contact(1, 0, second_surface="inner", friction=friction)
    return Model([Body(hole, law), Body(round_it, law)], supports, contacts=[asked])


def strip(space, press, **contact):
    """A section in plane strain between two planes, of which one moves by ``press``."""
    means = np.flatnonzero(space.is_control_point)[:1] if space.layer_nodes > space.is_control_point.sum() else []
    supports = [Support(np.arange(space.nodes), "z"), *(Support([k], "x") for k in means)]
    planes = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), Plane((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), travel=press)
    contacts = [Contact(0, plane, **contact) for plane in planes]
    return Model([Body(space, LinearElastic(1.0, 0.3))], supports, contacts=contacts)


def falling(degree=4, friction=0.0):
    """A hollow rod that is thrown on a plane, and a rod in it, which it takes along."""
    outer = straight(8, height=4.0, degree=1).with_rings((0.7, 1.0))
    inner = moved(straight(8, height=2.0, radius=0.6, degree=1), (0.0, 0.0, 1.0))
    spaces = [
        Space.paper(outer, elements=2, degree=2, section_degree=degree, quadrature="auto"),
        Space.paper(inner, elements=2, degree=2, section_degree=3, quadrature="auto"),
    ]
    contacts = [
        Contact(0, Plane((0.0, -1.05, 0.0), (0.0, 1.0, 0.0)), 1000.0, points=(3, 4), friction=friction),
        Contact(1, 0, 1000.0, points=(3, 4), second_surface="inner", friction=friction),
    ]
    model = Model([Body(space, NeoHookean(1000.0, 0.3), 1.0) for space in spaces], contacts=contacts)
    speeds = [np.outer(space.is_control_point, [0.2, -1.0, 0.0]) for space in spaces]
    return model, np.concatenate(speeds).ravel()
