"""Contact forces and their tangent: exact derivatives of one energy, exact projections, balance, and bad input."""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_matrix

from isorod.contact.force_kernel import add_forces
from isorod.contact.operator import ContactOperator
from isorod.contact.surface_kernel import EDGE, END, FREE, closest, surface_gap
from isorod.contact.tables import pack
from isorod.errors import InputError
from isorod.geometry.axis import Axis
from isorod.geometry.center_line import helix
from isorod.geometry.rod import Rod
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Cylinder, Model, Plane
from isorod.space import Space

LAW = NeoHookean(1.0, 0.3)
RADIUS = 0.8  # of the ring's wire
RING = 4.0  # of the ring


def moved(rod, shift, turn=None):
    return Rod(
        rod.axis,
        rod.control_points @ (np.eye(3) if turn is None else turn.T) + np.asarray(shift, dtype=float),
        rod.closed,
    )


def ring(shift=(0.0, 0.0, 0.0)):
    line = helix(RING, 0.0, 1, 4)
    rod = line.sweep(circle(8, RADIUS), closed=True)
    return moved(rod, shift)


def bent(angle=0.6):
    """Two straight pieces that meet at a kink in u = 1: a degree-1 axis in the y-z plane."""
    centers = np.array(
        [[0.0, 2.0 * np.sin(angle), -2.0 * np.cos(angle)], [0, 0, 0], [0, 2.0 * np.sin(angle), 2.0 * np.cos(angle)]]
    )
    return Rod.sweep(circle(8), Axis(1, np.array([0.0, 0, 1, 2, 2]), np.ones(3)), centers)


ACROSS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # z to x


@pytest.fixture
def pair(cylinder):
    """A straight rod along z, section refined and of order 2, and a ring that cuts into it, both with obstacles."""
    rod = cylinder(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    first = Space(rod, section_points=16, order=2)
    second = Space(ring((-RING - 1.6, 0.0, 3.1)), elements=8, degree=3)
    contacts = [
        Contact(0, 1, 100.0, points=(3, 4)),
        Contact(0, Plane((0.0, 0.95, 0.0), (0.0, -2.0, 0.0)), 50.0),
        Contact(1, Cylinder((-9.0, 0.0, 3.0), (0.0, 1.0, 0.0), 0.5), 70.0),
    ]
    return Model([Body(first, LAW), Body(second, LAW)], contacts=contacts)


@pytest.fixture
def crease(cylinder):
    """A thin rod that lies in the hollow of a bent one and touches it along the kink."""
    # An arc, and a point, in the middle below.
    rod = cylinder(4, radius=0.4, height=2.0)
    thin = moved(rod, (-1.0, 1.3, 0.0), ACROSS)
    return Model([Body(Space(thin), LAW), Body(Space(bent()), LAW)], contacts=[Contact(0, 1, 10.0, points=(5, 12))])


def reference(model):
    return np.concatenate([body.space.positions for body in model.bodies])


def shaken(model, size=0.02):
    """Return random displacements ``(dofs,)`` of a model."""
    return size * np.random.default_rng(0).standard_normal(model.dofs)


def forces_at(model, displacement):
    packed = pack(model)
    forces = np.zeros_like(reference(model))
    outcome = add_forces(packed, reference(model) + displacement.reshape(-1, 3), forces)
    return packed, outcome, forces


def project(packed, surface, x, start, positions):
    """Return outcome, gap, foot and where it is (row, theta, s)."""
    phi, axial, y, d, normal = np.empty((3, 3)), np.empty((3, 7)), np.empty((6, 3)), np.empty(3), np.empty(3)
    where = np.array(start, dtype=float)
    outcome, _ = closest(packed, surface, x, where, positions, phi, axial, y, d)
    gap = surface_gap(y, d, outcome == EDGE, normal)
    assert abs(d @ y[1]) < 1e-11
    return outcome, gap, y[0].copy(), where


def test_projection_on_a_torus_is_exact_from_any_start(pair):
    packed, positions = pack(pair), reference(pair)
    rng = np.random.default_rng(1)
    center = np.array([-RING - 1.6, 0.0, 3.1])
    first, rows = packed.surfaces[1, 2:4]
    for _ in range(200):
        around, phi, depth = *rng.uniform(-np.pi, np.pi, 2), rng.uniform(-0.5, 0.6)
        out = RING + (RADIUS + depth) * np.cos(phi)
        x = center + np.array([out * np.cos(around), out * np.sin(around), (RADIUS + depth) * np.sin(phi)])
        # A start one element away along the axis and an eighth of a turn round the section.
        row = int(around % (2.0 * np.pi) / (2.0 * np.pi) * rows)
        start = [first + (row + rng.integers(-1, 2)) % rows, -phi + rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 1.0)]
        outcome, gap, foot, _ = project(packed, 1, x, start, positions)
        assert outcome == FREE
        assert abs(gap - depth) < 1e-12
        np.testing.assert_allclose(
            x - foot,
            depth / (RADIUS + depth) * (x - center - RING * np.array([np.cos(around), np.sin(around), 0.0])),
            atol=1e-10,
        )


def test_projection_on_a_cylinder_and_beyond_its_ends(pair):
    packed, positions = pack(pair), reference(pair)
    rng = np.random.default_rng(2)
    for _ in range(200):
        height, phi, depth = rng.uniform(-1.0, 7.0), rng.uniform(-np.pi, np.pi), rng.uniform(-0.6, 1.0)
        x = np.array([(1.0 + depth) * np.cos(phi), (1.0 + depth) * np.sin(phi), height])
        start = [rng.integers(0, 3), phi + rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)]
        outcome, gap, foot, where = project(packed, 0, x, start, positions)
        assert outcome == (FREE if 0.0 <= height <= 6.0 else END)
        np.testing.assert_allclose(foot, [np.cos(phi), np.sin(phi), np.clip(height, 0.0, 6.0)], atol=1e-11)
        if outcome == FREE:
            assert abs(gap - depth) < 1e-12
            assert abs(packed.spans[int(where[0])] @ [1.0, where[2]] - 0.5 * height) < 1e-11


@pytest.mark.parametrize("scene", ["pair", "crease"])
def test_forces_are_minus_the_derivative_of_the_energy(scene, request):
    model = request.getfixturevalue(scene)
    displacement = shaken(model)
    packed, _, forces = forces_at(model, displacement)
    assert (packed.states[:, 1] > 0.0).sum() > 20
    if scene == "crease":
        assert (packed.states[:, 2] == 1.0).sum() >= 3
    rng, step = np.random.default_rng(3), 1e-5
    for _ in range(10):
        v = rng.standard_normal(model.dofs)
        energies = [forces_at(model, displacement + k * step * v)[1][0] for k in (-2, -1, 1, 2)]
        slope = (energies[0] - 8.0 * energies[1] + 8.0 * energies[2] - energies[3]) / (12.0 * step)
        assert abs(slope + forces.ravel() @ v) < 1e-6 * abs(slope)


@pytest.mark.parametrize("scene", ["pair", "crease"])
@pytest.mark.parametrize("augmented", [False, True], ids=["penalty", "multipliers"])
def test_tangent_is_the_derivative_of_the_forces_and_symmetric(scene, augmented, request):
    model = request.getfixturevalue(scene)
    displacement = shaken(model)
    operator = ContactOperator(model)
    if augmented:
        # Pressures that the gaps do not explain: curvature counts for more.
        operator.forces(displacement)
        touching = operator.packed.states[:, 1] > 0.0
        operator.packed.multipliers[touching] = np.random.default_rng(4).uniform(1.0, 20.0, touching.sum())
    values = operator.tangent(displacement)
    K = coo_matrix((values, (operator.rows, operator.columns)), shape=(model.dofs, model.dofs)).tocsr()
    assert abs(K - K.T).max() < 1e-13 * abs(K).max()
    rng, step = np.random.default_rng(5), 1e-6
    for _ in range(10):
        v = rng.standard_normal(model.dofs)
        change = (operator.forces(displacement - step * v)[0] - operator.forces(displacement + step * v)[0]) / (
            2.0 * step
        )
        assert np.abs(K @ v).max() > 0.1
        assert np.abs(K @ v - change).max() < 1e-6 * np.abs(change).max()
        np.testing.assert_allclose(operator.product(v), K @ v, atol=1e-12 * np.abs(change).max())


def test_second_derivatives_of_a_pressed_out_gap_are_not_left_out(pair):
    """Without curvature the tangent of pressures that dwarf the penalty would be wrong altogether."""
    model = replace(pair, contacts=[replace(pair.contacts[0], penalty=1e-3)])
    operator, displacement = ContactOperator(model), shaken(pair)
    operator.forces(displacement)
    operator.packed.multipliers[operator.packed.states[:, 1] > 0.0] = 10.0
    values = operator.tangent(displacement).copy()
    operator.packed.penalty[:] *= 2.0
    doubled = operator.tangent(displacement)
    # Twice the penalty adds next to nothing: what is there is curvature.
    assert np.abs(doubled - values).max() < 1e-2 * np.abs(values).max()


@pytest.mark.parametrize("scene", ["pair", "crease"])
def test_action_equals_reaction_and_moments_balance(scene, request):
    model = request.getfixturevalue(scene)
    model = replace(model, contacts=model.contacts[:1])
    displacement = shaken(model)
    _, outcome, forces = forces_at(model, displacement)
    # Each body's k = 0 forces: those of the others are zero.
    assert not forces[~model.carries].any()
    x = reference(model) + displacement.reshape(-1, 3)
    scale = np.abs(forces).sum()
    assert outcome[1] > 0.1
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 * scale
    assert np.abs(np.cross(x, forces).sum(axis=0)).max() < 1e-12 * scale * np.abs(x).max()
    first = forces[: model.first_node[1]].sum(axis=0)
    assert np.linalg.norm(first) > 0.1 * outcome[1]


def test_neither_body_is_preferred(pair):
    """Bodies swapped, forces stay: each is slave with half the weight."""
    contact = pair.contacts[0]
    one = replace(pair, contacts=[contact])
    other = replace(pair, contacts=[replace(contact, first=1, second=0)])
    displacement = shaken(pair)
    _, outcome, forces = forces_at(one, displacement)
    _, swapped_outcome, swapped = forces_at(other, displacement)
    np.testing.assert_allclose(swapped, forces, atol=1e-13 * np.abs(forces).max())
    np.testing.assert_allclose(swapped_outcome, outcome, rtol=1e-13)


def test_rigid_motion_turns_the_forces_with_it(pair):
    turn = np.linalg.qr(np.random.default_rng(6).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    model = replace(pair, contacts=pair.contacts[:1])
    x = reference(model) + shaken(model).reshape(-1, 3)
    packed, outcome, forces = forces_at(model, shaken(model))
    turned = np.zeros_like(forces)
    there = add_forces(packed, x @ turn.T + model.carries[:, None] * np.array([1.0, -2.0, 3.0]), turned)
    np.testing.assert_allclose(there, outcome, rtol=1e-11)
    np.testing.assert_allclose(turned, forces @ turn.T, atol=1e-11 * np.abs(forces).max())


def test_start_values_change_nothing_but_time(pair):
    x = reference(pair) + shaken(pair).reshape(-1, 3)
    packed, outcome, fresh = forces_at(pair, shaken(pair))
    starts = packed.starts.copy()
    assert (starts[:, 0] >= 0.0).sum() >= 20
    warm = np.zeros_like(fresh)
    again = add_forces(packed, x, warm)
    np.testing.assert_allclose(again, outcome, rtol=1e-12)
    np.testing.assert_allclose(warm, fresh, atol=1e-12 * np.abs(fresh).max())
    packed.starts[:] = starts
    repeated = np.zeros_like(fresh)
    assert add_forces(packed, x, repeated) == again
    assert np.array_equal(repeated, warm)


def test_a_sequence_of_steps_gives_what_fresh_searches_give(cylinder):
    """A rod comes from afar, presses on another and leaves on its other side.

    Searches are skipped only where nothing touches.
    """
    rod = cylinder(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    thin = moved(cylinder(6, radius=0.5, height=4.0), (-2.0, 0.0, 0.0), ACROSS)
    model = Model([Body(Space(rod), LAW), Body(Space(thin), LAW)], contacts=[Contact(0, 1, 10.0, points=(3, 3))])
    base, packed = reference(model), pack(model)
    mobile = np.arange(base.shape[0]) >= model.first_node[1]
    searches = np.zeros(2, dtype=int)
    touched = 0
    for t in np.linspace(0.0, 2.0 * np.pi, 500):
        x, kept, fresh = base.copy(), np.zeros_like(base), np.zeros_like(base)
        x[mobile] += [0.0, 2.2 + 0.8 * np.cos(t), 3.0 + 2.0 * np.sin(t)]
        outcome = add_forces(packed, x, kept)
        searches[0] += np.isfinite(packed.states[:, 0]).sum()
        new = pack(model)
        np.testing.assert_allclose(outcome, add_forces(new, x, fresh), rtol=1e-10, atol=1e-13)
        searches[1] += np.isfinite(new.states[:, 0]).sum()
        np.testing.assert_allclose(kept, fresh, atol=1e-10 * (1.0 + np.abs(fresh).max()))
        touched += outcome[1] > 0.0
    assert 20 < touched < 480
    assert searches[0] < 0.5 * searches[1]


def test_work_along_a_path_is_the_change_of_energy(cylinder):
    """A rod slides across arcs and elements of another: nothing is lost, nothing jumps."""
    rod = cylinder(8, breaks=(0.0, 1.0, 2.0, 3.0), height=6.0)
    thin = moved(cylinder(6, radius=0.5, height=4.0), (-2.0, 1.4, 0.0), ACROSS)
    model = Model([Body(Space(rod), LAW), Body(Space(thin), LAW)], contacts=[Contact(0, 1, 10.0, points=(4, 8))])
    base, packed = reference(model), pack(model)
    mobile = np.arange(base.shape[0]) >= model.first_node[1]

    def at(t):
        x, forces = base.copy(), np.zeros_like(base)
        x[mobile] += [0.6 * np.sin(2.0 * t), -0.1 * t, 1.3 + 2.4 * t]
        outcome = add_forces(packed, x, forces)
        return outcome[0], forces[mobile].sum(axis=0) @ [1.2 * np.cos(2.0 * t), -0.1, 2.4]

    # Gauss points on many pieces: the force is smooth but for points that come and go.
    x, w = np.polynomial.legendre.leggauss(2)
    pieces = np.linspace(0.0, 1.0, 1201)
    work = sum(
        0.5 * (b - a) * v * at(0.5 * (a + b) + 0.5 * (b - a) * t)[1]
        for a, b in pairwise(pieces)
        for t, v in zip(x, w, strict=True)
    )
    gained = at(1.0)[0] - at(0.0)[0]
    assert abs(gained) > 1e-3
    assert abs(work + gained) < 1e-6 * abs(gained)


def test_rod_on_a_plane_has_the_closed_form(cylinder):
    """Pressure eps (R cos phi - R + depth) over the arc below the plane."""
    radius, depth, length, penalty = 1.5, 0.2, 4.0, 7.0
    space = Space(cylinder(8, radius=radius, height=length))
    plane = Plane((0.0, depth - radius, 1.0), (0.0, 3.0, 0.0))
    model = Model([Body(space, LAW)], contacts=[Contact(0, plane, penalty, points=(64, 2))])
    packed, (energy, force, area, deepest), forces = forces_at(model, np.zeros(model.dofs))
    edge = np.arccos(1.0 - depth / radius)
    low = radius - depth
    np.testing.assert_allclose(packed.states[:, 0], packed.places[:, 1] + low, atol=1e-14)
    assert force == pytest.approx(penalty * length * 2.0 * radius * (radius * np.sin(edge) - low * edge), rel=1e-4)
    square = radius**2 * (edge + np.sin(edge) * np.cos(edge)) - 4.0 * radius * low * np.sin(edge) + 2.0 * low**2 * edge
    assert energy == pytest.approx(0.5 * penalty * length * radius * square, rel=1e-4)
    assert area == pytest.approx(2.0 * edge * radius * length, rel=1e-2)
    assert -depth <= deepest < -0.999 * depth
    assert forces[:, 1].sum() == pytest.approx(force, rel=1e-12)


def test_rod_against_a_cylinder_has_the_closed_form(cylinder):
    """Parallel axes a distance apart: the gap of each point is known, and so is the force between two circles."""
    radius, obstacle, distance, penalty, length = 1.0, 2.5, 3.3, 7.0, 2.0
    space = Space(cylinder(8, radius=radius, height=length))
    second = Cylinder((distance, 0.0, 5.0), (0.0, 0.0, -2.0), obstacle)
    model = Model([Body(space, LAW)], contacts=[Contact(0, second, penalty, points=(64, 2))])
    packed, (energy, force, *_), forces = forces_at(model, np.zeros(model.dofs))
    gaps = np.hypot(packed.places[:, 0] - distance, packed.places[:, 1]) - obstacle
    np.testing.assert_allclose(packed.states[:, 0], gaps, atol=1e-14)
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
        Space(cylinder(8, height=length)),
        Space(moved(cylinder(8, radius=1.2, height=length), (distance + 0.2, 0.0, 0.0))),
    ]
    model = Model([Body(space, LAW) for space in spaces], contacts=[Contact(0, 1, penalty, points=(32, 2))])
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
    spaces = [Space(rod), Space(moved(rod, (1.9, 0.0, 0.0)))]
    named = Contact(0, 1, 1.0, first_elements=[1, 2], points=(3, 3))
    model = Model([Body(space, LAW) for space in spaces], contacts=[named])
    packed, (_, force, area, _), forces = forces_at(model, np.zeros(model.dofs))
    touching = packed.states[:, 1] > 0.0
    z = packed.places[touching, 2]
    assert z.min() > 1.0 and z.max() < 3.0
    whole = forces_at(replace(model, contacts=[replace(named, first_elements=None)]), np.zeros(model.dofs))[1]
    assert force == pytest.approx(0.5 * whole[1], rel=1e-12)
    assert area == pytest.approx(0.5 * whole[2], rel=1e-12)
    # Layer 0 of the first rod lives on element 0 alone.
    assert not forces[:8].any()


def test_far_and_separated_bodies_do_nothing(pair):
    for shift in ([50.0, 0.0, 0.0], [-0.3, 0.0, 0.0]):
        displacement = np.zeros((pair.dofs // 3, 3))
        displacement[pair.first_node[1] :] = shift
        packed, outcome, forces = forces_at(replace(pair, contacts=pair.contacts[:1]), displacement)
        assert outcome == (0.0, 0.0, 0.0, 0.0)
        assert not forces.any()
        assert (packed.starts[:, 0] == -1.0).all()


def test_numbers_that_are_not_finite_are_not_passed_over(pair):
    for bad in (np.nan, np.inf):
        for chosen in (slice(3 * 16, 3 * 40), slice(None), slice(0, 1)):
            displacement = shaken(pair)
            displacement[chosen] = bad
            packed, outcome, forces = forces_at(pair, displacement)
            assert np.isnan(outcome).all()
            assert np.isnan(forces).all()
            # And it does not last.
            fresh = forces_at(pair, shaken(pair))
            forces[:] = 0.0
            assert add_forces(packed, reference(pair) + shaken(pair).reshape(-1, 3), forces) == fresh[1]
            assert np.array_equal(forces, fresh[2])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Contact(0, 1, 0.0), "penalty"),
        (lambda: Contact(0, 1, float("nan")), "penalty"),
        (lambda: Contact(1, 1, 1.0), "itself"),
        (lambda: Contact(0, 1, 1.0, points=(0, 3)), "points round an arc"),
        (lambda: Contact(0, 1, 1.0, points=(3,)), "two numbers"),
        (lambda: Contact(0, 1, 1.0, penetration=-1.0), "penetration"),
        (lambda: Contact(0, Plane((0, 0, 0), (0, 0, 1)), 1.0, second_elements=[0]), "rigid"),
        (lambda: Plane((0, 0, 0), (0, 0, 0)), "direction"),
        (lambda: Plane((0, 0, float("inf")), (0, 0, 1)), "finite"),
        (lambda: Plane((0, 0), (0, 0, 1)), "three"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 0), 1.0), "direction"),
        (lambda: Cylinder((0, 0, 0), (0, 0, 1), -1.0), "radius"),
    ],
)
def test_bad_numbers_get_one_line(make, message):
    with pytest.raises(InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("contact", "message"),
    [
        (Contact(0, 2, 1.0), "contact 0: body 2 is not one of the 2 bodies"),
        (Contact(-1, 0, 1.0), "contact 0: body -1 is not"),
        (Contact(0, 1, 1.0, first_elements=[0, 3]), "contact 0: element 3 is not in body 0, which has 3"),
        (Contact(0, 1, 1.0, second_elements=[-1]), "contact 0: element -1 is not in body 1"),
        (Contact(0, 1, 1.0, first_elements=[]), "no elements of body 0"),
        (Contact(0, 1, 1.0, first_elements=[0.5]), "element 0.5"),
    ],
)
def test_a_model_refuses_what_is_not_there(contact, message, pair):
    with pytest.raises(InputError, match=re.escape(message)) as error:
        replace(pair, contacts=[contact])
    assert "\n" not in str(error.value)


def test_polynomial_sections_have_no_control_points_to_touch(cylinder):
    body = Body(Space(cylinder(8), section_degree=2), LAW)
    with pytest.raises(InputError, match="contact 0: body 0 has polynomial section functions"):
        Model([body], contacts=[Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), 1.0)])


def test_a_time_loop_refuses_multipliers(pair):
    model = replace(pair, contacts=[replace(pair.contacts[0], penetration=1e-3)])
    with pytest.raises(InputError, match="statics"):
        pack(model)


def test_other_scenes_do_not_load_contact(python):
    script = """
import sys
from isorod import options
options.initialize([])
from isorod import statics
from isorod.scenes.spring import Spring
statics.solve(Spring(coils=1, section_points=4).model())
print([name for name in sys.modules if name.startswith("isorod.contact")])
"""
    assert python(script).stdout.strip() == "[]"
