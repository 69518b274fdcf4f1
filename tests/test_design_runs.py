"""Designs and identifications of half a minute: a spring of two forces, a curve below a limit, friction."""

import json

import numpy as np
import pytest
from test_design import BEAM, tabled

# A compression spring, whose lower end is pushed up by a preload.
SPRING = """
[rod.wire]
curve = {helix = {radius = 6.0, pitch = 8.0, turns = 1.5}}
section = {circle = 0.53}
law = {LinearElastic = {E = 2.06e5, nu = 0.3}}
density = 7.85e-9

[support.lower]
end = "start"
displacement = [0.0, 0.0, 2.0]

[support.upper]
end = "end"

[analysis.statics]

[measure.force]
reaction = "lower"
component = "z"

[measure.stress]
stress = "wire"
u = 6.0
xi = [1.0, 0.0]

[case.low]

[case.high]
support.upper.displacement = [0.0, 0.0, -4.0]
"""


@pytest.mark.slow
def test_a_spring_of_two_forces_and_a_stress_is_the_lightest(command, tmp_path, monkeypatch):
    """The rate and the preload follow from the forces; the volume is as of a spring whose curvature counts."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spring.toml").write_text(SPRING)
    helix, preload = "rod.wire.curve.helix", "support.lower.displacement.2"
    vary = f"{helix}.radius=4:9,rod.wire.section.circle=0.4:1.6,{preload}=0.5:8"
    wanted_ = ("--target", "low.force=30,high.force=75", "--limit", "high.stress<1250", "--minimise", "mass")
    found = command.record("design", "spring.toml", "--vary", vary, *wanted_, "--output", "best.toml")
    # Forces begin at less than half of what they are to be.
    assert found["answers"]["high.force"]["before"] < 37.5
    assert not found["missed"]
    assert found["solves"] <= 30
    assert {"low.force = 30", "high.force = 75", "high.stress < 1250"} <= {*found["active"]}
    assert found["parameters"][preload]["after"] == pytest.approx(4.0 * 30.0 / 45.0, rel=1e-4)
    again = command.record("run", "best.toml", "--case", "high", "--no-estimate")
    assert again["force"] == pytest.approx(75.0, rel=1e-4)


# A rope over a drum that turns under it.
GRIP = """
[rod.rope]
curve = {start = [-4, 0, 0], direction = [1, 0, 0], normal = [0, 1, 0], chain = [
    {straight = 4.0}, {arc = {radius = 10.5, angle = 60}}, {straight = 4.0}]}
section = {circle = 0.5}
law = {NeoHookean = {E = 1000.0, nu = 0.3}}
space = {elements = 9, degree = 4, continuity = 1, section_degree = 3}

[obstacle.drum]
Cylinder = {point = [0.0, 10.5, 0.0], axis = [0, 0, 1], radius = 10.0}
motion = {angle = [[0, 0], [1, 5]]}

[support.held]
end = "end"

[load.weight]
end = "start"
force = [-10.0, 0.0, 0.0]

[contact.grip]
first = "rope"
second = "drum"
friction = 0.2

[analysis.statics]

[measure.torque]
obstacle_moment = "drum"
component = "z"
"""


# A bar that is pulled beyond yield.
METAL = """
[rod.bar]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {Plastic = {E = 200e3, nu = 0.3, hardening = [[0.0, 400.0], [1.0, 1400.0]]}}
space = {elements = 1, degree = 2, section_degree = 2}

[support]
left = {end = "start", mean = "fixed"}
right = {end = "end", mean = "fixed", displacement = [0.0, 0.0, 0.01]}

[analysis.statics]
load_steps = 4

[measure.force]
reaction = "right"
component = "z"
"""


@pytest.mark.filterwarnings("ignore:contact")
@pytest.mark.parametrize(
    ("text", "number", "true", "header", "given"),
    [
        pytest.param(
            *(GRIP, "contact.grip.friction", 0.237, "load.weight.force.0,torque", -10.0), marks=pytest.mark.slow
        ),
        (METAL, "rod.bar.law.Plastic.E", 180e3, "support.right.displacement.2,force", 0.01),
    ],
)
def test_what_depends_on_the_path_is_found_again(command, tmp_path, text, number, true, header, given):
    file, table = tmp_path / "my.toml", tmp_path / "my.csv"
    file.write_text(text)
    known = command.record("run", file, "--no-estimate", "--set", f"{number}={true}")[header.partition(",")[2]]
    tabled(table, header, [(given, known)])
    code, out, err = command._run(("identify", file, "--table", table, "--vary", number, "--json"))
    assert code == 0
    assert "two solves for each number" not in err
    assert json.loads(out)["parameters"][number]["found"] == pytest.approx(true, rel=1e-5)


@pytest.mark.slow
def test_a_limit_is_one_in_each_point_of_a_curve(command, tmp_path, monkeypatch):
    """Deflections of a cantilever are as the inverse fourth power of its radius: the limit decides, not the curve."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "beam.toml").write_text(BEAM)
    rows = [(load, 4.0 * load * 60.0**3 / (3.0 * np.pi * 2.1e5 * 1.3**4)) for load in (-5.0, -20.0)]
    tabled(tmp_path / "wanted.csv", "load.tip.force.1,deflection", rows)
    words = ("--vary", "rod.beam.section.circle=0.5:2", "--table", "wanted.csv", "--limit", "deflection>-1")
    found = command.record("design", "beam.toml", *words)
    radius = found["parameters"]["rod.beam.section.circle"]["after"]
    assert radius == pytest.approx((80.0 * 60.0**3 / (3.0 * np.pi * 2.1e5)) ** 0.25, rel=2e-3)
    assert [*found["active"]] == ["1.deflection > -1"]
