"""Searches that contact leaves out: none that finds a touch, however both bodies move."""

import numpy as np
import pytest
import surfaces
import test_contact_groups as groups
from conftest import straight
from test_contact_mesh import ball, on
from touching import LAW, across, add_forces, among, assert_as_fresh, moved, reference

from isorod import Body, Contact, Model, Rod, Space
from isorod.contact import tables
from isorod.contact.tables import pack
from isorod.tensors import rotation


def crossing(gap=0.4):
    """A rod along z and a thin one along x, this far from it."""
    return across((-2.0, 1.5 + gap, 3.0), (5, 6))


def approached(model, way):
    """Positions of the nodes when each body has gone a way towards the other."""
    x = reference(model)
    first = np.arange(x.shape[0]) < model.first_node[1]
    x[:, 1] += way * np.where(first, 1.0, -1.0) * model.is_control_point
    return x


@pytest.mark.parametrize("gap", [0.01, 0.3, 3.0], ids=["near", "in the boxes", "beyond the boxes"])
@pytest.mark.parametrize("share", [0.51, 0.6, 0.9])
def test_rods_that_approach_each_other_are_not_missed(gap, share):
    """Each goes a little more than half of the gap: how far the other is says nothing of when they meet."""
    depth = 2.0 * share * gap - gap
    model = crossing(gap)
    packed = pack(model)
    forces = np.zeros((model.dofs // 3, 3))
    assert add_forces(packed, approached(model, 0.0), forces)[1] == 0.0
    moved = approached(model, share * gap)
    _, force, area, deepest = add_forces(packed, moved, forces)
    fresh = np.zeros_like(forces)
    expected = add_forces(pack(model), moved, fresh)
    assert (force, area, deepest) == pytest.approx(expected[1:], rel=1e-12)
    np.testing.assert_allclose(forces, fresh, atol=1e-12 * np.abs(fresh).max())
    if depth > 0.1:
        assert force > 0.0 and -depth <= deepest < 0.0


def on_mesh():
    return on(ball(np.array([0.2, 2.6, 2.7]), 1.5, 2))


def wandering(model, halves, seed, steps, scale=1.0):
    """Positions of bodies, or of a body's halves, that go about at random, in steps of all sizes."""
    start, rng = reference(model), np.random.default_rng(seed)
    number = np.arange(start.shape[0])
    parts = number >= number.size // 2 if halves else np.searchsorted(model.first_node, number, side="right") - 1
    ways = np.zeros((parts.max() + 1, 3))
    for _ in range(steps):
        ways += rng.exponential(0.1) * rng.uniform(-1.0, 1.0, ways.shape) * scale - 0.05 * ways
        yield start + ways[parts.astype(int)] * model.is_control_point[:, None]


SELF = groups.pin, groups.spring
WANDERING = [
    *((scene, seed, room) for scene in (groups.group, *SELF) for seed in range(3) for room in (tables.NEAR, 2)),
    *((crossing, seed, tables.NEAR) for seed in range(4)),
    (on_mesh, 6, tables.NEAR),
    *((surfaces.inside, seed, tables.NEAR) for seed in range(3)),
]


# The first walk of each at once, the others where time is.
@pytest.mark.parametrize(
    ("scene", "seed", "room"),
    [pytest.param(*one, marks=pytest.mark.slow if one[1] in (1, 2, 3) else ()) for one in WANDERING],
)
def test_bodies_that_wander_touch_as_fresh_searches_say(scene, seed, room, monkeypatch):
    """Searches left out, lists kept, and lists that overflow change nothing."""
    model = scene()
    fresh = pack(model)
    monkeypatch.setattr(tables, "NEAR", room)
    packed = pack(model)
    steps = {groups.spring: 30, crossing: 150, on_mesh: 80}.get(scene, 60)
    within = {crossing: {"deepest": -0.25}, on_mesh: {"rtol": 1e-12}}.get(scene, {"deepest": -0.3})
    scale = {crossing: [1.0, 1.5, 1.0], surfaces.inside: [0.15, 0.15, 1.0]}.get(scene, 1.0)
    states = wandering(model, scene in SELF, seed, steps, scale)
    touched, left = sum(assert_as_fresh(packed, fresh, x, **within) for x in states)
    assert touched > 5
    assert left > packed.areas.size
    if room == 2:
        assert packed.counts.max() > 2


def test_a_rod_that_was_too_far_to_be_listed_comes_near_before_the_next_list_is_made():
    """While another one, which has been near, goes away, so that points are sought in between."""
    rod = straight(8, radius=0.5, height=4.0, breaks=(0.0, 1.0, 2.0))
    places = (0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 6.6, 0.0)
    model = among([Space.paper(moved(rod, place)) for place in places], Contact(0, (1, 2), 10.0, points=(3, 3)))
    packed, fresh, x = pack(model), pack(model), reference(model)
    for one in (packed, fresh):
        one.listed[0] = 5.0
    assert_as_fresh(packed, fresh, x)
    for ways in ([0.0, 2.0], [2.0, 0.0], [0.0, -2.0]), ([0.0, 0.9], [0.0, 0.0], [0.0, -0.9]):
        x[:, :2] += np.repeat(ways, np.diff(model.first_node), axis=0) * model.is_control_point[:, None]
        touch, _ = assert_as_fresh(packed, fresh, x)
    assert touch


@pytest.mark.parametrize("seed", range(3))
def test_rods_apart_and_far_from_the_origin_have_closest_points(seed):
    """Rounding of the coordinates is in the distances that a search compares; askew, rods are in each other's boxes."""
    model = crossing(1.0)
    turn, rng = rotation((0.6, 0.5, 0.4)), np.random.default_rng(seed)
    for _ in range(10):
        x = approached(model, 0.0)
        x[model.first_node[1] :, 2] += rng.uniform(-0.3, 0.3) * model.is_control_point[model.first_node[1] :]
        x = x @ turn.T + (rng.uniform(-0.3, 0.3, 3) + 200.0) * model.is_control_point[:, None]
        assert add_forces(pack(model), x, np.zeros_like(x))[1] == 0.0


def test_of_twenty_wires_round_a_point_none_is_forgotten():
    """The spheres of nineteen flat wires hold a thin rod, which touches the twentieth alone."""
    pin, flat = straight(6, radius=0.02, height=0.5), straight(8, height=2.0)
    beside, pressed = (0.0, -0.15, -0.75), (-0.9, -0.035, -0.75)

    def forces(places):
        rods = [pin, *(Rod(flat.axis, flat.control_points * [1.0, 0.05, 1.0] + place) for place in places)]
        bodies = [Body(Space.paper(one), LAW) for one in rods]
        model = Model(bodies, contacts=[Contact(0, range(1, len(bodies)), 10.0, points=(3, 4))])
        positions = np.concatenate([body.space.positions for body in bodies])
        found = np.zeros_like(positions)
        return add_forces(pack(model), positions, found), found[: model.first_node[1]]

    alone, among = forces([pressed]), forces([beside] * 19 + [pressed])
    assert alone[0][1] > 0.0
    assert among[0] == pytest.approx(alone[0], rel=1e-12)
    np.testing.assert_array_equal(among[1], alone[1])
    assert forces([beside] * 19)[0][1] == 0.0
