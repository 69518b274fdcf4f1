"""Tubes and layered rods in motion, explicit and implicit steps: forces, masses, composite frequencies, energy."""

from dataclasses import replace

import numpy as np
import pytest
from test_rings import MODULI, B, prism

from isorod import Muscle, Space, dynamics, modal
from isorod.assembly.assembler import Assembler
from isorod.dynamics.explicit import mesh
from isorod.dynamics.explicit.element_kernel import internal_forces
from isorod.dynamics.explicit.mass import Mass
from isorod.material import NeoHookean, fibre
from isorod.model import Body, Model, Support

LENGTH = 4.0
LAYERS = (0.0, 0.4, 0.75, 1.0)
MUSCLE = Muscle(30.0, 0.4, sigma_max=30.0, m1=35.0, m2=0.5, activation=0.8, fibre=fibre.helix(40.0))


def rod(rings, laws, density=1.0, held="xyz", length=LENGTH, formulation=None, **keywords):
    given = {"section_degree": 3, "elements": 3, "degree": 3, "quadrature": "auto"} | keywords
    space = Space(prism(rings, length=length), **given)
    supports = [Support.end(space, "start", held)] if held else []
    return Model([Body(space, laws, density, formulation)], supports)


CORE = [NeoHookean(20.0, 0.3), MUSCLE, NeoHookean(200.0, 0.2)]


def shaken(model, size=0.02):
    noise = size * np.random.default_rng(3).standard_normal(model.dofs)
    noise[model.held] = 0.0
    return noise


@pytest.mark.parametrize("by_element", [False, True])
def test_compiled_forces_and_energies_are_the_assemblers(by_element):
    """With fibres in one of the layers, which contract."""
    laws = [[*CORE], [CORE[1], CORE[0], CORE[1]], [CORE[2], CORE[0], CORE[0]]] if by_element else CORE
    model = rod(LAYERS, laws, [1.0, 2.0, 3.0])
    packed, places, displacement = mesh.pack(model), mesh.order(model), shaken(model)
    assembler = Assembler(model)
    x, expected = assembler.state(displacement), assembler.vector()
    u, forces = np.empty(model.dofs), np.empty(model.dofs)
    u[places] = displacement
    for factor in (0.0, 0.6):
        assembler.residual(x, factor, expected)
        inverted, stored, active, _ = internal_forces(packed, u, factor, True, False, forces)
        assert inverted == 0.0
        assert forces[places][model.free >= 0] == pytest.approx(
            expected.array, abs=1e-12 * np.abs(expected.array).max()
        )
        assert stored + factor * active == pytest.approx(assembler.energy(x, factor), rel=1e-12)


def test_mass_is_that_of_the_layers_and_the_most_that_is_added_trebles_their_inertia():
    """``rho I`` of a section that turns, all layers', gets ``s`` times their ``E' A``."""
    density, edges = np.array([4.0, 1.0, 9.0]), B * np.array(LAYERS)
    laws = [NeoHookean(one, 0.3) for one in MODULI]
    model = rod(LAYERS, laws, list(density), held="", quadrature="full")
    space, mass = model.bodies[0].space, Mass(model, mesh.order(model))
    whole = np.pi * LENGTH * density @ np.diff(edges**2)
    turning = np.pi / 4 * LENGTH * density @ np.diff(edges**4)
    along, turned = np.zeros((2, space.nodes, 3))
    along[space.is_control_point, 2], turned[:, 2] = 1.0, space.positions[:, 0]
    assert along.ravel() @ mass.momenta(along.ravel()) == pytest.approx(whole, rel=1e-10)
    assert turned.ravel() @ mass.momenta(turned.ravel()) == pytest.approx(turning, rel=1e-10)
    mass.scaling = mass.largest_scaling
    moduli = np.array([law.modulus for law in laws])
    assert mass.scaling == pytest.approx(2.0 * turning / (np.pi * LENGTH * moduli @ np.diff(edges**2)), rel=1e-8)
    assert turned.ravel() @ mass.momenta(turned.ravel()) == pytest.approx(3.0 * turning, rel=1e-8)


def swings(model, shape, frequency, integrator):
    """A motion let go in a mode, over half of its period, small: the last displacement over the first."""
    steps = {} if integrator == "explicit" else {"time_step": 0.5 / frequency / 40, "integrator": "implicit"}
    run = dynamics.solve(model, 0.5 / frequency, outputs=2, displacement=1e-4 * shape, **steps)
    assert np.abs(run.energy_error).max() < (1e-3 if integrator == "explicit" else 1e-6)
    middle, last = run.displacement[1:] @ shape / (run.displacement[0] @ shape)
    return middle, last


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
@pytest.mark.parametrize("rings", [(0.5, 1.0), LAYERS], ids=["hollow", "layered"])
def test_torsional_vibration(rings, integrator):
    """``u = r sin(k z) cos(k c t)``: exact in any layers of one speed ``c = sqrt(mu / rho)`` of shear waves, here 5."""
    moduli = MODULI if len(rings) > 2 else MODULI[1:2]
    laws, density = [NeoHookean(one, 0.25) for one in moduli], [one / 2.5 / 25.0 for one in moduli]
    one = len(laws) == 1
    model = rod(rings, laws[0] if one else laws, density[0] if one else density, length=10.0)
    space, frequency = model.bodies[0].space, 5.0 / 40.0
    axis, nodal = space.axis, space.positions.reshape(space.layers, -1, 3)
    # Of the function of the axis that is nearest to sin(k z) times the turned section.
    u = np.linspace(*axis.breaks[[0, -1]], 60)
    table = np.zeros((60, space.layers))
    first, values, _ = axis.local(u)
    np.put_along_axis(table, first[:, None] + np.arange(values.shape[1]), values, axis=1)
    height = space.rod.grid([[0.0, 0.0]] if rings[0] == 0.0 else [[1.0, 0.0]], u)[0][:, 0, 2]
    along = np.linalg.lstsq(table, np.sin(np.pi * height / 20.0), rcond=None)[0]
    along[0] = 0.0
    shape = (along[:, None, None] * nodal @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])).ravel()
    shape[model.held] = 0.0
    middle, last = swings(model, shape, frequency, integrator)
    assert middle == pytest.approx(0.0, abs=2e-3) and last == pytest.approx(-1.0, abs=1e-4)


@pytest.mark.parametrize("integrator", ["explicit", "implicit"])
def test_longitudinal_vibration_of_a_slender_layered_bar(integrator):
    """``sqrt(sum E A / sum rho A)``: what layers of different speeds have together, where they are slender."""
    density, length, area = np.array([3.0, 1.0, 8.0]), 400.0, np.diff(np.array(LAYERS) ** 2)
    laws = [NeoHookean(one, 0.0) for one in MODULI]
    model = rod(LAYERS, laws, list(density), held="", length=length, section_degree=2)
    space = model.bodies[0].space
    model = replace(model, supports=[Support.end(space, "start", "z"), Support(np.arange(space.nodes), "xy")])
    frequency = np.sqrt(area @ MODULI / (area @ density)) / (4.0 * length)
    found = modal.solve(model, 1)
    assert found.frequencies[0] == pytest.approx(frequency, rel=1e-4)
    shape = found.vectors[0] / np.abs(found.vectors[0]).max()
    middle, last = swings(model, shape, frequency, integrator)
    assert middle == pytest.approx(0.0, abs=2e-3) and last == pytest.approx(-1.0, abs=1e-3)


RUBBERS = [NeoHookean(20.0, 0.5), NeoHookean(100.0, 0.3)]


@pytest.mark.parametrize(
    ("rings", "laws", "formulation"),
    [
        ((0.0, 0.6, 1.0), [NeoHookean(20.0, 0.3), NeoHookean(100.0, 0.3)], "displacement"),
        ((0.0, 0.6, 1.0), RUBBERS, "mixed"),
        ((0.5, 1.0), RUBBERS[0], "mixed"),
    ],
    ids=["layers", "layers, one incompressible", "incompressible tube"],
)
def test_implicit_steps_keep_energy_and_momenta_whatever_the_step(rings, laws, formulation):
    """A free rod, thrown, turning and bending by far."""
    density = [1.0, 3.0] if len(rings) > 2 else 1.0
    model = rod(rings, laws, density, held="", formulation=formulation, section_degree=2, elements=2, length=10.0)
    space = model.bodies[0].space
    x = space.positions
    velocity = np.outer(x[:, 2] * x[:, 2] / 10.0, [0.5, 0.0, 0.0]) * space.is_control_point[:, None]
    velocity += np.cross([0.3, 0.0, 0.5], x)
    run = dynamics.solve(
        model, 10.0, 0.5, integrator="implicit", outputs=4, velocity=velocity.ravel(), petsc={"snes_rtol": 1e-12}
    )
    assert run.stored.max() > 0.01 * run.kinetic[0]
    assert np.abs(run.energy_error).max() < 1e-8
    assert np.abs(run.momentum_error).max() < 1e-9


def test_explicit_steps_of_layers_keep_their_energy_and_long_ones_are_stable():
    """A stiff core in a light soft sheath: the core's waves limit the step, added mass makes it ten times as long."""
    model = rod((0.0, 0.4, 1.0), [NeoHookean(2000.0, 0.3), NeoHookean(20.0, 0.45)], [3.0, 1.0], length=20.0)
    velocity = np.outer(model.bodies[0].space.positions[:, 2] / 20.0, [1.0, 0.0, 0.0]).ravel()
    velocity[model.held] = 0.0
    short = dynamics.solve(model, 10.0, outputs=5, velocity=velocity)
    assert np.abs(short.energy_error).max() < 1e-3
    long = dynamics.solve(model, 10.0, 10.0 * short.critical_step, outputs=5, velocity=velocity)
    assert long.added_kinetic.max() > 0.0 and np.abs(long.energy_error).max() < 1e-2
    moved = np.abs(short.displacement[-1]).max()
    assert long.displacement[-1] == pytest.approx(short.displacement[-1], abs=0.05 * moved)
    assert short.displacement[-1].reshape(-1, 3)[model.is_control_point][-1, 0] > 0.5 * moved > 0.5
