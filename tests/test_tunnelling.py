"""No step takes rods through each other, in statics or in motion."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import straight
from push_pairs import BAD, judged
from pushed import ACROSS, LAW, outcome, rods

from comparisons.contact.capstan import Capstan
from isorod import NeoHookean, Rod, SolveError, Space, circle, dynamics, helix, statics
from isorod.contact.tunnelling import Tunnelling
from isorod.model import Body, Contact, Cylinder, Model, SectionLoad, Sphere, Support


def thrown(penalty, friction=0.0):
    """A rod thrown at another, clamped one; in a time of one it would go four radii."""
    model = rods((0.0, 2.1, 0.0), turn=ACROSS, contacts=[Contact(0, 1, penalty, friction=friction, points=(3, 3))])
    model = replace(model, supports=[Support.end(model.bodies[0].space, end) for end in ("start", "end")])
    velocity = np.zeros((model.dofs // 3, 3))
    velocity[model.first_node[1] :, 1] = -4.0 * model.is_control_point[model.first_node[1] :]
    return model, velocity.ravel()


@pytest.mark.parametrize(
    ("integrator", "step", "said"),
    [
        ("explicit", None, "penetration exceeds half the smaller radius .tunnelling.; increase"),
        ("implicit", 0.05, r"contact 0: penetration is \S+ of the smaller radius; increase the penalty"),
    ],
)
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_motion_through_a_rod_ends_with_one_line(integrator, step, said, friction):
    model, velocity = thrown(0.01, friction)
    with pytest.raises(SolveError, match=said) as error:
        dynamics.solve(model, 1.0, step, 2, velocity=velocity, integrator=integrator)
    assert "\n" not in str(error.value)


def test_a_rod_thrown_at_a_stiff_one_bounces():
    model, velocity = thrown(1000.0)
    history = dynamics.solve(model, 0.4, 0.04, 5, velocity=velocity, integrator="implicit")
    assert history.contact_force.max() > 0.0
    assert history.penetration.max() < 0.5
    assert history.displacement[-1].reshape(-1, 3)[model.first_node[1] :, 1].mean() > -1.0


@pytest.mark.parametrize("seed", [3, 7, 10])
def test_rods_pushed_at_each_other_are_right_or_refused(seed):
    outcome(seed)


def test_rods_moved_beside_each_other_carry_nothing():
    """What rounding leaves of no force at all is no lack of balance."""
    assert outcome(210)[0] == "right: penetration 0"


@pytest.mark.slow
def test_500_pairs_of_rods_pushed_through_each_other():
    bad = []
    for seed, seconds, said in judged(range(500), limit=300.0):
        print(f"{seed} {seconds:.1f} s {said}")
        if said.split(":")[0] in BAD:
            bad.append((seed, said))
    assert not bad


def test_pairs_are_pushed_within_a_time():
    ((seed, seconds, said),) = judged([0], limit=0.01)
    assert (seed, seconds, said) == (0, 0.01, "late: no answer after 0.01 s")


def test_rods_pushed_past_each_other_in_one_step_keep_their_sides():
    """Pushed three diameters in one step, after which no force tells that they have changed sides."""
    model = rods((0.0, 2.1, 0.0), turn=ACROSS, contacts=[Contact(0, 1, 1e4)])
    low, high = (body.space for body in model.bodies)
    supports = [Support.end(low, end) for end in ("start", "end")]
    supports += [Support.end(high, end, displacement=(0.0, -6.0, 0.0), body=1) for end in ("start", "end")]
    solution = statics.solve(replace(model, supports=supports))
    assert solution.cuts > 0
    # Each bends as much as the other.
    assert solution.at(0, 1.5)[1] == pytest.approx(-6.0 - solution.at(1, 1.5)[1], rel=1e-3)
    assert solution.position(1, 1.5)[1] - solution.position(0, 1.5)[1] > 1.0
    soft = replace(model, supports=supports, contacts=[Contact(0, 1, 1.0)])
    with pytest.raises(SolveError, match=r"contact 0: penetration is \S+ of the smaller radius|through body 1"):
        statics.solve(soft)


def watched(contact, *shifts, turn=ACROSS):
    model = rods(*shifts, turn=turn, contacts=[contact])
    return model, Tunnelling(model)


@pytest.mark.parametrize("turn", [None, ACROSS], ids=["parallel", "crossing"])
def test_ways_through_each_other_are_seen_however_long_the_step(turn):
    model, passing = watched(Contact(0, 1), (0.0, 2.1, 0.0), turn=turn)
    rest, carriers = (
        np.zeros((model.dofs // 3, 3)),
        model.is_control_point & (np.arange(model.dofs // 3) >= model.first_node[1]),
    )
    for way, through in (((0.0, -0.5, 0.0), False), ((0.0, -4.2, 0.0), True), ((0.0, -9e3, 0.0), True)):
        moved = rest + carriers[:, None] * np.array(way)
        assert bool(passing.passed(rest.ravel(), moved.ravel())) is through
    # Away, and over its end.
    for way in ((0.0, 50.0, 0.0), (0.0, 0.0, 20.0) if turn is not None else (30.0, 0.0, 0.0)):
        assert passing.passed(rest.ravel(), (rest + carriers[:, None] * np.array(way)).ravel()) is None


@pytest.mark.parametrize(
    "obstacle",
    [Cylinder((0.0, -1.5, 1.0), (2.0, 0.0, 0.0), 0.4), Sphere((0.1, -1.5, 1.0), 0.4)],
    ids=["cylinder", "sphere"],
)
def test_ways_through_a_rigid_obstacle_are_seen(obstacle):
    model, passing = watched(Contact(0, obstacle))
    rest = np.zeros((model.dofs // 3, 3))
    for way, through in ((0.3, False), (-0.3, False), (-3.2, True)):
        moved = rest + model.is_control_point[:, None] * np.array([0.0, way, 0.0])
        said = passing.passed(rest.ravel(), moved.ravel())
        assert (said is not None and "through the obstacle of contact 0" in said) is through


def test_coils_that_change_places_are_seen_and_their_own_bends_are_not():
    space = Space.paper(helix(6.0, 2.6, 2).sweep(circle(8, 1.0)), elements=16, degree=4)
    model = Model([Body(space, LAW)], contacts=[Contact(0)])
    passing = Tunnelling(model)
    rest = np.zeros((space.nodes, 3))
    squeeze = rest - np.where(space.is_control_point, space.positions[:, 2], 0.0)[:, None] * [0.0, 0.0, 1.0]
    assert passing.passed(rest.ravel(), 0.2 * squeeze.ravel()) is None
    assert "body 0 at u" in passing.passed(rest.ravel(), 2.0 * squeeze.ravel())


def test_a_way_is_free_until_rods_enter_each_other_by_a_fifth_of_a_radius():
    model = rods((0.0, 2.1, 0.0), turn=ACROSS, contacts=[Contact(0, 1, 100.0)])
    start, way = np.zeros(model.dofs), np.zeros((model.dofs // 3, 3))
    way[model.first_node[1] :, 1] = -4.0 * model.is_control_point[model.first_node[1] :]
    watch = Tunnelling(model)
    # Of a way of four radii 0.3 are free: the gap and a fifth of a radius.
    assert watch.free(start, way.ravel()) == 0.0625
    assert watch.free(start, 0.07 * way.ravel()) == 1.0
    assert watch.free(start, -way.ravel()) == 1.0
    # What is deeper already may come out, and go no deeper.
    deep = 0.2 * way.ravel()
    assert watch.free(deep, start) == 1.0
    assert watch.free(deep, 0.4 * way.ravel()) < 0.1


def test_a_rod_over_a_cylinder_that_nothing_but_contact_holds_is_pulled_down_in_one_step():
    """By symmetry its right half; a first step, before anything is touched, goes through the cylinder."""
    E, force, length, radius = 1000.0, 10.0, 40.0, 10.0
    rod = straight(8, breaks=np.linspace(0.0, 1.0, 9), height=length)
    space = Space.paper(Rod(rod.axis, rod.control_points @ ACROSS.T), degree=3, order=2, quadrature="auto")
    model = Model(
        [Body(space, NeoHookean(E, 0.0))],
        [Support.end(space, "start", "xz")],
        contacts=[Contact(0, Cylinder((0.0, -radius - 1.0, 0.0), (0.0, 0.0, 1.0), radius))],
        loads=[SectionLoad.end(space, "end", (0.0, -force, 0.0))],
    )
    solution = statics.solve(model)
    tip = solution.at(0, [1.0])[0] + [length, 0.0, 0.0]
    elastica = Capstan(E * np.pi / 4.0, radius + 1.0, np.pi, force, length)
    # The elastica does not stretch: this rod does, by up to 0.13.
    expected = elastica.positions(np.array([length]))[0] - [0.0, radius + 1.0]
    np.testing.assert_allclose(tip[:2], expected, atol=0.2)
    np.testing.assert_allclose(solution.contacts[0].force, 2.0 * force, rtol=0.5)
