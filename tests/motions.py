"""What the tests of motions share: bars along z, how they are thrown, and their momenta."""

from dataclasses import replace

import numpy as np
from conftest import straight

from isorod import Body, Model, Muscle, NeoHookean, Space, Support, dynamics
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.dynamics.implicit.mixed import MixedStepAssembler

E, DENSITY, LENGTH = 100.0, 2.0, 4.0
SPEED = np.sqrt(E / DENSITY)


def muscle(nu=0.3, sigma_max=40.0, activation=1.0, fibre=(0.0, 0.0, 1.0)):
    return Muscle(E, nu, sigma_max, m1=35.0, m2=0.5, activation=activation, fibre=fibre)


def bar(held="xyz", nu=0.3, elements=4, degree=2, law=None, contacts=(), quadrature="auto", also=(), **more):
    """A cylinder along z, one end of which may be held, as others that are named ``also``."""
    radius, length, formulation = more.get("radius", 1.0), more.get("length", LENGTH), more.get("formulation")
    rod = straight(4, radius=radius, height=length)
    space = Space.paper(rod, elements=elements, degree=degree, quadrature=quadrature)
    supports = [Support.end(space, "start", held)] if held else []
    supports += [Support.end(space, end) for end in also]
    return Model([Body(space, law or NeoHookean(E, nu), DENSITY, formulation)], supports, contacts=contacts)


def mixed(nu=0.5, held="xyz", law=None, elements=1, degree=2, length=2.0, **more):
    """One of radius 0.5 with pressures: 42 unknowns, 6 of which are pressures."""
    rod = straight(8, radius=0.5, height=length)
    space = Space(rod, section_degree=2, degree=degree, elements=elements, continuity=degree - 1, quadrature="auto")
    supports = [Support.end(space, "start", held)] if held else []
    return Model([Body(space, law or NeoHookean(E, nu), DENSITY, "mixed")], supports, **more)


def implicit(model, end_time, time_step, **settings):
    return dynamics.solve(model, end_time, time_step, integrator="implicit", **settings)


def critical(model):
    return dynamics.solve(model, 1e-9, outputs=1).critical_step


def field(model, function):
    """All degrees of freedom of a vector field of the position that is linear in it, and zero where that is."""
    return function(model.bodies[0].space.positions).ravel()


def swing(model, size=0.4):
    """Velocities across the bar, which change no volume."""
    return field(model, lambda x: size * np.outer(x[:, 2], [1.0, 0.0, 0.0]))


def thrown(model, velocity):
    return np.kron(model.is_control_point, velocity)


def velocities(model, size=1.0):
    """Random velocities of all degrees of freedom that are not held: all modes at once."""
    values = size * np.random.default_rng(0).standard_normal(model.dofs)
    values[model.held] = 0.0
    return values


def moving(model, velocity):
    """Consistent mass times velocities ``(o, dofs)``: shape ``(o, nodes, 3)``."""
    pressures = any(body.formulation == "mixed" for body in model.bodies)
    assembler = (MixedStepAssembler if pressures else StepAssembler)(replace(model, contacts=()))
    return np.array([assembler.momenta(one) for one in velocity]).reshape(len(velocity), -1, 3)


def momenta(model, velocity):
    """Those of the nodes that move with their rod."""
    return moving(model, velocity) * model.is_control_point[:, None]


def change_of_momenta(history):
    """By how much momentum and angular momentum change in a motion, and the latter at first; over what is moving."""
    own = moving(history.model, history.velocity)
    at_rest = np.concatenate([body.space.positions for body in history.model.bodies])
    places = at_rest + history.displacement.reshape(len(history), -1, 3)
    momentum = (own * history.model.is_control_point[:, None]).sum(axis=1)
    angular, size = np.cross(places, own).sum(axis=1), np.abs(own).sum()
    found = [np.abs(one - one[0]).max() / size for one in (momentum, angular)]
    return *found, np.abs(angular[0]).max() / size
