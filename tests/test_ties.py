"""Ties of rods: patch tests, exact solutions, invariances, what they carry, and bad input."""

import numpy as np
import pytest

from isorod import LinearElastic, NeoHookean, Space, circle, dynamics, modal, statics, straight
from isorod.assembly.constraints import Constraints
from isorod.assembly.formulation import assembler_for
from isorod.errors import InputError, SolveError
from isorod.model import Body, Model, SectionLoad, Support
from isorod.model.tie import EndFace, LateralSurface, SolidSurface, Tie
from isorod.tensors import rotation

FAMILIES = {"control points": {"order": 3}, "polynomials": {"section_degree": 3}}
WELD = Tie(EndFace(1, "start"), EndFace(0, "end"))


def bar(length, start=(0.0, 0.0, 0.0), n=8, radius=1.0, rings=None, end=None, **space):
    line = straight(length, start=start) if end is None else straight(start=start, end=end)
    rod = line.sweep(circle(n, radius))
    return Space(rod if rings is None else rod.with_rings(rings), **space)


def pair(family="control points"):
    """Two bars end on end, of different spaces."""
    lower = bar(4.0, order=2, elements=2, degree=3)
    return lower, bar(3.0, (0.0, 0.0, 4.0), 12, elements=3, degree=4, **FAMILIES[family])


def moved(space, which, gradient, body):
    """Return a support that moves an end face by a linear field."""
    nodes = np.arange(space.nodes).reshape(space.layers, -1)[space.end(which)]
    return Support(nodes, displacement=space.positions[nodes] @ np.transpose(gradient), body=body, space=space)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("turned", [False, True])
def test_uniform_tension_passes_a_weld_of_any_two_meshes(family, turned):
    lower, upper = pair(family)
    law = LinearElastic(10.0, 0.3)
    gradient = 1e-3 * np.diag([-0.3, -0.3, 1.0])
    tie = Tie(WELD.master, WELD.slave) if turned else WELD
    supports = [moved(lower, "start", gradient, 0), moved(upper, "end", gradient, 1)]
    solved = statics.solve(Model([Body(lower, law), Body(upper, law)], supports, ties=[tie]))
    exact = np.concatenate([lower.positions, upper.positions]) @ gradient.T
    assert np.abs(solved.displacement.reshape(-1, 3) - exact).max() < 1e-10 * 1e-3
    force = np.pi * 10.0 * 1e-3 * (1.0 if turned else -1.0)
    assert solved.ties[0].force == pytest.approx([0.0, 0.0, force], rel=1e-9, abs=1e-12)


def test_torsion_passes_a_weld_of_any_moduli():
    lower, upper = pair()
    angle, moduli = 1e-4, (10.0, 1.0)
    laws = [LinearElastic(2.0 * modulus * (1.0 + nu), nu) for modulus, nu in zip(moduli, (0.3, 0.1), strict=True)]
    supports = [Support.end(lower, "start"), Support.end(upper, "end", turn=(0.0, 0.0, angle), body=1)]
    solved = statics.solve(Model([Body(lower, laws[0]), Body(upper, laws[1])], supports, ties=[WELD]))
    torque = angle / (4.0 / (10.0 * np.pi / 2.0) + 3.0 / (np.pi / 2.0))
    # Of a linear law the torque is that of the sine of the angle.
    assert solved.moments[1, 2] == pytest.approx(torque, rel=1e-8)
    assert solved.ties[0].moment[2] == pytest.approx(-torque, rel=1e-8)
    assert solved.ties[0].jump < 1e-12


def test_frequencies_of_two_welded_bars_are_those_of_the_characteristic_equation():
    lower, upper = pair()
    bodies = [
        Body(space, LinearElastic(2.6 * modulus, 0.3), density)
        for space, modulus, density in ((lower, 10.0, 2.0), (upper, 1.0, 1.0))
    ]
    found = modal.solve(Model(bodies, [Support.end(lower, "start")], ties=[WELD]), 8)
    fast, slow = np.sqrt(10.0 / 2.0), 1.0
    impedances = np.sqrt(10.0 * 2.0), 1.0
    torsion = [
        omega
        for omega in 2.0 * np.pi * found.frequencies
        if abs(impedances[0] / np.tan(omega * 4.0 / fast) - impedances[1] * np.tan(omega * 3.0 / slow)) < 1e-3
    ]
    assert torsion == pytest.approx([0.4479707513, 0.9256854357], rel=1e-4)


@pytest.mark.parametrize("inside", [True, False])
def test_a_rod_in_a_sleeve_twists_with_it(inside):
    core = bar(4.0, order=2, elements=2, degree=3)
    sleeve = bar(4.0, radius=2.0, rings=(0.5, 1.0), section_degree=4, elements=3, degree=4)
    surfaces = LateralSurface(0), LateralSurface(1, surface="inner")
    tie = Tie(*(surfaces if inside else surfaces[::-1]))
    angle, supports = 1e-6, []
    for b, space in enumerate((core, sleeve)):
        supports += [Support.end(space, "start", body=b), Support.end(space, "end", turn=(0.0, 0.0, angle), body=b)]
    bodies = [Body(core, LinearElastic(26.0, 0.3)), Body(sleeve, LinearElastic(2.6, 0.3))]
    solved = statics.solve(Model(bodies, supports, ties=[tie]))
    exact = angle / 4.0 * np.array([10.0 * np.pi / 2.0, np.pi / 2.0 * 15.0])
    assert solved.moments[[1, 3], 2] == pytest.approx(exact, rel=1e-10)


def test_rigid_motions_of_a_welded_pair_cost_nothing():
    lower, upper = pair()
    model = Model([Body(lower, NeoHookean(10.0, 0.3)), Body(upper, NeoHookean(1.0, 0.3))], ties=[WELD])
    assembler = assembler_for(model)
    turn = rotation(np.array([0.3, -0.5, 0.9])) - np.eye(3)
    everywhere = np.concatenate([space.positions @ turn.T for space in (lower, upper)])
    everywhere += model.is_control_point[:, None] * [1.0, -2.0, 0.5]
    x, force = assembler.state(everywhere.ravel()), assembler.vector()
    assert np.abs(assembler.displacement(x, 1.0).reshape(-1, 3) - everywhere).max() < 1e-11
    assembler.residual(x, 1.0, force)
    assert force.norm() < 1e-11
    assert (
        len(modal.solve(Model([Body(one, LinearElastic(1.0, 0.3), 1.0) for one in (lower, upper)], ties=[WELD]), 1))
        == 7
    )


def test_the_tangent_is_the_derivative_of_the_residual():
    lower, upper = pair("polynomials")
    model = Model(
        [Body(lower, NeoHookean(10.0, 0.3)), Body(upper, NeoHookean(2.0, 0.2))],
        [Support.end(lower, "start")],
        ties=[WELD],
    )
    assembler = assembler_for(model)
    rng = np.random.default_rng(5)
    x, way = assembler.vector(), assembler.vector()
    x.array_w[:] = 1e-2 * rng.standard_normal(x.local_size)
    way.array_w[:] = rng.standard_normal(x.local_size)
    matrix, forces = assembler.matrix(), [assembler.vector() for _ in range(2)]
    assembler.tangent(x, 1.0, matrix)
    for sign, force in zip((1.0, -1.0), forces, strict=True):
        assembler.residual(x + sign * 1e-6 * way, 1.0, force)
    difference = (forces[0] - forces[1]) * (1.0 / 2e-6)
    assert (difference - matrix * way).norm() < 1e-7 * difference.norm()


def test_supports_and_ties_share_a_surface_without_contradiction():
    lower, upper = pair()
    law = LinearElastic(10.0, 0.3)
    # The slave's face is held along x: the tie leaves x to the support.
    supports = [Support.end(lower, "start"), Support.end(upper, "start", "x", body=1)]
    load = SectionLoad.end(upper, "end", (0.0, 1e-3, 0.0), body=1)
    solved = statics.solve(Model([Body(lower, law), Body(upper, law)], supports, loads=[load], ties=[WELD]))
    assert solved.reactions.sum(axis=0) == pytest.approx([0.0, -1e-3, 0.0], abs=1e-12)
    assert solved.ties[0].force == pytest.approx([0.0, -1e-3, 0.0], abs=1e-9)


def test_a_chain_of_ties_carries_what_hangs_on_it():
    spaces = [bar(2.0, (0.0, 0.0, 2.0 * k), 6, order=2, elements=1, degree=3) for k in range(4)]
    law = LinearElastic(10.0, 0.0)
    ties = [Tie(EndFace(k, "start"), EndFace(k - 1, "end")) for k in (3, 1, 2)]
    load = SectionLoad.end(spaces[-1], "end", (1e-3, 0.0, 1e-3), body=3)
    model = Model([Body(one, law) for one in spaces], [Support.end(spaces[0], "start")], loads=[load], ties=ties)
    solved = statics.solve(model)
    for tie in solved.ties:
        assert tie.force == pytest.approx([-1e-3, 0.0, -1e-3], rel=1e-8, abs=1e-11)
    alone = bar(8.0, n=6, order=2, elements=4, degree=3, continuity=0)
    load = SectionLoad.end(alone, "end", (1e-3, 0.0, 1e-3))
    whole = statics.solve(Model([Body(alone, law)], [Support.end(alone, "start")], loads=[load]))
    assert solved.at(3, "end") == pytest.approx(whole.at(0, "end"), rel=1e-8)


BAD = {
    "apart": (Tie(EndFace(1, "end"), EndFace(0, "end")), "apart at"),
    # Where one touches the rod, but at its other end.
    "other end": (Tie(EndFace(1, "start"), EndFace(0, "start")), "apart at"),
    "no body": (Tie(EndFace(2, "end"), EndFace(0, "end")), "tie 0: body 2 is not one of the model's 2"),
    "no hole": (Tie(LateralSurface(1, surface="inner"), EndFace(0, "end")), "the rod has no hole"),
    "no joint": (Tie(LateralSurface(1, (0.0, 0.7)), EndFace(0, "end"), gap=9.0), "is no joint of elements"),
    "beyond": (
        Tie(LateralSurface(1, (0.0, 3.5)), EndFace(0, "end"), gap=9.0),
        "along is from 0 to 3.5, need lengths from 0 to the rod's 3$",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_ties_that_cannot_be_are_refused(case):
    lower, upper = pair()
    tie, message = BAD[case]
    with pytest.raises(InputError, match=message):
        Constraints(Model([Body(lower, LinearElastic(1.0, 0.3)), Body(upper, LinearElastic(1.0, 0.3))], ties=[tie]))


def test_what_nothing_holds_is_refused():
    lower, upper = pair()
    model = Model([Body(one, LinearElastic(1.0, 0.3)) for one in (lower, upper)], [Support([0], "x")], ties=[WELD])
    with pytest.raises(SolveError, match="body 0 is free to"):
        statics.solve(model)


def test_a_circle_of_ties_is_refused():
    spaces = pair()
    ties = [WELD, Tie(EndFace(0, "end"), EndFace(1, "start"))]
    with pytest.raises(InputError, match="ties go round in a circle"):
        Constraints(Model([Body(one, LinearElastic(1.0, 0.3)) for one in spaces], ties=ties))


def test_a_face_that_is_held_has_no_tie_left():
    lower, upper = pair()
    supports = [Support.end(upper, "start", body=1)]
    with pytest.raises(InputError, match="supports or other ties hold all of the start of body 1"):
        Constraints(Model([Body(one, LinearElastic(1.0, 0.3)) for one in (lower, upper)], supports, ties=[WELD]))


def test_a_body_is_not_tied_to_itself():
    with pytest.raises(InputError, match="tie: body 0 with itself"):
        Tie(EndFace(0, "start"), EndFace(0, "end"))


def hollow_pair():
    return bar(4.0, order=2, elements=2, degree=3), bar(
        4.0, radius=2.0, rings=(0.5, 1.0), section_degree=4, elements=3, degree=4
    )


@pytest.mark.parametrize("inside", [True, False])
def test_what_slides_carries_the_pressure_of_a_core_that_is_shortened(inside):
    core, sleeve = hollow_pair()
    law, strain = LinearElastic(10.0, 0.3), -1e-3
    surfaces = LateralSurface(0), LateralSurface(1, surface="inner")
    tie = Tie(*(surfaces if inside else surfaces[::-1]), kind="slide")
    supports = [Support.end(core, "start", "z"), Support.end(core, "end", "z", (0.0, 0.0, 4.0 * strain))]
    supports += [Support.end(sleeve, which, "z", body=1) for which in ("start", "end")]
    # The first functions of the sleeve are 1 and the coordinates: nothing of it moves or turns as a whole.
    supports += [Support([0], "xy", body=1), Support([1], "y", body=1)]
    model = Model([Body(core, law), Body(sleeve, law)], supports, ties=[tie])
    with pytest.raises(SolveError, match=r"body 0 is free to turn about \(.*, 1\)|\(.*, -1\)"):
        statics.solve(model)
    # A control point on the x-axis that does not move along y.
    solved = statics.solve(Model(model.bodies, [*supports, Support([0], "y")], ties=[tie]))
    inner = (1.0 - 0.3 - 2.0 * 0.3**2) / 10.0
    outer = 1.3 / 10.0 / 3.0 * (1.0 - 2.0 * 0.3 + 4.0)
    pressure = -0.3 * strain / (inner + outer)
    found = solved.ties[0]
    assert np.sum(found.traction * found.normals, axis=1) == pytest.approx(-pressure, rel=1e-4)
    assert found.jump < 1e-8


@pytest.mark.parametrize("stiffness", [0.1, 10.0])
def test_a_bond_slips_as_springs_in_series_do(stiffness):
    lower, upper = pair()
    law = LinearElastic(10.0, 0.0)
    tie = Tie(EndFace(1, "start"), EndFace(0, "end"), kind="slide", bond=stiffness)
    angle = 1e-4
    supports = [Support.end(lower, "start"), Support.end(upper, "end", turn=(0.0, 0.0, angle), body=1)]
    solved = statics.solve(Model([Body(lower, law), Body(upper, law)], supports, ties=[tie]))
    polar = np.pi / 2.0
    torque = angle / (7.0 / (5.0 * polar) + 1.0 / (stiffness * polar))
    assert solved.moments[1, 2] == pytest.approx(torque, rel=1e-7)
    assert solved.ties[0].moment[2] == pytest.approx(-torque, rel=1e-7)


def test_a_mean_tie_passes_force_and_moment_and_lets_the_section_breathe():
    lower, upper = pair()
    stiff, soft = LinearElastic(1e4, 0.3), LinearElastic(10.0, 0.3)
    tie = Tie(EndFace(1, "start"), EndFace(0, "end"), kind="mean")
    supports = [Support.end(lower, "start"), moved(upper, "end", 1e-3 * np.diag([-0.3, -0.3, 1.0]), 1)]
    solved = statics.solve(Model([Body(lower, stiff), Body(upper, soft)], supports, ties=[tie]))
    # The soft bar's face, welded to a stiff one, would not contract.
    edge = solved.at(1, "start", (1.0, 0.0)) - solved.at(1, "start")
    strain = solved.at(1, 0.9)[2] - solved.at(1, 0.1)[2]
    assert edge[0] == pytest.approx(-0.3 * strain / 2.4, rel=1e-2)
    assert solved.ties[0].force == pytest.approx(solved.reactions[0], abs=1e-10)


def test_a_tie_to_a_face_that_is_held_pulls_at_its_support():
    lower, upper = pair()
    law = LinearElastic(10.0, 0.0)
    supports = [Support.end(lower, "start"), Support.end(lower, "end")]
    load = SectionLoad.end(upper, "end", (2e-3, 0.0, 1e-3), body=1)
    solved = statics.solve(Model([Body(lower, law), Body(upper, law)], supports, loads=[load], ties=[WELD]))
    assert solved.reactions == pytest.approx(np.array([[0.0] * 3, [-2e-3, 0.0, -1e-3]]), abs=1e-11)


@pytest.mark.parametrize("nu", [0.3, 0.4999, 0.5])
def test_welded_bars_swing_as_one(nu):
    # From 0.49 on with pressures of their own.
    kinds = {"order": 2, "degree": 3, "continuity": 0}
    lower, upper = (bar(2.0, (0.0, 0.0, z), elements=2, **kinds) for z in (0.0, 2.0))
    one, law = bar(4.0, elements=4, **kinds), NeoHookean(10.0, nu)

    def swung(spaces, ties):
        last = len(spaces) - 1
        load = SectionLoad.end(spaces[last], "end", (5e-2, 0.0, 0.0), body=last)
        bodies = [Body(space, law, 1.0) for space in spaces]
        model = Model(bodies, [Support.end(spaces[0], "start")], loads=[load], ties=ties)
        found = dynamics.solve(model, 4.0, 0.5, integrator="implicit", outputs=4)
        return found, [state.at(last, "end") for _, state in found.frames()]

    found, path = swung([lower, upper], [WELD])
    alone, expected = swung([one], [])
    assert np.array(path) == pytest.approx(np.array(expected), abs=1e-8)
    assert np.array(found.reactions) == pytest.approx(np.array(alone.reactions), abs=1e-7)
    assert np.abs(found.energy_error).max() < 1e-10


def test_a_disk_swings_on_its_bond():
    """``k A`` is its spring, ``rho A L`` its mass; it starts in the middle and at the end of a swing."""
    bond, density, thick = 4.0, 2.0, 0.5
    lower, disk = bar(1.0), bar(thick, (0.0, 0.0, 1.0), elements=1)
    stiff = LinearElastic(1e4, 0.3)
    tie = Tie(WELD.slave, WELD.master, kind="slide", bond=bond)
    model = Model([Body(lower, stiff, 1.0), Body(disk, stiff, density)], [Support.end(lower, "start")], ties=[tie])
    frequency = np.sqrt(bond / (density * thick))
    period = 2.0 * np.pi / frequency
    # That of the trapezoidal rule.
    step = period / 24
    late = 2.0 / step * np.arctan(0.5 * frequency * step)
    way = np.zeros((model.dofs // 3, 3))
    way[lower.nodes :, 0] = 0.1 * disk.is_control_point

    def swung(quarter, shape, size, **start):
        found = dynamics.solve(model, period, step, outputs=8, integrator="implicit", **start)
        expected = size * shape(late * found.times)
        moved = np.array([state.at(1, "end")[0] for state in found])
        assert np.abs(moved - expected).max() < 1e-2 * size
        assert found.stored[quarter] == pytest.approx(0.5 * bond * np.pi * size**2, rel=5e-3)
        assert np.abs(found.energy_error).max() < 1e-8
        return found.reactions[:, 0, 0], -bond * np.pi * moved

    swung(4, np.cos, 0.1, displacement=way.ravel())
    # Begun slowly nothing rings: the support of the bar carries what the bond pulls.
    carried, pulled = swung(2, np.sin, 0.1 / frequency, velocity=way.ravel())
    assert np.abs(carried - pulled).max() < 0.05 * np.abs(pulled).max()


def test_facets_that_follow_a_rods_end_are_warned_of():
    with pytest.warns(UserWarning, match="facets of solid 0 as slave of the start of body 0"):
        Tie(SolidSurface(0, [1]), EndFace(0, "start"))
