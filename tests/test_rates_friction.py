"""Derivatives along a path with friction: runs beside as points stick and slip, closed forms, scale, Taylor, ranks."""

from math import log, pi
from pathlib import Path

import numpy as np
import pytest
from petsc4py import PETSc
from test_rates import logarithmic
from test_rates_path import TIGHT, begun, runs_apart, scene_of

from isorod import InputError, choices, files, statics
from isorod.design import derivatives, parameters
from isorod.statics import contact_policy

pytestmark = pytest.mark.filterwarnings("ignore:contact 0. contact patch under-resolved", "ignore:stress along the rod")

MU, E, FAR = "contact.floor.friction", "rod.bar.law.NeoHookean.E", "support.left.displacement.2"
SPRINGS = ("support.one.stiffness.1", "support.other.stiffness.1", "contact.floor.penalty")
FORCES = (E, "load.one.force.1", "load.other.force.1", *SPRINGS)

# Pressed onto a floor off which springs hold it, its left end is moved on meanwhile, then more, then back.
BACK = """
[rod.bar]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {NeoHookean = {E = 10.0, nu = 0.3}}
space = {elements = 3, degree = 2, section_degree = 3}

[support.left]
end = "start"
components = "xz"
displacement = [0.0, 0.0, 0.1]

[support.right]
end = "end"
components = "x"

[support.one]
spring = "start"
stiffness = [0.0, 10.0, 0.0]

[support.other]
spring = "end"
stiffness = [0.0, 10.0, 0.0]

[load.one]
end = "start"
force = [0.0, -2.0, 0.0]

[load.other]
end = "end"
force = [0.0, -2.0, 0.0]

[obstacle.floor]
Plane = {point = [0.0, -1.05, 0.0], normal = [0, 1, 0]}

[contact.floor]
first = "bar"
second = "floor"
friction = 0.3

[[step]]
time = 1.0
load.one = 1.0
load.other = 1.0
support.left = 0.5

[[step]]
time = 1.0
support.left = 1.0

[[step]]
time = 1.0
support.left = 0.8

[analysis.statics]

[measure.drag]
obstacle_force = "floor"
component = "z"

[measure.push]
obstacle_force = "floor"
component = "y"

[measure.end]
displacement = "bar"
component = "z"
"""
LINE = ("[obstacle.floor]", "[load.all]\nper_length = [0.0, -0.2, 0.0]\n\n[obstacle.floor]")
GROWS = ("load.other = 1.0", "load.other = 1.0\nload.all = 1.0")
STEPS, FINER = ("[analysis.statics]", "[analysis.statics]\nload_steps = 2"), ("elements = 3", "elements = 4")
PENALTY = ("friction = 0.3", "friction = 0.3\npenalty = 100.0")
# As far as all of it slips.
FURTHER = ("[0.0, 0.0, 0.1]", "[0.0, 0.0, 1.0]")
ONWARD = ("support.left = 0.8", "support.left = 1.5")


def direct(scene, solution, names):
    """Return derivatives along the path; none of them differences of answers."""
    known = parameters.parameters(scene)
    found = derivatives.of(scene, solution, {name: known[name] for name in names}).checked()
    assert not found.errors and not found.why
    return found


@pytest.fixture(scope="module")
def back(tmp_path_factory):
    """Return a scene, its choices, its solution, and derivatives of it."""
    scene = scene_of(tmp_path_factory.mktemp("back"), BACK, penalty=PENALTY)
    made, solution = begun(scene)
    return scene, made, solution, direct(scene, solution, (MU, FAR, *FORCES))


def agrees(scene, made, found, name):
    # Runs are balanced to 1e-13 of the loads, 4, and their difference to that over the step.
    rounding = 4e-13 / (1e-5 * found.parameters[name])
    for key, rate in runs_apart(scene, made, name, 1e-5).items():
        size = max(abs(rate), 1e-2 * abs(float(found.values[key]) / found.parameters[name]))
        assert abs(float(found.by[name][key]) - rate) < 1e-5 * size + rounding, (name, key)


@pytest.mark.parametrize("name", [MU, FAR, E])
def test_they_are_those_of_whole_runs_beside(back, name):
    """Points come into contact, stick, slip, and slip back; increments begin straight, or as the path bends."""
    scene, made, solution, found = back
    slips = solution.contacts[0].slips[solution.contacts[0].pressure > 0.0]
    assert 0.1 * slips.size < slips.sum() < 0.9 * slips.size
    agrees(scene, made, found, name)


def test_so_they_are_where_multipliers_are_updated(tmp_path):
    """Between these runs no point begins to touch elsewhere."""
    scene = scene_of(tmp_path, BACK, load=LINE, grows=GROWS, steps=STEPS, elements=FINER)
    made, solution = begun(scene)
    assert len(solution.settlings[0].stages) > 3
    agrees(scene, made, direct(scene, solution, [MU]), MU)


def test_forces_scale_with_all_forces(back):
    """Where all of them grow, the modulus too, displacements stay."""
    found = back[-1]
    for key, power in (("drag", 1.0), ("push", 1.0), ("end", 0.0)):
        each = [float(logarithmic(found, key, one)) for one in FORCES]
        assert sum(each) == pytest.approx(power, abs=1e-5 * np.abs(each).sum()), key


def test_what_slides_is_dragged_by_what_presses_it(tmp_path):
    """The drag F is mu N: dF/dmu = N + mu dN/dmu."""
    scene = scene_of(tmp_path, BACK, further=FURTHER, onward=ONWARD, penalty=PENALTY)
    found = direct(scene, begun(scene)[1], [MU])
    (drag, push), (by_drag, by_push) = (
        [float(one[k]) for k in ("drag", "push")] for one in (found.values, found.by[MU])
    )
    assert drag == pytest.approx(-0.3 * push, rel=1e-2)
    assert by_drag == pytest.approx(-push - 0.3 * by_push, rel=1e-2)


def test_a_path_that_is_too_long_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(contact_policy, "_KEPT", 1)
    scene = scene_of(tmp_path, BACK, further=FURTHER, onward=ONWARD, penalty=PENALTY)
    solution = statics.solve(scene.model(), **scene.settings())
    assert not solution.settlings
    with pytest.raises(InputError, match="not available with friction"):
        solution.derivatives(lambda values: parameters.at(scene, values).model(), {MU: 0.3}, scene.measure)


def test_the_remainder_of_taylor_falls_with_the_square(back):
    scene, made, solution, found = back
    at, rate = found.parameters[MU], float(found.by[MU]["drag"])
    left = []
    for share in (1.6e-3, 8e-4, 4e-4):
        with choices.repeated(made):
            model = parameters.at(scene, {MU: at * (1.0 + share)}).model()
        moved = scene.measure(statics.solve(model, petsc=TIGHT, like=solution, **scene.settings()))["drag"]
        left.append(abs(float(moved) - float(found.values["drag"]) - share * at * rate))
    assert np.log2(left[:-1] / np.array(left[1:])) == pytest.approx(2.0, abs=0.05)


@pytest.mark.slow
def test_a_drum_holds_by_the_exponential_of_its_friction():
    """A rope pulled against its weight F exp(-mu alpha): dF/dmu = -alpha F, but for what its bending takes."""
    scene = files.find(str(Path(files.__file__).parent / "examples" / "contact" / "drum.toml"))
    grip = "contact.grip.friction"
    found = direct(scene, statics.solve(scene.model(), **scene.settings()), [grip])
    pull = float(found.values["pull"])
    assert float(found.by[grip]["pull"]) == pytest.approx(-pi * pull, rel=0.02)
    assert logarithmic(found, "pull", grip) == pytest.approx(log(-pull), rel=5e-3)


def on_two(path):
    scene = files.find(path)
    both, alone = (direct(scene, begun(scene, comm=comm)[1], [MU]) for comm in (PETSc.COMM_WORLD, PETSc.COMM_SELF))
    for key in ("drag", "push", "end"):
        assert float(both.by[MU][key]) == pytest.approx(float(alone.by[MU][key]), rel=1e-5, abs=1e-6)


def test_ranks_find_the_same(on_ranks, tmp_path):
    scene_of(tmp_path, BACK, penalty=PENALTY)
    on_ranks(2, f"test_rates_friction.on_two({str(tmp_path / 'bar.toml')!r})")
