"""Groups of bodies, bodies that touch themselves, and spheres: what pairs and closed forms say they are."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import straight
from touching import ACROSS, among, assert_as_fresh, forces_at, moved, reference, ring, shaken

from isorod import Contact, Space, Sphere, arc, circle, helix, polyline
from isorod.contact.tables import pack

PENALTY = 10.0
TURNED = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])


def rods():
    """A rod along z, one across it in front and a slanted one behind: the first alone touches both others."""
    rod = straight(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    thin = straight(6, radius=0.5, height=4.0, breaks=(0.0, 1.0, 2.0))
    return [
        Space.paper(rod),
        Space.paper(moved(thin, (-2.0, 1.4, 2.0), ACROSS)),
        Space.paper(moved(thin, (-0.9, -1.35, 1.5), TURNED)),
    ]


def hairpin():
    """Two straight legs beside each other, too near, and a wide loop that joins them."""
    loop = np.linspace(-0.8 * np.pi, 0.8 * np.pi, 17)[1:-1]
    around = np.stack([-3.0 * np.sin(loop), 0.0 * loop, 10.0 + 3.0 * np.cos(loop)], axis=1)
    legs = np.stack([np.full(7, 0.96), np.zeros(7), np.linspace(0.0, 5.0, 7)], axis=1)
    points = np.concatenate([legs, around[::-1] * [-1.0, 1.0, 1.0], legs[::-1] * [-1.0, 1.0, 1.0]])
    return polyline(points, 0.02).sweep(circle(8))


def coil():
    """A helix of two turns and a half, whose wire is thicker than its pitch."""
    return helix(4.0, 1.9, 2.5).sweep(circle(8))


def group():
    return among(rods(), Contact(range(3), None, PENALTY, points=(4, 6)))


def pin():
    return among([Space.paper(hairpin())], Contact(0, None, PENALTY, points=(4, 4)))


def spring():
    return among([Space.paper(coil())], Contact(0, None, PENALTY, points=(4, 4)))


def ball():
    return among(rods()[:1], Contact(0, Sphere((0.2, 2.2, 2.7), 1.5), PENALTY, points=(4, 8)))


SCENES = [group, pin, spring, ball]


def same(found, expected):
    """Energy, force, area and depth, and forces on all nodes."""
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-11)
    np.testing.assert_allclose(found[2], expected[2], atol=1e-11 * np.abs(expected[2]).max())


@pytest.mark.parametrize(
    ("contact", "pairs"),
    [((range(3), None), [(0, 1), (0, 2), (1, 2)]), ((0, (1, 2)), [(0, 1), (0, 2)]), (((2, 1), (0,)), [(1, 0), (2, 0)])],
    ids=["all", "one with two", "two with one"],
)
def test_a_group_is_all_its_pairs(contact, pairs):
    """Where each point meets one neighbour."""
    spaces = rods()
    whole = among(spaces, Contact(*contact, PENALTY, points=(4, 6)))
    single = among(spaces, *(Contact(*pair, PENALTY, points=(4, 6)) for pair in pairs))
    displacement = shaken(whole)
    found, expected = forces_at(whole, displacement), forces_at(single, displacement)
    same(found, expected)
    for body, (first, last) in enumerate(zip(whole.first_node, whole.first_node[1:], strict=False)):
        assert np.abs(expected[2][first:last]).max() > 1e-3, body


def test_a_body_that_touches_itself_is_two_bodies_that_touch():
    """Both legs of a hairpin, as elements of one body, and as named elements of two bodies of its shape."""
    one = pin()
    space = one.bodies[0].space
    middles = 0.5 * (space.axis.breaks[1:] + space.axis.breaks[:-1])
    heights = space.rod.grid(np.zeros((1, 2)), middles)[0][:, 0]
    legs = [np.flatnonzero((heights[:, 2] < 6.0) & (side * heights[:, 0] > 0.0)) for side in (1.0, -1.0)]
    two = among([space, space], Contact(0, 1, PENALTY, *legs, points=(4, 4)))
    displacement = shaken(one)
    found, expected = forces_at(one, displacement), forces_at(two, np.tile(displacement, 2))
    assert expected[1].force > 1.0
    same(found, (None, expected[1], expected[2].reshape(2, -1, 3).sum(axis=0)))


def test_turns_of_a_coil_touch_as_parallel_wires_do():
    """Far from the ends every section is pressed by both neighbours, as by straight wires at the same distance."""
    model = among([Space.paper(coil())], Contact(0, None, PENALTY, points=(16, 4)))
    packed, (_, force, area, deepest), forces = forces_at(model, np.zeros(model.dofs))
    apart = 1.9 * np.cos(np.arctan2(1.9, 2.0 * np.pi * 4.0))
    theta = np.linspace(-np.pi, np.pi, 200_001)[:-1]
    depth = np.maximum(1.0 - np.hypot(apart - np.cos(theta), np.sin(theta)), 0.0)
    length = 1.5 * np.hypot(2.0 * np.pi * 4.0, 1.9)
    assert force == pytest.approx(PENALTY * length * 2.0 * np.pi * depth.mean(), rel=0.03)
    assert area == pytest.approx(length * 2.0 * np.pi * (depth > 0.0).mean(), rel=0.1)
    assert deepest == pytest.approx(apart - 2.0, rel=0.02)
    x = reference(model)
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * np.abs(forces).sum()
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-12 * np.abs(forces).sum() * np.abs(x).max()
    # The first half turn touches what is above it, the last what is below.
    z = packed.points[packed.states["pressure"] > 0.0, 2]
    assert 0.5 < z.min() and z.max() < 1.9 * 2.5 - 0.5


def free(name):
    """A rod that nowhere touches itself."""
    kind, elements = name.split(", ")
    count = int(elements.split()[0])
    if kind == "straight":
        return Space.paper(straight(8, height=60.0, degree=1), elements=count, degree=2)
    if kind == "uneven":
        # Sections come closer and closer to each other.
        rod = straight(8, height=60.0, degree=2)
        rod.control_points[1, :, 2] = 55.0
        return Space.paper(rod, elements=count)
    if kind == "arc":
        return Space.paper(arc(1.2, 300.0).sweep(circle(8)), elements=count)
    if kind == "wide arc":
        return Space.paper(arc(40.0, 270.0).sweep(circle(8)), elements=count)
    if kind == "tight ring":
        return Space.paper(arc(1.1, 360.0).sweep(circle(8)), elements=count)
    return Space.paper(ring(), elements=count)


@pytest.mark.parametrize(
    "name",
    [
        *(f"straight, {count} elements" for count in (1, 2, 7, 60)),
        *(f"uneven, {count} elements" for count in (1, 5, 40)),
        *(f"arc, {count} elements" for count in (4, 12, 60)),
        *(f"wide arc, {count} elements" for count in (3, 39)),
        *(f"tight ring, {count} elements" for count in (4, 12, 60)),
        *(f"ring, {count} elements" for count in (4, 16, 100)),
    ],
)
@pytest.mark.parametrize("points", [None, (1, 1), (3, 9)])
def test_a_rod_does_not_touch_its_own_neighbourhood(name, points):
    """Whatever the mesh: elements much longer and much shorter than the radius, and the joint of a closed rod."""
    model = among([free(name)], Contact(0, None, 1e6, points=points))
    for displacement in (np.zeros(model.dofs), shaken(model, 1e-3)):
        packed, outcome, forces = forces_at(model, displacement)
        assert outcome == (0.0, 0.0, 0.0, 0.0)
        assert not forces.any()
        assert not packed.states["pressure"].any()


def test_a_rod_on_a_sphere_has_the_closed_form():
    """The gap of each point is its distance from the sphere's centre less the radius; forces balance about it."""
    radius, center = 1.5, np.array([0.2, 2.2, 2.7])
    model = among(rods()[:1], Contact(0, Sphere(tuple(center), radius), PENALTY, points=(32, 48)))
    packed, (energy, force, area, deepest), forces = forces_at(model, np.zeros(model.dofs))
    np.testing.assert_allclose(
        packed.states["gap"], np.linalg.norm(packed.points - center, axis=1) - radius, atol=1e-14
    )
    theta, z = np.meshgrid(np.linspace(-np.pi, np.pi, 2001)[:-1], np.linspace(0.0, 6.0, 2001)[:-1] + 1.5e-3)
    points = np.stack([np.cos(theta), np.sin(theta), z], axis=-1)
    away = points - center
    far = np.linalg.norm(away, axis=-1)
    depth = np.maximum(radius - far, 0.0)
    cell = 2.0 * np.pi / 2000 * 6.0 / 2000
    assert energy == pytest.approx(0.5 * PENALTY * cell * (depth**2).sum(), rel=1e-3)
    assert force == pytest.approx(PENALTY * cell * depth.sum(), rel=1e-3)
    assert area == pytest.approx(cell * (depth > 0.0).sum(), rel=1e-2)
    assert deepest == pytest.approx(-depth.max(), rel=1e-3)
    push = PENALTY * cell * (depth / far)[..., None] * away
    np.testing.assert_allclose(forces.sum(axis=0), push.sum(axis=(0, 1)), atol=1e-3 * force)
    about = np.cross(reference(model) - center, forces).sum(axis=0)
    assert np.abs(about).max() < 1e-12 * np.abs(forces).sum() * 6.0


def test_a_point_that_leaves_one_body_meets_the_other_at_once():
    """A thin rod lies across two that are side by side, and goes along itself from one to the other in one step."""
    rod = straight(8, breaks=(0.0, 1.0, 2.0), height=4.0)
    thin = straight(6, radius=0.5, height=8.0, breaks=(0.0, 1.0, 2.0, 3.0))
    ways = [(0.0, 0.0, -2.0), (2.2, 0.0, -2.0)]
    spaces = [*(Space.paper(moved(rod, way)) for way in ways), Space.paper(moved(thin, (-4.0, 1.45, 0.0), ACROSS))]
    model = among(spaces, Contact(2, (0, 1), PENALTY, points=(4, 8)))
    packed, base = pack(model), reference(model)
    mobile = np.arange(base.shape[0])[:, None] >= model.first_node[2]
    for way in (0.0, 2.2, 0.1, 2.1, -2.2, 0.0, 2.0):
        x = base + mobile * model.is_control_point[:, None] * np.array([way, 0.0, 0.0])
        assert_as_fresh(packed, pack(model), x, rtol=1e-10)


@pytest.mark.parametrize("points", [(1, 1), (2, 3), (5, 9)])
@pytest.mark.parametrize("elements", [1, 3, 24])
def test_between_wires_each_point_meets_the_one_it_is_in(points, elements):
    """Three long parallel wires, one touches both others by a little: what is found does not depend on the mesh."""
    rod = straight(8, height=20.0, degree=1)
    middles = np.array([[0.0, 0.0], [1.99, 0.0], [0.5 * 1.995, np.sqrt(0.75) * 1.995]])
    spaces = [Space.paper(moved(rod, (*middle, 0.0)), elements=elements, degree=2) for middle in middles]
    model = among(spaces, Contact(range(3), None, PENALTY, points=points))
    packed, outcome, _ = forces_at(model, np.zeros(model.dofs))
    count = packed.points.shape[0] // 3
    for body in range(3):
        own = slice(body * count, (body + 1) * count)
        others = np.delete(middles, body, axis=0)
        gaps = np.linalg.norm(packed.points[own, None, :2] - others, axis=2).min(axis=1) - 1.0
        expected = np.maximum(-PENALTY * gaps, 0.0)
        np.testing.assert_allclose(packed.states["pressure"][own], expected, atol=1e-11)
    # A point in the middle of an arc is where the wires are nearest.
    assert outcome.deepest == pytest.approx(-0.01, abs=1e-11) or points[0] == 2


def test_numbers_of_bodies_change_nothing():
    spaces, order = rods(), (2, 0, 1)
    contact = Contact(range(3), None, PENALTY, points=(4, 6))
    model = among(spaces, contact)
    permuted = among([spaces[k] for k in order], contact)
    displacement = shaken(model).reshape(-1, 3)
    pieces = np.split(displacement, model.first_node[1:-1])
    _, outcome, forces = forces_at(model, displacement.ravel())
    _, other, turned = forces_at(permuted, np.concatenate([pieces[k] for k in order]).ravel())
    own = np.split(forces, model.first_node[1:-1])
    np.testing.assert_allclose(other, outcome, rtol=1e-12)
    expected = np.concatenate([own[k] for k in order])
    np.testing.assert_allclose(turned, expected, atol=1e-13 * np.abs(expected).max())


def test_what_is_left_of_a_group_is_as_if_the_rest_were_not_there():
    """A far body changes no bit of what the others do."""
    spaces = rods()
    far = Space.paper(moved(spaces[1].rod, (0.0, 40.0, 0.0)))
    contact = Contact(range(3), None, PENALTY, points=(4, 6))
    few = among(spaces, contact)
    many = among([*spaces, far], replace(contact, first=range(4)))
    displacement = shaken(few)
    _, outcome, forces = forces_at(few, displacement)
    more = np.concatenate([displacement, np.zeros(many.dofs - few.dofs)])
    _, other, found = forces_at(many, more)
    assert other == outcome
    assert np.array_equal(found[: forces.shape[0]], forces)
    assert not found[forces.shape[0] :].any()
