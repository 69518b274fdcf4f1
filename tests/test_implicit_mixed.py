"""Implicit motion of bodies with pressures: energy, momenta, order and frequencies up to a Poisson's ratio of 0.5."""

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import BSpline

from isorod import dynamics, modal, statics
from isorod.dynamics.implicit import inertia
from isorod.dynamics.implicit.mixed import MixedStepAssembler
from isorod.errors import InputError, SolveError
from isorod.geometry import center_line, section
from isorod.geometry.rod import Rod
from isorod.material import LinearElastic, NeoHookean
from isorod.material.along_rod import Laws, Piece, volume_between
from isorod.material.muscle import Muscle
from isorod.model import Body, BodyForce, Contact, Model, Plane, Support
from isorod.space import Space

E, DENSITY, LENGTH, RADIUS = 100.0, 2.0, 2.0, 0.5
RATIOS = (0.4999, 0.5)
FIBRES = {"sigma_max": 20.0, "m1": 35.0, "m2": 0.5, "activation": 1.0, "fibre": (0.0, 0.0, 1.0)}


def bar(nu=0.5, held="xyz", law=None, elements=1, degree=2, across=2, length=LENGTH, **more):
    """A cylinder along z, one end of which may be held: 42 unknowns, 6 of which are pressures."""
    rod = center_line.straight(length).sweep(section.circle(8, RADIUS))
    space = Space(
        rod, section_degree=across, degree=degree, elements=elements, continuity=degree - 1, quadrature="auto"
    )
    supports = [Support.end(space, "start", held)] if held else []
    return Model([Body(space, law or NeoHookean(E, nu), DENSITY, "mixed")], supports, **more)


def field(model, function):
    """All degrees of freedom of a vector field of the position that is linear in it, and zero where that is."""
    return function(model.bodies[0].space.positions).ravel()


def wild(model, size):
    """Random velocities of all degrees of freedom: all modes at once."""
    return size * np.random.default_rng(0).standard_normal(model.dofs)


def swing(model, size=0.8):
    """Velocities across the bar, which change no volume."""
    return field(model, lambda x: np.stack([size * x[:, 2], 0.0 * x[:, 0], 0.0 * x[:, 0]], axis=1))


def run(model, end_time, time_step, **settings):
    return dynamics.solve(model, end_time, time_step, integrator="implicit", **settings)


def states(points=40):
    """Pairs of deformation gradients far apart, as start and change."""
    first, last = np.eye(3) + 0.35 * np.random.default_rng(1).standard_normal((2, points, 3, 3))
    good = (np.linalg.det(first) > 0.1) & (np.linalg.det(last) > 0.1)
    return first[good], (last - first)[good]


def test_the_gradient_between_states_is_the_change_of_volume():
    F, H = states()
    laws = Laws([Piece(NeoHookean(E, 0.5), 0, len(F))])
    gradient, slope = volume_between(laws, F, H, True)
    grown = np.log(np.linalg.det(F + H) / np.linalg.det(F))
    np.testing.assert_allclose(np.sum(gradient * H, axis=(1, 2)), grown, atol=1e-13)
    # No moment.
    turned = gradient @ np.swapaxes(F + 0.5 * H, 1, 2)
    np.testing.assert_allclose(turned, np.swapaxes(turned, 1, 2), atol=1e-12 * np.abs(turned).max())
    step = 1e-6 * np.eye(9).reshape(9, 3, 3)
    ahead, behind = (
        np.stack([volume_between(laws, F, H + s * one, False)[0] for one in step], -1) for s in (1.0, -1.0)
    )
    found = ((ahead - behind) / 2e-6).reshape(slope.shape)
    np.testing.assert_allclose(slope, found, atol=1e-7 * np.abs(found).max())


def test_the_gradient_of_small_strains_is_that_of_the_trace():
    F, H = states()
    laws = Laws([Piece(NeoHookean(E, 0.49), 0, 2), Piece(LinearElastic(E, 0.5), 2, len(F))])
    gradient, slope = volume_between(laws, F, H, True)
    np.testing.assert_array_equal(gradient[2:], np.broadcast_to(np.eye(3), F[2:].shape))
    assert slope[:2].any() and not slope[2:].any()


@pytest.mark.parametrize("law", [NeoHookean(E, 0.5), Muscle(E, 0.4999, **FIBRES)])
def test_the_tangent_is_the_derivative_of_the_residual(law):
    assembler = MixedStepAssembler(bar(law=law))
    rng = np.random.default_rng(2)
    before, rate = 0.05 * rng.standard_normal((2, assembler.model.dofs))
    assembler.begin(0.1, 0.3, before, rate)
    x, way, image = (assembler.vector() for _ in range(3))
    x.array_w[:], way.array_w[:] = 0.05 * rng.standard_normal((2, assembler.unknowns))
    tangent = assembler.matrix()
    assembler.tangent(x, 0.7, tangent)
    tangent.mult(way, image)
    sides = []
    for sign in (1.0, -1.0):
        moved, out = x.copy(), assembler.vector()
        moved.axpy(1e-5 * sign, way)
        assembler.residual(moved, 0.7, out)
        sides.append(out.array_r.copy())
    found = (sides[0] - sides[1]) / 2e-5
    pressures = ~np.isin(np.arange(assembler.unknowns), assembler.unknown_of)
    assert pressures.sum() == assembler.pressure.size == 6
    for rows in (pressures, ~pressures):
        np.testing.assert_allclose(image.array_r[rows], found[rows], atol=1e-7 * np.abs(found[rows]).max())


@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("step", [0.02, 0.2])
def test_energy_is_kept_whatever_the_step(nu, step):
    """All modes at once: waves of pressure too, which are a thousand times faster, where there are some."""
    model = bar(nu)
    history = run(model, 20 * step, step, outputs=5, velocity=wild(model, 0.3))
    assert history.cuts == 0 and history.stored.max() > 0.01 * history.kinetic[0]
    assert np.abs(history.energy_error).max() < 1e-9
    assert np.abs(history.momentum_error).max() < 1e-9
    assert history.newton_iterations <= 5 * history.steps


@pytest.mark.slow
@pytest.mark.parametrize("nu", RATIOS)
@pytest.mark.parametrize("law", [NeoHookean, Muscle])
def test_energy_is_kept_for_ten_thousand_steps(nu, law):
    model = bar(law=law(E, nu, **({} if law is NeoHookean else FIBRES | {"activation": 0.0})))
    history = run(model, 500.0, 0.05, outputs=50, velocity=swing(model))
    print(f"energy {np.abs(history.energy_error).max():.1e}, momentum {np.abs(history.momentum_error).max():.1e}")
    assert history.steps == 10_000 and np.abs(history.energy_error).max() < 1e-8


@pytest.mark.parametrize("nu", RATIOS)
def test_a_spinning_body_keeps_both_momenta(nu):
    model = bar(nu, held="")
    flung = wild(model, 0.1) + field(model, lambda x: np.cross([0.3, 2.0, 0.5], x))
    history = run(model, 1.0, 0.05, outputs=10, velocity=flung)
    places = model.bodies[0].space.positions + history.displacement.reshape(len(history), -1, 3)
    momenta = MixedStepAssembler(model).momenta
    moving = np.array([momenta(one) for one in history.velocity]).reshape(places.shape)
    momentum, angular = (model.is_carrier[:, None] * moving).sum(axis=1), np.cross(places, moving).sum(axis=1)
    size = np.abs(moving).sum()
    assert np.abs(momentum - momentum[0]).max() < 1e-10 * size
    assert np.abs(angular - angular[0]).max() < 1e-10 * size < 1e-7 * np.abs(angular[0]).max()
    assert np.abs(history.energy_error).max() < 1e-9


@pytest.mark.parametrize("nu", RATIOS)
def test_second_order_in_the_time_step(nu):
    """Displacement, velocity, pressure and reactions at the time of an output."""
    model = bar(nu)
    runs = [run(model, 0.4, 0.04 / 2**k, outputs=1, velocity=swing(model)) for k in range(4)]
    for name in ("displacement", "velocity", "pressure", "reactions"):
        ends = [getattr(one, name)[-1] for one in runs]
        errors = [np.abs(one - other).max() for one, other in pairwise(ends)]
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        print(name, "differences", errors, "orders", orders)
        assert errors[-1] < 5e-3 * np.abs(ends[-1]).max()
        assert orders[-1] == pytest.approx(2.0, abs=0.2)


def frequency(model, shape, step):
    """Angular frequency of small oscillations, which steps make ``tan(omega_h dt / 2) = omega dt / 2``."""
    history = run(model, 8 * step, step, outputs=8, velocity=1e-4 * shape)
    x = history.displacement @ shape
    turn = np.arccos(0.5 * (x[2:] + x[:-2]) / x[1:-1])
    assert np.ptp(turn) < 1e-5
    return 2.0 / step * np.tan(0.5 * turn.mean())


@pytest.mark.parametrize("nu", RATIOS)
def test_a_cylinder_twists_to_and_fro_at_its_exact_frequency(nu):
    """``omega = pi / (2 L) sqrt(mu / rho)``, whatever Poisson's ratio."""
    model = bar(nu, degree=6)
    space = model.bodies[0].space
    u = np.linspace(0.0, 1.0, 50)
    basis = BSpline.design_matrix(u, space.axis.knots, 6).toarray()
    along = np.linalg.lstsq(basis, np.sin(0.5 * np.pi * u), rcond=None)[0].repeat(space.layer_nodes)
    twist = field(model, lambda x: along[:, None] * np.cross([0.0, 0.0, 1.0], x))
    omega = 0.5 * np.pi / LENGTH * np.sqrt(NeoHookean(E, nu).mu / DENSITY)
    assert frequency(model, twist, 0.1 / omega) == pytest.approx(omega, rel=1e-6)


def slender_beam(nu, length):
    """First bending of a free cylinder: angular frequency, and its shape ``f`` and slope of ``z / length``.

    Euler and Bernoulli's beam, rotary inertia and shear (Cowper, J. Appl. Mech. 33 (1966) 335-340) to first order of
    ``(RADIUS / length)^2``, by Rayleigh's quotient.
    """
    root = 4.730040744862704
    ratio = (np.cosh(root) - np.cos(root)) / (np.sinh(root) - np.sin(root))

    def shape(z, order):
        x = root * z
        waves = [np.cos(x), -np.sin(x), -np.cos(x), np.sin(x)], [np.sin(x), np.cos(x), -np.sin(x), -np.cos(x)]
        grows = (np.cosh(x), np.sinh(x)) if order % 2 == 0 else (np.sinh(x), np.cosh(x))
        return root**order * (grows[0] + waves[0][order] - ratio * (grows[1] + waves[1][order]))

    turning, bending, shearing = (np.mean(shape(np.linspace(0.0, 1.0, 10_001), k) ** 2) for k in (1, 2, 3))
    whole = np.mean(shape(np.linspace(0.0, 1.0, 10_001), 0) ** 2)
    shear = 2.0 * (1.0 + nu) * (7.0 + 6.0 * nu) / (6.0 * (1.0 + nu))
    lost = (0.5 * RADIUS / length) ** 2 * (turning / whole + shear * shearing / bending)
    return root**2 / length**2 * 0.5 * RADIUS * np.sqrt(E / DENSITY) * (1.0 - 0.5 * lost), shape


@pytest.mark.parametrize("nu", [0.4999, pytest.param(0.5, marks=pytest.mark.slow)])
def test_a_slender_bar_bends_to_and_fro_as_a_beam(nu):
    """By a space in which displacements alone are too stiff."""
    length = 20.0
    model = bar(nu, held="", elements=6, degree=3, length=length)
    omega, shape = slender_beam(nu, length)
    space = model.bodies[0].space
    u = np.linspace(0.0, 1.0, 50)
    basis = BSpline.design_matrix(u, space.axis.knots, space.axis.degree).toarray()
    across, turn = (np.linalg.lstsq(basis, shape(u, k), rcond=None)[0].repeat(space.layer_nodes) for k in (0, 1))
    velocity = np.zeros((space.nodes, 3))
    velocity[:, 0] = across * space.is_carrier
    velocity[:, 2] = -turn / length * space.positions[:, 0]
    step = 2.0 * np.pi / omega / 40.0
    history = run(model, 25 * step, step, outputs=25, velocity=1e-4 * velocity.ravel())
    moved = np.array([one.at(0, 0.5)[0] for one in history])
    after = 1 + int(np.argmax(moved[1:] * moved[1] < 0.0))
    half = step * (after - moved[after] / (moved[after] - moved[after - 1]))
    found = 2.0 / step * np.tan(0.5 * np.pi / half * step)
    body = replace(model.bodies[0], material=NeoHookean(E, 0.4999), formulation="displacement")
    locked = 2.0 * np.pi * modal.solve(Model([body]), 7).frequencies[6]
    print(f"{found:.6g}, beam {omega:.6g}, displacements alone {locked:.6g}")
    assert found == pytest.approx(omega, rel=2e-3)
    assert locked - omega > 3.0 * abs(found - omega)


@pytest.mark.parametrize("nu", [0.4999, pytest.param(0.5, marks=pytest.mark.slow)])
def test_damped_motion_ends_in_the_static_equilibrium(nu):
    """Of a load and an active muscle, and what begins there stays there."""
    model = bar(law=Muscle(E, nu, **FIBRES), loads=[BodyForce((0.5, 0.0, 0.0))])
    rest = statics.solve(model)
    moved = run(model, 20.0, 0.1, outputs=2, damping=3.0, ramp=4.0)
    stays = run(model, 0.5, 0.1, outputs=2, displacement=rest.displacement)
    # What swings fast still does, a little: steps follow it no more.
    for history, error, loose in ((moved, 1e-6, 1e-4), (stays, 1e-8, 1e-7)):
        off = history.displacement[-1] - rest.displacement
        assert np.abs(off).max() < error * np.abs(rest.displacement).max()
        np.testing.assert_allclose(history.reactions[-1], rest.reactions, atol=loose * np.abs(rest.reactions).max())
        found, expected = history[-1].fields(0)["pressure"], rest.pressures[0]
        np.testing.assert_allclose(found, expected, atol=loose * np.abs(expected).max())
        stress = history[-1].stress(0, [0.2, 0.7]), rest.stress(0, [0.2, 0.7])
        np.testing.assert_allclose(*stress, atol=loose * np.abs(stress[1]).max())
        assert np.abs(history.energy_error).max() < 1e-8


def test_a_start_that_changes_volumes_becomes_the_nearest_that_does_not():
    """The energy of what is left is kept; a state without such a neighbour is refused."""
    model = bar()
    stretched = field(model, lambda x: x * [0.0, 0.0, 0.2])
    history = run(model, 0.2, 0.05, outputs=2, displacement=stretched, velocity=stretched)
    assembler = MixedStepAssembler(model)
    for k, one in enumerate(history):
        local, volumes, rates = assembler.local(one.displacement), *np.zeros((2, 72))
        assembler.parts[0].add_integrals(local, volumes)
        assembler.parts[0].add_rates(local, assembler.local(one.velocity), rates)
        assert np.abs(volumes).max() < 1e-10 and (k > 0 or np.abs(rates).max() < 1e-10)
        assert 0.1 < one.at(0, "end")[2] < 0.6
    assert np.abs(history.energy_error).max() < 1e-9
    crushed = field(model, lambda x: x * [0.0, 0.0, -0.99])
    with pytest.raises(InputError, match=r"^initial "):
        run(model, 0.2, 0.05, displacement=crushed)


@pytest.mark.parametrize("nu", [0.5, pytest.param(0.4999, marks=pytest.mark.slow)])
def test_bodies_with_pressures_bounce_off_a_plane(nu, cylinder):
    wall = Contact(0, Plane((1.05 * RADIUS, 0.0, 0.0), (-1.0, 0.0, 0.0)), 2000.0)
    errors = []
    for step in (0.01, 0.005):
        space = Space.paper(cylinder(4, radius=RADIUS, height=LENGTH), degree=2, quadrature="auto")
        model = Model([Body(space, NeoHookean(E, nu), DENSITY, "mixed")], contacts=[wall])
        thrown = np.outer(model.is_carrier, [1.0, 0.0, 0.0]).ravel()
        history = run(model, 0.5, step, outputs=10, velocity=thrown)
        assert history.contact_force.max() > 0.0 == history.contact_force[-1]
        assert np.abs(history.momentum_error).max() < 1e-9
        errors.append(np.abs(history.energy_error[-1]))
    print("energy", errors)
    assert history.velocity[-1, ::3] @ model.is_carrier < 0.0
    assert errors[1] < 0.5 * errors[0] < 0.05


def test_bodies_whose_pressures_are_chosen_pass_on_their_momentum(cylinder):
    """One is thrown at another off its middle, of the same mass: energy is off by 7e-4, as at ``nu`` 0.3 (5e-4)."""
    rod = cylinder(8, radius=RADIUS, height=LENGTH)
    other = Rod(rod.axis, rod.control_points + np.array([2.05 * RADIUS, 0.0, 0.3 * LENGTH]))
    spaces = [Space.paper(one, degree=2, order=2, quadrature="auto") for one in (rod, other)]
    model = Model([Body(one, NeoHookean(E, 0.4999), DENSITY) for one in spaces], contacts=[Contact(0, 1, 1000.0)])
    first = np.arange(len(model.is_carrier)) < model.first_node[1]
    history = run(model, 0.7, 0.02, outputs=7, velocity=np.outer(model.is_carrier & first, [0.4, 0.0, 0.0]).ravel())
    print(f"energy {np.abs(history.energy_error).max():.1e}, momentum {np.abs(history.momentum_error).max():.1e}")
    assert {body.formulation for body in history.model.bodies} == {"mixed"}
    assert history.contact_force.max() > 0.0 == history.contact_force[-1]
    assert np.abs(history.momentum_error).max() < 1e-12
    assert np.abs(history.energy_error).max() < 2e-3
    at_rest = np.concatenate([one.positions for one in spaces])
    places = at_rest + history.displacement.reshape(len(history), -1, 3)
    momenta = MixedStepAssembler(model).momenta
    moving = np.array([momenta(one) for one in history.velocity]).reshape(places.shape)
    angular = np.cross(places, moving).sum(axis=1)
    assert np.abs(angular - angular[0]).max() < 1e-10 * np.abs(angular[0]).max()
    # Of what it had the one that was thrown keeps less than it gives.
    given = (model.is_carrier & ~first) @ moving[-1, :, 0]
    assert 0.5 < given / (model.is_carrier @ moving[0, :, 0]) < 1.0


def test_explicit_steps_say_that_they_take_displacements(cylinder):
    """Of a body whose pressures were chosen; at 0.49, where explicit steps may be, or with a law that says so, not."""
    space = Space.paper(cylinder(4, radius=RADIUS, height=LENGTH), degree=2, quadrature="auto", order=2)
    model = Model([Body(space, NeoHookean(E, 0.4999), DENSITY)])
    with pytest.warns(UserWarning, match=r"^nu = 0.4999: explicit steps use the displacement formulation"):
        assert model.in_motion("explicit").bodies[0].formulation == "displacement"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for quiet in (
            Body(space, NeoHookean(E, 0.49), DENSITY),
            Body(space, NeoHookean(E, 0.4999), DENSITY, "displacement"),
        ):
            Model([quiet]).in_motion("explicit")
        model.in_motion("implicit")


def test_a_run_continues_from_its_checkpoint(tmp_path):
    model, file = bar(), tmp_path / "state"
    settings = {"velocity": swing(model)}
    whole = run(model, 0.4, 0.05, outputs=4, **settings)
    run(model, 0.2, 0.05, outputs=2, checkpoint=file, **settings)
    again = run(model, 0.4, 0.05, outputs=4, checkpoint=file, resume=True, **settings)
    for name in ("times", "displacement", "velocity", "pressure", "reactions", "energy_error"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name), err_msg=name)
    with pytest.raises(InputError, match="belongs to another model"):
        run(bar(0.4999), 0.4, 0.05, outputs=4, checkpoint=file, resume=True, **settings)


def test_explicit_steps_say_that_they_take_no_pressures():
    with pytest.raises(
        InputError, match=r"^body 0: formulation: got 'mixed', explicit steps take 'displacement' alone"
    ):
        dynamics.solve(bar(0.4), 1.0)
    body = bar().bodies[0]
    with pytest.raises(InputError, match=r"^body 0: material: incompressible \(nu = 0.5\), where no explicit step"):
        dynamics.solve(Model([Body(body.space, body.material, DENSITY)]), 1.0)


def test_pressures_are_found_where_pivots_are_put_off():
    """In mm, MPa and t mass is so small beside constraints that MUMPS asks for more room than it foresees.

    In another unit of time it does not, and pressures are the same.
    """

    def pressures(times):
        space = Space(center_line.straight(100.0).sweep(section.circle(8, 10.0)), order=2, degree=4, elements=4)
        body = Body(space, NeoHookean(1.0, 0.5), 1e-9 * times**2)
        model = Model([body], [Support.end(space, "start")], loads=[BodyForce((0.0, 1e-5, 0.0))])
        return run(model, 6e-3 * times, 6e-3 * times, outputs=1).pressure[-1]

    assert pressures(1.0) == pytest.approx(pressures(1e4), rel=1e-5, abs=1e-8)


def test_what_is_not_finite_is_no_result(monkeypatch):
    monkeypatch.setattr(inertia.MixedInertia, "settle", lambda *_: (np.full(63, np.nan), np.zeros(6)))
    with pytest.raises(SolveError, match="step 0, time 0: reactions is not finite"):
        run(bar(), 0.1, 0.1, outputs=1)
