"""Contact of sections without control points, and of inner surfaces: one energy, balance, closed forms."""

import numpy as np
import pytest
from conftest import straight
from petsc4py import PETSc
from refused import refused
from surfaces import SCENES, inside, mandrel, rubbing, shaken, tube
from touching import assert_tangent, reference, stiffness

from isorod import Body, Contact, NeoHookean, Plane, Space
from isorod.contact.frozen import Frozen
from isorod.contact.operator import ContactOperator
from isorod.contact.traces import section_functions, trace
from isorod.model import Model


@pytest.mark.parametrize("scene", SCENES)
def test_forces_are_minus_the_derivative_of_the_energy(scene):
    model = scene()
    displacement, operator = shaken(model), ContactOperator(model)
    forces, _ = operator.forces(displacement)
    assert operator.touching > 5
    rng, step = np.random.default_rng(3), 1e-5
    for _ in range(3):
        v = rng.standard_normal(model.dofs)
        energies = [operator.forces(displacement + k * step * v)[1] for k in (-2, -1, 1, 2)]
        slope = (energies[0] - 8.0 * energies[1] + 8.0 * energies[2] - energies[3]) / (12.0 * step)
        assert abs(slope + forces @ v) < 1e-6 * np.linalg.norm(forces) * np.linalg.norm(v)


@pytest.mark.parametrize("scene", SCENES)
def test_tangent_is_the_derivative_of_the_forces_and_symmetric(scene):
    model = scene()
    assert_tangent(ContactOperator(model), shaken(model), 1e-7, 3, 1e-5)


@pytest.mark.parametrize("friction", [100.0, 0.005], ids=["stick", "slip"])
@pytest.mark.parametrize("scene", SCENES)
def test_tangent_with_friction_is_the_derivative_of_the_forces(scene, friction):
    model = rubbing(scene(), friction)
    operator, displacement = ContactOperator(model), shaken(model)
    operator.accept(displacement)
    displacement = displacement + 0.3 * np.roll(displacement, 7)
    K = stiffness(operator, displacement)
    assert abs(K - K.T).max() > 1e-3 * abs(K).max()
    assert_tangent(operator, displacement, 1e-8, 3, 1e-5, symmetric=False)


@pytest.mark.parametrize("scene", SCENES)
def test_forces_and_moments_are_in_balance(scene):
    """Between bodies they add up to nothing; from an obstacle to what it presses with."""
    model = rubbing(scene(), 0.2)
    operator, displacement = ContactOperator(model), shaken(model)
    operator.accept(displacement)
    displacement = displacement + 0.3 * np.roll(displacement, 7)
    forces = operator.forces(displacement)[0].reshape(-1, 3)
    results = operator.results(displacement)
    expected = sum((one.resultant + one.friction for one in results), np.zeros(3)) if scene is mandrel else np.zeros(3)
    if scene.__name__ == "polynomials":
        expected = results[1].resultant + results[1].friction
    size = sum(one.force for one in results)
    # They touch; how hard depends on the signs of the section's functions, which are LAPACK's.
    assert size > 0.01
    assert forces[model.is_control_point].sum(axis=0) == pytest.approx(expected, abs=1e-12 * size)
    if len(model.contacts) == 1 and scene is not mandrel:
        places = reference(model) + displacement.reshape(-1, 3)
        # Reactions act at the projections, off the points by the gap: without friction moments are in balance.
        plain = ContactOperator(scene())
        pushed = plain.forces(displacement)[0].reshape(-1, 3)
        assert np.cross(places, pushed).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-11 * size)


def test_the_forces_turn_with_the_bodies():
    model = inside()
    operator, displacement = ContactOperator(model), shaken(model)
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    at = reference(model) + displacement.reshape(-1, 3)
    carriers = model.is_control_point[:, None]
    rotated = at @ turn.T + carriers * np.array([3.0, -1.0, 2.0])
    forces = operator.forces(displacement)[0].reshape(-1, 3)
    other = operator.forces((rotated - reference(model)).ravel())[0].reshape(-1, 3)
    assert other == pytest.approx(forces @ turn.T, abs=1e-10 * np.abs(forces).max())


@pytest.mark.parametrize("scene", SCENES)
def test_contact_about_an_equilibrium_is_on_the_same_surfaces(scene):
    """Forces and their change, but for what traces miss and for curvature of gaps."""
    model = scene()
    operator, displacement = ContactOperator(model), shaken(model, 1e-3)
    forces = operator.forces(displacement)[0]
    frozen = Frozen(model, model.contacts, operator.results(displacement), displacement, PETSc.COMM_SELF)
    assert np.abs(frozen.forces(displacement)[0] - forces).max() < 1e-2 * np.abs(forces).max()
    operator.tangent(displacement)
    v = np.random.default_rng(2).standard_normal(model.dofs)
    expected = operator.product(v)
    found = frozen.forces(displacement)[0] - frozen.forces(displacement + v)[0]
    assert np.linalg.norm(found - expected) < 0.05 * np.linalg.norm(expected)


@pytest.mark.parametrize("inner", [False, True])
@pytest.mark.parametrize("degree", [2, 5, 8])
def test_traces_are_those_of_the_space(degree, inner):
    """What they miss falls as control points do; constants and coordinates of a round section are exact."""
    space = tube(degree)
    own = trace(space, inner)
    functions, angle, _ = section_functions(own, 4)
    n = len(own.arcs)
    assert own.lift.shape == (n, space.layer_nodes)
    assert own.dimension in (2 * degree + 1, 2 * degree + 3)
    nodes = (np.repeat(np.arange(n), 4)[:, None] + np.arange(-1, 2)) % n
    found = np.einsum("qc,qci->qi", functions, own.lift[nodes])
    exact = space.basis.functions(own.circle(angle))[0]
    assert np.abs(found - exact).max() < 5e-3 * np.abs(exact).max()
    assert found[:, :3] == pytest.approx(exact[:, :3], abs=1e-10)


@pytest.mark.parametrize("gap", [0.01, 0.05, 0.2])
def test_a_point_in_a_hole_sees_the_wall_at_its_distance(gap):
    """A straight rod beside the axis of a tube: its gap is the clearance less the shift, to the side it is shifted."""
    rod, hole = straight(8, breaks=(0.0, 1.0), radius=0.4 - gap, height=2.0), 0.4
    shift = np.array([0.6, -0.8, 0.0]) * 0.005
    rod = type(rod)(rod.axis, rod.control_points + shift + [0.0, 0.0, 2.0])
    spaces = [tube(hole=hole), Space.paper(rod, section_degree=3)]
    law = NeoHookean(1.0, 0.3)
    contact = Contact(1, 0, 10.0, points=(4, 3), second_surface="inner")
    operator = ContactOperator(Model([Body(space, law) for space in spaces], contacts=[contact]))
    # A multiplier lets what does not touch be seen.
    operator.packed.multipliers[:] = 5.0
    operator.forces(np.zeros(operator.model.dofs))
    result = operator.results(np.zeros(operator.model.dofs))[0]
    mine = (result.body == 1) & (result.pressure > 0.0)
    angle = result.parameters[mine, 1]
    place = shift[:2] + (0.4 - gap) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    expected = hole - np.linalg.norm(place, axis=1)
    gaps = (5.0 - result.pressure[mine]) / 10.0
    assert mine.sum() == np.count_nonzero(result.body == 1)
    assert gaps == pytest.approx(expected, abs=1e-10)
    # The wall is met where the point is, whichever way its angles are counted.
    assert result.projections[mine, 1] % (2.0 * np.pi) == pytest.approx(
        np.arctan2(place[:, 1], place[:, 0]) % (2.0 * np.pi), abs=1e-8
    )


FLOOR = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))


def on_floor(space, *arguments, **named):
    return Model([Body(space, NeoHookean(1.0, 0.3))], contacts=[Contact(0, *arguments, **named)])


test_bad_input = refused(
    (lambda: Contact(0, 1, first_surface="upper"), "got first_surface 'upper', need 'outer' or 'inner'"),
    (lambda: Contact(0, 1, first_surface="inner", second_surface="inner"), "two inner surfaces never touch"),
    (lambda: Contact(0, first_surface="inner"), "first_surface is 'inner', which touches what is in its hole"),
    (lambda: Contact(0, FLOOR, second_surface="inner"), "second_surface is given, but the second partner is rigid"),
    (
        lambda: on_floor(Space.paper(straight(8), section_degree=2), FLOOR, first_surface="inner"),
        "contact 0: body 0 has no hole, but its inner surface is named",
    ),
)
