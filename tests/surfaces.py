"""Bodies whose sections have no control points on the surface that touches, and whose inner surfaces touch."""

from dataclasses import replace

import numpy as np
from conftest import straight
from touching import ACROSS, LAW, moved, ring

from isorod import Body, Contact, Cylinder, Model, Plane, Space

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
