"""Ties in scene files: surfaces by their names, knots where a part of a rod is tied, what is measured and refused."""

import copy

import numpy as np
import pytest
from scene_files import WELD, text

from isorod import InputError, modal, statics
from isorod.command import printing, solving
from isorod.files.scene import FileScene
from isorod.model.tie import EndFace, LateralSurface

# A bar in a sleeve, bonded over a part of its length.
SLEEVE = """
analysis = "statics"
[rod.bar]
curve = {straight = 8.0}
section = {circle = 1.0}
law = {LinearElastic = {E = 10.0, nu = 0.3}}
[rod.sleeve]
curve = {straight = 5.0}
section = {circle = 3.0}
rings = [0.33333333333333333, 1.0]
law = {LinearElastic = {E = 1.0, nu = 0.3}}
space = {section_degree = 3}
[support.foot]
end = "start"
rod = "sleeve"
[load.pull]
end = "end"
rod = "bar"
force = [0.0, 0.0, 0.001]
[tie.bond]
slave = "bar.outer"
along = [1.0, 3.0]
master = "sleeve.inner"
"""


@pytest.fixture
def written(tmp_path):
    """Write a scene; return it, with changes."""

    def write(content, *changes):
        path = tmp_path / "my.toml"
        path.write_text(text(content) if isinstance(content, dict) else content)
        return FileScene(str(path), changes=changes)

    return write


def turned():
    """Return the welded bars, the upper end turned."""
    found = copy.deepcopy(WELD)
    del found["load"]
    found["support"]["top"] = {"end": "end", "rod": "upper", "rotation": [0.0, 0.0, 0.01]}
    return found


def test_the_torque_of_two_bars_welded(written):
    scene = written(turned())
    solution = statics.solve(scene.model(), **scene.settings())
    flexibility = 2.0 / np.pi * (4.0 / 10.0 + 3.0 / 1.0)
    found = scene.measure(solution)
    np.testing.assert_allclose(found["torque"], [0.0, 0.0, -np.radians(0.01) / flexibility], rtol=1e-7, atol=1e-15)
    assert found["force"] == pytest.approx(0.0, abs=1e-8)


def test_the_frequencies_of_two_bars_welded(written):
    """Torsion, fixed and free: ``Z1 cot(w L1/c1) = Z2 tan(w L2/c2)``, ``Z = sqrt(G rho)``."""
    scene = written(WELD | {"analysis": {"modal": {"modes": 8}}, "load": {}, "measure": {}})
    found = scene.measure(modal.solve(scene.model(), **scene.settings()))["frequencies"]
    for omega in (0.4479707513, 0.9256854357):
        w = np.array([4.0 * np.sqrt(2.0 / 10.0), 3.0]) * omega
        assert np.sqrt(20.0) / np.tan(w[0]) == pytest.approx(np.tan(w[1]), rel=1e-6)
        assert np.abs(found * 2.0 * np.pi / omega - 1.0).min() < 2e-5


def test_a_record_has_what_ties_carry_and_words_name_them(written):
    scene = written(WELD)
    solution, seconds = solving.solve(scene, scene.settings())
    record = solving.record(scene, solution, seconds, {})
    (tie,) = record["ties"]
    np.testing.assert_allclose(tie["force"], [0.0, 0.0, -0.001], atol=1e-12)
    assert record["force"] == tie["force"][2]
    (line,) = [one for one in printing.summary(record, scene).splitlines() if one.startswith("tie")]
    assert line.startswith("tie weld            force ") and "-0.001;" in line


@pytest.mark.parametrize(
    ("changes", "slave", "master"),
    [
        ([], EndFace(1, "start"), EndFace(0, "end")),
        (["tie.weld.slave=lower.start", "tie.weld.master=upper.outer"], EndFace(0, "start"), LateralSurface(1)),
        (
            ["tie.weld.slave=lower.outer", "tie.weld.along=[1, 2]", "tie.weld.master=upper.inner"],
            LateralSurface(0, (1, 2)),
            LateralSurface(1, surface="inner"),
        ),
    ],
)
def test_surfaces_by_their_names(changes, slave, master, written):
    (tie,) = written(WELD, *changes).model().ties
    assert (tie.slave, tie.master) == (slave, master) and tie.gap == 0.1


@pytest.mark.parametrize(
    ("changes", "knots"),
    [
        ([], [0.125, 0.375]),
        # At a knot of elements that the file gives, and at one of the curve.
        (["rod.bar.space={elements=8}", "tie.bond.along=[2, 3.3]"], [0.25, 0.4125]),
        (["rod.bar.curve={straight={length=8, breaks=[0, 0.25, 1]}}", "tie.bond.along=[2, 3.3]"], [0.25, 0.4125]),
        # Where the rod begins and ends there are no more.
        (["tie.bond.along=[0, 3]"], [0.375]),
        (["tie.bond.along=[0, 8.0000001]"], []),
    ],
)
def test_a_part_that_is_tied_ends_at_kinks(changes, knots, written):
    space = written(SLEEVE, *changes).model().bodies[0].space
    kinks = space.axis.breaks[1:-1][space.axis.multiplicities[1:-1] == space.axis.degree]
    np.testing.assert_allclose(kinks, knots, atol=1e-9)
    assert np.diff(space.axis.breaks).min() > 1e-3


def test_kinks_are_at_lengths_along_a_rod_whose_parameter_is_none(written):
    line = "[[0, 0, 0], [0, 0.2, 1], [0, 0, 2.5], [0, 0.1, 5], [0, 0, 8]]"
    space = written(SLEEVE, f"rod.bar.curve={{polyline={{points={line}, tolerance=0.01}}}}").model().bodies[0].space
    kinks = space.axis.breaks[1:-1][space.axis.multiplicities[1:-1] == space.axis.degree]
    length = space.rod.arc_length(np.asarray(kinks))
    np.testing.assert_allclose([np.abs(length - one).min() for one in (1.0, 3.0)], 0.0, atol=1e-9)


def test_a_part_is_tied_on_halved_elements_as_well(written):
    scene = written(SLEEVE, "tie.bond.along=[2.0, 3.0]", "rod.bar.space={elements=4}", "rod.sleeve.space={elements=2}")
    from dataclasses import replace

    from isorod.space.choice import halved

    spaces = [body.space for body in scene.model().bodies]
    finer = scene.on([replace(one, **halved(one)) for one in spaces]).model()
    assert finer.bodies[0].space.axis.elements == 2 * spaces[0].axis.elements
    assert statics.solve(finer).ties[0].gap < 1e-12


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (["tie.weld.slave=upper.strat"], "tie.weld.slave: 'upper.strat' is not known; did you mean upper.start?"),
        (["tie.weld.slave=3"], "tie.weld.slave: got 3, need the name of a surface"),
        (["tie.weld.slave=lower.start"], "tie.weld: tie: rod lower with itself; name two bodies"),
        (
            ["tie.weld.along=[0, 1]"],
            "tie.weld.along: it goes with a lateral surface, ROD.outer or ROD.inner",
        ),
        (["tie.weld.gap=0"], "tie.weld.gap: tie: gap: got 0, need a positive length"),
        (["measure.force.tie_force=wled"], "measure.force.tie_force: 'wled' is not known; did you mean weld?"),
        (
            ["rod.upper.curve.straight.start=[0, 0, 4.5]"],
            "tie.weld.gap: the surfaces are 0.5 apart .* or give a larger gap",
        ),
    ],
)
def test_a_tie_that_cannot_be_is_refused_where_it_is(changes, said, written):
    with pytest.raises(InputError, match=rf"my.toml:\d+: {said}"):
        solving.solve(written(WELD, *changes), {})


def test_a_part_between_knots_that_a_file_gives_is_refused(written):
    scene = written(SLEEVE, "rod.bar.space={elements=8, knots=[0.2]}")
    with pytest.raises(
        InputError, match=r"my.toml:\d+: tie.bond.along: .*1 along the rod is no joint .* knot 0.125 tw"
    ):
        solving.solve(scene, {})


@pytest.mark.parametrize("given", ["[[0, 0], [0.1, 2.0], [0.3, 0]]", "law.csv"])
def test_a_law_of_traction_over_slip_is_points_or_a_file_of_them(given, written, tmp_path):
    (tmp_path / "law.csv").write_text("# slip, traction\n0, 0\n0.1, 2\n0.3, 0\n")
    scene = written(SLEEVE, f"tie.bond.bond={given}", "tie.bond.kind=slide")
    (tie,) = scene.model().ties
    assert tie.bond == ((0.0, 0.0), (0.1, 2.0), (0.3, 0.0))
    with pytest.raises(InputError, match=r"my.toml:\d+: tie.bond.bond: got 'x'|my.toml:\d+: tie.bond.bond: x: cannot"):
        written(SLEEVE, "tie.bond.bond=x", "tie.bond.kind=slide")
    for wrong in ("[[0, 0], [0.1, -2.0]]", "[[0, 0, 1], [0.1, 2.0, 1]]"):
        with pytest.raises(InputError, match=r"^\S+my.toml:\d+: tie.bond.bond: ") as caught:
            written(SLEEVE, f"tie.bond.bond={wrong}", "tie.bond.kind=slide").model()
        assert "\n" not in str(caught.value)


COLUMN = """
[rod.column]
curve = {straight = 20.0}
section = {circle = 1.0}
law = {LinearElastic = {E = 1.0, nu = 0.3}}
[rod.left]
curve = {straight = {start = [-9.0, 0.0, 7.0], end = [-0.9, 0.0, 7.0]}}
section = {circle = 0.4}
law = {LinearElastic = {E = 1.0, nu = 0.3}}
[rod.right]
curve = {straight = {start = [0.9, 0.0, 7.0001], end = [9.0, 0.0, 7.0]}}
section = {circle = 0.4}
law = {LinearElastic = {E = 1.0, nu = 0.3}}
[rod.high]
curve = {straight = {start = [0.0, 0.9, 15.0], end = [0.0, 9.0, 15.0]}}
section = {circle = 0.4}
law = {LinearElastic = {E = 1.0, nu = 0.3}}
[tie]
left = {slave = "left.end", master = "column.outer"}
right = {slave = "right.start", master = "column.outer"}
high = {slave = "column.outer", master = "high.start", gap = 50.0}
[support.foot]
end = "start"
rod = "column"
[analysis.statics]
"""


def test_a_rod_has_short_elements_where_ends_of_others_are_tied_to_its_flank(tmp_path):
    """What meets it in one place from two sides is one kink; the rods that end there have what they had."""
    (tmp_path / "frame.toml").write_text(COLUMN)
    spaces = [body.space for body in FileScene(str(tmp_path / "frame.toml")).model().bodies]
    axis = spaces[0].axis
    twice = [u for u in axis.breaks[1:-1] if np.sum(np.abs(axis.knots - u) < 1e-9) == axis.degree]
    np.testing.assert_allclose(twice, [0.35, 0.75], atol=1e-4)
    lengths = 20.0 * np.diff(axis.breaks)
    for u in twice:
        k = int(np.searchsorted(axis.breaks, u))
        assert max(lengths[k - 1], lengths[k]) < 0.6 * lengths.max()
    bare = COLUMN.partition("[tie]")[0] + "[analysis.statics]\n"
    (tmp_path / "bare.toml").write_text(bare)
    alone = [body.space for body in FileScene(str(tmp_path / "bare.toml")).model().bodies]
    assert [str(space) for space in spaces[1:]] == [str(space) for space in alone[1:]]
    assert spaces[0].elements > alone[0].elements or len(spaces[0].knots) > len(alone[0].knots)
