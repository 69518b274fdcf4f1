"""Searches that contact leaves out: none that finds a touch, however both bodies move."""

import numpy as np
import pytest
from conftest import straight
from touching import add_forces

from isorod.contact.tables import pack
from isorod.geometry.rod import Rod
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Model
from isorod.model.support import rotation
from isorod.space import Space

LAW = NeoHookean(1.0, 0.3)


def crossing(gap):
    """A rod along z and a thin one along x, this far from it."""
    thick = straight(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    thin = straight(6, radius=0.5, height=4.0)
    across = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    points = thin.control_points @ across.T + np.array([-2.0, 1.5 + gap, 3.0])
    spaces = Space.paper(thick), Space.paper(Rod(thin.axis, points))
    return Model([Body(space, LAW) for space in spaces], contacts=[Contact(0, 1, 10.0, points=(5, 6))])


def approached(model, way):
    """Positions of the nodes when each body has gone a way towards the other."""
    x = np.concatenate([body.space.positions for body in model.bodies])
    first = np.arange(x.shape[0]) < model.first_node[1]
    x[:, 1] += way * np.where(first, 1.0, -1.0) * model.is_carrier
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


@pytest.mark.parametrize("seed", range(4))
def test_two_rods_that_wander_touch_as_fresh_searches_say(seed):
    """Both move at random, in steps of all sizes, near and far: no touch is missed."""
    model, rng = crossing(0.4), np.random.default_rng(seed)
    packed = pack(model)
    first = np.arange(model.dofs // 3) < model.first_node[1]
    start = approached(model, 0.0)
    ways = np.zeros((2, 3))
    touched = missed = 0
    for _ in range(150):
        ways += rng.exponential(0.1) * rng.uniform(-1.0, 1.0, (2, 3)) * [1.0, 1.5, 1.0] - 0.05 * ways
        x = start + np.where(first[:, None], ways[0], ways[1]) * model.is_carrier[:, None]
        kept, fresh = np.zeros_like(x), np.zeros_like(x)
        found, expected = add_forces(packed, x, kept), add_forces(pack(model), x, fresh)
        # Where rods are deep in each other a point may have two closest points.
        if not -0.25 < expected[3]:
            continue
        touched += expected[1] > 0.0
        missed += found[2] != pytest.approx(expected[2], rel=1e-9)
        np.testing.assert_allclose(kept, fresh, atol=1e-10 * (1.0 + np.abs(fresh).max()))
    assert missed == 0
    assert touched > 5


@pytest.mark.parametrize("seed", range(3))
def test_rods_apart_and_far_from_the_origin_have_closest_points(seed):
    """Rounding of the coordinates is in the distances that a search compares; askew, rods are in each other's boxes."""
    model = crossing(1.0)
    turn, rng = rotation((0.6, 0.5, 0.4)), np.random.default_rng(seed)
    for _ in range(10):
        x = approached(model, 0.0)
        x[model.first_node[1] :, 2] += rng.uniform(-0.3, 0.3) * model.is_carrier[model.first_node[1] :]
        x = x @ turn.T + (rng.uniform(-0.3, 0.3, 3) + 200.0) * model.is_carrier[:, None]
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
