"""Smooth lines near points, the frames along them, and sections that turn and change on the way."""

import numpy as np
import pytest
from lines import KNOT, RIM, TREFOIL, distances, parameters, random_curve, sections

from isorod import InputError, circle, ellipse, helix, polyline, straight
from isorod.geometry.fitting import evaluate
from isorod.geometry.frames import Frames

# Polylines


def test_a_trefoil_from_points_is_a_few_lines():
    line = polyline(TREFOIL, tolerance=1e-3, closed=True)
    rod = line.sweep(circle(8, 0.2))
    assert rod.check() > 0.0
    assert distances(TREFOIL, line).max() <= 1e-3 + 1e-6
    assert line.axis.elements < 40
    assert rod.axis.elements <= 64
    # Circles of the right radius, normal to the line, everywhere.
    u, _, arms = sections(rod)
    assert np.abs(np.linalg.norm(arms, axis=2) - 0.2).max() < 1e-3
    assert np.abs(np.einsum("tqa,ta->tq", arms, rod.tangents(u))).max() < 1e-3
    # The line does what its formula does between the points, too.
    t = np.linspace(0.0, 2 * np.pi, 300)
    exact = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    assert distances(exact, line).max() < 3e-3
    length = np.linalg.norm(np.diff(exact, axis=0), axis=1).sum()
    assert rod.volume() == pytest.approx(np.pi * 0.04 * length, rel=1e-3)


@pytest.mark.parametrize("normal", [None, (1.0, 2.0, 3.0)])
def test_a_closed_line_goes_on_as_it_began(normal):
    line = polyline(TREFOIL, 1e-3, closed=True, normal=normal)
    rod = line.sweep(ellipse(8, 0.2, 0.1))
    assert rod.closed and np.array_equal(rod.control_points[0], rod.control_points[-1])
    low, high = rod.axis.breaks[[0, -1]]
    (_, first), (_, last) = (rod.grid(RIM, [u]) for u in (low, high))
    assert np.abs(first - last).max() < 5e-3 * np.abs(first).max()
    # Frames themselves: smooth across the seam to the second order.
    step = 1e-4 * (high - low)
    before, seam, after = line.frames(np.array([high - step, low, low + step]))
    assert np.abs(before - 2 * seam + after).max() < 1e-5


@pytest.mark.parametrize("tolerance", [3e-2, 1e-3, 0.0])
@pytest.mark.parametrize("seed", range(4))
def test_lines_are_within_the_tolerance_of_points_at_random(seed, tolerance):
    points = random_curve(seed, 60)
    line = polyline(points, tolerance)
    assert distances(points, line).max() <= tolerance + 1e-6
    where, _ = evaluate(line.axis, line.centers, line.stations)
    assert np.linalg.norm(where - points, axis=1).max() <= tolerance + 1e-12
    np.testing.assert_allclose(where[[0, -1]], points[[0, -1]], atol=1e-12)
    assert line.axis.multiplicities[1:-1].max() == 1 and line.axis.degree == 3
    assert line.axis.elements <= {3e-2: 24, 1e-3: 59, 0.0: 59}[tolerance]


def test_a_helix_of_points_takes_a_fraction_of_them_for_elements():
    angle = np.linspace(0.0, 6 * np.pi, 200)
    points = np.stack([6 * np.cos(angle), 6 * np.sin(angle), 0.4 * angle], axis=1)
    line = polyline(points, 1e-2)
    assert line.axis.elements <= 24
    assert distances(points, line).max() <= 1e-2


def test_noise_below_the_tolerance_is_smoothed():
    clean, noisy = random_curve(7, 120), random_curve(7, 120, 1e-3)
    line = polyline(noisy, 5e-3)
    assert line.axis.elements < 40
    assert distances(clean, line)[1:-1].max() < 5e-3


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_rough_points_do_not_make_a_line_overshoot(seed, closed):
    """Walks at random with steps of very unequal length."""
    random = np.random.default_rng(seed)
    steps = random.standard_normal((20, 3)) * np.exp(1.5 * random.standard_normal((20, 1)))
    points = np.cumsum(steps, axis=0)
    line = polyline(points, 1e-6, closed=closed)
    ring = np.concatenate([points, points[:1]]) if closed else points
    chords = np.linalg.norm(np.diff(ring, axis=0), axis=1)
    padded = np.pad(chords, 1, mode="wrap" if closed else "edge")
    for k, (a, b) in enumerate(zip(line.stations[:-1], line.stations[1:], strict=True)):
        x, _ = evaluate(line.axis, line.centers, np.linspace(a, b, 30))
        share = np.clip((x - ring[k]) @ (ring[k + 1] - ring[k]) / chords[k] ** 2, 0.0, 1.0)
        off = np.linalg.norm(x - ring[k] - share[:, None] * (ring[k + 1] - ring[k]), axis=1)
        assert off.max() < 0.5 * padded[k : k + 3].max()


@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_a_few_points_will_do(count):
    points = random_curve(1, count)
    line = polyline(points, 1e-9)
    assert distances(points, line).max() < 1e-4
    assert line.sweep(circle(4, 0.01)).check() > 0.0


def test_a_closed_line_may_repeat_its_first_point():
    once, again = polyline(TREFOIL, 1e-2, True), polyline(np.concatenate([TREFOIL, TREFOIL[:1]]), 1e-2, True)
    np.testing.assert_array_equal(once.centers, again.centers)


# Frames


def test_frames_are_orthonormal_and_turn_about_the_tangent_as_little_as_can_be():
    line = polyline(random_curve(5, 30), 1e-3)
    u, step = parameters(line, 11)[1:-1], 1e-5
    frame = line.frames(u)
    _, slope = evaluate(line.axis, line.centers, u)
    tangent = slope / np.linalg.norm(slope, axis=1, keepdims=True)
    whole = np.concatenate([frame, tangent[:, :, None]], axis=2)
    np.testing.assert_allclose(whole.swapaxes(1, 2) @ whole, np.broadcast_to(np.eye(3), (u.size, 3, 3)), atol=1e-12)
    assert (np.linalg.det(whole) > 0.0).all()
    change = (line.frames(u + step) - line.frames(u - step)) / (2 * step)
    assert np.abs(np.einsum("ta,ta->t", change[:, :, 0], frame[:, :, 1])).max() < 1e-4


@pytest.mark.parametrize("pitch", [1.0, 5.0])
def test_along_a_helix_frames_turn_back_against_the_normal_by_the_torsion(pitch):
    """The integral of the torsion is 2 pi n sin(lead angle)."""
    turns = 2.3
    line = helix(1.0, pitch, turns)
    frames = Frames(line.axis, line.centers, np.array([1.0, 0.0, 0.0]))
    radial = line.frames(line.axis.breaks[[-1]])[0]
    end = frames(line.axis.breaks[[-1]])[0]
    turned = np.arctan2(end[:, 0] @ radial[:, 1], end[:, 0] @ radial[:, 0])
    torsion = 2 * np.pi * turns * np.sin(np.arctan(pitch / (2 * np.pi)))
    assert np.angle(np.exp(1j * (turned + torsion))) == pytest.approx(0.0, abs=2e-4)


def test_the_start_of_a_frame_may_be_given():
    line = polyline([[0, 0, 0], [1, 0, 0], [2, 0, 0]], 0.0, normal=(5.0, 0.0, 2.0))
    np.testing.assert_allclose(line.frames(np.zeros(1))[0].T, [[0, 0, 1], [0, -1, 0]], atol=1e-14)


# Twist, size, second section


def test_a_prescribed_twist_is_the_angle_between_the_ends():
    rod = straight(3.0).sweep(ellipse(8, 0.5, 0.2), twist=200.0)
    u, _, arms = sections(rod)
    angle = np.radians(200.0) * u
    x = np.stack([np.cos(angle), np.sin(angle), 0.0 * u], axis=1)
    assert np.abs(arms[:, 0] - 0.5 * x).max() < 5e-3
    assert np.abs(arms[:, 6] - 0.2 * np.cross([0.0, 0.0, 1.0], x)).max() < 5e-3
    assert rod.axis.elements > 3


def test_a_closed_line_takes_whole_turns_of_twist():
    line = polyline(TREFOIL, 1e-2, closed=True)
    assert line.sweep(ellipse(8, 0.2, 0.1), twist=-360.0).check() > 0.0
    with pytest.raises(InputError, match="closed rod: the last section is"):
        line.sweep(ellipse(8, 0.2, 0.1), twist=90.0)


def test_a_cone_is_exact():
    for scale in (lambda u: 1.0 - 0.5 * u, [1.0, 0.5]):
        rod = straight(3.0).sweep(circle(8, 1.0), scale=scale)
        assert rod.axis.elements == 1
        assert rod.volume() == pytest.approx(np.pi * 3.0 * 1.75 / 3.0, rel=1e-12)


def test_radii_belong_to_the_points_of_a_polyline():
    points = random_curve(2, 25)
    radii = 0.05 * (1.5 + np.sin(np.arange(25.0)))
    line = polyline(points, 1e-3)
    rod = line.sweep(circle(8, 1.0), scale=radii)
    x, _ = rod.grid(np.concatenate([[[0.0, 0.0]], RIM]), line.stations)
    size = np.linalg.norm(x[:, 1:] - x[:, :1], axis=2)
    assert np.abs(size - radii[:, None]).max() < 5e-3 * radii.max()
    # In between nothing is thicker or thinner than the neighbours.
    _, _, arms = sections(rod)
    assert np.linalg.norm(arms, axis=2).max() < 1.005 * radii.max()


def test_radii_of_a_closed_polyline_go_round():
    line = polyline(TREFOIL, 1e-3, closed=True)
    for radii in (0.2 + 0.1 * np.cos(KNOT), 0.2 + 0.1 * np.cos(np.append(KNOT, 0.0))):
        rod = line.sweep(circle(8, 1.0), scale=radii)
        _, centers, arms = sections(rod)
        nearest = np.linalg.norm(centers[:, None] - TREFOIL, axis=2).argmin(axis=1)
        wanted = 0.2 + 0.1 * np.cos(KNOT[nearest])
        assert np.abs(np.linalg.norm(arms, axis=2) - wanted[:, None]).max() < 0.012


def test_a_section_goes_over_into_another():
    rod = straight(2.0).sweep(circle(8, 1.0), end=ellipse(8, 1.0, 0.5))
    assert rod.axis.elements == 1
    assert rod.volume() == pytest.approx(np.pi * 2.0 * 0.75, rel=1e-12)


def test_a_tighter_tolerance_takes_more_elements_and_keeps_it():
    line = polyline(random_curve(1, 40), 1e-3)
    elements = []
    for tolerance in (2e-2, 1e-3, 1e-4):
        rod = line.sweep(circle(8, 0.05), tolerance=tolerance)
        elements.append(rod.axis.elements)
        u, _, arms = sections(rod, 23)
        assert np.abs(np.linalg.norm(arms, axis=2) / 0.05 - 1.0).max() < tolerance
        assert np.abs(np.einsum("tqa,ta->tq", arms, rod.tangents(u))).max() < 1.1 * tolerance * 0.05
    assert elements[0] < elements[1] < elements[2]


def test_radii_of_a_closed_polyline_go_on_as_they_began():
    line = polyline(TREFOIL, 1e-3, closed=True)
    rod = line.sweep(circle(8, 1.0), scale=0.2 + 0.1 * np.sin(KNOT), tolerance=2e-5)
    x, _ = rod.grid([[0.0, 0.0], [1.0, 0.0]], [0.0, 0.05, line.axis.breaks[-1] - 0.05])
    here, after, before = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
    # The curve's speed at its start is the length of (5, 0, -3).
    assert ((after - here) / 0.05, (here - before) / 0.05) == pytest.approx([0.1 / 34**0.5] * 2, rel=0.02)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (1.0, 0.2, 0.3)])
def test_a_closed_path_of_arcs_that_is_not_plane_begins_at_its_normal(normal):
    """Its frames are turned back evenly on the way, so that both ends meet."""
    corners = [[2.0, 0.0, 0.5], [0.0, 2.0, -0.7], [-2.0, 0.3, 0.1], [0.0, -2.0, -0.5], [1.0, -2.2, 0.4]]
    rod = polyline(corners, fillet=0.4, closed=True, normal=normal).sweep(circle(8, 0.1))
    u = rod.axis.breaks[[0, -1]]
    places, _ = rod.grid([[0.0, 0.0], [1.0, 0.0]], u)
    np.testing.assert_allclose(places[0], places[1], atol=1e-12)
    (tangent,) = rod.tangents(u[:1])
    across = np.array(normal) - np.dot(normal, tangent) * tangent
    np.testing.assert_allclose((places[0, 1] - places[0, 0]) / 0.1, across / np.linalg.norm(across), atol=1e-9)
