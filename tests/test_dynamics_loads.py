"""Loads in motion: what dead loads do to a body in implicit steps, and the balances that hold them to it."""

import numpy as np
import pytest
from models import bend
from test_derivatives import difference, moved, residual

import isorod
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.dynamics.implicit.mixed import MixedStepAssembler
from isorod.geometry.quadrature import axis_points, circle_points

GRAVITY, DENSITY = (0.0, 2.0, -9.81), 3.0


def bar(loads, supports=(), law=None):
    """A bar along z with loads made for its space."""
    rod = isorod.straight(1.0).sweep(isorod.circle(4, 0.1))
    space = isorod.Space(rod, elements=2, degree=2, continuity=1, section_degree=2)
    body = isorod.Body(space, law or isorod.NeoHookean(E=100.0, nu=0.3), density=DENSITY)
    return isorod.Model([body], [one(space) for one in supports], loads=[one(space) for one in loads])


def weight(space):
    return isorod.BodyForce(tuple(DENSITY * np.array(GRAVITY)))


def clamp(space):
    return isorod.Support.end(space, "start")


def test_a_free_body_falls_as_galilei_says():
    model = bar([weight])
    history = isorod.dynamics.solve(model, 2.0, 0.25, outputs=4, integrator="implicit")
    for k, time in enumerate(history.times):
        fallen = history[k].position(0, np.linspace(0.0, 1.0, 5)) - history[0].position(0, np.linspace(0.0, 1.0, 5))
        # Steps of second order are exact under a constant force.
        assert fallen == pytest.approx(np.tile(0.5 * time**2 * np.array(GRAVITY), (5, 1)), abs=1e-9)
    mass = DENSITY * model.bodies[0].space.rod.volume()
    assert history.load_work[-1] == pytest.approx(mass * 2.0 * np.dot(GRAVITY, GRAVITY), rel=1e-9)
    assert history.kinetic[-1] == pytest.approx(history.load_work[-1], rel=1e-9)
    assert np.abs(history.energy_error).max() < 1e-9 and history.momentum_error.max() < 1e-12


def test_a_load_put_on_at_once_swings_about_its_equilibrium():
    def pull(space):
        return isorod.SectionLoad.end(space, "end", (0.0, 0.0, 1e-3))

    model = bar([pull], [clamp])
    still = isorod.statics.solve(model)
    period = 4.0 * np.sqrt(DENSITY / 100.0)
    history = isorod.dynamics.solve(model, 10.0 * period, period / 20.0, outputs=200, integrator="implicit")
    tip = [one.at(0, "end")[2] for one in history]
    assert np.mean(tip) == pytest.approx(still.at(0, "end")[2], rel=0.02) and max(tip) > 1.9 * np.mean(tip)
    assert history.reactions[:, 0].mean(axis=0) == pytest.approx(still.reactions[0], abs=2e-5)
    assert np.abs(history.energy_error).max() < 1e-8 and history.momentum_error.max() < 1e-10


def test_a_state_of_rest_under_loads_stays_and_is_held_by_its_supports():
    model = bar([weight], [clamp])
    rest = isorod.statics.solve(model)
    history = isorod.dynamics.solve(model, 1.0, 0.1, outputs=2, integrator="implicit", displacement=rest.displacement)
    assert np.abs(history.displacement - rest.displacement).max() < 1e-9
    assert history.reactions[-1] == pytest.approx(rest.reactions, abs=1e-8)


# Pressures that follow


def hose(rings, laws, *loads, held=("start", "end")):
    """A bend, with a hole, in layers or with pressures."""
    space = isorod.Space(bend(rings), degree=2, section_degree=2, quadrature="auto", elements=2)
    supports = [isorod.Support.end(space, end) for end in held]
    return isorod.Model([isorod.Body(space, laws, DENSITY)], supports, loads=loads)


SOFT, RUBBER, STIFF = (isorod.NeoHookean(E, nu) for E, nu in ((1.0, 0.3), (1.0, 0.5), (3.0, 0.3)))
HOSES = {
    "hollow": ((0.6, 1.0), SOFT),
    "hollow, incompressible": ((0.6, 1.0), RUBBER),
    "layered": ((0.5, 0.7, 1.0), [RUBBER, STIFF]),
}
INSIDE = isorod.Pressure(0.05, "inner", follows=True)


@pytest.mark.parametrize("name", HOSES)
def test_the_tangent_of_a_step_knows_pressures_that_follow_and_free_edges(name):
    model = hose(*HOSES[name], INSIDE, isorod.Pressure(0.03, follows=True), held=("start",))
    mixed = any(body.formulation == "mixed" for body in model.bodies)
    assembler = (MixedStepAssembler if mixed else StepAssembler)(model)
    rng = np.random.default_rng(2)
    before, rate = 0.02 * rng.standard_normal((2, model.dofs))
    assembler.begin(0.1, 0.3, before, rate)
    start, way = 0.02 * rng.standard_normal((2, assembler.unknowns))
    x, tangent = moved(assembler.vector(), start), assembler.matrix()
    assembler.tangent(x, 0.7, tangent)
    image = (tangent * moved(assembler.vector(), way)).array_r
    found = difference(lambda t: residual(assembler, moved(x, t * way), 0.7), 1e-3)
    assert image == pytest.approx(found, abs=1e-7 * np.abs(found).max())


@pytest.mark.parametrize("name", HOSES)
def test_an_equilibrium_under_a_pressure_that_follows_stays_and_another_state_moves(name):
    model = hose(*HOSES[name], INSIDE)
    still = isorod.statics.solve(model)
    size = np.abs(still.displacement).max()
    settings = {"integrator": "implicit", "outputs": 2, "petsc": {"snes_rtol": 1e-12}}
    history = isorod.dynamics.solve(model, 4.0, 0.5, displacement=still.displacement, **settings)
    assert np.abs(history.displacement - still.displacement).max() < 1e-6 * size and size > 0.01
    assert history.reactions[-1] == pytest.approx(still.reactions, abs=1e-5 * np.abs(still.reactions).max())
    history = isorod.dynamics.solve(model, 4.0, 0.5, **settings)
    assert np.abs(history.displacement).max() > 0.5 * size and history.load_work.max() > 0.0
    assert np.abs(history.energy_error).max() < 1e-8 and history.momentum_error.max() < 1e-9


def test_work_of_a_pressure_that_follows_is_pressure_times_volume():
    """Inside of a straight tube whose ends are held: by the area of the hole, as steps become shorter."""
    space = isorod.Space(
        isorod.straight(4.0).sweep(isorod.circle(8, 1.0)).with_rings((0.5, 1.0)), elements=2, degree=3, section_degree=3
    )
    ends = [isorod.Support.end(space, end) for end in ("start", "end")]
    load = isorod.Pressure(0.4, "inner", follows=True)
    model = isorod.Model([isorod.Body(space, SOFT, DENSITY)], ends, loads=[load])
    xi, turn = circle_points(8, 6, 0.5)
    found = []
    for steps in (20, 40):
        history = isorod.dynamics.solve(model, 2.0, 2.0 / steps, outputs=1, integrator="implicit")
        assert np.abs(history.energy_error).max() < 1e-8
        u, length = (one.ravel() for one in axis_points(space.axis, 6))
        changed, gradient = space.displacement(history.displacement[-1], xi, u)
        place, jacobian = space.rod.grid(xi, u)
        # Of x . n dA over three, less that of the caps, which stay.
        around = (gradient @ jacobian)[..., 1] * xi[:, :1] - (gradient @ jacobian)[..., 0] * xi[:, 1:]
        out = np.cross(around, (gradient @ jacobian)[..., 2])
        volume = np.einsum("tqa,tqa,t,q->", place + changed, out, length, turn) / 3.0
        grown = volume - np.pi * 0.25 * 4.0 * 2.0 / 3.0
        found.append(abs(history.load_work[-1] / (load.pressure * grown) - 1.0))
    assert grown > 0.05 and found[1] < 1e-3 and found[1] < 0.35 * found[0]
