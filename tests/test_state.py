"""What solutions answer: displacements, places and stresses at points of a body, named by number or by its rod."""

import numpy as np
import pytest
from conftest import straight
from petsc4py import PETSc

from isorod import InputError, LinearElastic, Muscle, NeoHookean, Space, circle, dynamics, helix, modal, statics
from isorod.model import Body, Model, SectionLoad, Support
from isorod.output.state import State
from isorod.output.stress import cauchy, von_mises
from isorod.scenes.biceps import Biceps
from isorod.scenes.spring import Spring
from isorod.tensors import rotation

LAW = NeoHookean(2.0, 0.3)
STRETCHES = np.array([0.9, 1.1, 1.3])
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
F = TURN @ np.diag(STRETCHES)
XI = np.array([[0.0, 0.0], [0.4, -0.3], [1.0, 0.0]])


def affine(model, gradient=F):
    """Return the state in which every point ``X`` is at ``F X``."""
    positions = np.concatenate([body.space.positions for body in model.bodies])
    return State(model, (positions @ (gradient - np.eye(3)).T).ravel())


@pytest.fixture(scope="module")
def model():
    wire = Space(helix(2.0, 1.0, 1, 4).sweep(circle(5, 0.3)), degree=3, elements=8)
    bar = Space(straight(4, height=2.0), elements=3, order=2)
    return Model([Body(wire, LAW), Body(bar, LAW)])


@pytest.mark.parametrize("number", [0, 1])
def test_answers_at_points_of_an_affine_deformation(number, model):
    state, rod = affine(model), model.bodies[number].space.rod
    u = np.array([0.0, 0.37, 1.0])
    rest, _ = rod.grid(XI, u)
    assert state.position(rod, u, XI) == pytest.approx(rest @ F.T, abs=1e-12)
    assert state.at(rod, u, XI) == pytest.approx(rest @ (F - np.eye(3)).T, abs=1e-12)
    assert state.position(rod, u, XI, scale=2.0) == pytest.approx(rest @ (2.0 * F - np.eye(3)).T, abs=1e-12)
    assert state.deformation_gradient(rod, u, XI) == pytest.approx(np.broadcast_to(F, (3, 3, 3, 3)), abs=1e-12)
    J = STRETCHES.prod()
    principal = (LAW.mu * (STRETCHES**2 - 1.0) + LAW.lame * np.log(J)) / J
    stress = TURN @ np.diag(principal) @ TURN.T
    assert state.stress(rod, u, XI) == pytest.approx(np.broadcast_to(stress, (3, 3, 3, 3)), abs=1e-12)
    first = J * stress @ np.linalg.inv(F).T
    assert state.stress(rod, u, XI, kind="pk1") == pytest.approx(np.broadcast_to(first, (3, 3, 3, 3)), abs=1e-12)
    assert state.stress(rod, u, XI, kind="von Mises") == pytest.approx(np.full((3, 3), von_mises(stress)), abs=1e-12)


def test_von_mises_of_known_states():
    assert von_mises(np.diag([0.0, 0.0, -7.0])) == pytest.approx(7.0)
    assert von_mises(5.0 * np.eye(3)) == pytest.approx(0.0, abs=1e-14)
    shear = np.zeros((2, 3, 3))
    shear[:, 0, 1] = shear[:, 1, 0] = 2.0
    assert von_mises(shear) == pytest.approx([2 * np.sqrt(3)] * 2)
    s1, s2, s3 = 3.0, -1.0, 0.5
    expected = np.sqrt(((s1 - s2) ** 2 + (s2 - s3) ** 2 + (s3 - s1) ** 2) / 2)
    Q = rotation((0.0, 0.7, 0.0))
    assert von_mises(Q @ np.diag([s1, s2, s3]) @ Q.T) == pytest.approx(expected)


def test_shape_is_that_of_u_then_that_of_xi(model):
    state = affine(model)
    for u, across, shape in (
        (0.5, (0.0, 0.0), ()),
        ("end", XI, (3,)),
        ([0.5], [0.0, 0.0], (1,)),
        (np.full((2, 5), 0.5), XI.reshape(1, 3, 2), (2, 5, 1, 3)),
    ):
        assert state.at(1, u, across).shape == (*shape, 3)
        assert state.position(1, u, across).shape == (*shape, 3)
        assert state.stress(1, u, across).shape == (*shape, 3, 3)
        assert np.shape(state.stress(1, u, across, kind="von Mises")) == shape
        assert state.deformation_gradient(1, u, across).shape == (*shape, 3, 3)


def test_centre_is_where_nothing_is_said_and_ends_have_names(model):
    state = affine(model)
    for name, u in (("start", 0.0), ("end", 4.0)):
        assert np.array_equal(state.at(0, name), state.at(0, u, (0.0, 0.0)))
    u = np.linspace(0.0, 4.0, 9)
    assert state.centre_line(0, 9) == pytest.approx(state.position(0, u))
    rest, _ = model.bodies[0].space.rod.grid([[0.0, 0.0]], u)
    assert state.centre_line(0, 9, scale=0.0) == pytest.approx(rest[:, 0])


def test_a_body_is_named_by_what_it_is_made_of(model):
    state, body = affine(model), model.bodies[1]
    wanted = state.at(1, 0.3)
    for name in (np.int64(1), body, body.space, body.space.rod):
        assert np.array_equal(state.at(name, 0.3), wanted)


BAD = {
    "number": (lambda state: state.at(2, 0.0), "body: got 2, need a number from 0 to 1, or a Rod of the model"),
    "negative": (lambda state: state.at(-1, 0.0), "body: got -1, need a number from 0 to 1"),
    "word": (lambda state: state.centre_line("wire"), "body: got 'wire', need a number from 0 to 1"),
    "flag": (lambda state: state.at(True, 0.0), "body: got True, need a number"),
    "stranger": (lambda state: state.at(straight(), 0.0), "body: this Rod is that of none of the model's 2 bodies"),
    "far": (lambda state: state.at(1, 2.0), "axis parameter u: got 2, need numbers from 0 to 1, or 'start' or 'end'"),
    "NaN": (lambda state: state.at(1, float("nan")), "axis parameter u: got nan, need numbers from 0 to 1"),
    "end": (lambda state: state.at(1, "ends"), "axis parameter u: got 'ends', need"),
    "nothing": (lambda state: state.at(1, None), "axis parameter u: got nan, need"),
    "many": (lambda state: state.at(1, [0.0, 3.0]), "axis parameter u: got 3, need"),
    "none": (lambda state: state.at(1, []), "axis parameter u: got none, need"),
    "ragged": (lambda state: state.at(1, [[0.0], [0.0, 1.0]]), "axis parameter u: got list, need"),
    "outside": (lambda state: state.at(1, 0.0, (2.0, 0.0)), r"point \(2, 0\) is not in the unit disk"),
    "disk": (lambda state: state.stress(1, 0.0, (0.0, 0.0, 0.0)), "disk points xi: need two numbers, or an array"),
    "disk word": (lambda state: state.at(1, 0.0, "centre"), "disk points xi: need two numbers"),
    "kind": (lambda state: state.stress(1, 0.0, kind="Tresca"), "stress: got kind 'Tresca', need one of 'cauchy', "),
    "count": (lambda state: state.centre_line(1, 1), "centre line: points: got 1, need an integer from 2"),
    "scale": (lambda state: state.position(1, 0.0, scale=np.inf), "scale: got inf, need a finite number"),
    "scale word": (lambda state: state.centre_line(1, scale="big"), "scale: got 'big', need a number"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_refused_in_one_line(case, model):
    call, said = BAD[case]
    with pytest.raises(InputError, match=f"^{said}") as refusal:
        call(affine(model))
    assert "\n" not in str(refusal.value)


def test_a_rod_of_two_bodies_is_named_by_number():
    space = Space(straight())
    state = affine(Model([Body(space, LAW), Body(space, LAW)]))
    with pytest.raises(InputError, match=r"body: this Rod is that of bodies \[0, 1\]; give the number of one"):
        state.at(space.rod, 0.0)
    assert state.at(1, 0.0).shape == (3,)


def cantilever(law=LAW, **keywords):
    space = Space(straight(6, radius=0.2, height=3.0), elements=8, degree=4, section_degree=3)
    return Model([Body(space, law, **keywords)], [Support.end(space, "start")], loads=[SectionLoad((1e-4, 0.0, 0.0))])


def test_tip_displacement_of_a_cantilever_in_one_expression():
    """Beam theory, ``F L^3 / 3 E I`` and a little shear."""
    solution = statics.solve(cantilever(LinearElastic(2.0, 0.3)))
    exact = 1e-4 * 27.0 / (3.0 * 2.0 * 0.25 * np.pi * 0.2**4)
    assert solution.at(0, "end")[0] == pytest.approx(exact, rel=5e-3)
    assert np.array_equal(solution.at(0, "start"), np.zeros(3))


def test_modes_answer_one_by_one():
    model = cantilever(density=1.0)
    modes = modal.solve(model, 3, at_rest=True)
    assert len(modes) == 3
    assert [mode.number for mode in modes] == [0, 1, 2]
    for k, mode in enumerate(modes):
        body = model.bodies[0].space
        wanted, _ = body.displacement(modes.vectors[k].reshape(-1, 3), XI, [0.7])
        assert np.array_equal(mode.at(0, 0.7, XI), wanted[0])
        assert mode.frequency == modes.frequencies[k]
    assert modes[-1].number == 2
    assert repr(modes[1]).startswith("Mode 1 of Model(")
    assert modes[0].position(0, "end") - modes[0].at(0, "end") == pytest.approx([0.0, 0.0, 3.0], abs=1e-12)
    for number in (3, -4, 1.5, "first", slice(2)):
        with pytest.raises(InputError, match=r"^mode: got .*, need an integer from -3 to 2"):
            modes[number]


def test_modes_about_a_state_are_about_its_places():
    model = cantilever(density=1.0)
    solution = statics.solve(model)
    mode = modal.solve(model, 2, state=solution)[0]
    assert np.abs(solution.at(0, "end")).max() > 0.05
    assert mode.position(0, "end", scale=0.5) == pytest.approx(solution.position(0, "end") + 0.5 * mode.at(0, "end"))
    assert mode.centre_line(0, 5, scale=0.0) == pytest.approx(solution.centre_line(0, 5))


def test_a_motion_answers_output_by_output():
    """Stresses follow the activation of the time: that of a muscle at rest is its own."""
    scene = Biceps(elements=5, order=1, end_time=4e-4, outputs=2)
    model = scene.model()
    settings = scene.settings() | {"ramp": 8e-4}
    history = dynamics.solve(model, **settings)
    assert [instant.time for instant in history] == pytest.approx([0.0, 2e-4, 4e-4])
    assert [instant.factor for instant in history] == pytest.approx([0.0, 0.25, 0.5])
    last, body = history[-1], model.bodies[1]
    assert np.array_equal(last.velocity, history.velocity[2])
    wanted, _ = body.space.displacement(model.nodal(history.displacement[2], 1), XI, [0.5])
    assert np.array_equal(last.at(1, 0.5, XI), wanted[0])
    stress = cauchy(body, model.nodal(history.displacement[2], 1), XI, [0.5], 0.5)
    assert np.array_equal(last.stress(1, 0.5, XI), stress[0])
    assert repr(last).startswith("Instant 0.0004 of Model(")
    with pytest.raises(InputError, match=r"^output: got 3, need an integer from -3 to 2"):
        history[3]


def test_load_factor_is_a_muscle_s_activation():
    space = Space(straight(4))
    model = Model([Body(space, Muscle(1.0, 0.3, sigma_max=5.0, activation=0.5))])
    for factor in (0.0, 0.4, 1.0):
        state = State(model, np.zeros(model.dofs), factor=factor)
        assert state.stress(0, 0.3, kind="von Mises") == pytest.approx(2.5 * factor)


def whole():
    s = statics.solve(Spring(helix="paper", coils=1, section_points=4, elements_per_turn=8).model())
    found = [*s.at(0, "end"), s.stress(0, 1.3, (1, 0), kind="von Mises"), *s.section_forces(0, 1.3).force]
    one, other = PETSc.COMM_WORLD.tompi4py().allgather([float(one) for one in found])
    assert one == other and s.section_forces(0, 1.3).force == pytest.approx(s.reactions[1], abs=1e-3)


@pytest.mark.mpi
def test_every_rank_has_the_whole_answer(on_ranks):
    on_ranks(2, "test_state.whole()")
