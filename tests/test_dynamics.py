"""Explicit dynamics: exact discrete motions, order, impacts, and the balances of energy and momentum."""

import numpy as np
import pytest
from motions import DENSITY, LENGTH, SPEED, E, bar, field, momenta, velocities

from isorod import dynamics, modal, statics
from isorod.errors import InputError
from isorod.material import NeoHookean
from isorod.material.muscle import Muscle
from isorod.model import Body, Contact, Model, Plane, Spin, Support


@pytest.mark.parametrize("mode", [0, 2, 5])
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_mode_moves_as_central_differences_move_one_mass(mode, damping, cylinder):
    """Released from a small mode shape: the recurrence of one degree of freedom, whose roots are known."""
    model = bar(cylinder)
    modes = modal.solve(model, modes=mode + 1)
    shape, square = modes.vectors[mode], modes.eigenvalues[mode]
    step = 0.5 * dynamics.solve(model, 1e-9, outputs=1).critical_step
    size = 1e-7 / np.abs(shape).max()
    history = dynamics.solve(model, 400 * step, step, outputs=400, damping=damping, displacement=size * shape)
    assert history.time_step == pytest.approx(step, rel=1e-12)
    # (1 + h) x[n+1] - (2 - square dt^2) x[n] + (1 - h) x[n-1] = 0, starting without velocity.
    half = 0.5 * damping * step
    exact = [1.0, 1.0 - 0.5 * square * step**2]
    for _ in range(399):
        exact.append(((2.0 - square * step**2) * exact[-1] - (1.0 - half) * exact[-2]) / (1.0 + half))
    largest = np.argmax(np.abs(shape))
    found = history.displacement[:, largest] / (size * shape[largest])
    error = np.abs(found - exact).max()
    print(f"mode {mode}, {400 * step * np.sqrt(square) / 2 / np.pi:.1f} periods, damping {damping}: error {error:.1e}")
    # The body is a little nonlinear: strains are near 1e-7.
    assert error < 2e-5


def test_longitudinal_frequency_is_that_of_the_bar(cylinder):
    """Fixed at one end, nu = 0: quarter wave, period 4 L / c; the shape of the first mode is a sine."""
    model = bar(cylinder, held="z", nu=0.0, elements=16)
    height = model.bodies[0].space.positions[:, 2]
    shape = np.zeros((model.dofs // 3, 3))
    shape[:, 2] = 1e-6 * np.sin(0.5 * np.pi * height / LENGTH) * model.bodies[0].space.is_carrier
    period = 4.0 * LENGTH / SPEED
    history = dynamics.solve(model, 2.25 * period, outputs=225, displacement=shape.ravel())
    end = history.displacement.reshape(len(history.times), -1, 3)[:, -1, 2]
    crossings = np.flatnonzero(np.sign(end[1:]) != np.sign(end[:-1]))
    k = crossings[-1]
    last = history.times[k] + (history.times[k + 1] - history.times[k]) * end[k] / (end[k] - end[k + 1])
    found = last / (crossings.size - 0.5) * 2.0
    print(f"period {found:.6g}, exact {period:.6g}: {found / period - 1:.1e}")
    assert found == pytest.approx(period, rel=2e-3)


def test_second_order_in_the_time_step(cylinder):
    """Large, damped, activated motion: halving the step divides the error by four."""
    law = Muscle(E, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0))
    model = bar(cylinder, law=law)
    swing = field(model, lambda x: np.stack([0.4 * x[:, 2], 0.0 * x[:, 0], 0.0 * x[:, 0]], axis=1))
    counts = (150, 300, 600, 4800)
    ends = [
        dynamics.solve(model, 1.5, 1.5 / count, outputs=1, damping=0.5, ramp=1.5, velocity=swing).displacement[-1]
        for count in counts
    ]
    errors = [np.abs(end - ends[-1]).max() for end in ends[:-1]]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    print("errors", errors, "orders", orders)
    assert errors[0] < 0.05 * np.abs(ends[-1]).max()
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_energy_is_kept_over_ten_periods(cylinder):
    """Free bending with large rotations; the period is that of the first bending mode."""
    model = bar(cylinder, radius=0.3)
    period = 1.0 / modal.solve(model, modes=1).frequencies[0]
    swing = field(model, lambda x: np.stack([0.2 * x[:, 2] ** 2 / LENGTH, 0.0 * x[:, 0], 0.0 * x[:, 0]], axis=1))
    history = dynamics.solve(model, 10.0 * period, 0.02, outputs=100, velocity=swing)
    top = history.displacement[:, -3]
    print(
        f"deflection {np.ptp(top) / LENGTH:.2f} lengths, steps {history.steps}, energy "
        f"{np.abs(history.energy_error).max():.1e}"
    )
    assert np.ptp(top) > 0.5 * LENGTH
    assert np.abs(history.energy_error).max() < 1e-4
    assert np.abs(history.energy_error[-20:]).max() < 2.0 * np.abs(history.energy_error[:20]).max()


def test_the_energy_error_of_violent_motion_is_of_second_order(cylinder):
    """All modes at once: what central differences leave of the energy is inherent to them, and falls with the square of
    the step.
    """
    model = bar(cylinder)
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    errors = []
    for share in (0.2, 0.1, 0.05):
        history = dynamics.solve(
            model, 100 * critical, share * critical, outputs=50, velocity=velocities(model, size=0.1)
        )
        errors.append(np.abs(history.energy_error).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    print("errors", errors, "orders", orders)
    np.testing.assert_allclose(orders, 2.0, atol=0.1)


def test_free_flight_is_exact(cylinder):
    model = bar(cylinder, held="")
    start = np.array([1.0, -2.0, 3.0])
    flight = field(model, lambda x: np.broadcast_to(start, x.shape))
    history = dynamics.solve(model, 5.0, outputs=5, velocity=flight)
    expected = history.times[:, None] * flight
    np.testing.assert_allclose(history.displacement, expected, atol=1e-11)
    mass = DENSITY * model.bodies[0].space.rod.volume()
    np.testing.assert_allclose(history.kinetic, 0.5 * mass * start @ start, rtol=1e-6)


def test_free_flight_with_damping_decays_exactly(cylinder):
    """``v+ = v- (1 - h) / (1 + h)``, and what damping takes is what kinetic energy loses."""
    model = bar(cylinder, held="")
    flight = field(model, lambda x: np.broadcast_to([1.0, 0.0, 0.0], x.shape))
    history = dynamics.solve(model, 2.0, 0.01, outputs=20, damping=0.7, velocity=flight)
    half = 0.35 * history.time_step
    factor = ((1.0 - half) / (1.0 + half)) ** (history.steps / 20 * np.arange(21))
    np.testing.assert_allclose(history.velocity[:, 0], factor, rtol=1e-10)
    np.testing.assert_allclose(
        history.dissipated, history.kinetic[0] - history.kinetic, atol=1e-10 * history.kinetic[0]
    )
    assert np.abs(history.momentum_error).max() < 1e-12


def test_tumbling_keeps_momentum_and_angular_momentum(cylinder):
    model = bar(cylinder, held="")
    space = model.bodies[0].space
    wild = velocities(model, size=0.3) + field(model, lambda x: np.cross([0.3, 2.0, 0.5], x))
    history = dynamics.solve(model, 4.0, 0.02, outputs=8, velocity=wild)
    places = space.positions + history.displacement.reshape(len(history.times), -1, 3)
    moving = momenta(model, history.velocity)
    momentum, angular = moving.sum(axis=1), np.cross(places, moving).sum(axis=1)
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * np.abs(moving).sum()
    assert np.abs(angular - angular[0]).max() < 1e-11 * np.abs(moving).sum()
    assert np.abs(history.energy_error).max() < 1e-3
    assert np.abs(history.momentum_error).max() < 1e-12


def test_momentum_changes_by_the_supports_impulse(cylinder):
    """From the outputs alone: the mean of two reactions times the step is the change of momentum."""
    model = bar(cylinder)
    history = dynamics.solve(model, 1.0, 0.01, outputs=100, velocity=velocities(model, size=0.2))
    assert history.steps == 100
    momentum = momenta(model, history.velocity).sum(axis=1)
    impulse = 0.5 * history.time_step * (history.reactions[1:, 0] + history.reactions[:-1, 0])
    np.testing.assert_allclose(np.diff(momentum, axis=0), impulse, atol=1e-12 * np.abs(history.reactions).max())
    assert np.abs(history.momentum_error).max() < 1e-12


def test_muscle_work_is_kinetic_stored_and_dissipated_energy(cylinder):
    """Contraction from rest: the balance closes, the better the smaller the step."""
    law = Muscle(E, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0))
    model = bar(cylinder, law=law)
    errors = []
    for step in (0.02, 0.01):
        history = dynamics.solve(model, 3.0, step, outputs=30, damping=1.0, ramp=1.0)
        errors.append(np.abs(history.energy_error).max())
    print("balance", errors, "muscle work", history.muscle_work[-1], "dissipated", history.dissipated[-1])
    assert errors[0] < 1e-3
    assert errors[1] < 0.3 * errors[0]
    assert history.muscle_work[-1] > 0.0
    assert history.dissipated[-1] > 0.05 * history.muscle_work[-1]


def test_slow_activation_ends_in_the_static_equilibrium(cylinder):
    law = Muscle(E, 0.3, sigma_max=20.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.2, 1.0))
    model = bar(cylinder, law=law)
    model = Model(model.bodies, [*model.supports, Support.end(model.bodies[0].space, "end")])
    rest = statics.solve(model)
    history = dynamics.solve(model, 30.0, outputs=10, damping=2.0, ramp=10.0)
    difference = np.abs(history.displacement[-1] - rest.displacement).max() / np.abs(rest.displacement).max()
    print(f"difference from statics {difference:.1e}")
    assert difference < 1e-6
    size = np.abs(rest.reactions).max()
    np.testing.assert_allclose(history.reactions[-1], rest.reactions, atol=1e-6 * size)
    assert history.reactions[-1, 1, 2] > 10.0


def test_a_bar_thrown_at_a_wall_comes_back(cylinder):
    """Held at the face that hits, nu = 0.

    Stress rho c v until 2 L / c, when the whole bar moves back as fast as it came.

    By symmetry, one of two equal bars that hit each other head-on and exchange their velocities.
    """
    model = bar(cylinder, held="z", nu=0.0, elements=64, quadrature="paper")
    speed = 1e-3 * SPEED
    thrown = field(model, lambda x: np.broadcast_to([0.0, 0.0, -speed], x.shape))
    contact_time = 2.0 * LENGTH / SPEED
    history = dynamics.solve(model, contact_time, outputs=200, velocity=thrown)
    force = history.reactions[:, 0, 2] / (DENSITY * SPEED * speed * np.pi)
    inside = (history.times > 0.05 * contact_time) & (history.times < 0.95 * contact_time)
    mass = DENSITY * model.bodies[0].space.rod.volume()
    after = momenta(model, history.velocity[-1:])[0, :, 2].sum() / mass
    print(f"force / rho c v A {force[inside].mean():.4f}, velocity after {after / speed:.4f}")
    assert force[inside].mean() == pytest.approx(1.0, rel=0.01)
    assert after == pytest.approx(speed, rel=0.02)


def test_a_bar_bounces_off_a_plane(cylinder):
    """Thrown sideways: momentum is the plane's impulse, energy is kept, and the force ends when the bar flies off."""
    wall = Contact(0, Plane((1.05, 0.0, 0.0), (-1.0, 0.0, 0.0)), 2000.0)
    model = bar(cylinder, held="", contacts=[wall])
    thrown = field(model, lambda x: np.broadcast_to([1.0, 0.0, 0.0], x.shape))
    history = dynamics.solve(model, 2.0, 0.004, outputs=500, velocity=thrown)
    assert history.steps == 500
    print("energy", np.abs(history.energy_error).max(), "deepest", history.penetration.max())
    assert history.contact_force[0] == history.contact_force[-1] == 0.0
    assert history.penetration.max() > 0.0
    assert np.abs(history.momentum_error).max() < 1e-12
    assert np.abs(history.energy_error).max() < 1e-3
    momentum = momenta(model, history.velocity).sum(axis=1)
    impulse = 0.5 * history.time_step * (history.contact_force[1:] + history.contact_force[:-1])
    np.testing.assert_allclose(np.diff(momentum[:, 0]), -impulse, atol=1e-10 * momentum[0, 0])
    assert momentum[-1, 0] < -0.3 * momentum[0, 0]


def test_settings_are_checked(cylinder):
    model = bar(cylinder)
    for wrong, message in (
        ({"end_time": -1.0}, "end time: got -1, need a positive time"),
        ({"time_step": 0.0}, "time step: got 0, need a positive time"),
        ({"time_step": 1e-300}, r"time step 1e-300: 1e\+300 steps to the end at 1, at most"),
        ({"outputs": 0}, "outputs: got 0, need an integer from 1"),
        ({"damping": -1.0}, "damping: got -1, need 1/time, not negative"),
        ({"ramp": np.nan}, "ramp: got nan, need a time, not negative"),
        ({"velocity": np.zeros(3)}, r"initial velocity: got shape \(3,\), need"),
        ({"displacement": np.full(model.dofs, np.nan)}, "initial displacement: .* finite"),
        ({"resume": True}, "resume: got no checkpoint"),
    ):
        with pytest.raises(InputError, match=message):
            dynamics.solve(model, **({"end_time": 1.0, "outputs": 1} | wrong))
    massless = Model([Body(model.bodies[0].space, NeoHookean(E, 0.3))])
    with pytest.raises(InputError, match="density of body 0: got 0, dynamics needs a positive mass"):
        dynamics.solve(massless, 1.0)
    rigid = Model(model.bodies, [Support(np.arange(model.bodies[0].space.nodes))])
    with pytest.raises(InputError, match="supports: all degrees of freedom are constrained"):
        dynamics.solve(rigid, 1.0)
    turning = Model([model.bodies[0]], spin=Spin((0.0, 0.0, 1.0)))
    with pytest.raises(InputError, match="spin: dynamics in a rotating frame"):
        dynamics.solve(turning, 1.0)
    inside_out = field(model, lambda x: -2.0 * x)
    with pytest.raises(InputError, match=r"initial state: an element is inverted; smallest det F = .* in element"):
        dynamics.solve(model, 1.0, displacement=inside_out)
