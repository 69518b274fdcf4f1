"""Contact forces and their tangent: exact derivatives of one energy, balance, closed forms, and bad input."""

from dataclasses import replace

import numpy as np
import pytest
import test_contact_groups as groups
import test_contact_mesh as mesh
from refused import refused
from touching import LAW, add_forces, among, assert_tangent, crease, forces_at, moved, pair, reference, shaken

from isorod import Body, Contact, Cylinder, InputError, Model, Plane, Space
from isorod.contact.operator import ContactOperator
from isorod.dynamics.explicit import contact as explicit_contact


@pytest.mark.parametrize("scene", [pair, crease, *groups.SCENES, mesh.notched, mesh.edged])
def test_forces_are_minus_the_derivative_of_the_energy(scene):
    model = scene()
    displacement = shaken(model)
    packed, _, forces = forces_at(model, displacement)
    assert (packed.states["pressure"] > 0.0).sum() > 20
    if scene is crease:
        assert packed.states["edge"].sum() >= 3
    rng, step = np.random.default_rng(3), 1e-5
    for _ in range(10 if scene in (pair, crease) else 3):
        v = rng.standard_normal(model.dofs)
        energies = [forces_at(model, displacement + k * step * v)[1][0] for k in (-2, -1, 1, 2)]
        slope = (energies[0] - 8.0 * energies[1] + 8.0 * energies[2] - energies[3]) / (12.0 * step)
        size = abs(slope) if scene in (pair, crease) else np.linalg.norm(forces) * np.linalg.norm(v)
        assert abs(slope + forces.ravel() @ v) < 1e-6 * size


@pytest.mark.parametrize("scene", [pair, crease, *groups.SCENES])
@pytest.mark.parametrize("augmented", [False, True], ids=["penalty", "multipliers"])
def test_tangent_is_the_derivative_of_the_forces_and_symmetric(scene, augmented):
    model = scene()
    displacement = shaken(model)
    operator = ContactOperator(model)
    few = scene in groups.SCENES
    if augmented:
        # Pressures that the gaps do not explain: curvature counts for more.
        operator.forces(displacement)
        touching = operator.packed.states["pressure"] > 0.0
        most = 2.0 if few else 20.0
        operator.packed.multipliers[touching] = np.random.default_rng(4).uniform(0.05 * most, most, touching.sum())
    assert_tangent(operator, displacement, *((1e-7, 3, 1e-5) if few else (1e-6, 10, 1e-6)))


def test_second_derivatives_of_a_pressed_out_gap_are_not_left_out():
    """Without curvature the tangent of pressures that dwarf the penalty would be wrong altogether."""
    both = pair()
    model = replace(both, contacts=[replace(both.contacts[0], penalty=1e-3)])
    operator, displacement = ContactOperator(model), shaken(both)
    operator.forces(displacement)
    operator.packed.multipliers[operator.packed.states["pressure"] > 0.0] = 10.0
    values = operator.tangent(displacement).copy()
    operator.packed.passes["penalty"] *= 2.0
    doubled = operator.tangent(displacement)
    # Twice the penalty adds next to nothing: what is there is curvature.
    assert np.abs(doubled - values).max() < 1e-2 * np.abs(values).max()


@pytest.mark.parametrize("scene", [pair, crease])
def test_action_equals_reaction_and_moments_balance(scene):
    model = scene()
    model = replace(model, contacts=model.contacts[:1])
    displacement = shaken(model)
    _, outcome, forces = forces_at(model, displacement)
    # Each body's k = 0 forces: those of the others are zero.
    assert not forces[~model.is_control_point].any()
    x = reference(model) + displacement.reshape(-1, 3)
    scale = np.abs(forces).sum()
    assert outcome[1] > 0.1
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-12 * scale * np.abs(x).max()
    first = forces[: model.first_node[1]].sum(axis=0)
    assert np.linalg.norm(first) > 0.1 * outcome[1]


def test_rigid_motion_turns_the_forces_with_it():
    both = pair()
    turn = np.linalg.qr(np.random.default_rng(6).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    model = replace(both, contacts=both.contacts[:1])
    x = reference(model) + shaken(model).reshape(-1, 3)
    packed, outcome, forces = forces_at(model, shaken(model))
    turned = np.zeros_like(forces)
    there = add_forces(packed, x @ turn.T + model.is_control_point[:, None] * np.array([1.0, -2.0, 3.0]), turned)
    np.testing.assert_allclose(there, outcome, rtol=1e-11)
    np.testing.assert_allclose(turned, forces @ turn.T, atol=1e-11 * np.abs(forces).max())


def test_rod_on_a_plane_has_the_closed_form(cylinder):
    """Pressure eps (R cos phi - R + depth) over the arc below the plane."""
    radius, depth, length, penalty = 1.5, 0.2, 4.0, 7.0
    space = Space.paper(cylinder(8, radius=radius, height=length))
    plane = Plane((0.0, depth - radius, 1.0), (0.0, 3.0, 0.0))
    model = among([space], Contact(0, plane, penalty, points=(64, 2)))
    packed, (energy, force, area, deepest), forces = forces_at(model, np.zeros(model.dofs))
    edge = np.arccos(1.0 - depth / radius)
    low = radius - depth
    np.testing.assert_allclose(packed.states["gap"], packed.points[:, 1] + low, atol=1e-14)
    assert force == pytest.approx(penalty * length * 2.0 * radius * (radius * np.sin(edge) - low * edge), rel=1e-4)
    square = radius**2 * (edge + np.sin(edge) * np.cos(edge)) - 4.0 * radius * low * np.sin(edge) + 2.0 * low**2 * edge
    assert energy == pytest.approx(0.5 * penalty * length * radius * square, rel=1e-4)
    assert area == pytest.approx(2.0 * edge * radius * length, rel=1e-2)
    assert -depth <= deepest < -0.999 * depth
    assert forces[:, 1].sum() == pytest.approx(force, rel=1e-12)


def test_rod_against_a_cylinder_has_the_closed_form(cylinder):
    """Parallel axes a distance apart: the gap of each point is known, and so is the force between two circles."""
    radius, obstacle, distance, penalty, length = 1.0, 2.5, 3.3, 7.0, 2.0
    space = Space.paper(cylinder(8, radius=radius, height=length))
    second = Cylinder((distance, 0.0, 5.0), (0.0, 0.0, -2.0), obstacle)
    model = among([space], Contact(0, second, penalty, points=(64, 2)))
    packed, (energy, force, *_), forces = forces_at(model, np.zeros(model.dofs))
    gaps = np.hypot(packed.points[:, 0] - distance, packed.points[:, 1]) - obstacle
    np.testing.assert_allclose(packed.states["gap"], gaps, atol=1e-14)
    theta = np.linspace(-np.pi, np.pi, 2_000_001)[:-1]
    depth = obstacle - np.hypot(distance - radius * np.cos(theta), radius * np.sin(theta))
    touching = np.maximum(depth, 0.0)
    scale = radius * length * 2.0 * np.pi
    assert energy == pytest.approx(0.5 * penalty * scale * np.mean(touching**2), rel=1e-4)
    assert force == pytest.approx(penalty * scale * touching.mean(), rel=1e-3)
    assert forces[:, 0].sum() < -0.5 * force


def test_two_cylinders_have_the_closed_form(cylinder):
    """Both circles are slaves in turn with half the weight."""
    distance, penalty, length = 1.9, 7.0, 2.0
    spaces = [
        Space.paper(cylinder(8, height=length)),
        Space.paper(moved(cylinder(8, radius=1.2, height=length), (distance + 0.2, 0.0, 0.0))),
    ]
    model = among(spaces, Contact(0, 1, penalty, points=(32, 2)))
    _, (_, force, _, deepest), _ = forces_at(model, np.zeros(model.dofs))
    theta = np.linspace(-np.pi, np.pi, 2_000_001)[:-1]
    expected = 0.0
    for own, other in ((1.0, 1.2), (1.2, 1.0)):
        depth = other - np.hypot(distance + 0.2 - own * np.cos(theta), own * np.sin(theta))
        expected += 0.5 * penalty * own * length * 2.0 * np.pi * np.maximum(depth, 0.0).mean()
    assert force == pytest.approx(expected, rel=1e-3)
    assert deepest == pytest.approx(-0.1, rel=1e-2)


def test_points_off_the_named_elements_are_not_in_contact(cylinder):
    """Two rods side by side overlap all along; only the middle elements of one are named."""
    rod = cylinder(8, breaks=(0.0, 1.0, 2.0, 3.0, 4.0), height=4.0)
    spaces = [Space.paper(rod), Space.paper(moved(rod, (1.9, 0.0, 0.0)))]
    named = Contact(0, 1, 1.0, first_elements=[1, 2], points=(3, 3))
    model = among(spaces, named)
    packed, (_, force, area, _), forces = forces_at(model, np.zeros(model.dofs))
    touching = packed.states["pressure"] > 0.0
    z = packed.points[touching, 2]
    assert z.min() > 1.0 and z.max() < 3.0
    whole = forces_at(replace(model, contacts=[replace(named, first_elements=None)]), np.zeros(model.dofs))[1]
    assert force == pytest.approx(0.5 * whole[1], rel=1e-12)
    assert area == pytest.approx(0.5 * whole[2], rel=1e-12)
    # Layer 0 of the first rod lives on element 0 alone.
    assert not forces[:8].any()


def with_contact(contact):
    return replace(pair(), contacts=[contact])


def in_steps(contact):
    model = with_contact(contact)
    return explicit_contact.pack(model, np.arange(model.dofs))


test_bad_numbers_get_one_line = refused(
    (lambda: Contact(0, 1, 0.0), "penalty"),
    (lambda: Contact(0, 1, float("nan")), "penalty"),
    (lambda: Contact(1, 1, 1.0), "itself"),
    (lambda: Contact(0, 1, 1.0, points=(0, 3)), "points round an arc"),
    (lambda: Contact(0, 1, 1.0, points=(3,)), r"got \(3,\), need 2 integers"),
    (lambda: Contact(0, 1, 1.0, penetration=-1.0), "penetration"),
    (lambda: Contact(0, 1, 1.0, penetration=0.0), "penetration"),
    (lambda: Contact(0, Plane((0, 0, 0), (0, 0, 1)), 1.0, second_elements=[0]), "rigid"),
    (lambda: Plane((0, 0, 0), (0, 0, 0)), "direction"),
    (lambda: Plane((0, 0, float("inf")), (0, 0, 1)), "finite"),
    (lambda: Plane((0, 0), (0, 0, 1)), r"point: got \(0, 0\), need 3 numbers"),
    (lambda: Cylinder((0, 0, 0), (0, 0, 0), 1.0), "direction"),
    (lambda: Cylinder((0, 0, 0), (0, 0, 1), -1.0), "radius"),
    (lambda: Contact(0, 1, 1.0, first_elements=[0.5]), r"first_elements: got \[0.5\], need a list of integers"),
    (lambda: with_contact(Contact(0, 2, 1.0)), "contact 0: body 2 is not one of the 2 bodies"),
    (lambda: with_contact(Contact(-1, 0, 1.0)), "contact 0: body -1 is not"),
    (lambda: with_contact(Contact(0, 1, 1.0, first_elements=[0, 3])), "element 3 is not in body 0, which has 3"),
    (lambda: with_contact(Contact(0, 1, 1.0, second_elements=[-1])), "contact 0: element -1 is not in body 1"),
    (lambda: with_contact(Contact(0, 1, 1.0, first_elements=[])), "no elements of body 0"),
    (
        lambda: in_steps(Contact(0, 1, 100.0, penetration=1e-3)),
        "contact 0: a largest penetration .* is for statics alone",
    ),
)


def test_rods_too_slender_for_double_precision_are_not_in_contact(cylinder):
    plane = Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), 1.0)
    slender, more = (Body(Space.paper(cylinder(8, radius=0.5, height=height)), LAW) for height in (4.9e4, 6e4))
    Model([slender], contacts=[plane])
    with pytest.raises(InputError, match=r"contact 0: body 0 is 1.* radii long, rods in contact may be 100000"):
        Model([more], contacts=[plane])
