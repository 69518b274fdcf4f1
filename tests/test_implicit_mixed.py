"""Implicit motion of bodies with pressures: energy, momenta, order and frequencies up to a Poisson's ratio of 0.5."""

import warnings

import numpy as np
import pytest
from motions import DENSITY, E, change_of_momenta, field, implicit, mixed, momenta, muscle
from test_derivatives import difference, moved, residual

from isorod import InputError, LinearElastic, NeoHookean, Rod, SolveError, Space, dynamics, modal
from isorod.dynamics.implicit import inertia
from isorod.dynamics.implicit.mixed import MixedStepAssembler
from isorod.geometry import center_line, section
from isorod.material.along_rod import Laws, Segment, volume_between
from isorod.model import Body, BodyForce, Contact, Model, Support

LENGTH, RADIUS = 2.0, 0.5
RATIOS = (0.4999, 0.5)


def states(points=40):
    """Pairs of deformation gradients far apart, as start and change."""
    first, last = np.eye(3) + 0.35 * np.random.default_rng(1).standard_normal((2, points, 3, 3))
    good = (np.linalg.det(first) > 0.1) & (np.linalg.det(last) > 0.1)
    return first[good], (last - first)[good]


def test_the_gradient_between_states_is_the_change_of_volume():
    F, H = states()
    laws = Laws([Segment(NeoHookean(E, 0.5), 0, len(F))])
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
    laws = Laws([Segment(NeoHookean(E, 0.49), 0, 2), Segment(LinearElastic(E, 0.5), 2, len(F))])
    gradient, slope = volume_between(laws, F, H, True)
    np.testing.assert_array_equal(gradient[2:], np.broadcast_to(np.eye(3), F[2:].shape))
    assert slope[:2].any() and not slope[2:].any()


@pytest.mark.parametrize("law", [NeoHookean(E, 0.5), muscle(0.4999, 20.0)])
def test_the_tangent_is_the_derivative_of_the_residual(law):
    assembler = MixedStepAssembler(mixed(law=law))
    rng = np.random.default_rng(2)
    before, rate = 0.05 * rng.standard_normal((2, assembler.model.dofs))
    assembler.begin(0.1, 0.3, before, rate)
    start, way = 0.05 * rng.standard_normal((2, assembler.unknowns))
    x, tangent = moved(assembler.vector(), start), assembler.matrix()
    assembler.tangent(x, 0.7, tangent)
    image = (tangent * moved(assembler.vector(), way)).array_r
    found = difference(lambda t: residual(assembler, moved(x, t * way)), 1e-4)
    pressures = ~np.isin(np.arange(assembler.unknowns), assembler.unknown_of)
    assert pressures.sum() == assembler.pressure.size == 6
    for rows in (pressures, ~pressures):
        np.testing.assert_allclose(image[rows], found[rows], atol=1e-7 * np.abs(found[rows]).max())


def frequency(model, shape, step):
    """Angular frequency of small oscillations, which steps make ``tan(omega_h dt / 2) = omega dt / 2``."""
    history = implicit(model, 8 * step, step, outputs=8, velocity=1e-4 * shape)
    x = history.displacement @ shape
    turn = np.arccos(0.5 * (x[2:] + x[:-2]) / x[1:-1])
    assert np.ptp(turn) < 1e-5
    return 2.0 / step * np.tan(0.5 * turn.mean())


@pytest.mark.parametrize("nu", RATIOS)
def test_small_motions_are_those_of_the_modes(nu):
    """Bending, twisting and stretching, whose frequencies are exact (`test_mixed_modes`)."""
    model = mixed(nu, degree=4)
    modes = modal.solve(model, 6)
    for k in (0, 2, 4, 5):
        omega = 2.0 * np.pi * modes.frequencies[k]
        shape = modes.vectors[k] / np.abs(modes.vectors[k]).max()
        assert frequency(model, shape, 0.1 / omega) == pytest.approx(omega, rel=1e-5)


def test_a_start_that_changes_volumes_becomes_the_nearest_that_does_not():
    """The energy of what is left is kept; a state without such a neighbour is refused."""
    model = mixed()
    stretched = field(model, lambda x: x * [0.0, 0.0, 0.2])
    history = implicit(model, 0.2, 0.05, outputs=2, displacement=stretched, velocity=stretched)
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
        implicit(model, 0.2, 0.05, displacement=crushed)


def test_bodies_whose_pressures_are_chosen_pass_on_their_momentum(cylinder):
    """One is thrown at another off its middle, of the same mass: energy is off by 7e-4, as at ``nu`` 0.3 (5e-4)."""
    rod = cylinder(8, radius=RADIUS, height=LENGTH)
    other = Rod(rod.axis, rod.control_points + np.array([2.05 * RADIUS, 0.0, 0.3 * LENGTH]))
    spaces = [Space.paper(one, degree=2, order=2, quadrature="auto") for one in (rod, other)]
    model = Model([Body(one, NeoHookean(E, 0.4999), DENSITY) for one in spaces], contacts=[Contact(0, 1, 1000.0)])
    first = np.arange(len(model.is_control_point)) < model.first_node[1]
    history = implicit(
        model, 0.7, 0.02, outputs=7, velocity=np.outer(model.is_control_point & first, [0.4, 0.0, 0.0]).ravel()
    )
    print(f"energy {np.abs(history.energy_error).max():.1e}, momentum {np.abs(history.momentum_error).max():.1e}")
    assert {body.formulation for body in history.model.bodies} == {"mixed"}
    assert history.contact_force.max() > 0.0 == history.contact_force[-1]
    assert np.abs(history.momentum_error).max() < 1e-12
    assert np.abs(history.energy_error).max() < 2e-3
    moving = momenta(model, history.velocity)
    _, angular, begun = change_of_momenta(history)
    assert angular < 1e-10 * begun
    # Of what it had the one that was thrown keeps less than it gives.
    given = (model.is_control_point & ~first) @ moving[-1, :, 0]
    assert 0.5 < given / (model.is_control_point @ moving[0, :, 0]) < 1.0


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


def test_explicit_steps_say_that_they_take_no_pressures():
    with pytest.raises(
        InputError, match=r"^body 0: formulation: got 'mixed', explicit steps take 'displacement' alone"
    ):
        dynamics.solve(mixed(0.4), 1.0)
    body = mixed().bodies[0]
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
        return implicit(model, 6e-3 * times, 6e-3 * times, outputs=1).pressure[-1]

    assert pressures(1.0) == pytest.approx(pressures(1e4), rel=1e-5, abs=1e-8)


def test_what_is_not_finite_is_no_result(monkeypatch):
    monkeypatch.setattr(inertia.MixedInertia, "settle", lambda *_: (np.full(63, np.nan), np.zeros(6)))
    with pytest.raises(SolveError, match="step 0, time 0: reactions is not finite"):
        implicit(mixed(), 0.1, 0.1, outputs=1)
