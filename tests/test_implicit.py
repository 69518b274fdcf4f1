"""Implicit dynamics: reactions, steps that are halved, checkpoints, the command, and what is refused."""

import re
from itertools import islice

import numpy as np
import pytest
from motions import bar, field, implicit, momenta, swing

from comparisons.stability import point, stepping
from isorod import InputError, SolveError, dynamics
from isorod.output import checkpoint


def test_reactions_are_those_of_the_time():
    """A bar that spins about its held end is pulled inward.

    Momentum's rate of change, by differences of the outputs.
    """
    model = bar()
    history = implicit(model, 0.5, 0.005, outputs=100, velocity=swing(model))
    carried = momenta(model, history.velocity).sum(axis=1)
    rate = (carried[2:] - carried[:-2]) / (history.times[2] - history.times[0])
    found = history.reactions[1:-1, 0]
    np.testing.assert_allclose(found, rate, atol=0.02 * np.abs(found).max())


def test_a_step_that_does_not_converge_is_halved(petsc_options):
    """With few Newton iterations allowed, long steps are cut, and nothing else is lost."""
    model = bar(elements=2)
    petsc_options(snes_max_it=5)
    history = implicit(model, 3.0, 0.5, outputs=3, velocity=swing(model, 2.0))
    print(f"cuts {history.cuts}, steps {history.steps}")
    assert history.cuts > 0
    assert history.steps == 6 + history.cuts
    assert np.abs(history.energy_error).max() < 1e-8
    petsc_options(ksp_type="richardson", ksp_max_it=1, pc_type="none")
    with pytest.raises(
        SolveError, match=r"^step 1, time 0: SNES diverged .* and at the minimum step size; smallest det F"
    ):
        implicit(model, 3.0, 0.5, outputs=3, velocity=swing(model, 2.0))


@pytest.mark.parametrize("outputs", [1, 2, 4])
def test_a_run_continues_from_its_checkpoint(outputs, tmp_path, monkeypatch):
    """Stopped when so many outputs of four were written; the last one is the finished run."""
    model, file = bar(elements=2), tmp_path / "state"
    settings = {"outputs": 4, "damping": 0.1, "velocity": swing(model)}
    whole = implicit(model, 1.0, 0.05, **settings)
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
            implicit(model, 1.0, 0.05, **settings)
    again = implicit(model, 1.0, 0.05, resume=True, **settings)
    assert again.resumed == pytest.approx(0.25 * outputs)
    for name in ("times", "displacement", "velocity", "reactions", "energy_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)
    assert again.steps == whole.steps
    # And on to a later end.
    later = {"end_time": 1.5, "time_step": 0.05} | settings | {"outputs": 6}
    further = implicit(model, resume=True, **later)
    np.testing.assert_array_equal(further.displacement, implicit(model, **later | {"checkpoint": None}).displacement)
    with pytest.raises(InputError, match="other run: integrator implicit there, explicit here"):
        dynamics.solve(model, 1.0, 0.05, resume=True, **settings)


def test_bad_input_is_one_line():
    model = bar()
    for settings, message in (
        ({"integrator": "magic"}, "integrator: got 'magic', need 'explicit' or 'implicit'"),
        ({"integrator": "implicit"}, "time step: got none"),
        ({"integrator": "implicit", "time_step": -1.0}, "time step: got -1, need a positive time"),
    ):
        with pytest.raises(InputError, match=message):
            dynamics.solve(model, 1.0, outputs=1, **settings)
    inside_out = field(model, lambda x: -2.0 * x)
    with pytest.raises(InputError, match="initial state: an element is inverted"):
        implicit(model, 1.0, 0.1, displacement=inside_out)


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
    curves = point.sweeps(list(islice(stepping.run("quick"), 28)))[stepping.FRACTION.name]
    small, violent = curves.values()
    assert point.reach(small) == 0.99
    assert point.reach(violent) >= 0.2
    for record in small[-3:]:
        step, critical = re.search(r"time step (\S+), critical time step (\S+) at", record["failure"]).groups()
        assert float(step) / float(critical) == pytest.approx(record["value"], rel=2e-3)
        # Long before the end.
        assert int(re.match(r"step (\d+),", record["failure"])[1]) < 100


def test_implicit_steps_from_the_command_line(command):
    """The biceps in steps ten times the critical one."""
    small = "run biceps --elements 5 --end-elements 0 --end-time 0.004 --outputs 2 --integrator implicit".split()
    record = command.record(*small, "--time-step", "5e-4", "-snes_rtol", "1e-8")
    assert record["steps"] == 8 and record["time_step"] > 5.0 * record["critical_step"]
    assert record["newton_iterations"] >= 8
    assert record["solver"]["time integration"] == "energy-momentum conserving"
    assert np.abs(record["energy_error"]).max() < 1e-2
    assert "time step: got none" in command.refuses(*small, "--time-step", 0)


def test_what_swings_faster_than_steps_follow_is_foreseen():
    """It goes back and forth from step to step, faster and faster: four iterations each, not six."""
    model = bar()
    stretched = field(model, lambda x: x * [0.0, 0.0, 0.2])
    assert implicit(model, 16.0, 2.0, outputs=1, displacement=stretched).newton_iterations <= 40
