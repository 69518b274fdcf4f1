"""The critical step of explicit dynamics: motions below, above and beyond it, with the mass that is added for those."""

import numpy as np
import pytest
from motions import DENSITY, LENGTH, E, bar, field, thrown, velocities

from isorod import Body, InputError, Model, Muscle, NeoHookean, SolveError, Space, Support, dynamics, modal
from isorod.dynamics.explicit import mesh, run
from isorod.dynamics.explicit.mass import SAFETY, Mass
from isorod.tensors import rotation


def at_share_of_critical(monkeypatch, model, share):
    """Run at a share of the critical step, which is told to be larger than it is."""
    true = run.System.critical_step
    monkeypatch.setattr(run.System, "critical_step", lambda *arguments: 10.0 * true(*arguments))
    made = dynamics.solve(model, 1e-9, outputs=1).critical_step / 10.0
    return dynamics.solve(model, 3000 * share * made, share * made, outputs=10, velocity=velocities(model, size=1e-3))


def test_stable_just_below_the_critical_step(monkeypatch):
    history = at_share_of_critical(monkeypatch, bar(), 0.99)
    assert history.steps == 3000
    assert np.abs(history.energy_error).max() < 1e-2


def test_blow_up_just_above_the_critical_step_is_reported(monkeypatch):
    with pytest.raises(
        SolveError, match=r"^step \d+, time .*element \d of body 0 at u = .*time step .*critical time step [^\n]*$"
    ) as error:
        at_share_of_critical(monkeypatch, bar(), 1.01)
    print(error.value)
    # Within the interval: 300 steps.
    assert int(str(error.value).split()[1].strip(",")) <= 300


def test_an_element_that_inverts_is_named():
    """Stable as it is at rest, thrown too hard: the body goes through itself."""
    model = bar()
    squash = field(model, lambda x: np.stack([0.0 * x[:, 0], 0.0 * x[:, 0], -40.0 * x[:, 2]], axis=1))
    with pytest.raises(
        SolveError, match=r"^step \d+, time 0\.\d+: an element inverts; smallest det F = -\S+ in element \d of body 0"
    ):
        dynamics.solve(model, 1.0, 0.05, outputs=1, velocity=squash)


def test_an_unstable_step_is_refused_and_the_critical_one_named():
    with pytest.raises(
        InputError,
        match=r"time step 1: unstable, the critical time step is 0.3\d+ with the largest mass scaling; use at most",
    ):
        dynamics.solve(bar(), 1.0, 1.0, outputs=1)


def test_the_step_follows_a_muscle_that_stiffens():
    """Passive fibres stiffen exponentially when the bar is thrown.

    The default step is cut, one of the user's refused.
    """
    law = Muscle(20.0, 0.3, m1=50.0, m2=1.0, fibre=(0.0, 0.0, 1.0))
    model = bar(law=law)
    throw = field(model, lambda x: np.stack([0.0 * x[:, 0], 0.0 * x[:, 0], 0.8 * x[:, 2]], axis=1))
    history = dynamics.solve(model, 8.0, outputs=40, velocity=throw)
    print("critical steps", history.estimates[:, 1], "energy", np.abs(history.energy_error).max())
    assert history.time_step < 0.8 * history.estimates[0, 1]
    assert np.abs(history.momentum_error).max() < 1e-12
    with pytest.raises(SolveError, match="critical time step"):
        dynamics.solve(model, 8.0, 0.99 * history.estimates[0, 1], outputs=40, velocity=throw)
    # Where mass was added a shorter step would have less, and be no more stable.
    longer = 1.05 * history.estimates[0, 1]
    with pytest.raises(
        SolveError, match=r"leave it out \(--time-step 0\) to follow the critical time step of the consistent mass"
    ):
        dynamics.solve(model, 120.0 * longer, longer, outputs=40, velocity=throw)


def test_a_step_beyond_the_critical_one_keeps_energy_and_momenta():
    """With the mass that is added for it; without supports, so that angular momentum is the mass's own."""
    model = bar(held="", elements=8)
    space = model.bodies[0].space
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    tumble = field(model, lambda x: np.cross([0.1, 0.7, 0.2], x) + 0.1 * x)
    history = dynamics.solve(model, 8.0, 2.0 * critical, outputs=16, velocity=tumble)
    assert history.critical_step > history.time_step > 1.9 * critical
    assert history.added_kinetic.min() > 0.0
    assert 0.0 < history.added_kinetic_share < 1.0
    mass = Mass(model, mesh.order(model))
    mass.scaling = mass.scaling_for(history.time_step, critical)
    moving = np.array([mass.momenta(one) for one in history.velocity]).reshape(len(history.times), -1, 3)
    places = space.positions + history.displacement.reshape(moving.shape)
    momentum, angular = (model.is_control_point[:, None] * moving).sum(axis=1), np.cross(places, moving).sum(axis=1)
    size = np.abs(moving).sum()
    print(f"momentum {np.ptp(momentum, axis=0).max() / size:.1e}, angular {np.ptp(angular, axis=0).max() / size:.1e}")
    assert np.abs(momentum - momentum[0]).max() < 1e-11 * size
    assert np.abs(angular - angular[0]).max() < 1e-7 * size
    assert np.abs(history.energy_error).max() < 2e-3
    assert np.abs(history.momentum_error).max() < 1e-12


def test_mass_is_added_for_the_step_taken_not_for_the_one_allowed():
    """Outputs closer than the critical step need none, however long a step is given."""
    model = bar(held="")
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    drift = thrown(model, [0.0, 0.0, 1.0])
    history = dynamics.solve(model, 5.0 * critical, 3.0 * critical, outputs=10, velocity=drift)
    assert history.time_step == pytest.approx(0.5 * critical)
    assert history.added_kinetic_share == 0.0


@pytest.mark.slow
def test_added_mass_is_an_error_of_second_order_in_the_step(cylinder):
    """A bar that swings, with steps beyond the critical one of sections of order 2."""
    space = Space.paper(cylinder(8, radius=0.3, height=LENGTH), elements=8, order=2, quadrature="auto")
    model = Model([Body(space, NeoHookean(E, 0.45), DENSITY)], [Support.end(space, "start")])
    modes = modal.solve(model, modes=1)
    period, shape = 1.0 / modes.frequencies[0], modes.vectors[0] / np.abs(modes.vectors[0]).max()
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    end = np.argmax(np.abs(shape))
    runs = [
        dynamics.solve(model, 2.0 * period, share * critical, outputs=40, velocity=1e-3 * shape)
        for share in (0.5, 2.5, 5.0)
    ]
    exact, *found = (run.displacement[:, end] for run in runs)
    errors = [np.linalg.norm(one - exact) / np.linalg.norm(exact) for one in found]
    print("errors", errors, "steps", [run.steps for run in runs])
    assert runs[2].critical_step > runs[2].time_step
    assert errors[1] < 0.1
    assert errors[0] < 0.3 * errors[1]


def twisting(cylinder, ends):
    """Return a nearly incompressible bar with its ends so held, its slowest twisting and how fast that is, turns/time.

    Of its modes that with the largest moments of displacements about the axis, a quarter of a shear wave or half one
    long.
    """
    space = Space.paper(cylinder(8, radius=0.3, height=LENGTH), elements=10, order=2, quadrature="auto")
    law = NeoHookean(E, 0.49)
    model = Model([Body(space, law, DENSITY)], [Support.end(space, end) for end in ends])
    modes = modal.solve(model, modes=12)
    moments = np.cross(space.positions, modes.vectors.reshape(12, -1, 3))[:, :, 2]
    k = int(np.argmax(np.abs(moments.sum(axis=1)) / np.linalg.norm(modes.vectors.reshape(12, -1), axis=1)))
    rate = modes.frequencies[k]
    assert rate == pytest.approx(0.25 * len(ends) / LENGTH * np.sqrt(law.mu / DENSITY), rel=1e-2)
    return model, modes.vectors[k] / np.abs(modes.vectors[k]).max(), rate


@pytest.mark.parametrize("ends", [("start",), ("start", "end")])
def test_added_mass_tells_twisting_from_swelling(ends, cylinder):
    """A bar that twists is as fast in steps of ten critical ones; mass that cannot tell them would make it far slower.

    Of a sine in time a frequency that is off by ``e`` leaves an error of ``4 pi e / sqrt(3)`` after two periods.
    """
    model, shape, rate = twisting(cylinder, ends)
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    history = dynamics.solve(model, 2.0 / rate, 10.0 * critical, outputs=20, velocity=1e-3 * shape)
    assert history.time_step > 8.0 * critical
    turned = history.displacement @ shape / (shape @ shape)
    exact = 1e-3 / (2.0 * np.pi * rate) * np.sin(2.0 * np.pi * rate * history.times)
    error = np.linalg.norm(turned - exact) / np.linalg.norm(exact)
    print(f"ends {ends}: {history.steps} steps, {history.added_kinetic_share:.2g} in added mass, error {error:.2g}")
    assert error < 0.01
    assert history.added_kinetic_share < 0.02
    assert np.abs(history.momentum_error).max() < 1e-12
    assert np.abs(history.energy_error).max() < 1e-3
    # The same state with the mass of bodies that nothing holds.
    made = Mass(model, mesh.order(model))
    own = shape @ made.momenta(shape)
    made.scaling = 0.25 * SAFETY * (history.time_step**2 - critical**2)
    assert shape @ made.momenta(shape) < 1.02 * own
    made.place(made.at)
    made.coupled = [False]
    assert shape @ made.momenta(shape) > 1.5 * own


def test_added_mass_follows_a_body_that_turns(cylinder):
    """Of a held bar that swings by a radian: twisting and turning then are as light as at rest, and swelling is not."""
    model, _, _ = twisting(cylinder, ("start",))
    space = model.bodies[0].space
    about = np.array([0.0, 1.0, 0.0])
    turn = rotation(1.0 * about)
    # Turned as a whole, whatever its support says of its end.
    turned = (space.positions @ (turn - np.eye(3)).T).ravel()
    spinning = np.cross(about, space.positions @ turn.T).ravel()
    made = Mass(model, mesh.order(model))
    own = spinning @ made.momenta(spinning)
    made.scaling = made.largest_scaling
    assert spinning @ made.momenta(spinning) > 2.0 * own
    made.place(turned)
    assert spinning @ made.momenta(spinning) == pytest.approx(own, rel=1e-9)
    assert made.change(turned) == pytest.approx(np.abs(turn - np.eye(3)).max(), rel=1e-9)
    swelling = ((space.positions * [1.0, 1.0, 0.0]) @ turn.T).ravel()
    assert made.added(swelling) > 2.0 * (swelling @ made.momenta(swelling) - made.added(swelling))
