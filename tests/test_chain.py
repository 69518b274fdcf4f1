"""Curves as wire is bent: pieces that go on from each other, and helices of tables."""

import numpy as np
import pytest
from lines import distances
from refused import refused
from scipy.integrate import quad

from isorod import circle, ellipse, helix, polyline
from isorod.geometry.chain import Arc, Helix, Straight, chain
from isorod.geometry.fitting import evaluate
from isorod.geometry.frames import ArcLength
from isorod.tensors import rotation

SPRING = [
    Arc(5.0, 90.0),
    Arc(1.5, 90.0, roll=-90.0),
    Helix(5.0, 1.2, 6.5, roll=90.0),
    Arc(1.5, 90.0, roll=90.0),
    Straight(2.0),
    Helix([5.0, 4.0, 4.0], [[0.0, 0.0], [0.7, 3.0], [2.0, -1.0]], 2.0),
    Arc(5.0, -300.0, roll=33.0),
]
PLANE = [Straight(30.0), Arc(5.0, 90.0), Straight(10.0), Arc(4.0, -135.0), Arc(3.0, 250.0, roll=40.0)]


def tangents(line, u):
    _, slope = evaluate(line.axis, line.centers, u)
    return slope / np.linalg.norm(slope, axis=1, keepdims=True)


@pytest.mark.parametrize("pieces", [SPRING, PLANE])
def test_pieces_meet_with_one_tangent_and_one_frame(pieces):
    line = chain(pieces, start=(1.0, 2.0, 3.0), direction=(1.0, 1.0, 0.5), normal=(0.0, 0.0, 2.0))
    axis, centers, degree = line.axis, line.centers, line.axis.degree
    assert line.stations.size == len(pieces) + 1
    for u in line.stations[1:-1]:
        assert np.count_nonzero(axis.knots == u) == degree
        corner = np.flatnonzero(axis.knots == u)[0] - 1
        before, after = centers[corner] - centers[corner - 1], centers[corner + 1] - centers[corner]
        before, after = (one / np.linalg.norm(one) for one in (before, after))
        np.testing.assert_allclose(before, after, atol=1e-12)
        nudge = np.array([u - 1e-13 * u, u])
        first, second = line.directions(nudge)
        np.testing.assert_allclose(first, second, atol=1e-11)
    np.testing.assert_allclose(centers[0], [1.0, 2.0, 3.0], atol=1e-15)
    np.testing.assert_allclose(tangents(line, np.zeros(1))[0], np.array([1.0, 1.0, 0.5]) / 1.5, atol=1e-12)
    x, y = line.directions(np.zeros(1))[0].T
    assert np.cross(tangents(line, np.zeros(1))[0], [0.0, 0.0, 1.0]) @ x == pytest.approx(0.0, abs=1e-12)
    assert x[2] > 0.9 and np.cross(x, y) @ np.array([1.0, 1.0, 0.5]) == pytest.approx(1.5)


def test_a_plane_chain_is_where_a_bending_machine_leaves_it():
    """Each bend as a product of rigid motions: feed, turn, bend."""
    line = chain(PLANE)
    place, triad = np.zeros(3), np.eye(3)
    ends = [place]
    for piece in PLANE:
        if isinstance(piece, Straight):
            place = place + piece.length * triad[:, 2]
        else:
            triad = triad @ rotation([0.0, 0.0, np.radians(piece.roll)])
            centre = place + np.sign(piece.angle) * piece.radius * triad[:, 0]
            turn = rotation(np.radians(piece.angle) * triad[:, 1])
            place, triad = centre + turn @ (place - centre), turn @ triad
        ends.append(place)
    where, _ = evaluate(line.axis, line.centers, line.stations)
    np.testing.assert_allclose(where, ends, atol=1e-12)
    np.testing.assert_allclose(tangents(line, line.stations[-1:])[0], triad[:, 2], atol=1e-12)


def test_straight_lines_and_arcs_are_exact():
    """Lengths, distances from centres, and volumes by Pappus and Guldin."""
    line = chain(PLANE)
    lengths = [30.0, 2.5 * np.pi, 10.0, 3.0 * np.pi, 3.0 * np.radians(250.0)]
    np.testing.assert_allclose(np.diff(line.stations), lengths, rtol=1e-14)
    assert line.deviation == 0.0 and line.frames is None and line.axis.degree == 2
    u = np.linspace(*line.stations[1:3], 50)
    where, _ = evaluate(line.axis, line.centers, u)
    np.testing.assert_allclose(np.linalg.norm(where - [5.0, 0.0, 30.0], axis=1), 5.0, rtol=1e-12)
    rod = line.sweep(circle(8, 1.0))
    assert rod.volume() == pytest.approx(np.pi * sum(lengths), rel=1e-8)
    # The torus's skin is exact, too.
    rim = rod.grid(np.array([[1.0, 0.0], [0.0, 1.0]]), np.linspace(*line.stations[1:3], 9))[0] - [5.0, 0.0, 30.0]
    across = 5.0 - np.hypot(rim[:, :, 0], rim[:, :, 2])
    np.testing.assert_allclose(np.hypot(across, rim[:, :, 1]), 1.0, rtol=1e-12)


def test_a_section_does_not_turn_about_straight_lines_and_arcs():
    line = chain([Straight(1.0), Arc(2.0, 90.0, roll=37.0), Arc(2.0, -60.0, roll=10.0)])
    u, step = np.linspace(*line.axis.breaks[[0, -1]], 60)[1:-1], 1e-5
    frame = line.sweep(ellipse(8, 0.2, 0.1)).grid(np.array([[0.0, 0.0], [1.0, 0.0]]), u)[0]
    x = (frame[:, 1] - frame[:, 0]) / 0.2
    later = line.sweep(ellipse(8, 0.2, 0.1)).grid(np.array([[0.0, 0.0], [1.0, 0.0]]), u + step)[0]
    change = ((later[:, 1] - later[:, 0]) / 0.2 - x) / step
    across = np.cross(tangents(line, u), x)
    assert np.abs(np.einsum("ta,ta->t", change, across)).max() < 1e-4


@pytest.mark.parametrize("pitch, hand", [(2.0, 1.0), (-2.0, -1.0)])
def test_a_helix_goes_on_about_the_axis_that_tangent_and_normal_tell(pitch, hand):
    radius, turns = 5.0, 2.25
    line = chain([Straight(3.0), Helix(radius, pitch, turns)])
    u = np.linspace(*line.stations[1:], 400)
    where, _ = evaluate(line.axis, line.centers, u)
    lead = np.arctan(pitch / (2.0 * np.pi * radius))
    # Tangent z, normal x, binormal y.
    axis = np.array([0.0, np.cos(lead), np.sin(lead)])
    arm = where - [radius, 0.0, 3.0]
    along = arm @ axis
    away = np.linalg.norm(arm - along[:, None] * axis, axis=1)
    np.testing.assert_allclose(away, radius, rtol=1e-4)
    assert along[-1] == pytest.approx(turns * pitch, rel=1e-12)
    length = turns * np.hypot(2.0 * np.pi * radius, pitch)
    assert line.stations[-1] - 3.0 == pytest.approx(length, rel=2e-6)
    jerk = np.gradient(np.gradient(np.gradient(where, u, axis=0), u, axis=0), u, axis=0)[20:-20]
    bend = np.gradient(np.gradient(where, u, axis=0), u, axis=0)[20:-20]
    torsion = np.einsum("ta,ta->t", np.cross(np.gradient(where, u, axis=0)[20:-20], bend), jerk)
    assert np.sign(torsion.mean()) == hand


def test_a_chain_of_one_helix_is_the_helix():
    own, line = helix(5.0, 3.0, 1.75), chain([Helix(5.0, 3.0, 1.75)])
    start, x = own.centers[0], np.array([-1.0, 0.0, 0.0])
    tangent = (own.centers[1] - start) / np.linalg.norm(own.centers[1] - start)
    triad = np.stack([x, np.cross(tangent, x), tangent], axis=1)
    np.testing.assert_allclose((own.centers - start) @ triad, line.centers, atol=1e-12)


# Tables of radius and pitch


def test_a_cone_and_a_spiral_have_the_radii_and_the_rise_that_are_told():
    line = helix([10.0, 6.0], 4.0, 5.0)
    u = np.linspace(0.0, line.axis.breaks[-1], 300)
    where, _ = evaluate(line.axis, line.centers, u)
    turn = np.unwrap(np.arctan2(where[:, 1], where[:, 0])) / (2.0 * np.pi)
    np.testing.assert_allclose(np.hypot(*where[:, :2].T), 10.0 - 0.8 * turn, atol=2 * line.deviation)
    np.testing.assert_allclose(where[:, 2], 4.0 * turn, atol=2 * line.deviation)
    np.testing.assert_allclose(where[-1], [6.0, 0.0, 20.0], atol=1e-12)
    assert line.deviation < 1e-4 * 10.0
    flat = helix([5.0, 15.0], 0.0, 4.0)
    exact, _ = quad(lambda t: np.hypot(2.5, 2.0 * np.pi * (5.0 + 2.5 * t)), 0.0, 4.0)
    assert np.abs(flat.centers[:, 2]).max() < 1e-15
    assert ArcLength(flat.axis, flat.centers).total == pytest.approx(exact, rel=1e-6)


def test_tables_are_smooth_without_overshoot_and_kept_at_their_turns():
    radius = [[0.0, 10.0], [1.0, 10.0], [3.0, 6.0], [4.0, 6.0]]
    line = helix(radius, [[0.0, 1.0], [1.0, 1.0], [2.0, 4.0], [3.0, 4.0], [4.0, 1.0]], 4.0)
    u = np.linspace(0.0, line.axis.breaks[-1], 2000)
    where, slope = evaluate(line.axis, line.centers, u)
    away = np.hypot(*where[:, :2].T)
    assert away.max() < 10.0 + 2 * line.deviation and away.min() > 6.0 - 2 * line.deviation
    assert (np.diff(where[:, 2]) > 0.0).all()
    for turn, value in radius:
        place, _ = evaluate(line.axis, line.centers, [turn / 4.0 * line.axis.breaks[-1]])
        assert np.hypot(*place[0, :2]) == pytest.approx(value, abs=2 * line.deviation)
    turns = np.abs(np.diff(slope / np.linalg.norm(slope, axis=1, keepdims=True), axis=0)).max()
    assert turns < 0.05


def test_frames_of_a_cone_point_away_from_its_axis():
    line = helix([8.0, 3.0], 4.0, 2.0, phase=30.0)
    u = np.linspace(0.0, line.axis.breaks[-1], 50)
    frame = np.concatenate([line.frames(u), tangents(line, u)[:, :, None]], axis=2)
    assert np.abs(frame.swapaxes(1, 2) @ frame - np.eye(3)).max() < 2e-3
    where, _ = evaluate(line.axis, line.centers, u)
    assert (np.einsum("ta,ta->t", frame[:, :, 0], where * [1.0, 1.0, 0.0]) > 0.0).all()
    assert line.sweep(circle(8, 0.5)).check() > 0.0


def test_a_helix_that_is_thin_beside_its_radius_is_warned_of():
    for line in (helix(10.0, 1.0, 1.0), chain([Straight(1.0), Helix(10.0, 1.0, 1.0)])):
        with pytest.warns(UserWarning, match=r"is 0.0005.+, 0.011 of the section's radius; a helix is no nearer"):
            line.sweep(circle(8, 0.05))


# Closed chains

TRACK = [Straight(20.0), Arc(5.0, 180.0), Straight(20.0), Arc(5.0, 180.0)]


def test_a_race_track_is_closed_and_exact():
    rod = chain(TRACK, closed=True).sweep(ellipse(8, 0.5, 0.3))
    assert rod.closed and np.array_equal(rod.control_points[0], rod.control_points[-1])
    assert rod.volume() == pytest.approx(0.15 * np.pi * (40.0 + 10.0 * np.pi), rel=1e-8)


def bent(points, radius):
    """Return feeds, bends and rolls that bend a closed polygon, from the middle of its first side on."""
    sides = np.roll(points, -1, axis=0) - points
    length = np.linalg.norm(sides, axis=1)
    along = sides / length[:, None]
    after = np.roll(along, -1, axis=0)
    angle = np.arccos(np.einsum("ta,ta->t", along, after))
    across = np.cross(along, after)
    trim = radius * np.tan(0.5 * angle)
    pieces = [Straight(0.5 * length[0] - trim[0])]
    for k in range(len(points)):
        first, second = across[k - 1], across[k]
        roll = np.degrees(np.arctan2(np.cross(first, second) @ along[k], first @ second)) if k else 0.0
        pieces.append(Arc(radius, float(np.degrees(angle[k])), float(roll)))
        room = length[(k + 1) % len(points)] - trim[k] - trim[(k + 1) % len(points)]
        pieces.append(Straight(float(room) if k + 1 < len(points) else float(0.5 * length[0] - trim[k])))
    return pieces, along[0], np.cross(across[0], along[0])


def test_bends_and_rolls_of_a_polygon_make_its_filleted_polyline():
    points = np.array([[0.0, 0, 0], [10, 0, 1], [12, 9, -3], [4, 12, 5], [-3, 5, 0]])
    pieces, direction, normal = bent(points, 1.5)
    line = chain(pieces, start=0.5 * (points[0] + points[1]), direction=direction, normal=normal, closed=True)
    other = polyline(points, fillet=1.5, closed=True)
    where, _ = evaluate(line.axis, line.centers, line.axis.breaks)
    assert distances(where, other).max() < 1e-9
    assert line.axis.breaks[-1] == pytest.approx(other.axis.breaks[-1], rel=1e-12)
    # It is not plane: its frame has to be turned back evenly.
    first, last = line.frames(line.axis.breaks[[0, -1]])
    np.testing.assert_allclose(first, last, atol=1e-6)
    rod = line.sweep(ellipse(8, 0.5, 0.3))
    assert rod.closed and rod.check() > 0.0


test_bad_pieces_are_refused_in_one_line = refused(
    (lambda: chain([]), "got no pieces"),
    (lambda: chain([Straight(1.0)], direction=(0, 0, 0)), "direction: got zeros"),
    (lambda: chain([Straight(1.0)], normal=(0, 0, 1)), "normal: .* runs along"),
    (lambda: chain(TRACK[:3], closed=True), "closed: the end is 10 away from the start"),
    (lambda: Straight(-1.0), "length: got -1"),
    (lambda: Arc(-1.0, 90.0), "radius: got -1"),
    (lambda: Arc(1.0, 0.0), "angle: got 0 degrees"),
    (lambda: Arc(1.0, 90.0, roll=np.nan), "roll: got nan"),
    (lambda: Helix([1.0, -1.0], 1.0, 1.0), "radius: got -1"),
    (lambda: Helix(1.0, [1.0, np.inf], 1.0), "pitch: got inf"),
    (lambda: Helix(1.0, [1.0], 1.0), "pitch: got shape"),
    (lambda: helix(1.0, [[0.0, 1.0], [1.0, 2.0]], 2.0), "pitch: got turns 0, 1; they must rise from 0 to 2"),
    (lambda: helix([1.0, 2.0], 1.0, 2.0, 4), "arcs a turn: they go with one radius"),
    (lambda: helix(1.0, 1.0, -1.0), "got -1 turns"),
)
