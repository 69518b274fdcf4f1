"""Loads and supports by time, and initial velocities, in implicit and explicit steps: against what is known exactly."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

import isorod
from isorod.model.history import Clock, TimeTable

E, DENSITY, LENGTH, RADIUS = 100.0, 3.0, 1.0, 0.1
AREA = np.pi * RADIUS**2
# Of a bar clamped at one end: speed of waves, and frequencies of stretching.
SPEED = np.sqrt(E / DENSITY)
STRETCHING = (np.arange(400) + 0.5) * np.pi * SPEED / LENGTH


def bar(loads=(), supports=(), elements=4, **more):
    """A bar along z without lateral contraction."""
    rod = isorod.straight(LENGTH).sweep(isorod.circle(8, RADIUS))
    space = isorod.Space(rod, elements=elements, degree=3, section_degree=2)
    body = isorod.Body(space, isorod.NeoHookean(E=E, nu=0.0), density=DENSITY, **more)
    return isorod.Model([body], [one(space) for one in supports], loads=[one(space) for one in loads])


def clamp(space):
    return isorod.Support.end(space, "start")


TABLES = [
    [[0, 0], [0.1, 1], [0.5, 1]],
    [[0, 0.3], [0.2, 0.3], [0.2, -1.0], [0.7, 2.0]],
    [[0.3, 1.0], [0.4, 0.0]],
    [[0.5, 2.0]],
]


@pytest.mark.parametrize("rows", TABLES)
def test_means_of_a_table_are_integrals_of_it(rows):
    """Against quadrature between kinks; before the first and behind the last point values stay."""
    table = TimeTable.of(rows)
    for begin, end in ((0.0, 0.05), (0.05, 0.35), (0.1, 2.0), (0.69, 0.71)):
        kinks = [time for time, _ in rows if begin < time < end]
        pieces = np.unique([begin, *kinks, end])
        exact = sum(quad(table.at, a, b, epsabs=1e-13)[0] for a, b in pairwise(pieces))
        assert table.integral(begin, end) == pytest.approx(exact, abs=1e-11)
        assert table.mean(begin, end) == pytest.approx(exact / (end - begin), abs=1e-11)
    assert table.at(-1.0) == rows[0][1] and table.at(1e9) == rows[-1][1]
    assert table.slope(1e9) == 0.0


def test_a_jump_has_both_its_values():
    table = TimeTable.of(TABLES[1])
    assert table.at(0.2) == -1.0 and table.at(0.2, before=True) == 0.3
    assert table.slope(0.2) == pytest.approx(6.0) and table.slope(0.2, before=True) == 0.0 and table.jumps


@pytest.mark.parametrize("spins", [False, True])
@pytest.mark.parametrize("rows", [None, [[0, 0], [0.1, 1], [0.5, 3], [0.6, -1.0]]])
def test_clocks_have_the_rates_of_their_factors(spins, rows):
    clock, h = Clock(rows and TimeTable.of(rows), spins), 1e-6
    for time in (0.05, 0.3, 0.57):
        rate = (clock.at(time + h) - clock.at(time - h)) / (2 * h)
        assert clock.rate(time, False) == pytest.approx(rate, abs=1e-8)
        acceleration = (clock.rate(time + h, False) - clock.rate(time - h, False)) / (2 * h)
        assert clock.acceleration(time) == pytest.approx(acceleration, abs=1e-8)
    # At a kink of what turns the mean of both sides.
    if spins and rows:
        assert clock.acceleration(0.1) == pytest.approx(0.5 * (10.0 + 5.0))


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([[0, 0], [0.2, 1], [0.1, 1]], "history: times run back from 0.2 to 0.1 (row 2); need them to rise"),
        ([[0, 0], [0.1, np.nan]], "history: row 1 is not finite"),
        ([], "history: got shape (0,), need rows [time, factor], as [[0, 0], [0.1, 1]]"),
        ([[0, 0, 1]], "history: got shape (1, 3), need rows [time, factor], as [[0, 0], [0.1, 1]]"),
    ],
)
def test_bad_tables(rows, said):
    with pytest.raises(isorod.InputError) as refused:
        isorod.BodyForce((0.0, 0.0, 1.0), history=rows)
    assert str(refused.value) == said


BOTH = pytest.mark.parametrize("integrator", ["implicit", "explicit"])


@pytest.mark.parametrize(("integrator", "step"), [("implicit", 0.5), ("implicit", 0.17), ("explicit", None)])
def test_a_free_body_has_the_impulse_of_the_table(integrator, step):
    """Whatever the steps, and wherever the kinks: momentum is the integral of the force."""
    table = [[0.0, 0.0], [0.33, 1.0], [0.61, -0.5], [0.61, 2.0]]
    model = bar([lambda space: isorod.BodyForce((0.0, 0.3, 0.0), history=table)])
    found = isorod.dynamics.solve(model, 2.0, step, outputs=4, integrator=integrator)
    given = [TimeTable.of(table).integral(0.0, time) for time in found.times]
    speed = [one.velocity.reshape(-1, 3)[model.is_control_point, 1].mean() for one in found]
    # Explicit velocities of outputs are means of those half a step before and after.
    assert speed == pytest.approx([0.3 / DENSITY * one for one in given], abs=1e-10 if step else 1e-3)
    assert found.momentum_error.max() < 1e-10 and np.abs(found.energy_error).max() < 1e-9


def pulled(time, begin):
    """Displacement of the end under a unit force that grows from 0 to 1 until ``begin``, by modes."""
    late = np.maximum(time - begin, 0.0)
    w = STRETCHING
    # Duhamel's integral of a ramp less that of one which begins later.
    ramp = (time - np.sin(w * time) / w) - (late - np.sin(w * late) / w)
    return float(np.sum(2.0 / (DENSITY * AREA * LENGTH * w**2) * ramp / begin))


@BOTH
def test_a_ramped_force_on_a_clamped_bar_is_that_of_its_modes(integrator):
    begin, force = 0.25, 1e-4
    load = lambda space: isorod.SectionLoad.end(space, "end", (0, 0, force), history=[[0, 0], [begin, 1]])  # noqa: E731
    found = isorod.dynamics.solve(bar([load], [clamp]), 1.0, 0.005, outputs=20, integrator=integrator)
    exact = [force * pulled(time, begin) for time in found.times]
    tip = [one.at(0, "end")[2] for one in found]
    assert tip == pytest.approx(exact, abs=0.005 * max(exact))
    assert np.abs(found.energy_error).max() < 1e-5 and (found.time_error or 0.0) < 0.005


def spun(spin, ramp):
    """A bar along x that a hub turns about z, faster and faster, until the rate ``spin`` at ``ramp``."""
    rod = isorod.straight(start=(0.0, 0.0, 0.0), end=(LENGTH, 0.0, 0.0)).sweep(isorod.circle(8, 0.2))
    space = isorod.Space(rod, elements=3, degree=3, section_degree=2)
    tau = np.linspace(0.0, 1.0, 41)
    table = np.column_stack([ramp * tau, tau - np.sin(2.0 * np.pi * tau) / (2.0 * np.pi)])
    hub = isorod.Support.end(space, "start", spin=(0.0, 0.0, spin), history=table)
    return isorod.Model([isorod.Body(space, isorod.NeoHookean(E=10.0 * E, nu=0.0), DENSITY)], [hub])


@pytest.mark.parametrize(
    ("integrator", "step"), [("implicit", 0.05), pytest.param("explicit", None, marks=pytest.mark.slow)]
)
def test_a_bar_spun_up_is_longer_by_its_centrifugal_force(integrator, step):
    """The steady stretch is ``rho w^2 L^3 / (3 E)``; the hub turns by the integral of the table, and pulls."""
    spin, ramp, end = 1.0, 6.0, 9.0
    model = spun(spin, ramp)
    found = isorod.dynamics.solve(model, end, step, outputs=90, integrator=integrator)
    longer = [np.linalg.norm(one.position(0, 1.0).ravel()) - LENGTH for one in found]
    steady = found.times > ramp
    assert np.mean(np.array(longer)[steady]) == pytest.approx(DENSITY * spin**2 * LENGTH**3 / (30.0 * E), rel=0.005)
    angle = spin * (end - 0.5 * ramp)
    edges = [one.position(0, 0.0, (0.6, 0.8)).ravel() - one.position(0, 0.0).ravel() for one in (found[0], found[-1])]
    cosine, sine = np.cos(angle), np.sin(angle)
    assert edges[1] == pytest.approx([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]] @ edges[0], abs=1e-12)
    mass = DENSITY * 0.04 * np.pi * LENGTH
    pull = np.linalg.norm(found.reactions[steady, 0], axis=1)
    assert np.mean(pull) == pytest.approx(mass * spin**2 * LENGTH / 2.0, rel=0.005)
    assert np.abs(found.energy_error).max() < 1e-4 and found.momentum_error.max() < 1e-9
    # What turns with the hub is not late.
    assert (found.time_error or 0.0) < 0.01


def test_a_mean_motion_goes_where_its_table_says():
    """A face held in the mean and shaken: its mean is where the table has it, and work and impulse are counted."""
    table = [[0.0, 0.0], [0.4, 1.0], [0.7, 0.2]]

    def face(space):
        return isorod.MeanSupport.end(space, "start", "fixed", displacement=(0.0, 0.01, 0.02), history=table)

    model = bar(supports=[face])
    found = isorod.dynamics.solve(model, 1.0, 0.05, outputs=10, integrator="implicit")
    space = model.bodies[0].space
    nodes, shares = model.supports[0].middle(space)
    moved = np.array([shares @ model.nodal(one)[nodes] for one in found.displacement])
    factors = [TimeTable.of(table).at(time) for time in found.times]
    assert moved == pytest.approx(np.outer(factors, [0.0, 0.01, 0.02]), abs=1e-12)
    assert found.momentum_error.max() < 1e-9 and np.abs(found.energy_error).max() < 1e-9


@pytest.mark.parametrize(("integrator", "step"), [("implicit", 0.1), ("explicit", None)])
def test_a_thrown_bar_that_turns_flies_as_a_rigid_one(integrator, step):
    """The centre of mass goes straight, momenta and energy stay."""
    velocity, spin = (0.1, 0.2, -0.3), (0.0, 0.02, 0.01)
    model = bar(velocity=velocity, spin=spin)
    found = isorod.dynamics.solve(model, 4.0, step, outputs=4, integrator=integrator)
    masses = model.bodies[0].masses(model.bodies[0].space)
    gone = masses @ (found.displacement.reshape(5, -1, 3)) / (DENSITY * model.bodies[0].space.rod.volume())
    assert gone == pytest.approx(np.outer(found.times, velocity), abs=1e-10)
    arms = np.linspace(-0.5, 0.5, 5)[:, None] * [0.0, 0.0, 1.0]
    at_once = found[0].position(0, np.linspace(0.0, 1.0, 5)).reshape(-1, 3)
    rates = isorod.Model(model.bodies).bodies[0].initial_velocity
    assert at_once - at_once[2] == pytest.approx(arms, abs=1e-12)
    expected = np.array(velocity) + np.cross(spin, model.bodies[0].space.positions[:] - 0.0)
    carriers = model.is_control_point
    middle = np.cross(spin, [0.0, 0.0, 0.5])
    assert rates[carriers] == pytest.approx((expected - middle)[carriers], abs=1e-12)
    assert np.ptp(found.kinetic + found.stored) < 1e-6 * found.kinetic[0] and found.momentum_error.max() < 1e-10


@BOTH
def test_a_clamped_bar_that_begins_to_move_swings_as_its_modes(integrator):
    """All of it at one speed along: ``u(L, t) = sum 2 v sin(w t) sin(w L / c) / (w^2 L / c)``."""
    speed = 1e-4
    model = bar(supports=[clamp], velocity=(0.0, 0.0, speed), elements=12)
    found = isorod.dynamics.solve(model, 0.5, 0.002, outputs=10, integrator=integrator)
    # The sum is a saw: it grows with v until the wave from the clamp is there, then falls.
    reach = LENGTH / SPEED
    exact = [speed * (time if time < reach else 2.0 * reach - time) for time in found.times if time < 3.0 * reach]
    tip = [one.at(0, "end")[2] for one in found][: len(exact)]
    assert tip == pytest.approx(exact, abs=0.02 * speed * reach)


def ramp(**what):
    return lambda space: isorod.SectionLoad.end(space, "end", history=[[0, 0], [0.25, 1]], **what)


MEAN = isorod.MeanSupport
DRIVEN = {
    "moment": ([ramp(moment=(1e-3, 0.0, 1e-3))], [clamp]),
    "spring": (
        [ramp(force=(0, 1e-3, 1e-3))],
        [lambda space: MEAN.spring(space, "start", (0.5, 0.4, 0.3), (1, 2, 0.5))],
    ),
    "fixed in the mean": ([ramp(force=(0, 1e-3, 1e-3))], [lambda space: MEAN.end(space, "start", "fixed")]),
    "pin and bearing": (
        [ramp(force=(0, 1e-3, 1e-3))],
        [lambda space: MEAN.end(space, "start", "pin"), lambda space: MEAN.bearing(space, 0.5)],
    ),
    "hub": ([], [lambda space: isorod.Support.end(space, "start", spin=(0.3, 0, 0), history=[[0, 0], [1, 1]])]),
}


@pytest.mark.parametrize("what", DRIVEN)
def test_explicit_and_implicit_steps_are_driven_the_same(what):
    """With damping: displacements, forces of supports and the work done, and balances of both."""
    loads, supports = DRIVEN[what]
    model = bar(loads, supports)
    explicit, implicit = (
        isorod.dynamics.solve(model, 1.0, step, outputs=5, integrator=name, damping=0.5)
        for name, step in (("explicit", None), ("implicit", 0.005))
    )
    size = np.abs(implicit.displacement).max()
    assert np.abs(explicit.displacement - implicit.displacement).max() < 2e-3 * size
    assert explicit.load_work[-1] == pytest.approx(implicit.load_work[-1], rel=5e-3)
    assert explicit.reactions[-1] == pytest.approx(implicit.reactions[-1], abs=0.03 * np.abs(implicit.reactions).max())
    for one in (explicit, implicit):
        assert np.abs(one.energy_error).max() < 1e-4 and one.momentum_error.max() < 1e-9
