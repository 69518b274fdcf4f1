"""Supports that turn by any angle: torque and moment in closed form, whole turns that are kept, steps, and files."""

import warnings

import numpy as np
import pytest

from isorod import InputError, LinearElastic, NeoHookean, Space, circle, dynamics, statics, straight
from isorod.checks.turning import LONGEST, Turning
from isorod.command import cli, solving
from isorod.files.scene import FileScene
from isorod.model import Body, Contact, Model, Pressure, Sphere, Support
from isorod.statics import continuation
from isorod.tensors import rotation

E, NU, LENGTH = 2.1e5, 0.3, 50.0
TURN = 2.0 * np.pi

FILE = """
[rod.bar]
curve = {straight = 50.0}
section = {circle = 1.0}
law = {NeoHookean = {E = 2.1e5, nu = 0.3}}
space = {elements = 4, degree = 4, section_degree = 2}
[support.foot]
end = "start"
[support.head]
end = "end"
{turn}
[analysis.{analysis}]
"""


def rod(turn, radius=0.5, nu=NU, rings=None, first=(0.0, 0.0, 0.0), windows=((0.0, 1.0), (0.0, 1.0)), **space):
    """Return a model of a straight rod along z, its ends turned, the first one held in its place."""
    made = straight(LENGTH).sweep(circle(8, radius))
    given = {"elements": 4, "degree": 5, "continuity": 0, "section_degree": 2} | space
    tied = given.pop("tied", "")
    on = Space(made if rings is None else made.with_rings(rings), **given)
    held = "".join(letter for letter in "xyz" if letter not in tied)
    ends = (
        Support.end(on, "start", turn=first, during=windows[0]),
        Support.end(on, "end", held, turn=tuple(turn), tied=tied, during=windows[1]),
    )
    return Model([Body(on, NeoHookean(E, nu), 1e-9)], ends)


def torsion(angle, radius=0.5, hole=0.0, nu=NU):
    """Return G J theta / L."""
    return 0.5 * E / (1.0 + nu) * 0.5 * np.pi * (radius**4 - hole**4) * angle / LENGTH


def bending(angle, radius=0.5):
    """Return E I theta / L."""
    return E * 0.25 * np.pi * radius**4 * angle / LENGTH


THIN = 0.5 * (1.0 - (1.0 + NU) * (1.0 - 2.0 * NU) * 500.0 / E)
TURNED = [
    # Of slender rods what large twist adds is as its square: 3 (r theta / L)^2 at most.
    *[(angle, {"radius": 0.25, "elements": elements}, {"radius": 0.25}) for angle, elements in ((6.0, 4), (-13.0, 4))],
    (25.0, {"radius": 0.25, "elements": 8}, {"radius": 0.25}),
    (1.5 * TURN, {"radius": 0.25, "rings": (0.5, 1.0)}, {"radius": 0.25, "hole": 0.125}),
    (2.0 * TURN, {"nu": 0.5}, {"nu": 0.5}),
    # Its ends hold its length: it is thinner by (1 + nu) (1 - 2 nu) p / E.
    (1.5 * TURN, {"loads": [Pressure(500.0, follows=True)]}, {"radius": THIN}),
]


@pytest.mark.parametrize(("angle", "changes", "expected"), TURNED, ids=str)
def test_torque_grows_with_the_turn(angle, changes, expected):
    changes = dict(changes)
    loads = changes.pop("loads", ())
    model = rod((0.0, 0.0, angle), **changes)
    found = statics.solve(Model(model.bodies, model.supports, loads=loads))
    assert found.moments[1, 2] == pytest.approx(torsion(angle, **expected), rel=2e-3 if "elements" in changes else 5e-3)
    assert bool(found.pressures) == ("nu" in changes)
    assert loads or found.work == pytest.approx(found.moments[1, 2] * angle, rel=1e-6)


def test_a_rod_that_touches_is_turned():
    on = Space(straight(LENGTH).sweep(circle(8, 0.5)), elements=6, degree=3, order=1)
    ends = Support.end(on, "start"), Support.end(on, "end", turn=(0.0, 0.0, 0.6 * TURN))
    ball = Sphere(center=(0.0, -2.4, 0.5 * LENGTH), radius=2.0)
    with pytest.warns(UserWarning, match="control points wide"):
        found = statics.solve(Model([Body(on, NeoHookean(E, NU))], ends, contacts=[Contact(0, ball)]))
    assert found.reactions[:2, 1].max() < 0.0
    assert found.moments[1, 2] == pytest.approx(torsion(0.6 * TURN), rel=2e-2)


@pytest.mark.parametrize(("turns", "space"), [(1, {}), (2, {"elements": 16, "continuity": None})])
def test_a_rod_is_rolled_up(turns, space):
    model = rod((0.0, turns * TURN, 0.0), radius=0.25, tied="xz", **space)
    with pytest.warns(UserWarning, match="overlap"):
        found = statics.solve(model)
    exact = bending(turns * TURN, 0.25)
    assert found.moments[1, 1] == pytest.approx(exact, rel=5e-3)
    assert found.estimate() < 5e-3


def test_an_estimate_knows_when_a_rolled_up_rod_is_coarse():
    coarse, fine = (
        statics.solve(rod((0.0, 0.5 * TURN, 0.0), tied="xyz", **space))
        for space in ({"elements": 8, "degree": 3, "continuity": 2}, {"elements": 12})
    )
    error = abs(coarse.moments[1, 1] / fine.moments[1, 1] - 1.0)
    assert error > 5e-3
    assert 0.3 * error < coarse.estimate() < 3.0 * error


@pytest.mark.parametrize("steps", [1, 3])
def test_small_steps_lead_to_the_same_about_a_skew_axis(steps):
    turn = np.radians([200.0, 0.0, 300.0])
    one, other = (statics.solve(rod(turn, tied="xyz", degree=4), load_steps=count) for count in (steps, 40))
    assert one.displacement == pytest.approx(other.displacement, abs=1e-6 * LENGTH)


def test_no_step_turns_a_support_farther_than_a_quarter():
    windows = (0.0, 0.5), (0.25, 1.0)
    model = rod((0.0, 0.0, 0.9 * TURN), first=(0.0, 0.0, -1.1 * TURN), windows=windows)
    found = statics.solve(model, keep=True)
    factors = [0.0, *(step.factor for step in found.path)]
    assert {0.25, 0.5} < {*factors}
    angles = np.array([[np.interp(f, window, (0.0, 1.0)) for window in windows] for f in factors]) * TURN * (-1.1, 0.9)
    apart = np.diff(angles[:, 1] - angles[:, 0])
    assert max(np.abs(apart).max(), np.abs(np.diff(angles, axis=0)).max()) < LONGEST + 1e-9
    assert found.moments[1, 2] == pytest.approx(torsion(2.0 * TURN), rel=5e-3)


def test_the_longest_step_is_that_of_two_supports_against_each_other():
    turning = Turning(rod((0.0, 0.0, 3.0), first=(0.0, 4.0, 0.0), windows=((0.0, 0.5), (0.25, 1.0))))
    assert turning.longest_step(0.0) == pytest.approx(LONGEST / 8.0)
    assert turning.longest_step(0.3) == pytest.approx(LONGEST / np.hypot(8.0, 4.0))
    assert turning.longest_step(0.5) == pytest.approx(LONGEST / 4.0)
    assert Turning(rod((0.0, 0.0, 0.0))).longest_step(0.0) == np.inf


def test_a_start_that_is_wound_otherwise_is_left():
    less, once = (rod((0.0, 0.0, 0.3 + whole * TURN), degree=4) for whole in (0, 1))
    at_less, at_once = (statics.solve(model) for model in (less, once))
    assert at_once.moments[1, 2] == pytest.approx(torsion(0.3 + TURN), rel=5e-3)
    for model, start, right in ((less, at_once, at_less), (once, at_less, at_once)):
        found = statics.solve(model, start=start.displacement)
        assert found.moments[1, 2] == pytest.approx(right.moments[1, 2], rel=1e-6)
        assert statics.solve(model, start=right.displacement).load_steps == 1


@pytest.mark.parametrize(("turn", "tied"), [((0.0, 0.0, 1.0), ""), ((0.0, 1.0, 0.0), "xyz"), ((0.6, 0.0, 0.8), "xyz")])
def test_whole_turns_are_seen_from_one_end_to_the_other(turn, tied):
    about = np.array(turn)
    found = statics.solve(rod((0.4 + 0.5 * TURN) * about, tied=tied, degree=4)).displacement
    for whole in range(-3, 4):
        turning = Turning(rod((0.4 + (0.5 + whole) * TURN) * about, tied=tied, degree=4))
        assert turning.follows(found) == (whole == 0)


def test_a_step_that_loses_a_turn_is_seen():
    model = rod((0.0, 0.0, TURN + 0.2), degree=4)
    turning = Turning(model)
    before, lost, right = (
        statics.solve(rod((0.0, 0.0, angle), degree=4)).displacement for angle in (TURN - 1.0, 0.2, TURN + 0.2)
    )
    assert turning.lost(before, right) is None
    assert "turn" in turning.lost(before, lost)


def test_a_free_end_turns_with_the_rod():
    on = Space(straight(LENGTH).sweep(circle(8, 0.5)), elements=2, degree=3, section_degree=2)
    model = Model([Body(on, NeoHookean(E, NU))], [Support.end(on, "start", turn=(0.0, 2.5 * TURN, 0.0))])
    with pytest.warns(UserWarning, match="at round-off level"):
        found = statics.solve(model)
    assert found.load_steps >= 10
    assert found.position(0, 1.0) == pytest.approx([0.0, 0.0, -LENGTH], abs=1e-6)


def test_twist_at_which_a_rod_buckles():
    # Greenhill (1883), of clamped ends: M = 8.987 E I / L, twice the first root of tan(x) = x.
    # What it grows in length it may: held, its ends would press it.
    path = continuation.follow(rod((0.0, 0.0, 13.0), tied="z"), 0.02, 60, longest=0.5)
    angles, unstable = 13.0 * path.factors, path.negative > 0
    assert np.diff(angles).max() < LONGEST + 1e-9
    assert angles[~unstable].max() < 8.9868 * (1.0 + NU) * 1.01
    assert 8.9868 * (1.0 + NU) * 0.99 < angles[unstable].min() < 13.5


@pytest.mark.parametrize(
    ("degrees", "lost"), [(0.0, False), (100.0, False), (134.0, False), (136.0, True), (180.0, True)]
)
def test_a_step_is_lost_where_sections_turn_by_more_than_three_quarters_of_a_half_turn(degrees, lost):
    model = rod((0.0, 0.0, 1.0))
    positions = model.bodies[0].space.positions
    turned = positions @ rotation((0.0, 0.0, np.radians(degrees))).T - positions
    assert bool(Turning(model).lost(np.zeros(model.dofs), turned.ravel())) is lost


def test_a_law_of_small_strains_is_not_turned_far():
    model = rod((0.0, 0.0, TURN))
    bodies = [Body(model.bodies[0].space, LinearElastic(E, NU))]
    with pytest.raises(
        InputError, match=r"support 1: got a rotation of 360 degrees, but LinearElastic is a small-strain law"
    ):
        statics.solve(Model(bodies, model.supports))


def write(folder, turn, analysis="statics"):
    path = folder / "bar.toml"
    path.write_text(FILE.replace("{turn}", turn).replace("{analysis}", analysis))
    return FileScene(str(path))


def test_a_file_says_degrees(tmp_path):
    support = write(tmp_path, "rotation = [0, 30, -720.0]").model().supports[1]
    assert support.turn == pytest.approx([0.0, np.pi / 6.0, -4.0 * np.pi], rel=1e-15)
    scene = write(tmp_path, "rotation = [0, 0, 180]")
    found, _ = solving.solve(scene, scene.settings())
    assert found.moments[1, 2] == pytest.approx(torsion(np.pi, 1.0), rel=5e-3)


def chosen(folder, law="nu = 0.3", **rotations):
    """Write a bar whose ends turn about z by so many turns, and whose space is chosen."""
    path = folder / "bar.toml"
    text = FILE.replace("space = {elements = 4, degree = 4, section_degree = 2}", "").replace("nu = 0.3", law)
    text = text.replace('"start"', f'"start"\nrotation = [0, 0, {360 * rotations["start"]}]')
    turn = f"rotation = [0, 0, {360 * rotations['end']}]"
    path.write_text(text.replace("{turn}", turn).replace("{analysis}", "statics"))
    return FileScene(str(path))


def test_a_rod_of_a_file_has_elements_for_what_its_supports_turn_it_by(tmp_path):
    """Of degree 5 one for each 120 degrees, and no less than five; what both ends turn by alike twists nothing."""
    found = {}
    for turns in ((0, 0), (3, 3), (0, 5), (-5, 5), (0, 1)):
        (body,) = chosen(tmp_path, start=turns[0], end=turns[1]).model().bodies
        found[turns] = body.space.elements
        assert body.space.knots[0] * LENGTH == pytest.approx(0.4)
    assert found == {(0, 0): 5, (3, 3): 5, (0, 5): 15, (-5, 5): 30, (0, 1): 5}
    (body,) = write(tmp_path, "rotation = [0, 0, 1800]").model().bodies
    assert body.space.elements == 4


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the equilibrium is unstable")
def test_a_bar_of_a_file_that_is_twisted_five_times_is_right_by_default(tmp_path):
    """Incompressible, with its length held: R. S. Rivlin, Phil. Trans. R. Soc. A 242 (1949) 173: G J k."""
    scene = chosen(tmp_path, "nu = 0.5", start=0, end=5)
    found, _ = solving.solve(scene, scene.settings())
    exact = E / 3.0 * 0.5 * np.pi * 5.0 * TURN / LENGTH
    assert found.moments[1, 2] == pytest.approx(exact, rel=1e-3)
    assert found.estimate() < 5e-3


def test_radians_of_a_file_are_taken_with_a_word_on_what_to_write(tmp_path):
    with pytest.warns(
        FutureWarning, match=r"bar\.toml:11: support\.head\.turn: .* rotation = \[0, 0, 90\], in degrees$"
    ):
        support = write(tmp_path, f"turn = [0, 0, {np.pi / 2.0!r}]").model().supports[1]
    assert support.turn == pytest.approx([0.0, 0.0, np.pi / 2.0])
    with pytest.warns(FutureWarning, match=r"if degrees were meant, write rotation = \[0, 0, 30\]"):
        write(tmp_path, "turn = [0, 0, 30]")


def test_degrees_in_the_old_key_are_told_where_the_run_fails_too(tmp_path, capsys):
    with pytest.warns(FutureWarning):
        write(tmp_path, "turn = [0, 0, 30]")
    path = str(tmp_path / "bar.toml")
    assert cli.main(["run", path, "--load-steps", "0"]) == 2
    first, last = capsys.readouterr().err.splitlines()
    assert "if degrees were meant, write rotation = [0, 0, 30]" in first
    assert "load" in last


def test_an_angle_that_is_given_twice_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"given twice, by turn too"):
        write(tmp_path, "rotation = [0, 0, 30]\nturn = [0, 0, 0.5]")


def test_a_motion_does_not_begin_with_an_end_turned_far():
    with pytest.raises(InputError, match=r"support 1: got an instantaneous rotation of 360 degrees"):
        dynamics.solve(rod((0.0, 0.0, TURN)), 1e-6, time_step=1e-7, integrator="implicit")


@pytest.mark.parametrize("degrees", [1.0, 5.0])
def test_the_torque_of_a_linear_elastic_bar_is_that_of_linear_theory(degrees):
    """Its stress balances in the places at rest: about those of the turned face it was 2 % more at one degree."""
    space = Space(straight(40.0).sweep(circle(8)))
    ends = Support.end(space, "start"), Support.end(space, "end", turn=(0.0, 0.0, np.radians(degrees)))
    solution = statics.solve(Model([Body(space, LinearElastic(10.0, 0.25))], ends))
    assert solution.moments[1, 2] == pytest.approx(4.0 * np.pi / 2.0 * np.sin(np.radians(degrees)) / 40.0, rel=1e-6)


@pytest.mark.parametrize(
    ("law", "turn", "held", "warned"),
    [
        (LinearElastic, (0.0, 0.0, 2.0), "xyz", True),
        (LinearElastic, (0.0, 0.0, 0.001), "xyz", False),
        (LinearElastic, (2.0, 0.0, 0.0), "z", False),
        (NeoHookean, (0.0, 0.0, 2.0), "xyz", False),
    ],
)
def test_a_face_turned_under_a_law_of_small_strains_is_warned_of(law, turn, held, warned):
    """A turn by 2 degrees is a strain of 1 - cos 2 degrees to it, where what it twists is strained by as little."""
    made = Space(straight(LENGTH).sweep(circle(8, 0.5)), elements=4, degree=3, section_degree=2)
    ends = Support.end(made, "start"), Support.end(made, "end", held, turn=tuple(np.radians(turn)))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        statics.solve(Model([Body(made, law(E, NU))], ends))
    found = [str(one.message) for one in said if "its face turns by " in str(one.message)]
    assert len(found) == warned
    assert all("takes for a strain of 0.00061" in one and "support 1" in one for one in found)
