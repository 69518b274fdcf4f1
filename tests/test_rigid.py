"""Rigid motions: which of them supports leave free, and what they are called."""

import re

import numpy as np
import pytest
from conftest import as_array

from isorod import Axis, Body, LinearElastic, Model, NeoHookean, Rod, Space, Support
from isorod.assembly.assembler import Assembler
from isorod.checks import rigid_motions
from isorod.geometry.disk import control_points
from isorod.scenes.blade import Blade
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring

LAW = LinearElastic(1.0, 0.3)


def bar(cylinder, order=1, height=6.0, radius=1.0, n=4, **refinement):
    """Layers of ``n`` nodes at angles 0, 2 pi / n, ..."""
    return Space.paper(cylinder(n, height=height, radius=radius), elements=4, order=order, **refinement)


SPACES = {
    "bar": bar,
    "bar of order 3": lambda cylinder: bar(cylinder, order=3),
    "bar of finer section": lambda cylinder: bar(cylinder, section_points=12),
    "bar of 3 points": lambda cylinder: bar(cylinder, n=3),
    "helix": lambda cylinder: Space.paper(Spring(helix="paper", section_points=5).rod(), elements=12, degree=3),
    "ring": lambda cylinder: Space.paper(Ring(section_points=4).rod(), elements=8, order=2),
    "blade": lambda cylinder: Space.paper(Blade().rod(), elements=3),
}


@pytest.fixture(params=SPACES)
def space(request, cylinder):
    return SPACES[request.param](cylinder)


def motions_of_points(points):
    """Return the six rigid motions of points, as columns, from their definition."""
    columns = [np.tile(e, (len(points), 1)) for e in np.eye(3)] + [np.cross(e, points) for e in np.eye(3)]
    return np.array([column.ravel() for column in columns]).T


def test_motions_are_orthonormal_and_strain_free(space):
    motions = rigid_motions.motions(space)
    assert motions.shape == (3 * space.nodes, 6)
    assert np.abs(motions.T @ motions - np.eye(6)).max() < 1e-13
    assembler = Assembler(Model([Body(space, LAW)]))
    matrix, force = assembler.matrix(), assembler.vector()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    for motion in motions.T:
        matrix.mult(assembler.state(motion), force)
        assert force.norm() < 1e-12 * matrix.norm()


def test_motions_move_the_points_of_the_rod_rigidly(space):
    """The six fields span what moves a grid of points as a rigid body does: residual of the fit, both ways."""
    xi, u = np.array([[0.0, 0.0], [0.9, 0.1], [-0.4, 0.7]]), np.linspace(*space.axis.knots[[0, -1]], 7)
    points, _ = space.rod.grid(xi, u)
    expected = motions_of_points(points.reshape(-1, 3))
    moved = np.array([space.displacement(motion, xi, u)[0].ravel() for motion in rigid_motions.motions(space).T]).T
    for a, b in ((expected, moved), (moved, expected)):
        fit, *_ = np.linalg.lstsq(a, b, rcond=None)
        assert np.abs(a @ fit - b).max() < 1e-12 * np.abs(b).max()


# Supports of the bar of 4 points by name, and the number of motions they leave.  Nodes 0 and 2 of a layer stand on the
# x axis.
TOP = 5 * 4
SUPPORTS = {
    "none": (lambda s: [], 6),
    "one node": (lambda s: [Support([0])], 3),
    "one node along x": (lambda s: [Support([0], "x")], 5),
    "one node along x and y": (lambda s: [Support([0], "xy")], 4),
    "two nodes": (lambda s: [Support([0, 2])], 1),
    "two nodes far apart": (lambda s: [Support([0, TOP])], 1),
    "two nodes and one more along their normal": (lambda s: [Support([0, 2]), Support([1], "z")], 0),
    "two nodes and one more in line with them": (lambda s: [Support([0, TOP, 2 * 4])], 1),
    "three nodes": (lambda s: [Support([0, 1, 2])], 0),
    "start": (lambda s: [Support.end(s, "start")], 0),
    "start along z": (lambda s: [Support.end(s, "start", "z")], 3),
    "start along x": (lambda s: [Support.end(s, "start", "x")], 4),
    "start along x and y": (lambda s: [Support.end(s, "start", "xy")], 3),
    "both ends along z": (lambda s: [Support.end(s, end, "z") for end in ("start", "end")], 3),
    "both ends along x": (lambda s: [Support.end(s, end, "x") for end in ("start", "end")], 3),
    "both ends along x and y": (lambda s: [Support.end(s, end, "xy") for end in ("start", "end")], 1),
    "both ends": (lambda s: [Support.end(s, end) for end in ("start", "end")], 0),
    "rollers, determinate": (lambda s: [Support([0]), Support([2], "yz"), Support([TOP], "y")], 0),
    "rollers under the bar": (lambda s: [Support([0, TOP], "y"), Support([2, TOP + 2], "y")], 3),
    "rollers and a stop": (lambda s: [Support([0, TOP], "y"), Support([2, TOP + 2], "y"), Support([0], "xz")], 1),
    "six rollers, one too weak": (lambda s: [Support([0, 1, 2], "z"), Support([0, 2, TOP], "y")], 1),
}


@pytest.mark.parametrize("name", SUPPORTS)
@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_number_of_free_motions(name, size, cylinder):
    supports, expected = SUPPORTS[name]
    space = bar(cylinder, height=6.0 * size, radius=size)
    model = Model([Body(space, LAW)], supports(space))
    found = rigid_motions.free_motions(model)
    assert len(found) == expected
    for body, motion in found:
        assert body == 0
        assert np.abs(motion.ravel()[model.held]).max(initial=0.0) < 1e-13 * np.abs(motion).max()
        assert np.linalg.norm(motion) == pytest.approx(1.0, abs=1e-12)
        fit, *_ = np.linalg.lstsq(rigid_motions.motions(space), motion.ravel(), rcond=None)
        assert np.abs(rigid_motions.motions(space) @ fit - motion.ravel()).max() < 1e-13


@pytest.mark.parametrize("name", SUPPORTS)
def test_free_motions_are_the_null_space_of_the_held_tangent(name, cylinder):
    """Counted independently, by the eigenvalues of the stiffness."""
    supports, expected = SUPPORTS[name]
    space = bar(cylinder)
    assembler = Assembler(Model([Body(space, LAW)], supports(space)))
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 0.0, matrix)
    values = np.linalg.eigvalsh(as_array(matrix))
    assert np.count_nonzero(np.abs(values) < 1e-12 * values[-1]) == expected
    assert values[expected] > 1e-6 * values[-1]


@pytest.mark.parametrize(("shape", "expected"), [((0.0, 0.0), 3), ((1.0, 0.0), 1), ((1e-3, 1e-3), 0)])
def test_an_end_that_is_a_point_or_an_edge_does_not_hold_a_rod(shape, expected):
    """A cone by its tip, a wedge by its edge, and a blunt cone."""
    circle = control_points(4)
    layers = [np.column_stack([circle * scale, np.full(4, z)]) for scale, z in (((1.0, 1.0), 0.0), (shape, 5.0))]
    space = Space.paper(Rod(Axis(1, [0.0, 0.0, 1.0, 1.0], [1.0, 1.0]), np.array(layers)), elements=3, degree=2)
    assert len(rigid_motions.free_motions(Model([Body(space, LAW)], [Support.end(space, "end")]))) == expected
    assert not rigid_motions.free_motions(Model([Body(space, LAW)], [Support.end(space, "start")]))


@pytest.mark.parametrize("slenderness", [10.0, 1e3, 1e5])
def test_a_slender_bar_is_held_by_its_end_face_and_not_by_its_axis(slenderness, cylinder):
    space = bar(cylinder, height=slenderness)
    assert not rigid_motions.free_motions(Model([Body(space, LAW)], [Support.end(space, "start")]))
    held = [Support.end(space, "start", "z"), Support.end(space, "end", "xy"), Support([0], "xy")]
    assert not rigid_motions.free_motions(Model([Body(space, LAW)], held))
    held[1:] = [Support.end(space, "end", "z"), Support([0], "xy")]
    ((_, motion),) = rigid_motions.free_motions(Model([Body(space, LAW)], held))
    assert re.fullmatch(r"turn about \(0, 0, -?1\)", rigid_motions.describe(space, motion))


def test_only_nodes_that_carry_the_rod_hold_it(cylinder):
    """The functions of higher order vanish in every rigid motion."""
    space = bar(cylinder, order=2)
    inner = np.flatnonzero(~space.is_control_point)
    assert len(rigid_motions.free_motions(Model([Body(space, LAW)], [Support(inner)]))) == 6
    assert not rigid_motions.free_motions(Model([Body(space, LAW)], [Support.end(space, "start")]))


def test_ring_held_in_its_planes_of_symmetry():
    space = Space.paper(Ring(section_points=4).rod())
    quarter = 2 * space.layer_nodes
    layer = np.arange(space.layer_nodes)
    first, second = [layer, layer + 2 * quarter], [layer + quarter, layer + 3 * quarter]
    held = [Support(nodes, "y") for nodes in first] + [Support(nodes, "x") for nodes in second]
    ((_, motion),) = rigid_motions.free_motions(Model([Body(space, LAW)], held))
    assert re.fullmatch(r"move along \(0, 0, -?1\)", rigid_motions.describe(space, motion))
    assert not rigid_motions.free_motions(Model([Body(space, LAW)], [*held, Support([0], "z")]))


@pytest.mark.parametrize("held", [(), (0,), (1,), (0, 1), (0, 2), (0, 1, 2)])
def test_every_body_counts_for_itself(held, cylinder):
    spaces = [bar(cylinder), Space.paper(Ring().rod()), bar(cylinder, n=3)]
    supports = [Support([0, 1, 5], body=b) for b in held]
    model = Model([Body(space, NeoHookean(2.0, 0.3)) for space in spaces], supports)
    found = rigid_motions.free_motions(model)
    assert [b for b, _ in found] == [b for b in range(3) if b not in held for _ in range(6)]
    for b, motion in found:
        assert motion.shape == (spaces[b].nodes, 3)


def oblique(cylinder):
    """A bar turned so that its axis and its section lie askew to x, y, z; returned with the rotation."""
    q, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    q *= np.linalg.det(q)
    rod = cylinder(4, height=6.0)
    return Space.paper(Rod(rod.axis, rod.control_points @ q.T + [3.0, -7.0, 2.0]), elements=4), q


def words(text):
    """Split a description into what and which direction (up to its sign)."""
    what, numbers = re.fullmatch(r"(turn about|move along) \((.*)\)", text).groups()
    return what, np.array([float(number) for number in numbers.split(", ")])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("what", ["move along", "turn about"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("size", [1.0, 1e-9])
def test_motions_are_described(axis, what, sign, size, space):
    carried = space.is_control_point[:, None]
    arm = space.positions - space.positions[space.is_control_point].mean(axis=0)
    direction = sign * np.eye(3)[axis]
    motion = size * carried * (direction if what == "move along" else np.cross(direction, arm))
    said, where = words(rigid_motions.describe(space, motion))
    assert said == what
    assert np.array_equal(where, direction)


def test_a_turn_about_a_far_axis_is_a_turn(space):
    arm = space.is_control_point[:, None] * (space.positions - [50.0, 3.0, -20.0])
    said, where = words(rigid_motions.describe(space, np.cross([0.6, 0.0, 0.8], arm)))
    assert said == "turn about"
    assert np.abs(where - [0.6, 0.0, 0.8]).max() < 1e-3


@pytest.mark.parametrize(
    ("held", "what", "direction"),
    [
        (lambda s: [Support([0, TOP])], "turn about", lambda s: s.positions[TOP] - s.positions[0]),
        (lambda s: [Support([1, 3])], "turn about", lambda s: s.positions[1] - s.positions[3]),
        (lambda s: [Support([0, TOP + 2])], "turn about", lambda s: s.positions[TOP + 2] - s.positions[0]),
    ],
)
def test_the_turn_about_two_held_nodes_is_named_by_their_line(held, what, direction, cylinder):
    space, _ = oblique(cylinder)
    ((_, motion),) = rigid_motions.free_motions(Model([Body(space, LAW)], held(space)))
    said, where = words(rigid_motions.describe(space, motion))
    line = direction(space)
    assert said == what
    assert np.abs(np.cross(where, line / np.linalg.norm(line))).max() < 2e-3  # three digits are shown


def test_control_points_of_the_bars_stand_where_the_supports_think(cylinder):
    space = bar(cylinder)
    assert np.abs(space.positions[:4, :2] - control_points(4)).max() < 1e-14
    assert np.ptp(space.positions[TOP : TOP + 4, 2]) == 0
    assert space.positions[TOP, 2] == pytest.approx(6.0)


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize(("ratio", "free"), [(1e-1, 0), (1e-5, 0), (1e-7, 0), (3e-9, 2)])
def test_whether_a_needle_is_held_by_its_face_does_not_depend_on_the_unit_of_length(ratio, free, unit, cylinder):
    """One that is too thin for double precision is free to turn about both directions across it."""
    space = Space.paper(cylinder(4, radius=ratio * unit, height=unit))
    model = Model([Body(space, NeoHookean(1.0, 0.3))], [Support.end(space, "start")])
    assert len(rigid_motions.free_motions(model)) == free
