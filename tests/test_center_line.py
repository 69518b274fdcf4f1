"""Centre lines: straight, exact arcs, even helices, curves made elsewhere; what is no line, and why a rod folds."""

from types import SimpleNamespace

import numpy as np
import pytest
from lines import RIM, TREFOIL, along, random_curve, sections
from refused import refused

from isorod import FoldedRodError, circle, flower
from isorod.geometry.center_line import CenterLine, nurbs, polyline, straight
from isorod.geometry.coils import arc, helix
from isorod.geometry.fitting import evaluate
from isorod.scenes.spring import Spring

# Straight lines


def test_a_straight_line_goes_from_point_to_point_with_a_frame_that_is_turned_the_shortest_way():
    line = straight(start=(1.0, 0.0, 2.0), end=(1.0, 3.0, 6.0), breaks=[0.0, 1.0, 3.0])
    rod = line.sweep(circle(5, 0.5))
    u = np.array([0.0, 0.6, 3.0])
    centre = rod.points(np.zeros((3, 2)), u)
    np.testing.assert_allclose(centre, [1.0, 0.0, 2.0] + u[:, None] * [0.0, 1.0, 4.0 / 3.0], atol=1e-14)
    arms = rod.points([[1.0, 0.0], [0.0, 1.0]], [0.0, 0.0]) - [1.0, 0.0, 2.0]
    np.testing.assert_allclose(arms, [[0.5, 0.0, 0.0], [0.0, 0.4, -0.3]], atol=1e-14)
    assert rod.volume() == pytest.approx(np.pi * 0.25 * 5.0, rel=1e-12)


# Arcs


@pytest.mark.parametrize("angle", [45.0, 90.0, 270.0, -120.0, 360.0])
def test_arcs_and_their_tori_are_exact(angle):
    rod = arc(4.0, angle, phase=30.0).sweep(circle(5, 0.5))
    assert rod.closed == (angle == 360.0)
    _, centers, arms = sections(rod)
    x = centers[:, None] + arms
    assert np.abs(np.hypot(centers[:, 0], centers[:, 1]) - 4.0).max() < 1e-13
    assert np.abs((np.hypot(x[..., 0], x[..., 1]) - 4.0) ** 2 + x[..., 2] ** 2 - 0.25).max() < 1e-13
    ends = np.radians([30.0, 30.0 + angle])
    np.testing.assert_allclose(centers[[0, -1], :2].T, 4.0 * np.array([np.cos(ends), np.sin(ends)]), atol=1e-13)
    # Pappus
    assert rod.volume() == pytest.approx(np.radians(abs(angle)) * 4.0 * np.pi * 0.25, rel=1e-7)
    assert rod.check() > 0.0


# Helices


def lead_angles(line):
    tangents = along(line, 100)[1]
    return np.degrees(np.arcsin(tangents[:, 2]))


@pytest.mark.parametrize("turns", [0.1, 0.3, 1.5, 3])
@pytest.mark.parametrize("pitch", [2.60258, -12.0, 12.0 * np.pi])
def test_the_lead_angle_of_a_helix_is_right_along_its_whole_length(pitch, turns):
    line = helix(6.0, pitch, turns)
    assert np.abs(lead_angles(line) - np.degrees(np.arctan(pitch / (12.0 * np.pi)))).max() < 0.02
    where, _ = along(line)
    assert np.abs(np.hypot(where[:, 0], where[:, 1]) / 6.0 - 1.0).max() < 6e-5
    assert line.axis.elements == np.ceil(8 * turns)


def test_the_papers_arcs_climb_unevenly():
    """What the even helix is for."""
    assert (np.ptp(lead_angles(helix(6.0, 2.60258, 3, 4))), np.ptp(lead_angles(helix(6.0, 2.60258, 3)))) == (
        pytest.approx(1.281, abs=1e-3),
        pytest.approx(0.005, abs=2e-3),
    )


@pytest.mark.parametrize("arcs", [None, 4])
@pytest.mark.parametrize("left", [False, True])
def test_a_helix_begins_and_ends_where_it_is_told(arcs, left):
    line = helix(2.0, 3.0, 1.3, arcs, phase=90.0, left=left)
    where, _ = along(line)
    angle = 0.5 * np.pi + (-1.0 if left else 1.0) * 2.6 * np.pi
    np.testing.assert_allclose(where[0], [0.0, 2.0, 0.0], atol=1e-13)
    np.testing.assert_allclose(where[-1], [2.0 * np.cos(angle), 2.0 * np.sin(angle), 3.9], atol=1e-13)
    # It climbs anticlockwise if it is right-handed.
    turn = where[:-1, 0] * where[1:, 1] - where[:-1, 1] * where[1:, 0]
    assert (turn < 0.0).all() if left else (turn > 0.0).all()
    rod = line.sweep(circle(6, 0.3))
    assert rod.check() > 0.0
    assert rod.volume() == pytest.approx(np.pi * 0.09 * 1.3 * np.hypot(4.0 * np.pi, 3.0), rel=2e-4)


def test_sections_of_an_even_helix_are_circles_in_the_plane_of_radius_and_binormal():
    rod = helix(6.0, 2.60258, 1.5).sweep(circle(8, 1.0))
    assert rod.axis.elements == 12
    u, _, arms = sections(rod)
    assert np.abs(np.linalg.norm(arms, axis=2) - 1.0).max() < 2e-4
    angle = np.pi / 4 * u
    radial = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    assert np.abs(arms[:, 0] - radial).max() < 2e-4
    assert np.abs(np.einsum("tqa,ta->tq", arms, rod.tangents(u))).max() < 1e-3


@pytest.mark.parametrize("kind", ["paper", "even"])
def test_the_spring_has_both_helices(kind):
    rod = Spring(helix=kind).rod()
    length = 3 * np.hypot(12 * np.pi, 2.60258)
    assert rod.axis.elements == {"paper": 12, "even": 24}[kind]
    assert rod.volume() == pytest.approx(np.pi * length, rel=5e-5)
    _, centers, _ = sections(rod)
    np.testing.assert_allclose(centers[-1], [6.0, 0.0, 3 * 2.60258], atol=1e-13)


# Curves made elsewhere

QUARTER = np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
CURVES = {
    "splinepy": SimpleNamespace(
        degrees=np.array([2]), knot_vectors=[[0, 0, 0, 1, 1, 1]], control_points=QUARTER, weights=[[1], [0.5**0.5], [1]]
    ),
    "geomdl": SimpleNamespace(
        degree=2,
        knotvector=[0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
        ctrlpts=[[*point, 0.0] for point in QUARTER.tolist()],
        weights=[1.0, 0.5**0.5, 1.0],
    ),
    "bezier": SimpleNamespace(degrees=[2], control_points=QUARTER, weights=[[1], [0.5**0.5], [1]]),
}


@pytest.mark.parametrize("kind", CURVES)
def test_a_curve_of_another_package_is_taken_as_it_is(kind):
    line = nurbs(CURVES[kind], normal=(1.0, 0.0, 0.0))
    assert isinstance(line, CenterLine)
    u = np.linspace(0.0, 1.0, 21)
    np.testing.assert_allclose(np.linalg.norm(evaluate(line.axis, line.centers, u)[0], axis=1), 1.0, atol=1e-14)
    rod, exact = line.sweep(circle(6, 0.2)), arc(1.0, 90.0).sweep(circle(6, 0.2))
    assert np.abs(rod.grid(RIM, u)[0] - exact.grid(RIM, u)[0]).max() < 1e-3
    assert rod.volume() == pytest.approx(exact.volume(), rel=2e-3)


def test_a_curve_without_weights_has_none_or_an_empty_list():
    cubic = {"degree": 3, "knotvector": [0, 0, 0, 0, 1, 1, 1, 1], "ctrlpts": random_curve(2, 4).tolist()}
    for weights in ({}, {"weights": None}, {"weights": []}):
        assert nurbs(SimpleNamespace(**cubic, **weights)).axis.weights.tolist() == [1.0] * 4


def corner():
    return SimpleNamespace(degree=1, knotvector=[0, 0, 1, 2, 2], ctrlpts=[[0, 0, 0], [1, 0, 0], [1, 1, 0]])


def cusp():
    return SimpleNamespace(degree=2, knotvector=[0, 0, 0, 1, 1, 1], ctrlpts=[[0, 0, 0], [0, 0, 0], [1, 1, 0]])


# What is refused

LINE = straight(1.0)
RING = polyline(TREFOIL, 1e-2, closed=True)
test_what_is_no_line_is_refused = refused(
    (lambda: arc(1.0, 400.0), "^arc: angle: got 400 degrees, need -360 to 360 and not 0"),
    (lambda: arc(1.0, 0.0), "^arc: angle: got 0 degrees"),
    (lambda: arc(-1.0, 90.0), "^centre line radius: got -1, need a positive length"),
    (lambda: helix(1.0, 1.0, -0.5), "^helix: got -0.5 turns, need a positive number"),
    (lambda: helix(1.0, 1.0, "2"), "^helix: turns: got '2', need a number"),
    (lambda: helix(1.0, 1.0, 1, 4.5), "^helix: arcs a turn: got 4.5, need an integer or None"),
    (lambda: helix(1.0, 1.0, 1e9), "^helix: 8000000000 arcs are too many"),
    (straight, "^straight line: the length is missing"),
    (lambda: straight(end=(0, 0, 0)), "^straight line: the end is the start"),
    (lambda: straight(1.0, end=(0, 0, 1)), "^straight line: got a length and an end, need one of them"),
    (lambda: straight(end=(0, 1)), r"^end: got shape \(2,\), need \(3,\)"),
    (lambda: polyline([[0, 0], [1, 1]], 0.1), r"^polyline: got shape \(2, 2\), need \(m, 3\)"),
    (lambda: polyline("abc", 0.1), "^polyline: got 'abc', need numbers"),
    (lambda: polyline([[0, 0, 0], [1, 1]], 0.1), "^polyline: got .*, need numbers"),
    (lambda: polyline([[0, 0, 0], [0, np.nan, 1]], 0.1), "^polyline: point 1: got nan, need finite"),
    (lambda: polyline([[0, 0, 0]], 0.1), "^polyline: got 1 points, need at least 2"),
    (lambda: polyline([[0, 0, 0]], 0.1, True), "^polyline: got 1 points, need at least 3"),
    (lambda: polyline([[0, 0, 0], [1, 0, 0]], 0.1, True), "^polyline: got 2 points, need at least 3"),
    (lambda: polyline([[0, 0, 0], [1, 0, 0], [1, 0, 0]], 0.1), "^polyline: point 1 coincides with the next"),
    (lambda: polyline(TREFOIL, -1.0), "^polyline: tolerance: got -1, need a length, 0 or more"),
    (lambda: polyline(TREFOIL, None), "^polyline: tolerance: got None, need a number"),
    (lambda: polyline([[0, 0, 0], [0, 0, 2]], 0.1, normal=(0, 0, 1)).sweep(circle(4)), "^normal: .0, 0, 1."),
    (lambda: LINE.sweep(circle(4), twist=np.inf), "^twist: got inf, need a finite number of degrees"),
    (lambda: LINE.sweep(circle(4), scale=[1.0, -1.0]), "^scale: number 1 is -1, need positive numbers"),
    (lambda: LINE.sweep(circle(4), scale=[1.0, np.nan]), "^scale: number 1 is nan, need positive numbers"),
    (lambda: LINE.sweep(circle(4), scale=-2.0), "^scale: got -2 at u = 0, need positive numbers"),
    (lambda: LINE.sweep(circle(4), scale=lambda u: [1.0, 2.0]), r"^scale: the function gave shape \(2,\) for"),
    (lambda: LINE.sweep(circle(4), scale="big"), "^scale: got 'big', need numbers"),
    (lambda: LINE.sweep(circle(4), scale=lambda u: u + np.nan), "^scale: got nan at u = 0, need positive"),
    (lambda: RING.sweep(circle(4), scale=np.ones(7)), "^scale: got 7 numbers for 40 points, need one each"),
    (lambda: LINE.sweep(circle(4), scale=lambda u: 1.0 + (u > 0.3)), "^sweep: at u = 0.3 sections are"),
    (lambda: LINE.sweep(circle(4), end=circle(5)), "^section at the end: got 5 points, need the 4 of the first"),
    (lambda: LINE.sweep(np.zeros((4, 3)), scale=2.0), r"^section: got shape \(4, 3\), need \(n, 2\)"),
    (lambda: LINE.sweep("round"), "^section: got 'round', need numbers"),
    (lambda: LINE.sweep(circle(4), twist=1.0, tolerance=0.0), "^sweep: tolerance: got 0, need a positive"),
    (lambda: nurbs(3.0), "^nurbs: got float without degrees or degree, need a curve of splinepy or geomdl"),
    (lambda: nurbs(SimpleNamespace(degrees=[2, 2])), "^nurbs: got a spline of 2 parameters, need a curve"),
    (lambda: nurbs(corner()), "^centre line: corner of 90 degrees at u = 1; it must be smooth"),
    (lambda: nurbs(cusp()), "^centre line: it stands still at u = 0 and has no direction there"),
    (lambda: nurbs(CURVES["geomdl"], closed=True), "^closed centre line: the end is 1.41 away from the start"),
    (lambda: Spring(helix="odd").rod(), "^helix: got 'odd', need even or paper"),
    (lambda: Spring(helix="even", elements_per_turn=12).model(), "^elements a turn: got 12, need a m"),
)


def flipped():
    """The frame of the upper half is a reflection."""
    rotations = np.broadcast_to(np.eye(3), (5, 3, 3)).copy()
    rotations[3:, 0, 0] = -1.0
    return CenterLine(straight(4.0, range(5), 1).axis, straight(4.0, range(5), 1).centers, rotations)


def back(size=1.0):
    line = straight(4.0, range(5), 1)
    return CenterLine(line.axis, size * line.centers[[0, 1, 2, 1, 4]])


def tilted():
    """Sections lean against each other, on a line that is straight."""
    angle = 1.2 * np.array([1.0, 0.0, -1.0])
    rotations = np.zeros((3, 3, 3))
    rotations[:, 0, 0] = 1.0
    rotations[:, 1, 1] = rotations[:, 2, 2] = np.cos(angle)
    rotations[:, 2, 1], rotations[:, 1, 2] = np.sin(angle), -np.sin(angle)
    return CenterLine(straight(0.5).axis, straight(0.5).centers, rotations)


test_a_fold_is_explained = refused(
    (lambda: straight(1.0).sweep(circle(6)[::-1]), "the outline runs clockwise about the line's direction"),
    (lambda: flipped().sweep(circle(6)), r"the frame flips over between u = 2\.\d+ and (2|3)"),
    (lambda: back().sweep(circle(6)), "the centre line turns back between u = 2 and (2|3)"),
    (lambda: back(1e-3).sweep(circle(6, 1e-3)), "the centre line turns back between u = 2 and (2|3)"),
    (
        lambda: arc(2.0, 90.0).sweep(circle(6, 2.5)),
        "bends too sharply: its radius of curvature is 2 there, and the section reaches 2.5 from it",
    ),
    (lambda: straight(1.0).sweep(flower(depth=0.95)), "the section folds in its own plane"),
    (lambda: tilted().sweep(circle(6)), "neighbouring sections cross"),
    by=lambda make: make().check(),
    error=FoldedRodError,
)
