"""What every integrator and formulation keeps: its order, energy, momenta; statics at rest; work of all that acts."""

from itertools import pairwise

import motions
import numpy as np
import pytest
from motions import E, bar, critical, field, implicit, mixed, momenta, muscle, swing, thrown, velocities

from isorod import BodyForce, Contact, InputError, Plane, SolveError, StVenantKirchhoff, dynamics, statics

RATIOS = (0.4999, 0.5)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def second_order(kind):
    """A model, the end of its motion and the number of the longest steps, settings, and what is of second order."""
    if kind in RATIOS:
        names = "displacement", "velocity", "pressure", "reactions"
        return (model := mixed(kind)), 0.4, 10, {"velocity": swing(model, 0.8), "integrator": "implicit"}, names
    model, steps = bar(law=muscle(), elements=4 if kind == "explicit" else 1), 150 if kind == "explicit" else 50
    settings = {"damping": 0.5, "ramp": 1.5, "velocity": swing(model), "integrator": kind}
    return model, 1.5, steps, settings, ("displacement",)


@pytest.mark.parametrize("kind", ["explicit", "implicit", *RATIOS], ids=str)
def test_second_order_in_the_time_step(kind):
    """Large motion, damped and activated without pressures: halving the step divides the difference from it by four."""
    model, end, first, settings, names = second_order(kind)
    runs = [dynamics.solve(model, end, end / first / 2**k, outputs=1, **settings) for k in range(4)]
    for name in names:
        ends = [getattr(one, name)[-1] for one in runs]
        errors = [np.abs(one - other).max() for one, other in pairwise(ends)]
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        print(name, "differences", errors, "orders", orders)
        assert errors[-1] < 5e-3 * np.abs(ends[-1]).max()
        assert orders[-1] == pytest.approx(2.0, abs=0.2 if kind in RATIOS else 0.1)


# Models, a unit of time and steps in it: critical ones, but with pressures, whose waves are far faster.  Of
# fibres small strains, whose way Gauss points are exact on, and large ones, where they are not.
KEPT = [
    *[(lambda: bar(), None, steps) for steps in (1, 10, 100, 1000)],
    *[(lambda: bar(law=muscle(fibre=(0.0, 0.6, 0.8)), elements=2), None, steps) for steps in (2, 20, 200)],
    *[(lambda nu=nu: mixed(nu), step, 1) for nu in RATIOS for step in (0.02, 0.2)],
]


@pytest.mark.parametrize(("make", "unit", "steps"), KEPT)
def test_energy_is_kept_whatever_the_step(make, unit, steps):
    """All modes at once, undamped."""
    model = make()
    step, count = steps * (unit or critical(model)), 100 if steps in (1, 10, 100, 1000) and unit is None else 20
    history = implicit(model, count * step, step, outputs=10, velocity=velocities(model, size=0.3 if unit else 0.5))
    assert history.steps == count + history.cuts and (history.cuts == 0 or count == 20)
    print(f"energy {np.abs(history.energy_error).max():.1e}, {history.newton_iterations / count:.1f} iterations a step")
    assert history.stored.max() > (0.01 if unit else 1e-6) * history.kinetic[0]
    assert np.abs(history.energy_error).max() < (1e-8 if count == 100 else 1e-9)
    assert np.abs(history.momentum_error).max() < 1e-9
    assert unit is None or history.newton_iterations <= 5 * history.steps


@pytest.mark.slow
@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("law", [None, muscle])
def test_energy_is_kept_for_ten_thousand_steps(nu, law):
    model = mixed(nu, law=law and law(nu, activation=0.0))
    history = implicit(model, 500.0, 0.05, outputs=50, velocity=swing(model, 0.8))
    print(f"energy {np.abs(history.energy_error).max():.1e}, momentum {np.abs(history.momentum_error).max():.1e}")
    assert history.steps == 10_000 and np.abs(history.energy_error).max() < 1e-8


@pytest.mark.parametrize(
    ("kind", "steps"), [("explicit", 0.0), ("implicit", 2.0), ("implicit", 10.0), *((nu, 0.0) for nu in RATIOS)]
)
def test_a_spinning_body_keeps_both_momenta(kind, steps):
    model = mixed(kind, held="") if kind in RATIOS else bar(held="")
    wild = velocities(model, size=0.1 if kind in RATIOS else 0.3)
    step = (steps and steps * critical(model)) or (0.02 if kind == "explicit" else 0.05)
    settings = {"integrator": "explicit" if kind == "explicit" else "implicit"}
    flung = wild + field(model, lambda x: np.cross([0.3, 2.0, 0.5], x))
    count = {"explicit": 200, "implicit": 40}.get(kind, 20)
    history = dynamics.solve(model, count * step, step, outputs=10, velocity=flung, **settings)
    momentum, angular, begun = motions.change_of_momenta(history)
    print(f"momentum {momentum:.1e}, angular {angular:.1e}")
    assert momentum < 1e-11 or kind != "explicit"
    assert max(momentum, angular) < (1e-11 if kind == "explicit" else 1e-10) and begun > 1e-3
    assert np.abs(history.energy_error).max() < (1e-3 if kind == "explicit" else 1e-9)
    assert np.abs(history.momentum_error).max() < 1e-12 or kind != "explicit"
    # Implicit steps add no mass.
    assert kind == "explicit" or not (history.added_kinetic.any() or history.added_kinetic_share)


@pytest.mark.parametrize("law", [None, StVenantKirchhoff(E, 0.3)], ids=["NeoHookean", "StVenantKirchhoff"])
def test_explicit_and_implicit_steps_move_the_same(law):
    """Large rotations: the difference from explicit motion falls with the square of the step."""
    model = bar(law=law, elements=2)
    reference = dynamics.solve(model, 2.0, 0.0025, outputs=1, velocity=swing(model))
    assert np.abs(reference.energy_error).max() < 1e-4
    size, errors = np.abs(reference.displacement[-1]).max(), []
    for step in (0.02, 0.01):
        found = implicit(model, 2.0, step, outputs=1, velocity=swing(model))
        assert np.abs(found.energy_error).max() < 1e-9
        errors.append(np.abs(found.displacement[-1] - reference.displacement[-1]).max())
    print("differences", errors, "of", size)
    assert size > 0.8 and errors[1] < 5e-3 * size
    assert errors[1] < 0.3 * errors[0]


def damped(kind):
    """A model, when its motion has ended, and settings: of implicit steps longer than the critical one."""
    if kind in RATIOS:
        model = mixed(law=muscle(kind, sigma_max=20.0), loads=[BodyForce((0.5, 0.0, 0.0))])
        return model, 20.0, {"damping": 3.0, "ramp": 4.0, "time_step": 0.1, "integrator": "implicit"}
    model = bar(law=muscle(sigma_max=20.0, fibre=(0.0, 0.2, 1.0)), also=["end"])
    if kind == "explicit":
        return model, 30.0, {"damping": 2.0, "ramp": 10.0}
    return model, 75.0, {"damping": 8.0, "ramp": 10.0, "time_step": 0.3, "integrator": "implicit"}


@pytest.mark.parametrize("kind", ["explicit", "implicit", 0.4999, slow(0.5)], ids=str)
def test_damped_motion_ends_in_the_static_equilibrium(kind):
    """Of an active muscle, with pressures of one under a load too, and what begins there stays."""
    model, end, settings = damped(kind)
    rest = statics.solve(model)
    runs = [(dynamics.solve(model, end, outputs=2, **settings), 1e-6, 1e-4 if kind in RATIOS else 1e-6)]
    if kind in RATIOS:
        stays = implicit(model, 0.5, 0.1, outputs=2, displacement=rest.displacement)
        # What swings fast still does, a little: steps follow it no more.
        runs.append((stays, 1e-8, 1e-7))
    for history, error, loose in runs:
        difference = np.abs(history.displacement[-1] - rest.displacement).max() / np.abs(rest.displacement).max()
        print(f"difference from statics {difference:.1e}")
        assert difference < error
        size = np.abs(rest.reactions).max()
        np.testing.assert_allclose(history.reactions[-1], rest.reactions, atol=loose * size)
        if kind in RATIOS:
            found, expected = history[-1].fields(0)["pressure"], rest.pressures[0]
            np.testing.assert_allclose(found, expected, atol=loose * np.abs(expected).max())
            stress = history[-1].stress(0, [0.2, 0.7]), rest.stress(0, [0.2, 0.7])
            np.testing.assert_allclose(*stress, atol=loose * np.abs(stress[1]).max())
        assert kind == "explicit" or np.abs(history.energy_error).max() < 1e-8
    assert size > 10.0 or kind in RATIOS


@pytest.mark.parametrize(
    ("model", "other", "name"),
    [(mixed(), mixed(0.4999), "pressure"), (mixed(0.3, loads=[BodyForce((0.5, 0.0, 0.0))]), mixed(0.3), "load_work")],
    ids=["pressures", "loads"],
)
def test_a_run_continues_from_its_checkpoint(model, other, name, tmp_path):
    settings = {"velocity": swing(model, 0.8), "resume": True, "checkpoint": tmp_path / "state"}
    whole = implicit(model, 0.4, 0.05, outputs=4, velocity=settings["velocity"])
    implicit(model, 0.2, 0.05, outputs=2, **(settings | {"resume": False}))
    again = implicit(model, 0.4, 0.05, outputs=4, **settings)
    for one in ("times", "displacement", "velocity", "reactions", "energy_error", "momentum_error", name):
        np.testing.assert_array_equal(getattr(again, one), getattr(whole, one), err_msg=one)
    with pytest.raises(InputError, match="belongs to another model"):
        implicit(other, 0.4, 0.05, outputs=4, **settings)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_muscle_work_is_kinetic_stored_and_dissipated_energy(integrator):
    """Contraction from rest: the balance closes to second order, that of implicit steps to rounding."""
    model, errors = bar(law=muscle()), []
    for step in (0.02, 0.01) if integrator == "explicit" else (0.1,):
        history = dynamics.solve(model, 3.0, step, outputs=30, damping=1.0, ramp=1.0, integrator=integrator)
        errors.append(np.abs(history.energy_error).max())
    print("balance", errors, "muscle work", history.muscle_work[-1], "dissipated", history.dissipated[-1])
    assert errors[0] < (1e-3 if integrator == "explicit" else 1e-9)
    assert errors[-1] < 0.3 * errors[0] or integrator == "implicit"
    assert np.abs(history.momentum_error).max() < 1e-9
    assert history.muscle_work[-1] > 0.0
    assert history.dissipated[-1] > 0.05 * history.muscle_work[-1]


SMALL = {"radius": 0.5, "length": 2.0, "elements": 1, "formulation": "mixed"}


@pytest.mark.parametrize(
    ("integrator", "steps", "end", "changes"),
    [
        ("explicit", (0.004,), 2.0, {}),
        slow("implicit", (0.02, 0.005), 2.0, {"elements": 2}),
        slow("implicit", (0.01, 0.005), 0.5, SMALL | {"nu": 0.4999}),
        ("implicit", (0.02, 0.01), 0.5, SMALL | {"nu": 0.5}),
    ],
)
def test_a_bar_bounces_off_a_plane(integrator, steps, end, changes):
    """Thrown sideways: momentum is the plane's impulse, and the force ends when the bar flies off.

    The energy, which contact keeps to second order only, is the better the smaller the step.
    """
    wall = Contact(0, Plane((1.05 * changes.get("radius", 1.0), 0.0, 0.0), (-1.0, 0.0, 0.0)), 2000.0)
    model, errors = bar(held="", contacts=[wall], **changes), []
    given = {"velocity": thrown(model, [1.0, 0.0, 0.0]), "integrator": integrator}
    for step in steps:
        history = dynamics.solve(model, end, step, outputs=round(end / step), **given)
        assert history.contact_force[0] == history.contact_force[-1] == 0.0 < history.contact_force.max()
        assert history.penetration.max() > 0.0
        assert np.abs(history.momentum_error).max() < (1e-12 if integrator == "explicit" else 1e-9)
        errors.append(np.abs(history.energy_error[-1]))
    print("energy", errors)
    momentum = momenta(model, history.velocity).sum(axis=1)[:, 0]
    assert momentum[-1] < -0.3 * momentum[0]
    assert len(errors) == 1 or errors[1] < 0.5 * errors[0] < 0.05
    if integrator == "explicit":
        assert np.abs(history.energy_error).max() < 1e-3
        impulse = 0.5 * history.time_step * (history.contact_force[1:] + history.contact_force[:-1])
        np.testing.assert_allclose(np.diff(momentum), -impulse, atol=1e-10 * momentum[0])
    elif not changes.get("formulation"):
        with pytest.raises(SolveError, match=r"^step \d+, time \S+: energy balance error .* use a smaller one$"):
            implicit(model, 2.0, 0.1, outputs=20, velocity=given["velocity"])
