"""Implicit dynamics: the work of its forces, order, what it conserves whatever the step, and agreement with explicit
steps and statics.
"""

import json
import re
from itertools import islice

import numpy as np
import pytest

from comparisons.stability import point, stepping
from isorod import dynamics, statics
from isorod.dynamics.implicit import assembler
from isorod.errors import InputError, SolveError
from isorod.material import NeoHookean
from isorod.material.muscle import Muscle
from isorod.model import Body, Contact, Model, Plane, Support
from isorod.output import checkpoint
from isorod.space import Space

E, DENSITY, LENGTH = 100.0, 2.0, 4.0


def bar(cylinder, held="xyz", law=None, elements=4, contacts=()):
    """A cylinder along z, one end of which may be held."""
    space = Space.paper(cylinder(4, height=LENGTH), elements=elements, degree=2, quadrature="auto")
    supports = [Support.end(space, "start", held)] if held else []
    return Model([Body(space, law or NeoHookean(E, 0.3), DENSITY)], supports, contacts=contacts)


def field(model, function):
    """All degrees of freedom of a vector field of the position that is linear in it."""
    space = model.bodies[0].space
    return (function(space.positions) * space.is_carrier[:, None]).ravel()


def wild(model, size):
    """Random velocities of all degrees of freedom: all modes at once."""
    return size * np.random.default_rng(0).standard_normal(model.dofs)


def swing(model, size=0.4):
    return field(model, lambda x: np.stack([size * x[:, 2], 0.0 * x[:, 0], 0.0 * x[:, 0]], axis=1))


def critical(model):
    return dynamics.solve(model, 1e-9, outputs=1).critical_step


def run(model, end_time, time_step, **settings):
    return dynamics.solve(model, end_time, time_step, integrator="implicit", **settings)


MUSCLE = Muscle(E, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.6, 0.8))


def states(seed=1, points=40):
    """Pairs of deformation gradients far apart, as start and change."""
    rng = np.random.default_rng(seed)
    first, last = np.eye(3) + 0.35 * rng.standard_normal((2, points, 3, 3))
    good = (np.linalg.det(first) > 0.1) & (np.linalg.det(last) > 0.1)
    return first[good], (last - first)[good]


LAWS = [NeoHookean(3.0, 0.4), MUSCLE]


@pytest.mark.parametrize("law", LAWS)
def test_the_stress_does_the_work_of_the_energy(law):
    law = law.at(0.7)

    def between(F, H):
        return law.discrete(F, H, False)[0]

    F, H = states()
    work = np.sum(between(F, H) * H, axis=(1, 2))
    np.testing.assert_allclose(work, law.energy(F + H) - law.energy(F), atol=1e-13 * law.energy(F).max())
    # Neither the order of states nor a rotation of both changes it, and F_m^-1 P is symmetric: no moment.
    np.testing.assert_allclose(between(F + H, -H), between(F, H), rtol=1e-10, atol=1e-11)
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(between(turn @ F, turn @ H), turn @ between(F, H), rtol=1e-10, atol=1e-11)
    second = between(F, H) @ np.swapaxes(F + 0.5 * H, 1, 2)
    np.testing.assert_allclose(second, np.swapaxes(second, 1, 2), atol=1e-11 * np.abs(second).max())


@pytest.mark.parametrize("law", LAWS)
def test_the_moduli_are_the_derivatives_of_the_stress(law):
    F, H = states()
    moduli, found = law.discrete(F, H)[1], np.empty((len(F), 3, 3, 3, 3))
    step = 1e-6
    for b in range(3):
        for B in range(3):
            move = np.zeros((3, 3))
            move[b, B] = step
            found[..., b, B] = (law.discrete(F, H + move)[0] - law.discrete(F, H - move)[0]) / (2.0 * step)
    np.testing.assert_allclose(moduli, found, atol=1e-7 * np.abs(found).max())


@pytest.mark.parametrize("law", LAWS)
def test_an_inverted_state_has_no_discrete_stress(law):
    F, H = states()
    for bad in (np.diag([1.0, 1.0, -1.0]), np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan)):
        first, change = F[:2].copy(), H[:2].copy()
        change[1] = bad - first[1]
        for found in law.discrete(first, change):
            assert np.isfinite(found[0]).all()
            assert np.isnan(found[1]).any()


@pytest.mark.parametrize("law", LAWS)
def test_without_a_change_it_is_the_law_itself(law):
    F, H = states()
    whole = law.at(0.7)
    stress, moduli = whole.discrete(F, 0.0 * H)
    np.testing.assert_allclose(stress, whole.stress(F), atol=1e-12 * np.abs(stress).max())
    np.testing.assert_allclose(moduli, 0.5 * whole.tangent(F), atol=1e-12 * np.abs(moduli).max())


def test_second_order_in_the_time_step(cylinder):
    """Large, damped, activated motion: halving the step divides the difference from it by four."""
    law = Muscle(E, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0))
    model = bar(cylinder, law=law, elements=1)
    ends = [
        run(model, 1.5, 1.5 / n, outputs=1, damping=0.5, ramp=1.5, velocity=swing(model)).displacement[-1]
        for n in (75, 150, 300, 600)
    ]
    errors = np.abs(np.diff(ends, axis=0)).max(axis=1)
    orders = np.log2(errors[:-1] / errors[1:])
    print("differences", errors, "orders", orders)
    assert errors[0] < 0.05 * np.abs(ends[-1]).max()
    np.testing.assert_allclose(orders, 2.0, atol=0.15)


@pytest.mark.parametrize("steps", [1, 10, 100, 1000])
def test_energy_is_kept_whatever_the_step(steps, cylinder):
    """All modes at once, undamped, in steps of so many critical ones."""
    model = bar(cylinder)
    step = steps * critical(model)
    history = run(model, 100 * step, step, outputs=10, velocity=wild(model, 0.5))
    assert history.steps == 100 and history.cuts == 0
    error = np.abs(history.energy_error).max()
    print(f"{steps} critical steps: energy {error:.1e}, {history.newton_iterations / 100:.1f} iterations a step")
    assert history.stored.max() > 1e-6 * history.kinetic[0]
    assert error < 1e-8
    assert np.abs(history.momentum_error).max() < 1e-9


@pytest.mark.parametrize("steps", [2, 20, 200])
def test_a_law_with_fibres_keeps_energy_and_momentum(steps, cylinder):
    """Small strains and large ones: those whose way Gauss points are exact on, and those where they are not."""
    model = bar(cylinder, law=MUSCLE, elements=2)
    step = steps * critical(model)
    history = run(model, 20 * step, step, outputs=10, velocity=wild(model, 0.5))
    error = np.abs(history.energy_error).max()
    print(f"{steps} critical steps: energy {error:.1e}, {history.newton_iterations / 20:.1f} iterations a step")
    assert history.stored.max() > 1e-6 * history.kinetic[0]
    assert error < 1e-9
    assert np.abs(history.momentum_error).max() < 1e-9


@pytest.mark.parametrize("steps", [2, 10])
def test_a_spinning_body_keeps_both_momenta(steps, cylinder):
    model = bar(cylinder, held="")
    step = steps * critical(model)
    flung = wild(model, 0.3) + field(model, lambda x: np.cross([0.3, 2.0, 0.5], x))
    history = run(model, 40 * step, step, outputs=10, velocity=flung)
    places = model.bodies[0].space.positions + history.displacement.reshape(len(history.times), -1, 3)
    momenta = assembler.StepAssembler(model).momenta
    moving = np.array([momenta(one) for one in history.velocity]).reshape(places.shape)
    carries = model.is_carrier[:, None]
    momentum, angular = (carries * moving).sum(axis=1), np.cross(places, moving).sum(axis=1)
    size = np.abs(moving).sum()
    print(f"momentum {np.ptp(momentum, axis=0).max() / size:.1e}, angular {np.ptp(angular, axis=0).max() / size:.1e}")
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * size
    assert np.abs(angular - angular[0]).max() < 1e-10 * size
    assert np.abs(angular[0]).max() > 1e-3 * size
    assert np.abs(history.energy_error).max() < 1e-9
    # Implicit steps add no mass.
    assert not history.added_kinetic.any() and history.added_kinetic_share == 0.0


def test_explicit_steps_move_the_same(cylinder):
    """The difference from explicit motion falls with the square of the step."""
    model = bar(cylinder, elements=2)
    reference = dynamics.solve(model, 2.0, 0.0025, outputs=1, velocity=swing(model))
    errors = []
    for step in (0.04, 0.02):
        found = run(model, 2.0, step, outputs=1, velocity=swing(model))
        errors.append(np.abs(found.displacement[-1] - reference.displacement[-1]).max())
    print("differences", errors, "of", np.abs(reference.displacement[-1]).max())
    assert errors[1] < 5e-3 * np.abs(reference.displacement[-1]).max()
    assert errors[1] < 0.3 * errors[0]


def test_damped_motion_ends_in_the_static_equilibrium(cylinder):
    """In steps longer than the critical one."""
    model = bar(cylinder, law=Muscle(E, 0.3, sigma_max=20.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.2, 1.0)))
    model = Model(model.bodies, [*model.supports, Support.end(model.bodies[0].space, "end")])
    rest = statics.solve(model)
    history = run(model, 75.0, 0.3, outputs=10, damping=8.0, ramp=10.0)
    difference = np.abs(history.displacement[-1] - rest.displacement).max() / np.abs(rest.displacement).max()
    print(f"{history.time_step / history.critical_step:.1f} critical steps, difference from statics {difference:.1e}")
    assert difference < 1e-6
    np.testing.assert_allclose(history.reactions[-1], rest.reactions, atol=1e-6 * np.abs(rest.reactions).max())
    assert np.abs(history.energy_error).max() < 1e-8


def test_muscle_work_is_kinetic_stored_and_dissipated_energy(cylinder):
    """The balance of explicit steps closes to second order, this one to rounding."""
    model = bar(cylinder, law=Muscle(E, 0.3, sigma_max=40.0, m1=35.0, m2=0.5, activation=1.0, fibre=(0.0, 0.0, 1.0)))
    history = run(model, 3.0, 0.1, outputs=30, damping=1.0, ramp=1.0)
    assert np.abs(history.energy_error).max() < 1e-9
    assert np.abs(history.momentum_error).max() < 1e-9
    assert history.muscle_work[-1] > 0.0
    assert history.dissipated[-1] > 0.05 * history.muscle_work[-1]


@pytest.mark.slow
def test_bouncing_off_a_plane(cylinder):
    """Both momenta to rounding; the energy, which contact keeps to second order only, better in smaller steps."""
    wall = Contact(0, Plane((1.05, 0.0, 0.0), (-1.0, 0.0, 0.0)), 2000.0)
    model = bar(cylinder, held="", contacts=[wall], elements=2)
    thrown = field(model, lambda x: np.broadcast_to([1.0, 0.0, 0.0], x.shape))
    errors = []
    for step in (0.02, 0.005):
        history = run(model, 2.0, step, outputs=100, velocity=thrown)
        assert history.contact_force[0] == history.contact_force[-1] == 0.0
        assert history.penetration.max() > 0.0
        assert np.abs(history.momentum_error).max() < 1e-9
        errors.append(np.abs(history.energy_error[-1]))
    print("energy", errors)
    assert history.velocity[-1, ::3] @ model.is_carrier < 0.0
    assert errors[1] < 0.3 * errors[0] < 0.05
    with pytest.raises(SolveError, match=r"^step \d+, time \S+: energy balance error .* use a smaller one$"):
        run(model, 2.0, 0.1, outputs=20, velocity=thrown)


def test_reactions_are_those_of_the_time(cylinder):
    """A bar that spins about its held end is pulled inward.

    Momentum's rate of change, by differences of the outputs.
    """
    model = bar(cylinder)
    history = run(model, 0.5, 0.005, outputs=100, velocity=swing(model))
    momenta = assembler.StepAssembler(model).momenta
    carried = np.array([(momenta(v).reshape(-1, 3) * model.is_carrier[:, None]).sum(axis=0) for v in history.velocity])
    rate = (carried[2:] - carried[:-2]) / (history.times[2] - history.times[0])
    found = history.reactions[1:-1, 0]
    np.testing.assert_allclose(found, rate, atol=0.02 * np.abs(found).max())


def test_a_step_that_does_not_converge_is_halved(cylinder, petsc_options):
    """With few Newton iterations allowed, long steps are cut, and nothing else is lost."""
    model = bar(cylinder, elements=2)
    petsc_options(snes_max_it=5)
    history = run(model, 3.0, 0.5, outputs=3, velocity=swing(model, 2.0))
    print(f"cuts {history.cuts}, steps {history.steps}")
    assert history.cuts > 0
    assert history.steps == 6 + history.cuts
    assert np.abs(history.energy_error).max() < 1e-8
    petsc_options(ksp_type="richardson", ksp_max_it=1, pc_type="none")
    with pytest.raises(
        SolveError, match=r"^step 1, time 0: SNES diverged .* and at the minimum step size; smallest det F"
    ):
        run(model, 3.0, 0.5, outputs=3, velocity=swing(model, 2.0))


@pytest.mark.parametrize("outputs", [1, 2, 4])
def test_a_run_continues_from_its_checkpoint(outputs, cylinder, tmp_path, monkeypatch):
    """Stopped when so many outputs of four were written; the last one is the finished run."""
    model, file = bar(cylinder, elements=2), tmp_path / "state"
    settings = {"outputs": 4, "damping": 0.1, "velocity": swing(model)}
    whole = run(model, 1.0, 0.05, **settings)
    settings |= {"checkpoint": file, "every": 0.0}
    true, written = checkpoint.write, []

    def write(*arguments):
        true(*arguments)
        written.append(arguments)
        # The first one is of the start.
        if len(written) == outputs + 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "write", write)
        with pytest.raises(KeyboardInterrupt):
            run(model, 1.0, 0.05, **settings)
    again = run(model, 1.0, 0.05, resume=True, **settings)
    assert again.resumed == pytest.approx(0.25 * outputs)
    for name in ("times", "displacement", "velocity", "reactions", "energy_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)
    assert again.steps == whole.steps
    # And on to a later end.
    later = {"end_time": 1.5, "time_step": 0.05} | settings | {"outputs": 6}
    further = run(model, resume=True, **later)
    np.testing.assert_array_equal(further.displacement, run(model, **later | {"checkpoint": None}).displacement)
    with pytest.raises(InputError, match="other run: integrator implicit there, explicit here"):
        dynamics.solve(model, 1.0, 0.05, resume=True, **settings)


def test_bad_input_is_one_line(cylinder):
    model = bar(cylinder)
    for settings, message in (
        ({"integrator": "magic"}, "integrator: got 'magic', need 'explicit' or 'implicit'"),
        ({"integrator": "implicit"}, "time step: got none"),
        ({"integrator": "implicit", "time_step": -1.0}, "time step: got -1, need a positive time"),
    ):
        with pytest.raises(InputError, match=message):
            dynamics.solve(model, 1.0, outputs=1, **settings)
    inside_out = field(model, lambda x: -2.0 * x)
    with pytest.raises(InputError, match="initial state: an element is inverted"):
        run(model, 1.0, 0.1, displacement=inside_out)


def test_explicit_steps_load_no_implicit_ones(python):
    script = """
import sys
from isorod import options
options.initialize([])
from isorod import dynamics
print([name for name in sys.modules if "implicit" in name or name.startswith("isorod.statics")])
"""
    result = python(script)
    assert result.stdout.strip() == "[]", result.stderr


def test_sweep_about_the_critical_step():
    """Explicit steps from 0.1 to 1.1 critical ones.

    Energy kept below, the blow-up above detected, the critical step named.
    """
    curves = point.sweeps(list(islice(stepping.run("quick"), 28)))[stepping.SHARE.name]
    small, violent = curves.values()
    assert point.reach(small) == 0.99
    assert point.reach(violent) >= 0.2
    for record in small[-3:]:
        step, critical = re.search(r"time step (\S+), critical time step (\S+) at", record["failure"]).groups()
        assert float(step) / float(critical) == pytest.approx(record["value"], rel=2e-3)
        # Long before the end.
        assert int(re.match(r"step (\d+),", record["failure"])[1]) < 100


def test_implicit_steps_from_the_command_line(isorod):
    """The biceps in steps ten times the critical one."""
    small = ("run", "biceps", "--elements", "5", "--end-elements", "0", "--end-time", "0.004", "--outputs", "2")
    result = isorod(*small, "--integrator", "implicit", "--time-step", "5e-4", "--json", "-snes_rtol", "1e-8")
    assert result.returncode == 0, result.stderr
    record = json.loads(result.stdout)
    assert record["steps"] == 8 and record["time_step"] > 5.0 * record["critical_step"]
    assert record["newton_iterations"] >= 8
    assert record["solver"]["time integration"] == "energy-momentum conserving"
    assert np.abs(record["energy_error"]).max() < 1e-2
    refused = isorod(*small, "--integrator", "implicit", "--time-step", "0")
    assert refused.returncode == 2
    assert re.match(r"[^\n]*time step: got none[^\n]*\n$", refused.stderr)


def test_what_swings_faster_than_steps_follow_is_foreseen(cylinder):
    """It goes back and forth from step to step, faster and faster: four iterations each, not six."""
    model = bar(cylinder)
    stretched = field(model, lambda x: x * [0.0, 0.0, 0.2])
    assert run(model, 16.0, 2.0, outputs=1, displacement=stretched).newton_iterations <= 40
