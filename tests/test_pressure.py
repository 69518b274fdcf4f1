"""Pressure on lateral surfaces, dead or following."""

import numpy as np
import pytest
from models import bend
from scipy.optimize import brentq

from isorod import LinearElastic, NeoHookean, Space, circle, modal, statics, straight
from isorod.model import Body, Model, Pressure, Support

LAW = NeoHookean(1.0, 0.3)
THETA = 2.0 * np.pi * np.arange(400) / 400


def clamped(space):
    return Support.end(space, "start"), Support.end(space, "end")


@pytest.mark.parametrize("order", [{"section_degree": 2}, {"order": 2}], ids=str)
@pytest.mark.parametrize("follows", [False, True])
def test_pressure_round_a_rod_of_rubber(follows, order):
    """In plane strain the section shrinks evenly; what follows presses on the surface that is left."""
    p = 0.4
    space = Space(straight(3.0).sweep(circle(8, 2.0)), degree=2, **order)
    pinned = [Support(np.array([0]), "xy"), Support(np.array([1]), "y")]
    if "order" in order:
        # Control points: opposite ones keep to the diameter.
        pinned = [Support(np.array([0, 4]), "y"), Support(np.array([2, 6]), "x")]
    ends = [Support.end(space, which, "z") for which in ("start", "end")]
    model = Model([Body(space, LAW)], [*ends, *pinned], loads=[Pressure(p, follows=follows)])
    solution = statics.solve(model, load_steps=2)

    def gap(stretch):
        nominal = LAW.stress(np.diag([stretch, stretch, 1.0])[None])[0, 0, 0]
        return nominal + p * (stretch if follows else 1.0)

    exact = brentq(gap, 0.3, 1.0, xtol=1e-14)
    _, gradient = space.displacement(solution.displacement, [[0.0, 0.0], [0.6, -0.8]], [0.2, 0.9])
    assert gradient == pytest.approx(np.broadcast_to(np.diag([exact, exact, 1.0]), gradient.shape), abs=1e-8)


def opening(space, displacement, u, radius):
    """Return the area vector of a circle of the disk at ``u`` where it is now."""
    xi = radius * np.stack([np.cos(THETA), np.sin(THETA)], axis=1)
    places = space.rod.grid(xi, [u])[0][0] + space.displacement(displacement, xi, [u])[0][0]
    return 0.5 * np.cross(places, np.roll(places, -1, axis=0)).sum(axis=0)


def test_a_bent_pipe_carries_the_thrust_of_its_openings():
    """Pressure on a closed surface has no resultant, so its supports carry ``p A`` of both openings."""
    space = Space(bend(), elements=2, degree=3, section_degree=3)
    start = Support.end(space, "start")
    for follows in (False, True):
        model = Model([Body(space, LAW)], [start], loads=[Pressure(0.02, "inner", follows=follows)])
        solution = statics.solve(model)
        now = solution.displacement if follows else np.zeros(model.dofs)
        first, last = (opening(space, now, u, 0.6) for u in (0.0, 1.0))
        assert solution.reactions[0] == pytest.approx(0.02 * (last - first), rel=1e-3)
    # The free end has moved: both differ.
    assert np.linalg.norm(last - opening(space, np.zeros(model.dofs), 1.0, 0.6)) > 0.01


def test_modes_of_a_held_pipe_fall_under_pressure():
    """Modes about a state know of the pressure that follows: within a straight held tube, it softens bending."""
    space = Space(
        straight(40.0).sweep(circle(8, 1.0)).with_rings((0.8, 1.0)),
        elements=2,
        degree=4,
        continuity=3,
        section_degree=3,
    )
    body, found = Body(space, NeoHookean(100.0, 0.3), 1.0), []
    for p in (0.0, 0.1):
        model = Model([body], clamped(space), loads=[Pressure(p, "inner", follows=True)])
        state = statics.solve(model)
        found.append(modal.solve(model, 1, state=state).frequencies[0])
    # A beam under the thrust p A_i, less the tension that its Poisson's ratio leaves in the held wall, 2 nu p A_i;
    # clamped: 0.97 of the load divided by 4 pi^2 EI / l^2 from the square of the frequency.
    critical = 4 * np.pi**2 * 100.0 * np.pi / 4 * (1 - 0.8**4) / 40.0**2
    fall = 0.97 * (1 - 2 * 0.3) * 0.1 * np.pi * 0.64 / critical
    # It has grown wider, too.
    radii = [0.8, 1.0] + space.displacement(state.displacement, [[0.8, 0.0], [1.0, 0.0]], [0.4])[0][0, :, 0]
    wider = (radii[1] ** 4 - radii[0] ** 4) / (1 - 0.8**4) - 1.0
    assert 1.0 - (found[1] / found[0]) ** 2 == pytest.approx(fall - wider, rel=0.05)


@pytest.mark.parametrize("follows", [True, False])
@pytest.mark.parametrize("sections", [{"order": 2}, {"section_degree": 3}], ids=str)
def test_pressure_on_a_bar_that_cannot_change_its_volume_is_all_there_is(sections, follows):
    """Between held faces nothing moves, and the pressure of the mixed formulation is that of the surface."""
    space = Space.paper(straight(3.0).sweep(circle(8, 2.0)), degree=3, quadrature="full", **sections)
    body = Body(space, NeoHookean(3.0, 0.5))
    model = Model([body], clamped(space), loads=[Pressure(0.7, follows=follows)])
    solution = statics.solve(model)
    assert np.abs(solution.displacement).max() < 1e-9
    found = body.pressures.evaluate(solution.pressures[0], [[0.0, 0.0], [0.6, -0.5]], [0.2, 0.9])
    assert found == pytest.approx(np.full((2, 2), -0.7), abs=1e-8)


def test_small_pressures_are_one_whether_they_follow_or_not():
    found = []
    for follows in (False, True):
        space = Space(bend(), section_degree=3, degree=2)
        model = Model(
            [Body(space, LinearElastic(1e6, 0.3))], clamped(space), loads=[Pressure(1.0, "inner", 0, follows)]
        )
        found.append(statics.solve(model).displacement)
    assert found[1] == pytest.approx(found[0], abs=1e-4 * np.abs(found[0]).max())
