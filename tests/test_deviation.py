"""Geometry is what was written, or says how far it is from that: outlines and lines beside exact ones."""

import warnings

import numpy as np
import pytest

from isorod import InputError, circle, ellipse, helix, naca, polyline, rounded_rectangle, straight
from isorod.command.cli import main
from isorod.geometry import reading
from isorod.geometry.disk import boundary_functions
from isorod.geometry.section import from_file, from_points

SQUARE = np.array([[1.0, 0.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
SHAPES = {
    # Area, and the second moments about the principal axes.
    "square": (SQUARE, 4.0, [4.0 / 3.0, 4.0 / 3.0]),
    "bar": (SQUARE * [4.0, 0.5], 8.0, [8.0 / 12.0, 8.0 * 64.0 / 12.0]),
    "triangle": ([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]], 4.5, [9.0 / 8.0, 27.0 / 8.0]),
    "half round": (
        np.stack([np.cos(np.linspace(0, np.pi, 19)), np.sin(np.linspace(0, np.pi, 19))], axis=1),
        None,
        None,
    ),
}


def ring(points):
    return boundary_functions(len(points), 2.0 * np.pi * np.arange(6000) / 6000) @ np.asarray(points)


def around(count, a=1.0, b=1.0):
    theta = 2.0 * np.pi * np.arange(count) / count
    return np.stack([a * np.cos(theta), b * np.sin(theta)], axis=1)


# Outlines


@pytest.mark.usefixtures("silent")
@pytest.mark.parametrize("name", SHAPES)
def test_straight_sides_are_straight_and_corners_sharp(name):
    points, area, second = SHAPES[name]
    if area is None:
        area, second = np.pi / 2.0, [np.pi / 8.0 - 8.0 / (9.0 * np.pi), np.pi / 8.0]
    found = from_points(points)
    measured, moments = reading.moments(ring(found))
    assert measured == pytest.approx(area, rel=2e-3)
    assert np.linalg.eigvalsh(moments) == pytest.approx(second, rel=3e-3)
    assert 0.0 < found.deviation < 0.01
    assert straight(1.0).sweep(found).check() > 0.0


@pytest.mark.usefixtures("silent")
def test_a_square_of_sixteen_points_does_not_bulge():
    side = np.linspace(-1.0, 1.0, 5)[:-1]
    one = np.ones(4)
    points = np.vstack([np.c_[one, side], np.c_[-side, one], np.c_[-one, -side], np.c_[side, -one]])
    area, second = reading.moments(ring(from_points(points)))
    assert area == pytest.approx(4.0, rel=1e-3)
    assert np.diag(second) == pytest.approx(4.0 / 3.0, rel=1e-3)


def test_the_deviation_of_a_corner_falls_with_the_distance_of_control_points():
    with warnings.catch_warnings(action="ignore"):
        found = [from_points(SQUARE, n) for n in (16, 32, 64, 128)]
    told = [one.deviation for one in found]
    # The corner itself is what is farthest, the half diagonal the half diameter.
    for one, deviation in zip(found, told, strict=True):
        gap = np.linalg.norm(ring(one) - [1.0, 1.0], axis=1).min() / np.sqrt(2.0)
        assert deviation == pytest.approx(gap, rel=0.02)
    assert np.divide(told[:-1], told[1:]) == pytest.approx(2.0, abs=0.2)


def test_too_few_control_points_are_warned_of_or_refused():
    with pytest.warns(
        UserWarning, match=r"16 control points is 0.0249 off, 0.018 of half the diameter.*take more contr"
    ):
        from_points(SQUARE, 16)
    with pytest.raises(InputError, match=r"area or second moments of 8 control points are \+\S+ % off; take more"):
        from_points(SQUARE, 8)
    with pytest.warns(UserWarning, match="rounded rectangle: the outline of 16"):
        rounded_rectangle(16, 2.0, 2.0, 0.0)


@pytest.mark.usefixtures("silent")
@pytest.mark.parametrize(("count", "a", "b"), [(12, 1.0, 1.0), (16, 1.0, 1.0), (16, 2.0, 1.0), (200, 5.0, 1.0)])
def test_samples_of_a_smooth_outline_pass(count, a, b):
    found = from_points(around(count, a, b))
    area, second = reading.moments(ring(found))
    assert area == pytest.approx(np.pi * a * b, rel=2e-3)
    assert np.diag(second) == pytest.approx([np.pi * a**3 * b / 4.0, np.pi * a * b**3 / 4.0], rel=6e-3)


def test_few_points_are_told_to_be_few():
    with pytest.warns(UserWarning, match=r"straight sides between them hold 9.9 % less area than the smooth outline"):
        from_points(around(8))
    with pytest.warns(UserWarning, match=r"the turn of 31 degrees at point 1 is taken for a sharp corner, but"):
        from_points(around(16, 4.0, 1.0))


@pytest.mark.usefixtures("silent")
def test_an_airfoil_with_a_sharp_edge_passes(tmp_path):
    x = 0.5 * (1.0 + np.cos(np.linspace(0.0, np.pi, 40)))
    half = 0.6 * (0.2969 * np.sqrt(x) - x * (0.1260 + x * (0.3516 - x * (0.2843 - 0.1036 * x))))
    around = np.concatenate([np.stack([x, half], axis=1), np.stack([x, -half], axis=1)[-2:0:-1]])
    (tmp_path / "wing.dat").write_text("".join(f"{a} {b}\n" for a, b in around))
    found = from_file(tmp_path / "wing.dat", scale=3.0)
    assert found.deviation < 0.01
    assert reading.moments(ring(found))[0] == pytest.approx(9.0 * reading.moments(around)[0], rel=3e-3)
    assert naca("0012").deviation < 3e-3


@pytest.mark.usefixtures("silent")
def test_the_deviation_of_a_section_is_that_of_the_largest():
    found = from_points(SQUARE)
    rod = straight(5.0).sweep(found, scale=[0.5, 3.0], end=ellipse(len(found), 1.0, 0.9))
    assert rod.deviation.section == pytest.approx(3.0 * np.sqrt(2.0) * found.deviation, rel=0.02)
    assert rod.deviation.relative == found.deviation
    assert straight(5.0).sweep(2.0 * found).deviation.relative == found.deviation


def test_places_begin_at_the_first_point():
    for start in range(len(SQUARE)):
        points = np.roll(SQUARE, start, axis=0)
        places, where = reading.between(points, reading.corners(points, True), True)
        np.testing.assert_allclose(places[where], points, atol=1e-15)
        assert np.array_equal(places[0], places[-1]) and where[0] == 0 and (np.diff(where) > 0).all()


BENT = np.array([[0, 0], [1, 0], [2, 0], [3, 0.1], [4, 0.2], [5, 0.3]])


@pytest.mark.parametrize(
    ("points", "closed", "corners", "coarse"),
    [
        (SQUARE, True, [1, 2, 3, 4], [1, 2, 3, 4]),
        # Straight sides that meet at a small angle, and a bend of the same angle at each point.
        (BENT, False, [2], [2]),
        (around(63)[:6], False, [], []),
        (around(13), True, [], []),
        # Ten points round a circle may be a decagon, six are a hexagon.
        (around(10), True, [], range(10)),
        (around(6), True, range(6), range(6)),
        (around(16, 2.0, 1.0), True, [], [0, 1, 7, 8, 9, 15]),
        # The blunt edge of an airfoil.
        ([[5, 0.01], [3, 0.4], [1, 0.5], [-0.5, 0.0], [1, -0.5], [3, -0.4], [5, -0.01]], True, [0, 3, 6], [0, 3, 6]),
    ],
)
def test_corners_are_told_from_samples(points, closed, corners, coarse):
    points = np.array(points, dtype=float)
    assert reading.corners(points, closed).tolist() == list(corners)
    assert reading.coarse(points, closed).tolist() == list(coarse)


def test_a_chamfer_is_straight_beyond_doubt_where_its_sides_have_points():
    vertices = np.array([[0.0, 0.0], [2.0, 0.0], [3.0, 1.0], [3.0, 3.0], [0.0, 3.0]])
    with pytest.warns(UserWarning, match="turn of 45 degrees at point 1 is taken for a sharp corner"):
        found = from_points(vertices)
    assert reading.moments(ring(found))[0] == pytest.approx(8.5, rel=1e-3)
    with warnings.catch_warnings(action="error"):
        sides = np.stack([vertices, 0.5 * (vertices + np.roll(vertices, -1, axis=0))], axis=1).reshape(-1, 2)
        assert reading.moments(ring(from_points(sides)))[0] == pytest.approx(8.5, rel=1e-3)


@pytest.mark.usefixtures("silent")
def test_noise_is_no_crowd_of_corners():
    """Noise larger than the distance of points makes many of them corners, none of which matter."""
    random = np.random.default_rng(1)
    points = around(5000) * (1.0 + 1e-3 * random.standard_normal((5000, 1)))
    found = from_points(points)
    assert reading.moments(ring(found))[0] == pytest.approx(np.pi, rel=2e-3)


def test_moments_are_those_of_a_triangle():
    area, second = reading.moments(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]))
    assert area == 4.5
    assert second == pytest.approx(4.5 * np.array([[0.5, -0.25], [-0.25, 0.5]]))
    wide = np.array([1.03, 1.0])
    assert reading.mismatch(around(50) * wide, around(50)) == pytest.approx(1.03**3 - 1.0)


# Lines


@pytest.mark.parametrize(("pitch", "each"), [(2.6, 4), (2.6, None), (-6.0, None), (0.0, 4)])
@pytest.mark.parametrize("left", [False, True])
def test_the_deviation_of_a_helix_is_its_distance_from_the_exact_one(pitch, each, left):
    line = helix(6.0, pitch, 1.3, each, phase=20.0, left=left)
    angle = np.linspace(0.0, 2.6 * np.pi, 20001)
    around = np.radians(20.0) + (-angle if left else angle)
    exact = np.stack([6.0 * np.cos(around), 6.0 * np.sin(around), pitch / (2.0 * np.pi) * angle], axis=1)
    u = np.linspace(*line.axis.breaks[[0, -1]], 5000)
    places = line.sweep(circle(4, 0.1)).points(np.zeros((u.size, 2)), u)
    assert line.deviation == pytest.approx(reading.farthest(places, exact), rel=0.02, abs=1e-6)


@pytest.mark.usefixtures("silent")
@pytest.mark.parametrize(
    ("points", "closed"),
    [
        (6.0 * np.c_[around(60), np.arange(60) / 10.0][:, [0, 1, 2]], False),
        (10.0 * np.c_[around(40), np.zeros(40)], True),
        # An S-hook of two half circles, straight at its ends.
        (
            np.concatenate(
                [
                    np.c_[-5.0 + 5.0 * np.cos(np.linspace(np.pi, 0.0, 15)), 5.0 * np.sin(np.linspace(np.pi, 0.0, 15))],
                    np.c_[5.0 - 5.0 * np.cos(np.linspace(0.0, np.pi, 15)), -5.0 * np.sin(np.linspace(0.0, np.pi, 15))][
                        1:
                    ],
                ]
            )
            @ np.eye(2, 3),
            False,
        ),
    ],
    ids=["helix", "ring", "S-hook"],
)
def test_samples_of_a_smooth_line_are_not_taken_for_corners(points, closed):
    line = polyline(points, 1e-3, closed)
    assert line.deviation <= 1e-3
    line.sweep(circle(8, 0.5))


def test_a_bow_in_place_of_a_frame_is_warned_of():
    line = polyline([[0, 0, 0], [0, 0, 4.0], [4.0, 0, 4.0]], 0.0)
    with pytest.warns(
        UserWarning, match=r"largest deviation is 0.5, 2.5 of .*turn by 90 degrees at point 1: give straig"
    ):
        rod = line.sweep(circle(8, 0.2))
    assert rod.deviation.relative == pytest.approx(2.5, rel=0.01)
    assert rod.refine(3).with_rings((0.5, 1.0)).deviation == rod.deviation


def test_samples_too_far_apart_deviate_by_the_sagitta():
    line = polyline(10.0 * np.c_[around(8), np.zeros(8)], 0.0, closed=True)
    # The spline through eight points of a circle is 0.00115 of its radius off.
    assert line.deviation == pytest.approx(10.0 * (1.0 - np.cos(np.pi / 8.0)), abs=0.012)
    with pytest.warns(UserWarning, match="turn by 45 degrees"):
        line.sweep(circle(8, 1.0))


def test_a_tolerance_that_is_large_beside_the_radius_is_warned_of():
    line = polyline(6.0 * np.c_[around(60), np.arange(60) / 10.0], 0.05)
    with pytest.warns(UserWarning, match="take a smaller tolerance"):
        line.sweep(circle(8, 0.5))


def test_sections_far_from_where_they_belong_are_warned_of():
    """The tolerance of a sweep is a share of the largest arm, which is not the radius of a section off the line."""
    line = straight(5.0)
    assert line.sweep(ellipse(8, 0.5, 0.2), twist=300.0).deviation.sweep < 5e-3 * 0.55
    with pytest.warns(UserWarning, match="sections along the line: their largest deviation is"):
        rod = line.sweep(ellipse(8, 0.5, 0.2), twist=90.0, tolerance=0.05)
    assert rod.deviation.relative == pytest.approx(rod.deviation.sweep / 0.5)
    assert 0.01 < rod.deviation.relative < 0.055
    with pytest.warns(UserWarning, match="a section about its own middle"):
        line.sweep(circle(8, 0.1) + np.array([2.0, 0.0]), twist=90.0)


# Fillets

CORNERS = {
    "frame": ([[0, 0, 0], [0, 0, 5.0], [7.0, 0, 5.0]], False, 12.0 - (2.0 - np.pi / 2.0)),
    "in space": ([[0, 0, 0], [0, 0, 5.0], [7.0, 0, 5.0], [7.0, 4.0, 5.0]], False, 16.0 - 2.0 * (2.0 - np.pi / 2.0)),
    "in line": ([[0, 0, 0], [0, 0, 5.0], [0, 0, 7.0], [3.0, 0, 7.0]], False, 10.0 - (2.0 - np.pi / 2.0)),
    "rectangle": ([[0, 0, 0], [5.0, 0, 0], [5.0, 3.0, 0], [0, 3.0, 0]], True, 16.0 - 4.0 * (2.0 - np.pi / 2.0)),
    "ring in space": ([[0, 0, 0], [5.0, 0, 0], [5.0, 5.0, 0], [5.0, 5.0, 5.0], [0, 5.0, 5.0], [0, 0, 5.0]], True, None),
}


@pytest.mark.usefixtures("silent")
@pytest.mark.parametrize("name", CORNERS)
def test_fillets_are_exact(name):
    points, closed, length = CORNERS[name]
    length = 30.0 - 6.0 * (2.0 - np.pi / 2.0) if length is None else length
    line = polyline(points, closed=closed, fillet=1.0)
    assert line.deviation == 0.0
    assert line.axis.breaks[-1] == pytest.approx(length, rel=1e-14)
    rod = line.sweep(circle(8, 0.3))
    # Exact tori and cylinders (Pappus), but where the frame of a line in space is turned back.
    assert rod.volume() == pytest.approx(np.pi * 0.09 * length, rel=1e-3 if name == "ring in space" else 1e-12)
    assert rod.check() > 0.0
    # Half way round the corner: (sqrt 2 - 1) of the radius from it, where it turns by a right angle.
    places = rod.points(np.zeros((len(points), 2)), line.stations[: len(points)])
    turn = reading.turns(np.array(points), closed)
    assert np.linalg.norm(places - points, axis=1) == pytest.approx((np.sqrt(2.0) - 1.0) * (turn > 1.0), abs=1e-12)


def test_a_fillet_too_large_or_beside_a_tolerance_is_refused():
    points = CORNERS["in space"][0]
    with pytest.raises(InputError, match=r"fillet: got 4, need 3.5 at most for the side from point 1 to point 2"):
        polyline(points, fillet=4.0)
    with pytest.raises(InputError, match="need one of them"):
        polyline(points, 0.1, fillet=0.5)
    with pytest.raises(InputError, match="fillet: got -1, need a positive length"):
        polyline(points, fillet=-1.0)


SCENE = """analysis = "statics"
[rod.frame]
curve = {polyline = {points = [[0, 0, 0], [0, 0, 40], [40, 0, 40]], CORNER}}
section = {circle = 1.0}
law = {LinearElastic = {E = 1000.0, nu = 0.3}}
[support.foot]
end = "start"
[load.tip]
end = "end"
force = [0.0, 0.0, 0.001]
[measure.tip]
displacement = "frame"
component = "z"
"""


def test_a_frame_bends_as_two_beams_and_an_arc(tmp_path, command, silent):
    (tmp_path / "frame.toml").write_text(SCENE.replace("CORNER", "fillet = 3.0"))
    found = command.record("run", tmp_path / "frame.toml")
    # Of the squared moment along the fillet.
    bent = 3.0 * (37.0**2 * np.pi / 2.0 + 6.0 * 37.0 + 9.0 * np.pi / 4.0)
    theory = 0.001 * (37.0 * 40.0**2 + bent + 37.0**3 / 3.0) / (1000.0 * np.pi / 4.0)
    assert found["tip"] == pytest.approx(theory, rel=5e-3)
    assert found["deviation"][0]["relative"] < 1e-12


def test_a_run_says_how_far_its_rods_are_from_what_was_written(tmp_path, capsys):
    (tmp_path / "frame.toml").write_text(SCENE.replace("CORNER", "tolerance = 0.0").replace('"statics"', '"geometry"'))
    text = (tmp_path / "frame.toml").read_text().partition("law =")[0]
    (tmp_path / "frame.toml").write_text(text)
    assert main(["run", str(tmp_path / "frame.toml")]) == 0
    said = capsys.readouterr()
    assert "deviation           5 at most, 500 % of the radius: centre line" in said.out
    assert said.err.startswith("isorod: warning: rod.frame: centre line: its largest deviation is 5, ")
    (tmp_path / "frame.toml").write_text(text.replace("tolerance = 0.0", "fillet = 3.0"))
    assert main(["run", str(tmp_path / "frame.toml")]) == 0
    said = capsys.readouterr()
    assert "deviation" not in said.out and not said.err
