"""What the tests of explicit dynamics share: a bar along z, how it is thrown, and its momenta."""

from dataclasses import replace

import numpy as np

from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.space import Space

E, DENSITY, LENGTH = 100.0, 2.0, 4.0
SPEED = np.sqrt(E / DENSITY)


def bar(cylinder, held="xyz", nu=0.3, elements=4, degree=2, law=None, contacts=(), radius=1.0, quadrature="auto"):
    """A cylinder along z, one end of which may be held."""
    space = Space.paper(
        cylinder(4, radius=radius, height=LENGTH), elements=elements, degree=degree, quadrature=quadrature
    )
    supports = [Support.end(space, "start", held)] if held else []
    return Model([Body(space, law or NeoHookean(E, nu), DENSITY)], supports, contacts=contacts)


def field(model, function):
    """All degrees of freedom of a vector field of the position that is linear in it."""
    nodes = model.bodies[0].space
    return (function(nodes.positions) * nodes.is_carrier[:, None]).ravel()


def velocities(model, seed=0, size=1.0):
    """Random velocities of all degrees of freedom that are not held: all modes at once."""
    values = size * np.random.default_rng(seed).standard_normal(model.dofs)
    values[model.held] = 0.0
    return values


def momenta(model, velocity):
    """Consistent mass times velocities ``(o, dofs)``, by nodes that move with their rod: shape ``(o, nodes, 3)``."""
    assembler = StepAssembler(replace(model, contacts=()))
    moving = np.array([assembler.momenta(one) for one in velocity])
    return moving.reshape(len(velocity), -1, 3) * model.is_carrier[:, None]
