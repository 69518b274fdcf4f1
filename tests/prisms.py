"""What the tests of loads and of supports share: prisms, slender ones without locking, and other spaces."""

import numpy as np

from isorod import NeoHookean, Space, circle, straight
from isorod.scenes.spring import Spring

LAW = NeoHookean(1.0, 0.3)


def prism(length, section=None, **space):
    return Space.paper(straight(length).sweep(circle(4) if section is None else section), **space)


def slender(length, elements=8, degree=3):
    """Polynomials across, C0 elements with as many points as their degree along: no locking."""
    return prism(length, elements=elements, degree=degree, continuity=0, section_degree=3, quadrature=f"4x5x{degree}")


def line(space):
    """Nodes of the centre line of a space of polynomials, ends left out."""
    return np.arange(1, space.layers - 1) * space.layer_nodes


def tip(space, solution):
    return space.displacement(solution.model.nodal(solution.displacement), [[0.0, 0.0]], [1.0])[0][0, 0]


SPACES = {
    "control points": lambda: Space.paper(Spring(helix="paper", coils=1, section_points=4).rod()),
    "order 2": lambda: Space.paper(Spring(helix="paper", coils=1, section_points=4).rod(), order=2, degree=3),
    "polynomials": lambda: prism(6.0, elements=3, section_degree=3),
}
