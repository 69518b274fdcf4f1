"""Derivatives as differences of whole answers: friction, scale, kinks, load steps, where designs begin."""

from dataclasses import replace

import numpy as np
import pytest
from test_design_runs import METAL
from test_rates import logarithmic
from test_rates_contact import PIN, RING

from isorod import choices, files, statics
from isorod.command import solving
from isorod.design import derivatives, differences, evaluations, parameters

pytestmark = pytest.mark.filterwarnings("ignore:contact 0. contact patch under-resolved", "ignore:stress along the rod")

# A bar that lies on a floor under its ends' weights, and is moved along.
SLIDE = """
[rod.bar]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {NeoHookean = {E = 100.0, nu = 0.3}}
space = {elements = 4, degree = 2, section_degree = 3}

[support.left]
end = "start"
components = "xz"
displacement = [0.0, 0.0, 0.4]

[support.right]
end = "end"
components = "xz"
displacement = [0.0, 0.0, 0.4]

[load.one]
end = "start"
force = [0.0, -1.0, 0.0]

[load.other]
end = "end"
force = [0.0, -1.0, 0.0]

[obstacle.floor]
Plane = {point = [0.0, -1.0, 0.0], normal = [0, 1, 0]}

[contact.floor]
first = "bar"
second = "floor"
friction = 0.3

[analysis.statics]

[measure.drag]
obstacle_force = "floor"
component = "z"
"""
FRICTION, PLASTIC, METAL_LAW = "contact.floor.friction", "rod.ring.law.Plastic", "rod.bar.law.Plastic"

# A coil that is pushed, and yields, and is let go.
SET = """
[rod.wire]
curve = {helix = {radius = 6.0, pitch = 4.0, turns = 1.0}}
section = {circle = 0.6}
law = {Plastic = {E = 2.06e5, nu = 0.3, hardening = [[0, 900], [1, 3000]]}}
space = {elements = 8, degree = 4, section_degree = 2}

[support.lower]
end = "start"

[load.push]
end = "end"
force = [0.0, 0.0, -40.0]

[[step]]
time = 1.0
load.push = 1.0

[[step]]
time = 1.0
unload = true

[analysis.statics]

[measure.set]
displacement = "wire"
component = "z"
"""


def scene_of(path, text):
    (path / "my.toml").write_text(text)
    return files.find(str(path / "my.toml"))


def test_a_bar_that_slides_is_dragged_by_its_weight_times_friction(tmp_path):
    scene, told = scene_of(tmp_path, SLIDE), []
    solution = statics.solve(scene.model())
    long = replace(solution, seconds={"solve": 60.0})
    found = derivatives.of(scene, long, {FRICTION: 0.3}, report=told.append)
    assert float(found.by[FRICTION]["drag"]) == pytest.approx(-2.0, rel=1e-6)
    assert found.errors[FRICTION]["drag"] < 1e-6
    why = "not available with friction where contact alone holds a body"
    assert found.why == why and told == [f"derivatives by finite differences ({why}): 4 solves, some 4 min 0 s"]


@pytest.mark.slow
def test_contact_of_metal_scales_with_stresses(tmp_path):
    law = "Plastic = {E = 10.0, nu = 0.3, hardening = [[0, 0.2], [1, 1.2]]}"
    text = RING.replace("NeoHookean = {E = 10.0, nu = 0.4}", law).replace("-8.0", "-6.0")
    text = text.replace("{order = 2, elements = 12, degree = 4}", "{section_degree = 3, elements = 8, degree = 4}")
    scene = scene_of(tmp_path, text.replace("[analysis.statics]", "[analysis.statics]\nload_steps = 2"))
    names = {f"{PLASTIC}.E": 10.0, f"{PLASTIC}.hardening.0.1": 0.2, f"{PLASTIC}.hardening.1.1": 1.2}
    solution = statics.solve(scene.model(), **scene.settings())
    with pytest.warns(UserWarning, match=r"derivative of widening by .* are .* % apart, the worst of 2 that are known"):
        found = derivatives.of(scene, solution, names)
    assert found.why == "not available with contact of laws with memory"
    for measured, power in (("push", 1.0), ("widening", 0.0)):
        assert sum(logarithmic(found, measured, one) for one in names) == pytest.approx(power, abs=1e-4)
    assert logarithmic(found, "push", f"{PLASTIC}.hardening.0.1") > 0.5


def test_an_increment_that_is_not_found_again_is_solved_for(command, tmp_path):
    """The force of a bar in tension goes with its area; its own path has no derivative by the radius."""
    scene, radius = scene_of(tmp_path, METAL), "rod.bar.section.circle"
    solution = statics.solve(scene.model(), **scene.settings())
    own = solution.derivatives(lambda values: parameters.at(scene, values).model(), {radius: 1.0}, scene.measure)
    if radius not in own.none:
        pytest.skip("with this rounding the increments beside are found")
    found = command.record("run", tmp_path / "my.toml", "--no-estimate", "--derivatives")
    assert f"not available by {radius} everywhere (beside it there is no equilibrium" in found["differences"]
    by = found["derivatives"]["force"]
    assert by[radius]["derivative"] / found["force"] == pytest.approx(2.0, abs=1e-6)
    assert by[radius]["error_estimate"] < 1e-6 and "error_estimate" not in by[f"{METAL_LAW}.E"]
    said = command.prints("run", tmp_path / "my.toml", "--no-estimate", "--derivatives")
    assert "derivatives with their errors are differences of answers" in said and said.count("known to") == 2


def test_models_beside_take_the_load_steps_of_an_answer(tmp_path):
    """Two would do here."""
    scene = scene_of(tmp_path, METAL)
    first = statics.solve(scene.model(), load_steps=4)
    again = statics.solve(scene.model(), like=first)
    assert again.factors == first.factors == [0.25, 0.5, 0.75, 1.0]
    assert again.steps_error is None
    np.testing.assert_allclose(again.reactions, first.reactions, rtol=1e-9, atol=1e-6)


def test_errors_are_those_of_jumps_and_of_curvature():
    class Beside:
        at = {"x": 1.0}  # noqa: RUF012

        def model(self, name, step):
            return self.at[name] + step

    def errors(function):
        rates, found = differences._by(
            "x", Beside(), {"y": np.array(function(1.0))}, lambda x: {"y": np.array(function(x))}, True
        )
        return float(rates["y"]), found["y"]

    assert errors(lambda x: x**3) == pytest.approx((3.0, 3.0 * differences.APART**2 / 3.0), rel=1e-4, abs=1e-5)
    rate, error = errors(lambda x: max(x, 1.0))
    assert (rate, error) == pytest.approx((0.5, 2.0), rel=1e-9)


@pytest.mark.slow
def test_a_design_of_a_set_ends(command, tmp_path, monkeypatch):
    """The first step goes to where nothing yields, and no set changes with the radius any more."""
    monkeypatch.chdir(tmp_path)
    scene_of(tmp_path, SET)
    words = ("design", "my.toml", "--vary", "rod.wire.section.circle=0.4:1", "--target")
    found = command.record(*words, "set=-0.2")
    assert not found["missed"] and found["solves"] <= 15
    assert found["answers"]["set"]["after"] == pytest.approx(-0.2, rel=1e-3)
    # Nothing is set against its load.
    code, _, err = command._run((*words, "set=0.5"))
    assert code == 2 and "targets or limits are not met: set =" in err and "nothing comes nearer in 10 solves" in err


@pytest.mark.slow
def test_a_design_begins_on_the_spaces_that_see_a_patch(tmp_path):
    scene, x = scene_of(tmp_path, PIN), np.array([1.0])
    name, at = next(iter(parameters.parameters(scene).items()))
    own = evaluations.Evaluations({"": scene}, [name], scene.settings(), solving.solve_scene)
    first = own.freeze(x * at)
    unknowns = first.solutions[0].model.unknowns
    with choices.kept():
        assert unknowns > scene.model().unknowns
    moved = own.evaluate(1.001 * x * at)
    assert moved.solutions[0].model.unknowns == unknowns
    assert moved.values["push"] == pytest.approx(first.values["push"], rel=1e-2)
