"""Loads in motion: what dead loads do to a body in implicit steps, and the balances that hold them to it."""

import numpy as np
import pytest

import isorod

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


@pytest.mark.parametrize(
    ("integrator", "load", "line"),
    [
        ("explicit", weight, "loads: not supported by explicit steps; use integrator 'implicit'"),
        (
            "implicit",
            lambda space: isorod.Pressure(1.0, follows=True),
            "loads: follower pressure is not supported in dynamics",
        ),
    ],
)
def test_loads_that_steps_do_not_know_are_refused(integrator, load, line):
    with pytest.raises(isorod.InputError) as refused:
        isorod.dynamics.solve(bar([load]), 1.0, 0.1, integrator=integrator)
    assert str(refused.value) == line
