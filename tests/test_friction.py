"""Coulomb friction: sticks, slides, turns with the rods, remembers, and what it takes is in the balance of energy."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import straight
from refused import refused
from touching import ACROSS, LAW, STIFF, add_forces, assert_tangent, crease, moved, pair, reference, shaken, stiffness

from isorod import Body, BodyForce, Contact, Model, Plane, Space, Sphere, Support, dynamics, statics
from isorod.contact.friction import pack as pack_friction
from isorod.contact.friction_kernel import add_friction
from isorod.contact.operator import ContactOperator
from isorod.contact.tables import pack
from isorod.dynamics.explicit.mass import Mass


def rubbing(model, friction):
    """Return a model with friction in all its contacts."""
    return replace(model, contacts=[replace(contact, friction=friction) for contact in model.contacts])


def on_sphere():
    """A ring and a straight rod, cut by a sphere."""
    model = pair()
    return replace(model, contacts=[Contact((0, 1), Sphere((-1.5, 0.3, 3.2), 1.2), 60.0)])


def begun(model, size=0.004):
    """Return an operator that has accepted a state, and a displacement a step away from it."""
    operator, displacement = ContactOperator(model), shaken(model)
    operator.accept(displacement)
    return operator, displacement + size * np.random.default_rng(7).standard_normal(model.dofs)


@pytest.mark.parametrize("scene", [pair, crease, on_sphere])
@pytest.mark.parametrize("friction", [100.0, 0.005], ids=["stick", "slip"])
def test_tangent_is_the_derivative_of_the_forces(scene, friction):
    operator, displacement = begun(rubbing(scene(), friction))
    K = stiffness(operator, displacement)
    told = operator.results(displacement)
    stuck, slid = (sum(getattr(one, name) for one in told) for name in ("sticking", "slipping"))
    assert stuck > 20 * max(slid, 1) if friction > 1.0 else slid > 5 * max(stuck, 4)
    assert abs(K - K.T).max() > 1e-3 * abs(K).max()
    assert_tangent(operator, displacement, 1e-7, 5, 1e-6, symmetric=False)


@pytest.mark.parametrize("scene", [pair, crease])
def test_action_equals_reaction(scene):
    model = scene()
    model = rubbing(replace(model, contacts=model.contacts[:1]), 0.3)
    operator, displacement = begun(model)
    forces = operator.forces(displacement)[0].reshape(-1, 3)
    plain = ContactOperator(rubbing(model, 0.0)).forces(displacement)[0].reshape(-1, 3)
    rubbed = forces - plain
    scale = np.abs(rubbed).sum()
    assert scale > 1e-2 * np.abs(plain).sum()
    assert np.abs(rubbed.sum(axis=0)).max() < 1e-13 * np.abs(forces).sum()
    # Slave and foot are a gap apart: no more than that is lost of the moments.
    (result,) = operator.results(displacement)
    x = reference(model) + displacement.reshape(-1, 3)
    moment = np.linalg.norm(np.cross(x, rubbed).sum(axis=0))
    loads = result.areas @ np.linalg.norm(operator.friction.tables.tractions, axis=1)
    assert moment < result.penetration * loads
    np.testing.assert_allclose(result.friction, rubbed[: model.first_node[1]].sum(axis=0), atol=1e-12 * scale)


def test_rigid_motion_turns_the_forces_with_it():
    turn = np.linalg.qr(np.random.default_rng(6).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    model = pair()
    model = rubbing(replace(model, contacts=model.contacts[:1]), 0.02)
    packed = pack(model)
    friction = pack_friction(model, packed)
    x = reference(model) + shaken(model).reshape(-1, 3)
    add_forces(packed, x, np.zeros_like(x))
    add_friction(packed, friction, x, True, np.zeros_like(x))
    x += 0.003 * np.random.default_rng(7).standard_normal(x.shape)

    def at(positions):
        forces = np.zeros_like(x)
        packed.forget()
        add_forces(packed, positions, np.zeros_like(x))
        return add_friction(packed, friction, positions, False, forces), forces, friction.slipping.sum()

    spent, forces, slid = at(x)
    assert 2 < slid < (packed.states["pressure"] > 0.0).sum() - 2
    there, turned, also_slid = at(x @ turn.T + model.is_control_point[:, None] * np.array([1.0, -2.0, 3.0]))
    assert also_slid == slid
    assert there[0] == pytest.approx(spent[0], rel=1e-10)
    np.testing.assert_allclose(turned, forces @ turn.T, atol=1e-11 * np.abs(forces).max())


def sliding(breaks, second=None, friction=0.3):
    """Return tractions of a thin rod's points, dragged along a straight one whose elements, or bodies, end anywhere."""
    thin = moved(straight(6, radius=0.5, height=4.0), (-2.0, 1.4, 0.0), ACROSS)
    if second is None:
        rods = [straight(8, breaks=breaks, height=6.0)]
    else:
        rods = [straight(8, height=second), moved(straight(8, height=6.0 - second), (0.0, 0.0, second))]
    bodies = [Body(Space.paper(rod), LAW) for rod in (thin, *rods)]
    contact = Contact(0, tuple(range(1, len(bodies))), 10.0, points=(4, 8), friction=friction)
    model = Model(bodies, contacts=[contact])
    operator, mobile = ContactOperator(model), np.arange(model.dofs // 3) < model.first_node[1]
    seen = []
    for t in np.linspace(0.0, 1.0, 41):
        displacement = np.zeros((model.dofs // 3, 3))
        displacement[mobile & model.is_control_point] = [0.05 * np.sin(4.0 * t), 0.0, 2.5 + t]
        operator.accept(displacement.ravel())
        operator.forces(displacement.ravel())
        seen.append(operator.friction.tables.tractions[operator.packed.passes["first_point"][0] :][:192].copy())
    return np.array(seen)


def test_history_survives_where_projections_cross_elements_and_rods():
    whole = sliding((0.0, 3.0))
    assert np.abs(whole).max() > 0.01
    cut = sliding((0.0, 1.5, 1.7, 3.0))
    np.testing.assert_allclose(cut, whole, atol=1e-9 * np.abs(whole).max())
    two = sliding((), second=3.1)
    # Of the other rod the points that straddle its end are lost; those that are there keep what they had.
    last = np.abs(whole[-1]).max(axis=1) > 0.0
    np.testing.assert_allclose(two[-1][last], whole[-1][last], atol=1e-6 * np.abs(whole).max())


@pytest.mark.parametrize("friction", [10.0, 0.3, 0.01])
def test_other_points_go_on_from_where_these_were(friction):
    """Four times as many points hang as fewer did before: nearly as if they had been there all the way."""
    model = pair()
    model = rubbing(replace(model, contacts=model.contacts[:1]), friction)
    way, second = np.zeros((model.dofs // 3, 3)), model.first_node[1]
    way[second:] = model.is_control_point[second:, None] * np.array([0.0, 2e-3, 3e-3])
    start = shaken(model, 1e-3)
    coarse, fine = (
        ContactOperator(replace(model, contacts=[replace(model.contacts[0], points=points)]))
        for points in ((8, 8), (16, 16))
    )
    for k in range(3):
        coarse.accept(start + k * way.ravel())
        fine.accept(start + k * way.ravel())
    coarse.packed = pack(fine.model)
    coarse.friction.take(coarse.packed)
    (found,), (wanted,) = (one.results(start + 3.0 * way.ravel()) for one in (coarse, fine))
    print(found.friction, wanted.friction, found.sticking, found.slipping, wanted.sticking, wanted.slipping)
    size = np.linalg.norm(wanted.friction)
    assert size > 1e-3 * wanted.force
    # Points about the patch's edge may have nobody near who hung.
    np.testing.assert_allclose(found.friction, wanted.friction, atol=0.05 * size)


def block(pull, friction=0.3, penalty=3e4, overlap=0.02, height=2.0, **options):
    """Return the outcome for a rod that lies pressed on a rough plane and is pulled along it by its back."""
    space = Space.paper(
        straight(8, breaks=(0.0, 1.0, 2.0), height=height), degree=2, order=2, section_points=16, quadrature="auto"
    )
    top = np.flatnonzero(np.sin(space.turn + 2.0 * np.pi / 16 * np.arange(16)) > 0.3)
    nodes = (np.arange(space.layers)[:, None] * space.layer_nodes + top).ravel()
    plane = Plane((0.0, overlap - 1.0, 0.0), (0.0, 1.0, 0.0))
    contact = Contact(0, plane, penalty, points=(4, 3), friction=friction)
    model = Model([Body(space, STIFF)], [Support(nodes, displacement=(0.0, 0.0, pull))], contacts=[contact])
    return statics.solve(model, **options)


def test_what_is_pressed_sticks_up_to_coulombs_force_and_slides_at_it():
    pulls = (0.002, 0.004, 0.05, 0.1)
    solutions = [block(pull, load_steps=2) for pull in pulls]
    results = [solution.contacts[0] for solution in solutions]
    ratios = [-result.friction[2] / result.force for result in results]
    for solution, result in zip(solutions, results, strict=True):
        np.testing.assert_allclose(solution.reactions[0], [0.0, -result.force, -result.friction[2]], atol=1e-6)
    assert not results[0].slipping and not results[1].slipping
    assert ratios[1] == pytest.approx(2.0 * ratios[0], rel=1e-2)
    assert not results[2].sticking and not results[3].sticking
    np.testing.assert_allclose(ratios[2:], 0.3, rtol=1e-5)
    assert results[3].slipping == (results[3].pressure > 0.0).sum() > 8


def test_multipliers_count_for_what_friction_holds():
    result = block(0.1, penalty=None, load_steps=2).contacts[0]
    assert result.relative_penetration < 1e-3
    assert -result.friction[2] / result.force == pytest.approx(0.3, rel=1e-5)


def squeezed(friction, penalty=3e4):
    """Return a free rod pressed between two rough planes, and velocities of one along it."""
    space = Space.paper(straight(8, breaks=(0.0, 1.0, 2.0), height=2.0), degree=2, order=2, quadrature="auto")
    planes = [Plane((0.0, side * 0.98, 0.0), (0.0, -side, 0.0)) for side in (-1.0, 1.0)]
    contacts = [Contact(0, plane, penalty, points=(4, 3), friction=friction) for plane in planes]
    model = Model([Body(space, STIFF, density=1.0)], [], contacts=contacts)
    return model, (model.is_control_point[:, None] * np.array([0.0, 0.0, 1.0])).ravel()


@cache
def at_rest():
    """Return the displacement of the squeezed rod at rest, before it rubs, and the sum of the planes' forces."""
    history = dynamics.solve(squeezed(0.0, 3e3)[0], 2.0, outputs=4, damping=10.0)
    return history.displacement[-1], history.contact_force[-1]


@pytest.mark.parametrize(
    ("integrator", "step", "energy", "momentum"), [("explicit", 1e-3, 1e-7, 1e-12), ("implicit", 8e-3, 2e-3, 1e-10)]
)
def test_a_sliding_rod_slows_down_as_coulomb_says_and_stops(integrator, step, energy, momentum):
    """``m dv/dt = -mu N``, and all of its energy is dissipated but for what the springs swing with."""
    displacement, force = at_rest()
    model, along = squeezed(0.1, 3e3)
    mass, speed = 2.0 * np.pi, 0.2
    slowing = 0.1 * force / mass
    given = {"displacement": displacement, "velocity": speed * along, "integrator": integrator}
    history = dynamics.solve(model, 1.2 * speed / slowing, step, 12, **given)
    momenta = Mass(model, np.arange(model.dofs)).momenta
    mean = [momenta(v).reshape(-1, 3)[model.is_control_point, 2].sum() / mass for v in history.velocity]
    print(integrator, history.steps, mean[:9], slowing, np.abs(history.energy_error).max())
    # After the springs are stretched, and before it stops.
    measured = (mean[1] - mean[8]) / (history.times[8] - history.times[1])
    assert measured == pytest.approx(slowing, rel=5e-3)
    assert np.abs(history.energy_error).max() < energy
    # That of implicit steps is as exact as Newton's iterations.
    assert history.momentum_error.max() < momentum
    assert history.dissipated[-1] == pytest.approx(0.5 * mass * speed**2, rel=0.03)
    assert (np.diff(history.dissipated) >= 0.0).all()


def test_what_sticks_does_not_creep():
    """A push too weak to slip: swings on the springs, which damping ends where they began."""
    displacement, _ = at_rest()
    model, along = squeezed(0.5, 3e3)
    history = dynamics.solve(model, 6.0, 1e-3, 6, damping=6.0, displacement=displacement, velocity=2e-3 * along)
    middle = [u.reshape(-1, 3)[model.is_control_point, 2].mean() for u in history.displacement]
    print(middle, history.contact_energy)
    assert abs(middle[-1]) < 1e-3 * np.abs(middle).max()


def on_incline(friction, slope):
    """Return a rod that lies on a plane whose weight, of one per volume, pulls it down along itself, and its axis."""
    space = Space.paper(straight(8, height=3.0), degree=2, quadrature="auto")
    weight = (0.0, -np.cos(np.arctan(slope)), np.sin(np.arctan(slope)))
    contact = Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)), 1000.0, points=(3, 3), friction=friction)
    return Model([Body(space, STIFF, density=1.0)], [], contacts=[contact], loads=[BodyForce(weight)])


@cache
def lying():
    """Return the displacement of the rod where the plane is level."""
    model = on_incline(0.0, 0.0)
    return dynamics.solve(model, 4.0, 5e-2, 2, damping=5.0, integrator="implicit").displacement[-1]


def center(model, values):
    """Return the mean along the axis of a vector of degrees of freedom, by mass."""
    momentum = Mass(model, np.arange(model.dofs)).momenta
    return momentum(values).reshape(-1, 3)[model.is_control_point, 2].sum() / (3.0 * np.pi)


def test_a_rod_slides_down_a_steep_incline():
    """Velocity grows with ``g (sin a - mu cos a)``; the rod rocks, and so the mean over some rocking is taken."""
    model, angle = on_incline(0.3, 0.5), np.arctan(0.5)
    history = dynamics.solve(model, 2.0, 4e-2, 10, displacement=lying(), integrator="implicit")
    speeds = [center(model, v) for v in history.velocity]
    found = (speeds[-1] - speeds[2]) / (history.times[-1] - history.times[2])
    print(found, np.sin(angle) - 0.3 * np.cos(angle))
    assert found == pytest.approx(np.sin(angle) - 0.3 * np.cos(angle), rel=5e-3)
    assert np.abs(history.energy_error).max() < 0.01
    assert history.dissipated[-1] > 0.1


def test_a_rod_rests_on_a_gentle_incline():
    """Just below the angle of friction; the load, put on at once, makes it slip a little, damping then lets it rest."""
    model = on_incline(0.3, 0.28)
    history = dynamics.solve(model, 8.0, 5e-2, 8, damping=4.0, displacement=lying(), integrator="implicit")
    places = [center(model, u - history.displacement[0]) for u in history.displacement]
    print(places, history.dissipated, history.contact_force)
    assert 1e-3 < places[-1] < 0.1
    assert abs(places[-1] - places[-3]) < 1e-5 * places[-1]
    assert history.contact_force[-1] == pytest.approx(3.0 * np.pi * np.cos(np.arctan(0.28)), rel=2e-3)


def test_rods_that_strike_and_rub_keep_the_balance():
    """A thin rod strikes another across and slides on it, a tenth of its radius deep: off the foot by as much."""
    space = Space.paper(straight(8, breaks=(0.0, 1.0, 2.0), height=6.0), degree=2, quadrature="auto")
    thin = moved(straight(8, breaks=(0.0, 1.0, 2.0), radius=0.7, height=4.0), (-2.0, 1.72, 2.5), ACROSS)
    bodies = [Body(one, STIFF, density=1.0) for one in (space, Space.paper(thin, degree=2, quadrature="auto"))]
    model = Model(bodies, contacts=[Contact(0, 1, 3e3, points=(6, 6), friction=0.3)])
    velocity = np.zeros((model.dofs // 3, 3))
    velocity[model.first_node[1] :] = model.is_control_point[model.first_node[1] :, None] * np.array([0.3, -1.0, 1.5])
    history = dynamics.solve(model, 0.6, 5e-4, 12, velocity=velocity.ravel())
    print(history.penetration.max(), history.dissipated[-1] / history.kinetic[0], np.abs(history.energy_error).max())
    assert history.dissipated[-1] > 0.15 * history.kinetic[0]
    assert history.contact_area[-1] == 0.0 == history.contact_energy[-1]
    # 0.006 if the work of the traction were taken for that on the foot's way.
    assert np.abs(history.energy_error).max() < 0.003
    assert history.momentum_error.max() < 1e-12


test_bad_numbers_get_one_line = refused(
    (lambda: Contact(0, 1, friction=-0.1), "friction -0.1, need a coefficient, not negative"),
    (lambda: Contact(0, 1, friction=float("nan")), "friction nan, need"),
    (lambda: Contact(0, 1, across=1.0), "contact: got 1 control points across a patch, need 2 to 12"),
    (lambda: Contact(0, 1, friction="rough"), "friction: got 'rough'"),
    (lambda: Contact(0, Plane((0, 0, 0), (0, 0, 1)), faces=["end"]), "end faces touch nothing"),
)


@pytest.mark.slow
def test_the_balance_of_energy_holds_over_many_steps():
    """Pressed between planes, rocking, sliding and sticking, for 10^5 explicit steps."""
    model, along = squeezed(0.3, 3e3)
    history = dynamics.solve(model, 100.0, 1e-3, 50, velocity=2.0 * along)
    print(history.steps, np.abs(history.energy_error).max(), history.dissipated, history.momentum_error.max())
    assert history.steps >= 100_000
    assert history.dissipated[-1] > 0.5 * history.kinetic[0]
    assert np.abs(history.energy_error).max() < 0.01
    assert history.momentum_error.max() < 1e-12
