"""Supports that turn and ties: rigid motions, moments, exact solutions."""

import numpy as np
import pytest
from prisms import LAW, SPACES, line, prism, slender
from scipy.optimize import brentq

from isorod import Body, InputError, Model, NeoHookean, SolveError, Space, Support, ellipse, statics
from isorod.assembly.assembler import Assembler
from isorod.checks import rigid_motions
from isorod.geometry import center_line, section
from isorod.tensors import rotation


def test_unknowns_of_tied_supports_are_two_and_come_back():
    space = prism(6.0, elements=2, degree=2)
    supports = [Support.end(space, "start"), Support.end(space, "end", "x", turn=(0.0, 0.4, 0.0), tied="yz")]
    model = Model([Body(space, LAW)], supports)
    assembler = Assembler(model)
    assert model.unknowns == 3 * space.nodes - model.bound.size + 2
    x = assembler.vector()
    x.array[:] = np.random.default_rng(2).standard_normal(model.unknowns)
    back = assembler.state(assembler.displacement(x, 0.5))
    assert np.abs(back.array_r - x.array_r).max() < 1e-15


def test_rotation_is_orthogonal_and_turns_by_its_length():
    for vector in ((0.0, 0.0, 0.0), (1e-9, 0.0, 0.0), (0.3, -2.0, 1.0), (0.0, 0.0, 20.0 * np.pi)):
        R = rotation(vector)
        assert R @ R.T == pytest.approx(np.eye(3), abs=1e-15)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert R @ vector == pytest.approx(vector, abs=1e-13)
        assert np.trace(R) == pytest.approx(1.0 + 2.0 * np.cos(np.linalg.norm(vector)))


def test_waypoints_are_passed_at_equal_shares_of_the_way():
    """A turn in four straight legs: on the turn at each waypoint, on the chord between; the last leg tells the rate."""
    space = prism(6.0, elements=2, degree=2)
    end = Support.end(space, "end", turn=(0.4, 0.0, 0.0), during=(0.5, 1.0))
    arms = np.asarray(end.arms)
    legs = [arms @ (rotation((0.1 * k, 0.0, 0.0)) - np.eye(3)).T for k in range(5)]
    legged = Support(end.nodes, displacement=legs[4], waypoints=legs[1:4], during=(0.5, 1.0), space=space)
    turned, moved = (Model([Body(space, LAW)], [Support.end(space, "start"), one]) for one in (end, legged))
    for factor in (0.25, 0.5, 0.625, 0.75, 0.875, 1.0):
        assert moved.prescribed(factor) == pytest.approx(turned.prescribed(factor), abs=1e-15)
    between = 0.5 * (turned.prescribed(0.625) + turned.prescribed(0.75))
    assert moved.prescribed(0.6875) == pytest.approx(between, abs=1e-15)
    last = 4.0 * (turned.prescribed(1.0) - turned.prescribed(0.875))
    assert moved.driven[moved.held] == pytest.approx(last[moved.held], abs=1e-14)
    for waypoints in (legs[1], np.full((1, *arms.shape), np.nan), [legs[1][:2]]):
        with pytest.raises(InputError, match=r"^support 0: got waypoints of shape .*, need \(count, \d+, 3\) finite"):
            Model([Body(space, LAW)], [Support(end.nodes, waypoints=waypoints)])
    with pytest.raises(InputError, match=r"^support 0: got no nodes of body 0, need at least one$"):
        Model([Body(space, LAW)], [Support([])])


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.parametrize("turns", [0.3, 1.7])
def test_both_ends_turned_alike_turn_the_rod_as_a_rigid_body(name, turns):
    """About a centre off the axis, with a displacement: no stress, and the position is R (x - c) + c + d everywhere."""
    space = SPACES[name]()
    turn, center, move = np.array([0.2, -0.5, 1.0]) * turns, (1.0, 2.0, -1.0), (0.5, 0.0, 0.3)
    supports = [Support.end(space, end, "xyz", move, turn=tuple(turn), center=center) for end in ("start", "end")]
    solution = statics.solve(Model([Body(space, LAW)], supports), 8)
    arms = space.positions - space.is_control_point[:, None] * np.array(center)
    wanted = arms @ (rotation(turn) - np.eye(3)).T + space.is_control_point[:, None] * np.array(move)
    found = solution.model.nodal(solution.displacement)
    assert np.abs(found - wanted).max() < 1e-8 * np.abs(wanted).max()
    assert np.abs(solution.reactions).max() < 1e-9
    assert np.abs(solution.moments).max() < 1e-8


def test_moments_balance_the_forces():
    space = prism(6.0, elements=3, degree=3)
    supports = [
        Support.end(space, "start"),
        Support.end(space, "end", "xyz", (0.4, 0.0, -0.2), turn=(0.2, 0.5, 1.0)),
    ]
    solution = statics.solve(Model([Body(space, LAW)], supports), 2)
    places = space.positions + solution.model.nodal(solution.displacement)
    layers = places.reshape(space.layers, -1, 3)
    arms = np.array([layer.mean(axis=0) for layer in (layers[0], layers[-1])])
    total = solution.moments.sum(axis=0) + np.cross(arms, solution.reactions).sum(axis=0)
    assert np.abs(total).max() < 1e-8 * np.abs(solution.moments).max()
    assert np.abs(solution.reactions.sum(axis=0)).max() < 1e-9 * np.abs(solution.reactions).max()


def test_moment_is_the_derivative_of_the_energy_by_the_angle():
    space = prism(4.0, elements=3, degree=3, section_degree=3)

    def energy(angle):
        supports = [Support.end(space, "start"), Support.end(space, "end", turn=(0.0, 0.0, angle))]
        solution = statics.solve(Model([Body(space, LAW)], supports), 2)
        assembler = Assembler(solution.model)
        return assembler.energy(assembler.state(solution.displacement), 1.0), solution.moments[1, 2]

    h = 1e-3
    slope = (energy(1.0 + h)[0] - energy(1.0 - h)[0]) / (2 * h)
    assert energy(1.0)[1] == pytest.approx(slope, rel=1e-6)


def test_a_tied_face_stays_rigid_and_its_free_translation_carries_no_force():
    space = prism(6.0, elements=3, degree=3)
    cap = Support.end(space, "end", "", turn=(0.0, 0.6, 0.0), tied="xyz")
    solution = statics.solve(Model([Body(space, LAW)], [Support.end(space, "start"), cap]), 2)
    rest = space.positions[-4:]
    now = rest + solution.model.nodal(solution.displacement)[-4:]
    R = rotation((0.0, 0.6, 0.0))
    assert now - now.mean(axis=0) == pytest.approx((rest - rest.mean(axis=0)) @ R.T, abs=1e-13)
    assert np.abs(solution.reactions).max() < 1e-9
    assert solution.moments[1, 1] > 0.05
    assert solution.moments[0] == pytest.approx(-solution.moments[1], abs=1e-8)


def test_a_rod_rolls_up_to_a_circle():
    """nu = 0: shape of the elastica under a moment, and M = EI 2 pi / L, both to (r / L)^2."""
    errors = []
    for length in (50.0, 100.0):
        space = slender(length)
        supports = [
            Support.end(space, "start"),
            Support(line(space), "y"),
            Support.end(space, "end", "y", turn=(0.0, 2.0 * np.pi, 0.0), tied="xz"),
        ]
        solution = statics.solve(Model([Body(space, NeoHookean(1.0, 0.0))], supports), 8)
        moment = solution.moments[2, 1] / (0.25 * np.pi * 2.0 * np.pi / length)
        k, s = 2.0 * np.pi, np.array([0.25, 0.5, 0.75, 1.0])
        exact = np.stack([(1.0 - np.cos(k * s)) / k, 0.0 * s, np.sin(k * s) / k - s], axis=1)
        found = space.displacement(solution.model.nodal(solution.displacement), [[0.0, 0.0]], s)[0][:, 0] / length
        errors.append((moment - 1.0, np.abs(found - exact).max()))
        assert np.abs(solution.reactions).max() < 1e-9
    assert abs(errors[1][0]) < 2.5e-3
    assert errors[0][0] / errors[1][0] == pytest.approx(4.0, rel=0.05)
    assert errors[1][1] < 5e-4


@pytest.mark.parametrize("stretch", [0.3, 0.5, 2.0, 5.0, 10.0])
def test_uniaxial_stretch_is_exact(stretch):
    """W of eq. 15: lateral stretch a of mu (a^2 - 1) + kappa ln(a^2 l) = 0.

    The force by reference area is mu (l - 1/l) + kappa ln(a^2 l) / l.
    """
    space = prism(10.0, ellipse(8, 1.0, 0.8), elements=4, section_degree=2, quadrature="auto")
    across = brentq(lambda a: LAW.mu * (a * a - 1.0) + LAW.lame * np.log(a * a * stretch), 1e-3, 10.0)
    stress = LAW.mu * (stretch - 1.0 / stretch) + LAW.lame * np.log(across**2 * stretch) / stretch
    # The coefficient of the coordinate x must not turn.
    along = int(np.argmax(np.abs(space.positions[: space.layer_nodes, 0])))
    supports = [
        Support.end(space, "start", "z"),
        Support.end(space, "end", "z", (0.0, 0.0, 10.0 * (stretch - 1.0))),
        Support([0], "xy"),
        Support([(space.layers - 1) * space.layer_nodes], "xy"),
        Support([along], "y"),
    ]
    solution = statics.solve(Model([Body(space, LAW)], supports))
    assert solution.reactions[1, 2] == pytest.approx(stress * space.rod.volume() / 10.0, rel=1e-9)
    exact = space.positions * (np.array([across, across, stretch]) - 1.0)
    assert np.abs(solution.model.nodal(solution.displacement) - exact).max() < 1e-8


def test_free_motions_under_ties(cylinder):
    space = Space.paper(cylinder(4, height=4.0), elements=3)
    body = Body(space, LAW)
    # A face tied in all components holds rotations, not translations.
    model = Model([body], [Support.end(space, "end", "", tied="xyz")])
    assert len(rigid_motions.free_motions(model)) == 3
    model = Model([body], [Support.end(space, "end", "z", tied="xy")])
    assert len(rigid_motions.free_motions(model)) == 2
    with pytest.raises(SolveError, match=r"free to move along"):
        statics.solve(model)


def staged(rod_space, pull, bend):
    components = {"x": (0.0, 0.0, 0.0), "yz": (0.0, 0.3, -0.4)}
    return [
        Support.end(rod_space, "start"),
        Support.end(rod_space, "end", "x", (0.2, 0.0, 0.0), during=pull),
        Support.end(rod_space, "end", "yz", components["yz"], during=bend),
    ]


def test_supports_move_one_after_the_other_and_end_where_they_would_together():
    space = Space(center_line.straight(4.0).sweep(section.circle(8, 0.5)), section_degree=2, elements=4, degree=3)
    laws = [Body(space, NeoHookean(100.0, 0.3))]
    late = Model(laws, staged(space, (0.0, 0.25), (0.25, 1.0)))
    assert late.stages == [0.25, 1.0]
    held = late.held[late.prescribed(1.0)[late.held] != 0.0]
    x, others = held[held % 3 == 0], held[held % 3 != 0]
    for factor, first, second in ((0.1, 0.4, 0.0), (0.25, 1.0, 0.0), (0.625, 1.0, 0.5), (1.0, 1.0, 1.0)):
        now, whole = late.prescribed(factor), late.prescribed(1.0)
        assert now[x] == pytest.approx(first * whole[x], rel=1e-14)
        assert now[others] == pytest.approx(second * whole[others], rel=1e-14, abs=1e-16)
    solution = statics.solve(late)
    at_once = statics.solve(Model(laws, staged(space, (0.0, 1.0), (0.0, 1.0))))
    # One step would go past the end of the first way.
    assert solution.load_steps >= 2
    assert solution.displacement == pytest.approx(at_once.displacement, abs=1e-9)


@pytest.mark.parametrize("during", [(0.5, 0.5), (-0.1, 1.0), (0.0, 1.1), (0.7, 0.2), (0.0, np.nan)])
def test_a_time_that_is_none_is_refused(during):
    space = Space(center_line.straight(1.0).sweep(section.circle(8, 0.1)), elements=1, degree=2)
    with pytest.raises(InputError, match=r"during.*need two load factors that rise, between 0 and 1"):
        Model([Body(space, NeoHookean(1.0, 0.3))], [Support.end(space, "start", during=during)])
