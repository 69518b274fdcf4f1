"""Modes of scene files about the equilibrium of what acts on them: closed forms of strings, beams and twisted rods."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from vibrations import pinned

from isorod import InputError, files, modal, statics
from isorod.command import solving
from isorod.command.cli import main

ROD = """title = "a rod"
analysis = {{modal = {{modes = {modes}}}}}
[rod.wire]
curve = {{straight = {length}}}
section = {{circle = {{radius = {radius}}}}}
law = {{NeoHookean = {{E = {E}, nu = {nu}}}}}
density = {density}
[support.start]
end = {{end = "start"}}
"""
SLIDING = """[support.end]
end = {{end = "end", components = "xy", tied = "z", turn = [0.0, 0.0, {turn}]}}
"""
PULLED = """[support.end]
end = {{end = "end", components = "xy"}}
[load.pull]
end = {{end = "end", force = [0.0, 0.0, {force}]}}
"""
STEEL = {"E": 2.1e11, "nu": 0.3, "density": 7850.0}


@pytest.fixture
def scene(tmp_path):
    def make(text, **changes):
        path = tmp_path / "scene.toml"
        path.write_text(text.format(**{"modes": 2} | changes))
        return files.find(str(path))

    return make


def solved(scene):
    return solving.solve(scene, scene.settings())[0]


@pytest.mark.parametrize("force", [20.0, 200.0])
def test_a_pulled_string_has_its_own_frequencies(force, scene):
    """Twice each; of the tension that is short of what it stretches, per current length, a share of T / EA."""
    rod = {"length": 1.0, "radius": 5e-4} | STEEL
    modes = solved(scene(ROD + PULLED, force=force, modes=6, **rod))
    bending, mass = 2.1e11 * np.pi * 5e-4**4 / 4, 7850.0 * np.pi * 5e-4**2
    exact = [pinned(force, 1.0, bending, mass, n) for n in (1, 2, 3)]
    assert modes.frequencies == pytest.approx(np.repeat(exact, 2), rel=1e-3)
    assert modes.about == "the equilibrium under 1 load"
    string = np.sqrt(force / (7850.0 * np.pi * 25e-8)) / 2.0
    # At rest it is a beam alone.
    assert modes.frequencies[0] == pytest.approx(string, rel=0.02 if force > 100.0 else 0.1)


def test_a_twisted_rod_buckles_where_its_lowest_frequency_is_zero(scene):
    """Clamped ends, one slides along the axis: M l / B = 8.98682, tan of half of it is half of it; M = C turn / l."""
    critical = 2.0 * brentq(lambda x: np.sin(x) - x * np.cos(x), 4.0, 4.6)
    assert critical == pytest.approx(8.98682, abs=1e-5)
    squares = []
    for turn in (0.995 * critical, 1.005 * critical):
        rod = {"length": 200.0, "radius": 1.0, "E": 1.0, "nu": 0.0, "density": 1.0}
        modes = solved(scene(ROD + SLIDING, turn=turn, **rod))
        squares.append(modes.eigenvalues[0])
    assert squares[0] > 0.0 > squares[1]
    # Halfway between both it is zero.
    assert abs(sum(squares)) < 0.1 * squares[0]


def test_the_state_is_that_of_statics_and_one_given_wins(scene):
    one = scene(ROD + PULLED, force=20.0, length=1.0, radius=5e-4, **STEEL)
    model = one.model()
    found = modal.solve(model, 2, load_steps=2)
    assert found.equilibrium.load_steps == 2
    assert "equilibrium" in found.seconds and found.record()["load_steps"] == 2
    state = statics.solve(model)
    given = modal.solve(model, 2, state=state)
    assert given.equilibrium is state and "equilibrium" not in given.seconds
    assert found.frequencies == pytest.approx(given.frequencies, rel=1e-9)
    rest = modal.solve(model, 2, at_rest=True)
    unloaded = modal.solve(replace(model, loads=()), 2)
    assert np.array_equal(rest.frequencies, unloaded.frequencies)
    assert rest.about == "the state of rest, without 1 load" and unloaded.about == "the state of rest"
    with pytest.raises(InputError, match="a state and at_rest, need one"):
        modal.solve(model, 2, state=state, at_rest=True)
    with pytest.raises(InputError, match="the state is of another model"):
        modal.solve(replace(model, loads=()), 2, state=state)


def test_loads_of_no_size_load_nothing(scene, monkeypatch):
    one = scene(ROD + PULLED + SLIDING.replace("end]", "other]"), force=0.0, turn=0.0, length=1.0, radius=0.1, **STEEL)
    monkeypatch.setattr(statics.analysis, "solve", None)
    assert solved(one).about == "the state of rest"


def test_the_printout_tells_what_they_are_about(scene, capsys):
    """And that a rod beyond Euler's load is unstable: clamped and free, pi^2 / 4 E I / l^2."""
    rod = {"length": 10.0, "radius": 0.5, "E": 2.1e3, "nu": 0.0, "density": 1.0}
    euler = np.pi**2 / 4.0 * 2.1e3 * np.pi * 0.5**4 / 4 / 100.0
    text = ROD + PULLED.replace('components = "xy"', 'components = "z"').partition("[load")[2].join(["[load", ""])
    for share, said in ((0.97, []), (1.03, ["unstable            2 modes shown below zero"])):
        path = scene(text, force=-share * euler, **rod).path
        assert main(["run", path, "--no-estimate", "-snes_rtol", "1e-10"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert "about               the equilibrium under 1 load" in lines
        assert [line[:44] for line in lines if line.startswith("unstable")] == said
    assert main(["run", path, "--at-rest", "--no-estimate", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["about"], "newton_iterations" in record) == ("the state of rest, without 1 load", False)


def test_the_estimate_sees_the_state(scene):
    """On a coarse space it is within a factor of three of what a fine one shows, as at rest."""
    rod = {"length": 10.0, "radius": 0.5, "E": 100.0, "nu": 0.3, "density": 1.0}
    text = ROD + "[load.side]\nend = {{end = 'end', force = [{force}, 0.0, 0.0]}}\n"
    one = scene(text, force=0.1, modes=4, **rod)
    coarse, fine = (solved(replace(one, elements=n, degree=p)) for n, p in ((2, 2), (8, 5)))
    error = np.abs(coarse.frequencies / fine.frequencies - 1.0).max()
    estimate = coarse.estimate()
    print(error, estimate, solved(one).estimate())
    assert error > 0.02 and error / 3.0 < estimate < 3.0 * error
    assert solved(one).estimate() < 0.005


@pytest.mark.parametrize(
    ("more", "law", "said"),
    [
        ("", "LinearElastic", "rod wire is linear elastic, without geometric stiffness; use NeoHookean, or use"),
        (
            "[load.blow]\npressure = {{pressure = 0.1, follows = true}}\n",
            "NeoHookean",
            "follower pressure on rod wire is symmetric .*; support both",
        ),
    ],
)
def test_what_has_no_such_modes_is_refused(more, law, said, scene):
    text = (ROD + "[load.side]\nend = {{end = 'end', force = [0.1, 0.0, 0.0]}}\n" + more).replace("NeoHookean", law)
    one = scene(text, length=10.0, radius=0.5, E=100.0, nu=0.3, density=1.0)
    with pytest.raises(InputError, match=said) as caught:
        solved(one)
    assert "\n" not in str(caught.value) and "at_rest" in str(caught.value)
    assert len(modal.solve(one.model(), 2, at_rest=True)) == 2


def test_modes_at_rest_load_and_build_no_equilibrium(python):
    found = python(
        "import sys, isorod\n"
        "model = isorod.scenes.find('blade')(preset='paper', elements=2).model()\n"
        "print(isorod.modal.solve(model, 1).built, 'isorod.statics.stabilisation' in sys.modules)\n"
    )
    assert found.stdout == "['tangent', 'mass'] False\n", found.stderr
