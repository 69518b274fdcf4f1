"""Temperatures of rods in files, by places and along axes: closed forms, strips, layers, buckling, and bad input."""

import re

import numpy as np
import pytest

import isorod
from isorod import InputError, Thermal, statics
from isorod.files.scene import FileScene

SPACE = "space = {section_degree = 4, elements = 4, degree = 3}\n"
ROD = f"""
[rod.bar]
curve = {{straight = 20.0}}
section = {{circle = 1.0}}
law = {{NeoHookean = {{E = 2.0e5, nu = 0.3}}}}
{SPACE}expansion = 1.2e-5
temperature = 100.0
[support.a]
mean = "fixed"
end = "start"
[analysis.statics]
[measure.tip]
displacement = "bar"
[measure.rim]
displacement = "bar"
u = 0.5
xi = [1.0, 0.0]
"""

# Free strains are then uniform where they do no harm: round-off of supports is what is told of forces.
pytestmark = pytest.mark.filterwarnings("ignore:support reactions are at round-off level")


def run(folder, text, *changes):
    """What a file measures, some of its lines replaced by those with the same key."""
    for line in changes:
        text = re.sub(rf"(?m)^{line.split(' ')[0]} = .*$", lambda _, line=line: line, text, count=1)
    path = folder / "scene.toml"
    path.write_text(text)
    scene = FileScene(str(path))
    return scene.measure(statics.solve(scene.model(), **scene.settings()))


def test_a_temperature_along_the_rod_is_joined_by_straight_lines(tmp_path):
    """In the mean sections move by the integral of the free strain; their middles lead by a quarter of its slope."""
    law = "law = {LinearElastic = {E = 2.0e5, nu = 0.3}}"
    found = run(tmp_path, ROD, law, "temperature = [[0, 20], [5, 100], [20, 40]]")
    assert found["tip"][2] == pytest.approx(1.2e-5 * (5 * 60 + 15 * 70 - 4 / 4), rel=1e-5)
    (tmp_path / "warm.csv").write_text("s,T\n0,20\n5,100\n20,40\n")
    assert run(tmp_path, ROD, law, 'temperature = "warm.csv"')["tip"] == pytest.approx(found["tip"], abs=1e-9)


def test_a_gradient_across_bends_a_free_rod_into_a_circle(tmp_path):
    """Free of stress in small strains: curvature and growth along it are those of the formula."""
    law = "law = {LinearElastic = {E = 2.0e5, nu = 0.3}}"
    found = run(tmp_path, ROD, law, 'temperature = "50 + 10*n"')
    assert found["tip"] == pytest.approx([-0.5 * 1.2e-4 * 20**2, 0.0, 20 * 6e-4], rel=1e-6, abs=1e-9)


def test_wood_swells_along_its_axes(tmp_path):
    wood = "{E = [1e4, 500, 800], nu = [0.3, 0.3, 0.3], G = [600, 600, 60], axes = ['tangent', 'normal']}"
    found = run(tmp_path, ROD, f"law = {{OrthotropicKirchhoff = {wood}}}", "expansion = [1e-5, 4e-5, 8e-5]")
    assert found["tip"] == pytest.approx([0.0, 0.0, 20 * 1e-3], abs=1e-9)
    assert found["rim"] == pytest.approx([4e-3, 0.0, 10 * 1e-3], abs=1e-9)


def test_a_bar_between_walls_that_stiffens_pulls_more(tmp_path):
    more = '[support.b]\nmean = "fixed"\nend = "end"\n[measure.pull]\nreaction = "b"\ncomponent = "z"\n'
    table = "expansion = 1.2e-5\nstiffness = [[-200, 1.3], [0, 1.0]]"
    law = "law = {LinearElastic = {E = 2.0e5, nu = 0.3}}"
    found = run(tmp_path, ROD + more, law, "temperature = -100", table)
    assert found["pull"] == pytest.approx(1.15 * 2e5 * np.pi * 1.2e-3, rel=1e-9)


def test_a_layer_that_was_shrunk_on_presses_as_lame_says(tmp_path):
    """A sleeve 0.1 % too small on a tube, without Poisson's ratio: the pressure between two tubes of one modulus."""
    tube = ROD.replace(SPACE, "").replace("circle = 1.0}", "circle = 2.0}\nrings = [0.5, 0.75, 1.0]")
    law = "{LinearElastic = {E = 2e5, nu = 0.0}}"
    hoop = "".join(
        f'[measure.{name}]\nstress = "bar"\nu = 0.5\nxi = [{xi}, 0.0]\ncomponent = "yy"\n'
        for name, xi in (("bore", 0.5), ("skin", 1.0))
    )
    lines = f"law = [{law}, {law}]", "expansion = [0, 1e-5]", "temperature = -100"
    found = run(tmp_path, tube + hoop, *lines)
    a, c, b = 1.0, 1.5, 2.0
    p = 2e5 * 1e-3 / ((c**2 + a**2) / (c**2 - a**2) + (b**2 + c**2) / (b**2 - c**2))
    assert found["bore"] == pytest.approx(-2 * p * c**2 / (c**2 - a**2), rel=5e-3)
    assert found["skin"] == pytest.approx(2 * p * c**2 / (b**2 - c**2), rel=5e-3)


@pytest.mark.parametrize(
    "thin, more",
    [
        (1.0, "space = {section_degree = 4, elements = 4}"),
        pytest.param(1.0, "", marks=pytest.mark.slow),
        pytest.param(0.5, "", marks=pytest.mark.slow),
    ],
)
def test_a_bimetal_strip_has_timoshenkos_curvature(tmp_path, thin, more):
    """S. Timoshenko, Analysis of bi-metal thermostats, J. Opt. Soc. Am. 11 (1925) 233-255."""
    strip = """
[rod.{name}]
curve = {{straight = 40.0, start = [0, {y}, 0]}}
section = {{rounded_rectangle = {{width = 4.0, height = {t}, corner_radius = 0.05}}}}
law = {{NeoHookean = {{E = {E}, nu = 0.3}}}}
expansion = {a}
temperature = 100
{more}
"""
    text = strip.format(name="steel", y=-0.5, t=1.0, E=2e5, a=1.2e-5, more=more)
    text += strip.format(name="brass", y=thin / 2, t=thin, E=1e5, a=1.9e-5, more=more)
    text += """
[tie.bond]
slave = "steel.outer"
master = "brass.outer"
touching = true
[support.a]
mean = "fixed"
rod = "brass"
end = "start"
[analysis.statics]
[measure.low]
rotation = "brass"
u = 0.25
[measure.high]
rotation = "brass"
u = 0.75
"""
    found = run(tmp_path, text)
    m, n, h = 1.0 / thin, 2.0, 1.0 + thin
    curvature = 6 * 7e-4 * (1 + m) ** 2 / (h * (3 * (1 + m) ** 2 + (1 + m * n) * (m**2 + 1 / (m * n))))
    assert np.radians(found["high"][0] - found["low"][0]) == pytest.approx(20.0 * curvature, rel=5e-3)


def test_flanks_that_do_not_touch_are_refused():
    """Strips that are apart, one that is longer than the other, and round bars, which touch along a line."""

    def tied(section, y, long=6.0, **kind):
        rods = isorod.straight(long).sweep(section), isorod.straight(6.0, start=(0, y, 0)).sweep(section)
        bodies = [isorod.Body(isorod.Space(rod, section_degree=2), isorod.LinearElastic(1.0, 0.0)) for rod in rods]
        weld = isorod.Tie(isorod.LateralSurface(0, touching=True), isorod.LateralSurface(1), **kind)
        held = [isorod.MeanSupport.end(bodies[1].space, "start", "fixed", body=1)]
        return statics.solve(isorod.Model(bodies, held, ties=[weld]))

    flat = isorod.rounded_rectangle(None, 2.0, 1.0, 0.05)
    with pytest.raises(InputError, match="do not touch all along"):
        tied(flat, 1.2)
    with pytest.raises(InputError, match="do not touch all along"):
        tied(flat, 1.0, 8.0)
    with pytest.raises(InputError, match="along a line"):
        tied(isorod.circle(8, 1.0), 2.0)
    with pytest.raises(InputError, match="need 'weld'"):
        tied(flat, 1.0, kind="slide")


def held(law, *ends, length=6.0):
    space = isorod.Space(isorod.straight(length).sweep(isorod.circle(8, 1.0)))
    return isorod.Model([isorod.Body(space, law, 1.0)], [isorod.MeanSupport.end(space, one, "fixed") for one in ends])


def test_an_incompressible_bar_between_walls_is_squeezed_by_its_heat():
    """Stretched by 1 in all, it has a stretch of 1 / (1 + e) left; free it grows by e all round."""
    law, e = Thermal(isorod.NeoHookean(10.0, 0.5), 1e-3, 20.0), 0.02
    solution = statics.solve(held(law, "start", "end"))
    area, mu = np.pi * (1 + e) ** 2, 10.0 / 3.0
    assert solution.reactions[1, 2] == pytest.approx(area * mu * (1 / (1 + e) - (1 + e) ** 2), rel=1e-9)
    model = held(law, "start")
    space = model.bodies[0].space
    grown = statics.solve(model).displacement.reshape(-1, 3)[space.is_control_point]
    np.testing.assert_allclose(grown, e * space.positions[space.is_control_point], atol=1e-12)


def test_a_heated_bar_between_walls_buckles_at_eulers_strain():
    law, long = Thermal(isorod.NeoHookean(2e5, 0.3), 1e-5, 100.0), 200.0
    space = isorod.Space(isorod.straight(long).sweep(isorod.circle(8, 1.0)))
    walls = [isorod.Support.end(space, one) for one in ("start", "end")]
    found = isorod.buckling.solve(isorod.Model([isorod.Body(space, law)], walls)).factors[0]
    assert found * 1e-3 == pytest.approx(0.25 * (2.0 * np.pi / long) ** 2, rel=2e-3)


def test_a_rod_with_a_field_of_temperatures_moves_alike_in_both_integrators():
    law = Thermal(isorod.NeoHookean(10.0, 0.3), 1e-3, lambda places: places.offset[..., 0] + places.length)
    space = isorod.Space(isorod.straight(6.0).sweep(isorod.circle(8, 1.0)), order=2, elements=4, degree=3)
    model = isorod.Model([isorod.Body(space, law, 1.0)], [isorod.Support.end(space, "start")])
    implicit = isorod.dynamics.solve(model, 0.4, 0.02, integrator="implicit").displacement[-1]
    explicit = isorod.dynamics.solve(model, 0.4, 0.002, integrator="explicit").displacement[-1]
    assert np.abs(implicit - explicit).max() < 0.05 * np.abs(implicit).max()


@pytest.mark.parametrize(
    "line, said",
    [
        ("temperature = [[0, 20], [15, 80]]", "its table is from 0 to 15 along the rod, which has 0 to 20"),
        ("temperature = [[0, 20], [0, 80]]", "lengths must rise, got 0 and 0"),
        ("temperature = [[0, 20]]", "two or more rows"),
        ('temperature = "50 + q"', "'q' is not known; need one of s, n, b, r, x, y, z"),
        ('temperature = "50 +"', "no expression"),
        ('temperature = "log(r - 1)"', "not finite everywhere"),
        ('temperature = "none.csv"', "cannot be read"),
        ('temperature = "1e6*s"', "strain up to 0.2"),
        ("temperature = true", "got true"),
        ("expansion = [1e-5, 2e-5]", "got 2 numbers, need one"),
        ("expansion = []", "need numbers"),
        ("expansion = 1e-5\nstiffness = [[0, 1], [50, 0.5]]", "its table is from 0 to 50, the"),
        ("expansion = 1e-5\nstiffness = [[0, 1], [200, 0]]", "a factor of 0"),
        (
            "expansion = 1e-5\nstiffness = [[0, 1], [200, 0.5]]\ntemperature_history = [[0, 0], [1, 3], [2, 0]]",
            "its table is from 0 to 200, the temperature runs through 300",
        ),
        ("expansion = 1e-5\nstiffness = [[200, 1], [0, 1]]", "must ascend"),
    ],
)
def test_files_say_in_one_line_what_is_wrong_of_a_temperature(tmp_path, line, said):
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        run(tmp_path, ROD, line)
    assert "\n" not in str(caught.value) and "scene.toml:" in str(caught.value)


def test_each_layer_or_all_have_an_expansion(tmp_path):
    law = "{NeoHookean = {E = 1, nu = 0}}"
    with pytest.raises(InputError, match="got 1 numbers for 2 laws, need one, or one for each"):
        run(tmp_path, ROD, f"law = [{law}, {law}]\nrings = [0, 0.5, 1]", "expansion = [1e-5]")
