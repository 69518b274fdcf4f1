"""A law that is one file: St. Venant-Kirchhoff in statics, modes and both integrators."""

import numpy as np
import pytest
from conftest import as_array
from scipy.linalg import eigh

from isorod import dynamics, modal, statics
from isorod.assembly.assembler import Assembler
from isorod.material import LinearElastic
from isorod.material.st_venant_kirchhoff import StVenantKirchhoff
from isorod.model import Body, Model, Support
from isorod.space import Space

LAW = StVenantKirchhoff(100.0, 0.3)
EYE = np.eye(3)
DENSITY, LENGTH = 2.0, 4.0


def gradients():
    return EYE + 0.25 * np.random.default_rng(0).uniform(-1, 1, (20, 3, 3))


def test_stress_and_tangent_are_derivatives():
    F, step = gradients(), 1e-5
    stress, tangent = LAW.stress(F), LAW.tangent(F)
    for a in range(3):
        for A in range(3):
            move = np.zeros((3, 3))
            move[a, A] = step
            energy = (LAW.energy(F + move) - LAW.energy(F - move)) / (2.0 * step)
            np.testing.assert_allclose(stress[:, a, A], energy, atol=1e-9 * np.abs(stress).max())
            slope = (LAW.stress(F + move) - LAW.stress(F - move)) / (2.0 * step)
            np.testing.assert_allclose(tangent[..., a, A], slope, atol=1e-9 * np.abs(tangent).max())


def test_at_rest_it_is_linear_elasticity_and_knows_no_rotation():
    moduli = LinearElastic(100.0, 0.3).tangent(EYE[None])
    np.testing.assert_allclose(LAW.tangent(EYE[None]), moduli, atol=1e-13 * moduli.max())
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    F = gradients()
    np.testing.assert_allclose(LAW.energy(turn @ F), LAW.energy(F), rtol=1e-12)
    assert np.abs(LAW.stress(turn[None])).max() < 1e-13
    for found in (LAW.energy, LAW.stress, LAW.tangent):
        assert np.isnan(found(np.diag([1.0, 1.0, -1.0])[None])).any()


@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9])
def test_small_strains_keep_their_digits(size):
    """The energy, of squares of strains, has as many as these have in ``F``."""
    F = EYE + size * np.random.default_rng(0).uniform(-1, 1, (20, 3, 3))
    change = F - EYE
    strain = 0.5 * (change + change.swapaxes(1, 2) + change.swapaxes(1, 2) @ change)
    trace = np.trace(strain, axis1=1, axis2=2)
    energy = LAW.mu * np.sum(strain**2, axis=(1, 2)) + 0.5 * LAW.lame * trace**2
    assert LAW.energy(F) == pytest.approx(energy, rel=3e-15 / size)


def test_what_is_no_number_stays_none_without_a_word(python):
    done = python(
        "import numpy as np\nfrom isorod import StVenantKirchhoff\n"
        "print(np.isnan(StVenantKirchhoff(1.0, 0.3).stress(np.full((1, 3, 3), np.nan))).all())"
    )
    assert (done.stdout, done.stderr) == ("True\n", "")


def bar(cylinder, law=LAW, elements=2, held="xyz"):
    space = Space.paper(cylinder(4, height=LENGTH), elements=elements, degree=2, quadrature="auto")
    return Model([Body(space, law, DENSITY)], [Support.end(space, "start", held)])


def swing(model):
    space = model.bodies[0].space
    x = space.positions
    return (np.stack([0.4 * x[:, 2], 0.0 * x[:, 0], 0.0 * x[:, 0]], axis=1) * space.is_carrier[:, None]).ravel()


@pytest.mark.parametrize("stretch", [0.9, 1.2])
def test_a_stretched_bar_bears_what_the_law_says(stretch, cylinder):
    """nu = 0: no strain across, ``P = E L (L^2 - 1) / 2`` along."""
    space = Space.paper(cylinder(4, height=LENGTH), elements=2)
    ends = [
        Support.end(space, "start"),
        Support.end(space, "end", displacement=(0.0, 0.0, (stretch - 1.0) * LENGTH)),
    ]
    solution = statics.solve(Model([Body(space, StVenantKirchhoff(100.0, 0.0))], ends))
    force = 50.0 * stretch * (stretch**2 - 1.0) * np.pi
    assert solution.reactions[1, 2] == pytest.approx(force, rel=1e-9)


def test_modes_about_rest_are_those_of_linear_elasticity(cylinder):
    found, expected = (modal.solve(bar(cylinder, law), modes=3) for law in (LAW, LinearElastic(100.0, 0.3)))
    np.testing.assert_allclose(found.frequencies, expected.frequencies, rtol=1e-9)


def test_the_critical_step_is_that_of_the_tangent(cylinder):
    """For the bar at rest: the highest frequency there is."""
    model = bar(cylinder)
    assembler = Assembler(model)
    matrix = assembler.matrix()
    assembler.tangent(assembler.vector(), 1.0, matrix)
    largest = eigh(as_array(matrix), as_array(assembler.mass()), eigvals_only=True)[-1]
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    assert critical == pytest.approx(2.0 / np.sqrt(largest), rel=1e-3)


def test_explicit_and_implicit_motion_are_the_same(cylinder):
    """Large rotations: the difference falls with the square of the step, energy is kept by both."""
    model = bar(cylinder)
    explicit = dynamics.solve(model, 2.0, 0.0025, outputs=1, velocity=swing(model))
    assert np.abs(explicit.energy_error).max() < 1e-4
    size, errors = np.abs(explicit.displacement[-1]).max(), []
    for step in (0.02, 0.01):
        implicit = dynamics.solve(model, 2.0, step, outputs=1, velocity=swing(model), integrator="implicit")
        assert np.abs(implicit.energy_error).max() < 1e-9
        errors.append(np.abs(implicit.displacement[-1] - explicit.displacement[-1]).max())
    print("differences", errors, "of", size)
    assert size > 0.2 * LENGTH
    assert errors[1] < 0.01 * size
    assert errors[1] < 0.3 * errors[0]


def test_mass_is_added_for_a_longer_step(cylinder):
    """The law's modulus scales the added mass."""
    model = bar(cylinder)
    critical = dynamics.solve(model, 1e-9, outputs=1).critical_step
    history = dynamics.solve(model, 40.0 * critical, 2.0 * critical, outputs=4, velocity=0.1 * swing(model))
    assert history.critical_step > history.time_step > 1.9 * critical
    assert np.abs(history.energy_error).max() < 1e-2
