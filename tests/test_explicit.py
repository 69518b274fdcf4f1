"""The compiled forces, energies and critical step of explicit dynamics against those of the assembler."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import as_array
from scipy.linalg import eigh

from isorod import Axis, Body, InputError, Model, Muscle, Rod, Space, Support, circle, flower, helix
from isorod.assembly.assembler import Assembler
from isorod.dynamics.explicit.element_kernel import internal_forces
from isorod.dynamics.explicit.mesh import order as order_in_state
from isorod.dynamics.explicit.mesh import pack
from isorod.dynamics.explicit.system import System
from isorod.material import NeoHookean, fibre
from isorod.tensors import rotation

ELASTIC = NeoHookean(20.0, 0.3)
MUSCLE = Muscle(30.0, 0.45, sigma_max=30.0, m1=35.0, m2=0.5, activation=0.8, fibre=(0.2, -0.3, 1.0))


def ring():
    line = helix(3.0, 0.0, 1, 4)
    return line.sweep(circle(5, 0.7), closed=True)


def two_bodies(cylinder, order, law):
    first = Space.paper(cylinder(4, height=3.0), elements=3, order=order, quadrature="auto")
    second = Space.paper(ring(), degree=3, continuity=1, order=3 - order, quadrature="paper")
    bodies = [Body(first, [ELASTIC, law, ELASTIC], 1.0), Body(second, law, 2.0)]
    return Model(bodies, [Support.end(first, "start")])


def deformed(model, stretch, seed=0):
    """A random homogeneous deformation and some noise, with the size asked for."""
    rng = np.random.default_rng(seed)
    positions = np.concatenate([body.space.positions for body in model.bodies])
    noise = np.where(model.is_control_point[:, None], 1.0, 0.2) * rng.standard_normal(positions.shape)
    displacement = (positions @ (np.diag(stretch) - np.eye(3)) + 0.05 * noise).ravel()
    displacement[model.held] = model.values
    return displacement


# In turn: det F near 1; beyond the logarithm's series above and below; fibres beyond the range of active force and of
# the exponential's series; fibres too short for it.
STRETCHES = [(1.0, 1.05, 1.0), (1.5, 1.5, 1.4), (0.7, 0.75, 0.7), (0.6, 0.6, 3.0), (1.3, 1.3, 0.4)]


def askew():
    """Twisted, tapered, of an uneven section and with an axis askew: no entry of the inverse Jacobians is zero."""
    axis = Axis(2, np.repeat([0.0, 1.0], 3), np.ones(3))
    turns = [rotation((0.7, 0.4, 0.3)) @ rotation((0.0, 0.0, angle)) for angle in (0.0, 0.3, 0.6)]
    centers = np.array([[0.0, 0.0, 0.0], [0.6, 0.3, 1.0], [0.2, -0.4, 2.2]])
    stretches = np.array([1.0, 0.8, 0.7])[:, None, None] * np.eye(3)
    space = Space.paper(Rod.sweep(flower(7, 1, 0.6, 0.2), axis, centers, turns, stretches), elements=2, order=2)
    inverse = space.tabulate(0, 2).inverse
    assert np.abs(inverse).min(axis=(0, 1, 2)).max() > 0.0 and np.abs(inverse).max(axis=(0, 1, 2)).min() > 0.1
    # Fibres of another direction at each point.
    winding = replace(MUSCLE, fibre=fibre.helix(40.0))
    return Model([Body(space, winding, 1.0)], [Support.end(space, "start", "xz")])


@pytest.mark.parametrize("stretch", STRETCHES, ids=str)
@pytest.mark.parametrize("order", [1, 2, "askew"])
def test_forces_and_energies_are_the_assemblers(stretch, order, cylinder):
    model = askew() if order == "askew" else two_bodies(cylinder, order, MUSCLE)
    mesh, places = pack(model), order_in_state(model)
    displacement, assembler = deformed(model, stretch), Assembler(model)
    x, expected = assembler.state(displacement), assembler.vector()
    u, forces = np.empty(model.dofs), np.empty(model.dofs)
    u[places] = displacement
    for factor in (0.0, 0.6):
        assembler.residual(x, factor, expected)
        inverted, stored, active, _ = internal_forces(mesh, u, factor, True, False, forces)
        assert inverted == 0.0
        error = np.abs(forces[places][model.free >= 0] - expected.array).max() / np.abs(expected.array).max()
        print(f"stretch {stretch}, activation {factor}: forces {error:.1e}")
        assert error < 1e-12
        assert stored + factor * active == pytest.approx(assembler.energy(x, factor), rel=1e-12)


def test_points_are_counted_where_the_body_is_inverted(cylinder):
    model = Model([Body(Space.paper(cylinder(4), quadrature="paper"), ELASTIC, 1.0)])
    mesh, places = pack(model), order_in_state(model)
    positions = model.bodies[0].space.positions
    points = model.bodies[0].space.tabulate(0, 1).weights.size
    u, forces = np.zeros(model.dofs), np.empty(model.dofs)
    assert internal_forces(mesh, u, 1.0, False, False, forces)[0] == 0
    assert not forces.any()
    u[places] = (-2.0 * positions * [0.0, 0.0, 1.0]).ravel()
    assert internal_forces(mesh, u, 1.0, False, False, forces)[0] == points
    u[:] = np.nan
    assert internal_forces(mesh, u, 1.0, False, False, forces)[0] >= points


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_critical_step_is_that_of_the_eigenvalue_problem(level, cylinder):
    """The largest eigenvalue of the assembled tangent and mass, in a deformed state."""
    space = Space.paper(cylinder(4, height=3.0), elements=3, quadrature="auto")
    model = Model([Body(space, MUSCLE, 1.0)], [Support.end(space, "start")])
    displacement = deformed(model, (1.0, 1.0, 1.1), seed=2)
    assembler = Assembler(model)
    matrix = assembler.matrix()
    assembler.tangent(assembler.state(displacement), level, matrix)
    dense = as_array(matrix)
    mass = as_array(assembler.mass())
    largest = eigh(dense, mass, eigvals_only=True)[-1]
    made = System(model)
    made.state.displacement[made.order] = displacement
    found = made.critical_step(made.state.displacement, level)
    print(f"critical step {found:.8g}, exact {2 / np.sqrt(largest):.8g}")
    assert found == pytest.approx(2.0 / np.sqrt(largest), rel=1e-4)


def test_forces_are_divided_by_the_assemblers_mass(cylinder):
    """Of a body with components held at some nodes of a layer, and of a closed one."""
    model = two_bodies(cylinder, 2, ELASTIC)
    partly = Support(np.array([25, 26, 30]), "x")
    model = Model(model.bodies, [*model.supports, partly])
    made = System(model)
    dense = as_array(Assembler(model).mass())
    forces = np.random.default_rng(0).standard_normal(model.dofs)
    free = model.free >= 0
    for scaling in (0.0, 0.1):
        made.scale(scaling)
        velocity = made.velocity(forces)
        assert not velocity[made.order[~free]].any()
        np.testing.assert_allclose(made.momenta(velocity)[made.free], forces[made.free], rtol=1e-9, atol=1e-11)
        if scaling == 0.0:
            found = velocity[made.order][free]
            np.testing.assert_allclose(dense @ found, forces[made.order][free], rtol=1e-9, atol=1e-11)


def test_too_few_quadrature_points_for_a_mass(cylinder):
    model = Model([Body(Space.paper(cylinder(8), order=3, quadrature="2x1"), ELASTIC, 1.0)])
    with pytest.raises(InputError, match="quadrature: too few points for a positive mass of body 0; take 'auto'"):
        System(model)
