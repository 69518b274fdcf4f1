"""Steps of a motion: those that are halved, those that contact shortens, and the mass that is added for long ones."""

from functools import partial

import motions
import numpy as np
import pytest
from conftest import straight
from models import gradients_of_functions
from motions import muscle, thrown

from isorod import Axis, NeoHookean, Rod, SolveError, Space, dynamics, ellipse
from isorod.assembly.gradients import add_stress, displacement_gradients
from isorod.dynamics.explicit import mesh
from isorod.dynamics.explicit.mass import Mass
from isorod.dynamics.implicit.assembler import StepAssembler
from isorod.dynamics.implicit.contraction import element_matrices
from isorod.dynamics.implicit.newton import Newton
from isorod.model import Body, Contact, Cylinder, Model, Plane, Support

MUSCLE, bar = muscle(fibre=(0.0, 0.6, 0.8)), partial(motions.bar, elements=2)

# Implicit steps


@pytest.fixture
def refuse_longer(monkeypatch):
    """Let Newton's method fail in steps longer than a given one; return that limit and the activations solved at."""
    begin, solve = StepAssembler.begin, Newton.solve
    limit, step, levels = [np.inf], [0.0], []

    def told(self, dt, *arguments):
        step[0] = dt
        begin(self, dt, *arguments)

    def refused(self, guess, factor):
        if step[0] > limit[0]:
            return None
        levels.append(factor)
        return solve(self, guess, factor)

    monkeypatch.setattr(StepAssembler, "begin", told)
    monkeypatch.setattr(Newton, "solve", refused)
    return limit, levels


@pytest.mark.parametrize("parts", [2, 4])
def test_halved_steps_are_those_of_a_run_with_shorter_ones(parts, refuse_longer):
    """Of a muscle whose activation grows meanwhile, each part at its own time: to the last bit."""
    limit, levels = refuse_longer
    model = bar(law=MUSCLE)
    settings = {"outputs": 2, "damping": 0.3, "ramp": 0.5, "integrator": "implicit"}
    short = dynamics.solve(model, 0.4, 0.1 / parts, **settings)
    expected = levels.copy()
    levels.clear()
    limit[0] = 0.1 / parts * (1.0 + 1e-9)
    halved = dynamics.solve(model, 0.4, 0.1, **settings)
    assert short.cuts == 0 and short.steps == 4 * parts
    assert halved.cuts == 4 * (parts - 1) and halved.steps == short.steps
    # The middle of each step on the ramp.
    np.testing.assert_allclose(expected, (np.arange(4 * parts) + 0.5) * 0.1 / parts / 0.5, rtol=1e-12)
    np.testing.assert_allclose(levels, expected, rtol=1e-12)
    scale = np.abs(short.displacement).max()
    np.testing.assert_allclose(halved.displacement, short.displacement, atol=1e-12 * scale)
    np.testing.assert_allclose(halved.velocity, short.velocity, atol=1e-11 * np.abs(short.velocity).max())
    np.testing.assert_allclose(halved.muscle_work, short.muscle_work, rtol=1e-10)
    np.testing.assert_allclose(halved.dissipated, short.dissipated, rtol=1e-10)


def test_a_step_that_would_be_cut_for_ever_ends_with_a_step_that_would_do(refuse_longer):
    limit, _ = refuse_longer
    limit[0] = 0.1 / 128 * (1.0 + 1e-9)
    with pytest.raises(SolveError, match=r"step \d+, time 0.0\d+: SNES .* cut 64 times: use 0.00078; smallest"):
        dynamics.solve(bar(), 0.2, 0.1, outputs=2, integrator="implicit")


def test_bodies_that_are_deep_in_each_other_are_no_matter_of_shorter_steps(refuse_longer):
    """Also says that it is the jump of a support that put them there."""
    limit, _ = refuse_longer
    limit[0] = 0.0
    space = Space.paper(straight(4, height=4.0), elements=2, degree=2, quadrature="auto")
    supports = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, -1.2, 0.0))]
    rod = Body(space, NeoHookean(100.0, 0.3), 2.0)
    contact = Contact(0, Cylinder(point=(0.0, -2.1, 4.0), axis=(1.0, 0.0, 0.0), radius=1.0))
    model = Model([rod], supports, contacts=[contact])
    with pytest.raises(
        SolveError, match=r"step 1, time 0: contact 0: penetration is 0.9\d of .* before the step; prescribed displ"
    ):
        dynamics.solve(model, 0.2, 0.1, outputs=2, integrator="implicit")


def test_the_tangent_is_the_sum_over_points_of_moduli_that_are_not_symmetric():
    """Section by section as function by function; forces and gradients too."""
    part = StepAssembler(bar(held="")).parts[0]
    t = part.table
    gradient = gradients_of_functions(t)
    random = np.random.default_rng(4)
    moduli = random.standard_normal((*t.weights.shape, 3, 3, 3, 3))
    expected = np.einsum("etq,etqAm,etqaAbB,etqBn->emanb", t.weights, gradient, moduli, gradient, optimize=True)
    np.testing.assert_allclose(element_matrices(t, moduli), expected, atol=1e-13 * np.abs(expected).max())
    nodal = random.standard_normal((t.elements, gradient.shape[-1], 3))
    expected = np.einsum("etqAn,ena->etqaA", gradient, nodal)
    np.testing.assert_allclose(
        displacement_gradients(t, nodal.reshape(t.elements, t.axial.shape[2], -1, 3)),
        expected,
        atol=1e-13 * np.abs(expected).max(),
    )
    expected = np.einsum("etq,etqAn,etqaA->ena", t.weights, gradient, moduli[..., 0, 0])
    forces = np.zeros(expected.size)
    add_stress(
        t, moduli[..., 0, 0], np.arange(0, forces.size, 3 * t.section.shape[2]).reshape(len(t.axial), -1), forces
    )
    np.testing.assert_allclose(forces.reshape(expected.shape), expected, atol=1e-13 * np.abs(expected).max())


# Explicit steps


def test_the_critical_step_is_estimated_again_where_contact_begins():
    """Long before the steps taken bring an estimate by themselves, and once only: not again while it lasts."""
    # Where no step ends at the wall: rounding would say which points touch.
    wall = Contact(0, Plane((1.053, 0.0, 0.0), (-1.0, 0.0, 0.0)), 2000.0, points=(3, 3))
    model = bar(held="", contacts=[wall])
    history = dynamics.solve(model, 0.11, 0.01, outputs=11, velocity=thrown(model, [1.0, 0.0, 0.0]))
    assert history.steps == 11
    touching = history.contact_area > 0.0
    first = int(np.argmax(touching))
    assert 0 < first < 8 and touching[first:].all()
    times, steps = history.estimates.T
    np.testing.assert_allclose(times, [0.0, history.times[first]], rtol=1e-12)
    assert steps[1] < steps[0]


def test_a_step_that_contact_makes_unstable_is_shortened_at_once():
    """A stiff penalty: the step that follows is stable, and energy is kept."""
    wall = Contact(0, Plane((1.02, 0.0, 0.0), (-1.0, 0.0, 0.0)), 5e4)
    model = bar(held="", contacts=[wall])
    history = dynamics.solve(model, 0.04, outputs=200, velocity=thrown(model, [1.0, 0.0, 0.0]))
    assert history.steps < 1000
    begun = history.times[np.argmax(history.contact_area > 0.0)]
    assert begun in history.estimates[:, 0]


def squashed(a=1.2, b=0.4, length=3.0):
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    rod = Rod.sweep(ellipse(8, a, b), axis, np.outer([0.0, 0.5, 1.0], [0.0, 0.0, length]))
    return Space.paper(rod, elements=3, quadrature="full")


@pytest.mark.parametrize(("a", "b"), [(1.2, 0.4), (0.4, 1.2)])
def test_the_most_mass_that_is_added_trebles_the_inertia_about_the_thin_axis(a, b):
    """Of a section that turns out of its plane: ``rho I`` and ``E A``, so the wide axis gets ``2 (b / a)^2`` more."""
    length, density = 3.0, 2.0
    space = squashed(a, b, length)
    model = Model([Body(space, NeoHookean(20.0, 0.3), density)])
    mass = Mass(model, mesh.order(model))
    whole = density * np.pi * a * b * length
    for axis, half in enumerate((a, b)):
        velocity = np.zeros((space.nodes, 3))
        velocity[:, 2] = space.positions[:, axis]
        mass.scaling = 0.0
        before = velocity.ravel() @ mass.momenta(velocity.ravel())
        assert before == pytest.approx(whole * half**2 / 4.0, rel=1e-6)
        mass.scaling = mass.largest_scaling
        after = velocity.ravel() @ mass.momenta(velocity.ravel())
        assert after / before == pytest.approx(1.0 + 2.0 * (min(a, b) / half) ** 2, rel=1e-6)


def test_the_thinnest_and_lightest_of_all_elements_and_bodies_bounds_the_mass_added():
    """``s = 2 min(rho / E' r^2)``, ``E' = lambda + 2 mu``."""
    space, law = squashed(1.0, 0.5), NeoHookean(20.0, 0.3)
    modulus = law.lame + 2.0 * law.mu

    def largest(*bodies):
        model = Model(bodies)
        return Mass(model, mesh.order(model)).largest_scaling

    expected = 2.0 / modulus * 0.25 * 0.25
    heavy, light = Body(space, law, [4.0, 3.0, 5.0]), Body(squashed(1.0, 1.0), law, 0.25)
    assert largest(heavy) == pytest.approx(3.0 * expected, rel=1e-6)
    assert largest(light) == pytest.approx(1.0 * expected, rel=1e-6)
    assert largest(heavy, light) == largest(light, heavy) == pytest.approx(expected, rel=1e-6)
