"""Explicit dynamics: exact discrete motions, order, impacts, and the balances of energy and momentum."""

import numpy as np
import pytest
from motions import DENSITY, LENGTH, SPEED, E, bar, field, momenta, thrown, velocities

from isorod import Body, InputError, Model, NeoHookean, Spin, Support, dynamics, modal


@pytest.mark.parametrize("mode", [0, 2, 5])
@pytest.mark.parametrize("damping", [0.0, 3.0])
def test_a_mode_moves_as_central_differences_move_one_mass(mode, damping):
    """Released from a small mode shape: the recurrence of one degree of freedom, whose roots are known."""
    model = bar()
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


def test_energy_is_kept_over_ten_periods():
    """Free bending with large rotations; the period is that of the first bending mode."""
    model = bar(radius=0.3)
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


def test_the_energy_error_of_violent_motion_is_of_second_order():
    """All modes at once: what central differences leave of the energy is inherent to them, and falls with the square of
    the step.
    """
    model = bar()
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


def test_free_flight_is_exact():
    model = bar(held="")
    start = np.array([1.0, -2.0, 3.0])
    flight = thrown(model, start)
    history = dynamics.solve(model, 5.0, outputs=5, velocity=flight)
    expected = history.times[:, None] * flight
    np.testing.assert_allclose(history.displacement, expected, atol=1e-11)
    mass = DENSITY * model.bodies[0].space.rod.volume()
    np.testing.assert_allclose(history.kinetic, 0.5 * mass * start @ start, rtol=1e-6)


def test_free_flight_with_damping_decays_exactly():
    """``v+ = v- (1 - h) / (1 + h)``, and what damping takes is what kinetic energy loses."""
    model = bar(held="")
    flight = thrown(model, [1.0, 0.0, 0.0])
    history = dynamics.solve(model, 2.0, 0.01, outputs=20, damping=0.7, velocity=flight)
    half = 0.35 * history.time_step
    factor = ((1.0 - half) / (1.0 + half)) ** (history.steps / 20 * np.arange(21))
    np.testing.assert_allclose(history.velocity[:, 0], factor, rtol=1e-10)
    np.testing.assert_allclose(
        history.dissipated, history.kinetic[0] - history.kinetic, atol=1e-10 * history.kinetic[0]
    )
    assert np.abs(history.momentum_error).max() < 1e-12


def test_momentum_changes_by_the_supports_impulse():
    """From the outputs alone: the mean of two reactions times the step is the change of momentum."""
    model = bar()
    history = dynamics.solve(model, 1.0, 0.01, outputs=100, velocity=velocities(model, size=0.2))
    assert history.steps == 100
    momentum = momenta(model, history.velocity).sum(axis=1)
    impulse = 0.5 * history.time_step * (history.reactions[1:, 0] + history.reactions[:-1, 0])
    np.testing.assert_allclose(np.diff(momentum, axis=0), impulse, atol=1e-12 * np.abs(history.reactions).max())
    assert np.abs(history.momentum_error).max() < 1e-12


def test_a_bar_thrown_at_a_wall_comes_back():
    """Held at the face that hits, nu = 0.

    Stress rho c v until 2 L / c, when the whole bar moves back as fast as it came.

    By symmetry, one of two equal bars that hit each other head-on and exchange their velocities.
    """
    model = bar(held="z", nu=0.0, elements=64, quadrature="paper")
    speed = 1e-3 * SPEED
    contact_time = 2.0 * LENGTH / SPEED
    history = dynamics.solve(model, contact_time, outputs=200, velocity=thrown(model, [0.0, 0.0, -speed]))
    force = history.reactions[:, 0, 2] / (DENSITY * SPEED * speed * np.pi)
    inside = (history.times > 0.05 * contact_time) & (history.times < 0.95 * contact_time)
    mass = DENSITY * model.bodies[0].space.rod.volume()
    after = momenta(model, history.velocity[-1:])[0, :, 2].sum() / mass
    print(f"force / rho c v A {force[inside].mean():.4f}, velocity after {after / speed:.4f}")
    assert force[inside].mean() == pytest.approx(1.0, rel=0.01)
    assert after == pytest.approx(speed, rel=0.02)


def test_settings_are_checked():
    model = bar()
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
