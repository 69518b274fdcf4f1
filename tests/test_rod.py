"""The geometry of rods: exact shapes, refinement that leaves them, Jacobians, and the place where a map folds."""

import re

import numpy as np
import pytest
from disks import derivative, disk_points
from refused import refused

from isorod import Axis, FoldedRodError, InputError, Rod, circle, flower, helix, straight
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring


def edge_points(count=40):
    return np.concatenate([[[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]], disk_points(1.0, count)])


def axis_parameters(rod, each=5):
    inside = np.linspace(0.01, 0.97, each)
    return (rod.axis.breaks[:-1, None] + np.diff(rod.axis.breaks)[:, None] * inside).ravel()


def swept(seed=5, n=6):
    """A bent and twisted tube that repeats nothing."""
    random = np.random.default_rng(seed)
    axis = Axis(3, [0, 0, 0, 0, 0.4, 1, 1, 1.5, 1.5, 1.5, 1.5], [1, 0.8, 1.2, 1, 0.9, 1.1, 1])
    centers = np.stack([0.3 * np.arange(7), 0.2 * random.random(7), np.arange(7.0)], axis=1)
    return Rod.sweep(circle(n, 0.5), axis, centers, stretches=np.eye(3) + 0.2 * random.random((7, 3, 3)))


RODS = {
    "swept": swept,
    "spring": lambda: Spring(helix="paper", section_points=5).rod(),
    "ring": lambda: Ring().rod(),
    "flower": lambda: Flower().rod(),
}


@pytest.fixture(params=RODS)
def rod(request):
    return RODS[request.param]()


@pytest.mark.parametrize("n", [3, 4, 7])
def test_ring_is_an_exact_torus(n):
    ring = Ring(section_points=n)
    rod = ring.rod()
    xi = edge_points()
    x = rod.grid(xi, np.concatenate([axis_parameters(rod, 9), rod.axis.breaks]))[0]
    out = (np.hypot(x[..., 0], x[..., 1]) - ring.radius) / ring.a
    assert np.abs(out - xi[:, 0]).max() < 1e-13
    assert np.abs(out**2 + (x[..., 2] / ring.b) ** 2 - np.sum(xi**2, axis=1)).max() < 1e-13


def test_ring_has_32_distinct_control_points_and_its_ends_are_one_section():
    rod = Ring().rod()
    assert rod.control_points.shape == (9, 4, 3)
    assert np.array_equal(rod.control_points[0], rod.control_points[-1])
    assert np.unique(rod.control_points.reshape(-1, 3).round(12), axis=0).shape == (32, 3)
    assert rod.distinct_control_points == 32
    assert rod.volume() == pytest.approx(2 * np.pi * 4 * np.pi * 1.5, rel=1e-6)


@pytest.mark.parametrize("n", [4, 8, 16])
def test_volume_of_the_helical_wire_is_its_section_times_its_length(n):
    length = 3 * np.hypot(2 * np.pi * 6, 2.60258)
    assert Spring(helix="paper", section_points=n).rod().volume() == pytest.approx(np.pi * length, rel=1e-5)


def test_helix_is_in_the_right_place():
    rod = Spring(helix="paper", section_points=5).rod()
    quarter = rod.points(np.zeros((13, 2)), np.arange(13.0))
    angle = np.pi / 2 * np.arange(13)
    expected = np.stack([6 * np.cos(angle), 6 * np.sin(angle), 2.60258 / 4 * np.arange(13)], axis=1)
    assert np.abs(quarter - expected).max() < 1e-13
    # the end sections are circles in the plane of the radial direction and the binormal
    binormal = np.array([0, -2.60258, 12 * np.pi]) / np.hypot(2.60258, 12 * np.pi)
    rim = rod.points([[1.0, 0.0], [0.0, 1.0]], [0.0, 0.0]) - [6, 0, 0]
    assert np.abs(rim - [[1, 0, 0], -binormal]).max() < 1e-13


@pytest.mark.parametrize(
    "refine",
    [
        lambda rod: rod.refine(3),
        lambda rod: rod.refine(1, rod.axis.degree + 1),
        lambda rod: rod.refine(2, 5, 0),
        lambda rod: rod.refine(2, 6).refine(2),
        lambda rod: rod.insert(0.3, rod.axis.degree),
        lambda rod: rod.insert(0.3).insert(0.7).insert(0.3),
    ],
    ids=["cut", "raised", "cut and raised", "twice", "insert p times", "insert again"],
)
def test_refinement_leaves_the_geometry(rod, refine):
    finer = refine(rod)
    assert finer.axis.count > rod.axis.count
    assert finer.closed == rod.closed
    u = np.concatenate([axis_parameters(rod), axis_parameters(finer, 2)])
    (old, old_jacobian), (new, new_jacobian) = rod.grid(edge_points(), u), finer.grid(edge_points(), u)
    assert np.abs(new - old).max() < 1e-13 * max(1, np.abs(old).max())
    assert np.abs(new_jacobian - old_jacobian).max() < 1e-11


def test_jacobian_is_the_derivative_of_the_position(rod):
    xi, u = 0.9 * edge_points(20), axis_parameters(rod, 3)
    _, jacobian = rod.grid(xi, u)
    for k, way in enumerate(np.eye(3)):
        difference = derivative(lambda s, way=way: rod.grid(xi + s * way[:2], u + s * way[2])[0], 0.0, 1.0, 1e-3)
        assert np.abs(difference - jacobian[..., k]).max() < 1e-9 * np.abs(jacobian).max()


def test_grid_and_points_agree(rod):
    xi, u = edge_points(7), axis_parameters(rod)
    table = rod.grid(xi, u)[0]
    pairs = rod.points(np.tile(xi, (u.size, 1)), np.repeat(u, len(xi)))
    assert np.abs(table.reshape(-1, 3) - pairs).max() < 1e-13


def test_check_returns_a_positive_determinant(rod, cylinder):
    assert rod.check() > 0
    assert cylinder(4, radius=0.5, height=3.0).check() == pytest.approx(0.75, rel=1e-12)


def bent_too_much():
    return helix(0.9, 1.0, 1, 4).sweep(circle(8, 1.0))


def clockwise():
    return straight(1.0).sweep(circle(6)[::-1])


def turned_back():
    """The third of four elements runs backwards."""
    axis = Axis(1, [0, 0, 1, 2, 3, 4, 4], np.ones(5))
    return Rod.sweep(circle(4), axis, np.outer([0, 1, 2, 1.5, 3], [0, 0, 1]))


def one_section_turned_inside_out():
    """A ring whose sixth section runs clockwise, and is large enough to win over its neighbours."""
    rod = Ring(section_points=8).rod()
    points = rod.control_points.copy()
    points[5] = points[5].mean(axis=0) + 3 * (points[5][::-1] - points[5].mean(axis=0))
    return Rod(rod.axis, points, closed=True)


@pytest.mark.parametrize(
    ("make", "elements"),
    [
        (lambda: Flower(depth=0.95).rod(), {0}),
        (lambda: Flower(depth=0.9, petals=5, section_points=20).rod(), {0}),
        (bent_too_much, {0, 1, 2, 3}),
        (clockwise, {0}),
        (turned_back, {2}),
        (one_section_turned_inside_out, {2}),
        (lambda: Ring(a=4.5).rod(), {0, 1, 2, 3}),
    ],
)
def test_check_names_the_place_of_a_fold(make, elements):
    rod = make()
    with pytest.raises(FoldedRodError) as caught:
        rod.check()
    message = str(caught.value)
    assert "\n" not in message
    number = r"(-?[\d.]+(?:e[+-]\d+)?)"
    found = re.search(
        rf"element (\d+) at u = {number}, disk point \({number}, {number}\), "
        rf"position \({number}, {number}, {number}\): "
        rf"Jacobian determinant {number}",
        message,
    )
    assert found, message
    element, u, *xi_and_position = (float(text) for text in found.groups())
    assert element in elements
    assert rod.axis.breaks[int(element)] <= u <= rod.axis.breaks[int(element) + 1]
    # the place is right: there, the determinant is what the message says (printed with 3 digits)
    xi = np.array(xi_and_position[:2])
    xi /= max(1.0, np.hypot(*xi))
    low, high = rod.axis.breaks[int(element) : int(element) + 2]
    where, jacobian = rod.grid([xi], [np.clip(u, low + 1e-9, high - 1e-9)])
    assert np.abs(where[0, 0] - xi_and_position[2:5]).max() < 2e-3 * np.abs(rod.control_points).max()
    assert xi_and_position[5] <= 0
    assert np.linalg.det(jacobian[0, 0]) < 0.5 * xi_and_position[5] + 1e-3


def test_sweep_places_stretches_then_turns_each_section():
    random = np.random.default_rng(2)
    axis = Axis(1, [0, 0, 1, 1], [1, 1])
    centers, turns, stretches = random.random((2, 3)), random.random((2, 3, 3)), random.random((2, 3, 3))
    section = flower(5)
    rod = Rod.sweep(section, axis, centers, turns, stretches)
    for j in range(2):
        for i in range(5):
            expected = centers[j] + turns[j] @ (stretches[j] @ [*section[i], 0.0])
            assert np.abs(rod.control_points[j, i] - expected).max() < 1e-14


LINE = Axis(2, [0, 0, 0, 1, 1, 1], [1, 1, 1])
CENTERS = straight(1.0).centers


def bad_point():
    points = Rod.sweep(circle(4), LINE, CENTERS).control_points.copy()
    points[2, 1, 0] = np.nan
    return Rod(LINE, points)


test_refuses_what_is_no_rod = refused(
    (bad_point, "control point 1 of layer 2 is not finite"),
    (lambda: Rod(LINE, np.zeros((4, 4, 3))), r"got shape \(4, 4, 3\), need \(3, n, 3\)"),
    (lambda: Rod(LINE, np.zeros((3, 4, 2))), r"got shape \(3, 4, 2\)"),
    (lambda: Rod(LINE, np.zeros((3, 2, 3))), "section control points: got 2"),
    (lambda: Rod(LINE, Rod.sweep(circle(4), LINE, CENTERS).control_points, closed=True), "must repeat the first"),
    (lambda: Rod.sweep(np.zeros((4, 3)), LINE, CENTERS), r"section: got shape \(4, 3\)"),
    (lambda: Rod.sweep(circle(4), LINE, CENTERS[:2]), r"centre line: got shape \(2, 3\), need \(3, 3\)"),
    (lambda: helix(0.0, 1.0, 1), "radius: got 0, need a positive length"),
    (lambda: helix(-2.0, 1.0, 1), "radius: got -2"),
    (lambda: helix(np.nan, 1.0, 1), "radius: got nan"),
    (lambda: helix(1.0, np.inf, 1), "pitch: got inf"),
    (lambda: helix(1.0, 1.0, 0), "got 0 turns"),
    (lambda: helix(1.0, 1.0, 1, 2), "2 arcs"),
    (lambda: helix(4.0, 1.0, 1).sweep(circle(4), closed=True), "closed"),
    (lambda: straight(0.0), "length: got 0, need a positive length"),
    (lambda: straight(np.inf), "length: got inf"),
    (lambda: straight(breaks=[1.0]), "got 1 breaks, need at least 2"),
    (lambda: straight(breaks=[0.0, 2.0, 1.0]), "knots must not decrease"),
    (lambda: straight(1.0, degree=0), "axis degree: got 0"),
    (lambda: Rod.sweep(circle(4), LINE, CENTERS, rotations=np.ones((2, 3, 3))), "rotation"),
    (lambda: Rod.sweep(circle(4), LINE, CENTERS, stretches=np.ones((2, 3, 3))), "stretche"),
)


@pytest.mark.parametrize("continuity", [None, 0, 1])
@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_straight_line_rises_in_proportion_to_the_parameter(degree, continuity):
    if continuity is not None and continuity >= degree:
        with pytest.raises(InputError, match=f"continuity: got {continuity}, need an integer from 0 to {degree - 1}"):
            straight(1.0, degree=degree, continuity=continuity)
        return
    u = np.linspace(2.0, 7.0, 23)
    for length, height in ((None, u - 2.0), (0.3, 0.06 * (u - 2.0))):
        rod = straight(length, [2.0, 2.5, 4.0, 7.0], degree, continuity).sweep(circle(5, 0.5))
        multiplicity = 1 if continuity is None else degree - continuity
        assert rod.axis.multiplicities.tolist() == [degree + 1, multiplicity, multiplicity, degree + 1]
        np.testing.assert_allclose(rod.points(np.zeros((23, 2)), u), height[:, None] * [0.0, 0.0, 1.0], atol=1e-14)
