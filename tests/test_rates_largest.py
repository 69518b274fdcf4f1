"""Derivatives of largest stresses: of equal ones in several places, and of those where places begin to count."""

import pytest
from test_rates import logarithmic

from isorod import files, statics
from isorod.design import derivatives, parameters

BAR = """
[rod.bar]
curve = {straight = 6.0}
section = {ellipse = {a = 1.0, b = 1.0}}
law = {NeoHookean = {E = 1000.0, nu = 0.3}}
space = {elements = 4, section_degree = 3, degree = 3}

[support.wall]
end = "start"

[load.tip]
end = "end"
moment = [0.0, 0.0, 5.0]

[analysis.statics]

[measure.stress]
stress = "bar"
"""
pytestmark = pytest.mark.filterwarnings("ignore:stress along the rod", "ignore:von Mises stress")

A, B, LENGTH = "section.ellipse.a", "section.ellipse.b", "curve.straight"
HEAVY = 'end = "end"\nmoment = [0.0, 0.0, 5.0]', 'rod = "bar"\nbody_force = [0.0, 1.0, 0.5]'
JUMPS = "the slope of stress jumps, as where the largest of several changes its place"


def rates(path, words, text=BAR):
    (path / "bar.toml").write_text(text + words)
    scene = files.find(str(path / "bar.toml"))
    solution = statics.solve(scene.model(), **scene.settings())
    return scene.measure(solution), derivatives.of(scene, solution)


def test_where_places_as_large_part_there_is_none(tmp_path):
    """Twisted, a circle has one stress all round, an ellipse its largest at the ends of the shorter axis."""
    _, found = rates(tmp_path, 'component = "von_mises"\nu = 0.5\n')
    assert found.none == {f"rod.bar.{one}": JUMPS for one in (A, B)}
    assert logarithmic(found, "stress", "load.tip.moment.2") == pytest.approx(1.0, abs=1e-4)


def test_places_from_a_knot_on_have_the_stresses_of_their_own_side(tmp_path):
    """Elements with kinks between them have two stresses there; a length moves the place to the other element."""
    bent = BAR.replace(*HEAVY) + 'component = "along"\naway = 1.5\n'
    measured, found = rates(tmp_path, '[measure.same]\nstress = "bar"\ncomponent = "along"\nu = 0.25\n', bent)
    assert measured["stress"] == pytest.approx(measured["same"], rel=1e-9)
    assert found.none == {f"rod.bar.{LENGTH}": JUMPS}
    for name in found.by:
        assert found.by[name]["stress"] == pytest.approx(found.by[name]["same"], rel=1e-6)


def test_where_places_are_gone_there_is_none(tmp_path):
    """Only the middle is as far from both ends, and not where the bar is shorter."""
    both = BAR.replace(*HEAVY).replace("[load.tip]", '[support.far]\nend = "end"\n\n[load.tip]')
    _, found = rates(tmp_path, "away = 3.0\n", both)
    assert "the place of the largest value is not there any more" in found.none[f"rod.bar.{LENGTH}"]


def test_where_both_ends_are_alike_there_is_one(tmp_path):
    """What a length changes at a fixed displacement, and along with it, differs between the ends; the sum does not."""
    both = BAR.replace(*HEAVY).replace("[load.tip]", '[support.far]\nend = "end"\n\n[load.tip]')
    text = both + 'component = "von_mises"\naway = 1.5\n'
    measured, found = rates(tmp_path, "", text)
    length = f"rod.bar.{LENGTH}"
    assert not found.none
    (tmp_path / "bar.toml").write_text(text)
    scene, step = files.find(str(tmp_path / "bar.toml")), 6e-4
    less, more = (parameters.at(scene, {length: 6.0 + one}) for one in (-step, step))
    less, more = (float(one.measure(statics.solve(one.model()))["stress"]) for one in (less, more))
    assert found.by[length]["stress"] == pytest.approx((more - less) / (2.0 * step), rel=1e-5)
    assert measured["stress"] == pytest.approx(0.5 * (less + more), rel=1e-6)


def test_where_places_part_a_design_takes_their_mean(tmp_path):
    """Of a circle that is twisted: both axes together change it as the radius does."""
    _, found = rates(tmp_path, 'component = "von_mises"\nu = 0.5\n')
    assert set(found.averaged().by) == {*found.by, *found.none}
    both = sum(float(found.means[f"rod.bar.{one}"]["stress"]) for one in (A, B))
    assert both == pytest.approx(-3.0 * float(found.values["stress"]), rel=0.02)
