"""The element: patch test (Lu & Zhou 2011, section 4.1), zero-energy modes, rigid motion."""

import numpy as np
import pytest
from scipy.optimize import brentq

from isorod import Axis, Body, Model, Rod, Space, StVenantKirchhoff, Support, ellipse, statics
from isorod.assembly.assembler import Assembler
from isorod.assembly.region import Region
from isorod.material import LinearElastic, NeoHookean
from isorod.scenes.spring import Spring

# section 4.1: E, nu; the unit cylinder is stretched by half its height
LAW = NeoHookean(1e6, 0.3)
STRETCH = 1.5
STRAIN = 0.625

RULES = ["paper", "full"]
XI = np.array([[0.0, 0.0], [0.5, 0.2], [-0.3, 0.9], [1.0, 0.0], [0.0, -1.0]])


def lateral_stretch(law, stretch):
    """Solve the scalar equation of no lateral stress in simple tension."""
    return brentq(lambda t: law.mu * (t * t - 1) + law.lame * np.log(t * t * stretch), 0.5, 1.5, xtol=1e-16, rtol=1e-15)


def nodes(space):
    """Positions at rest of the control points of the displacement space, shape ``(nodes, 3)``."""
    rod = space.rod
    return rod.axis.transfer(space.axis, rod.control_points)[: space.layers].reshape(-1, 3)


def on_rollers(space):
    """Both faces on rollers, the upper displaced, and just what keeps the cylinder from moving sideways and turning."""
    n = space.layer_nodes
    if n % 2 == 0:
        fixed, other, line = 0, n // 2, "y"
    else:
        fixed, other, line = (n - 1) // 2, (n + 1) // 2, "x"
    supports = [
        Support.end(space, "start", "z"),
        Support.end(space, "end", "z", (0.0, 0.0, STRETCH - 1)),
        Support([fixed], "xy"),
        Support([other], line),
    ]
    return Model([Body(space, LAW)], supports), fixed


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("p", [2, 3])
@pytest.mark.parametrize("n", [3, 4, 8, 16])
def test_patch_of_the_paper(n, p, rule, cylinder, petsc_options):
    petsc_options(snes_rtol=1e-14)
    space = Space.paper(cylinder(n), degree=p, quadrature=rule)
    model, fixed = on_rollers(space)
    solution = statics.solve(model)
    u, x = model.nodal(solution.displacement), nodes(space)
    t = lateral_stretch(LAW, STRETCH)
    exact = (x - x[fixed] * [1, 1, 0]) * [t - 1, t - 1, STRETCH - 1]
    assert np.abs(u - exact).max() < 1e-12 * np.abs(exact).max()
    if p == 2:
        assert np.abs(u.reshape(3, n, 3)[1, :, 2] - 0.25).max() < 1e-12 * 0.25
    _, F = space.displacement(u, XI, [0.0, 0.3, 1.0])
    strain = 0.5 * (F.swapaxes(-1, -2) @ F - np.eye(3))
    assert np.abs(strain[..., 2, 2] - STRAIN).max() < 1e-12 * STRAIN
    assert np.abs(F - np.diag([t, t, STRETCH])).max() < 1e-12
    # the force is the uniaxial stress times the area: pi in the rule as in truth
    force = np.pi * (LAW.mu * STRETCH + (LAW.lame * np.log(t * t * STRETCH) - LAW.mu) / STRETCH)
    assert solution.reactions[1, 2] == pytest.approx(force, rel=1e-12)
    assert np.abs(solution.reactions[2:]).max() < 1e-12 * force


SHEAR = np.array([[1.0, 0.2, 0.5], [0.1, 1.0, -0.4], [0.3, -0.2, 1.0]])


def distorted(n, weights=(1.0, 1.0, 1.0, 1.0, 1.0)):
    """A sheared elliptical prism of three unequal elements whose layers are not evenly spaced either."""
    axis = Axis(2, np.repeat([0.0, 0.2, 0.75, 1.0], [3, 1, 1, 3]), weights)
    rod = Rod.sweep(ellipse(n, 1.0, 0.6), axis, np.outer([0.0, 0.15, 0.4, 0.8, 1.0], [0.0, 0.0, 1.3]))
    return Rod(axis, rod.control_points @ SHEAR.T)


def turn(axis, angle):
    axis = np.asarray(axis) / np.linalg.norm(axis)
    K = np.cross(np.eye(3), axis)
    return np.eye(3) - np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def tension_along_the_generators(space):
    """Solve for tension along the generators of a prism, and a turn: its lateral surface then carries no traction.

    Both faces are put where the affine map has them.  Returns the map's gradient, the generators' direction, the
    displacements and their exact values.
    """
    a = SHEAR[:, 2] / np.linalg.norm(SHEAR[:, 2])
    t = lateral_stretch(LAW, STRETCH)
    gradient = turn([1.0, 2.0, -0.5], 0.6) @ (t * np.eye(3) + (STRETCH - t) * np.outer(a, a))
    exact = nodes(space) @ (gradient - np.eye(3)).T
    faces = [*range(space.layer_nodes), *range(space.nodes - space.layer_nodes, space.nodes)]
    model = Model([Body(space, LAW)], [Support([k], "xyz", tuple(exact[k])) for k in faces])
    assert model.unknowns >= 9 * space.layer_nodes
    return gradient, a, model.nodal(statics.solve(model).displacement), exact


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("p", [2, 3])
@pytest.mark.parametrize("n", [3, 4, 8, 16])
def test_patch_on_a_distorted_cylinder(n, p, rule, petsc_options):
    petsc_options(snes_rtol=1e-14)
    space = Space.paper(distorted(n), degree=p, quadrature=rule)
    gradient, a, u, exact = tension_along_the_generators(space)
    assert np.abs(u - exact).max() < 1e-12 * np.abs(exact).max()
    _, F = space.displacement(u, XI, [0.0, 0.1, 0.2, 0.6, 1.0])
    strain = 0.5 * np.einsum("a,tqba,tqbc,c->tq", a, F, F, a) - 0.5
    assert np.abs(strain - STRAIN).max() < 1e-12 * STRAIN
    assert np.abs(F - gradient).max() < 1e-12


def test_patch_on_a_rational_axis_is_as_good_as_the_rule_along_it(petsc_options):
    """With unequal weights the functions are rational, and Gauss points integrate them to any accuracy, not exactly."""
    petsc_options(snes_rtol=1e-14)
    errors = []
    for points in (3, 6, 12):
        space = Space.paper(distorted(5, (1.0, 0.9, 1.2, 1.1, 1.0)), quadrature=f"2x1x{points}")
        _, _, u, exact = tension_along_the_generators(space)
        errors.append(np.abs(u - exact).max() / np.abs(exact).max())
    assert errors[0] > 1e-6
    assert errors[1] < 1e-3 * errors[0]
    assert errors[2] < 1e-12


def stiffness(space, law):
    (part,) = Assembler(Model([Body(space, law)])).parts
    return part.matrices(np.zeros(space.nodes * 3), 0.0)


@pytest.mark.parametrize("law", [LinearElastic(2.0, 0.3), StVenantKirchhoff(2.0, 0.3)], ids=["linear", "at rest"])
def test_section_sums_of_one_place_serve_a_straight_rod_of_a_linear_law(law, cylinder, monkeypatch):
    """Elements of several lengths, against one place after the other; a law that knows the state has no such sums."""
    rod = cylinder(6).refine(4, 3, 2).insert(0.1)
    space = Space(rod, order=2, degree=3)
    (part,) = Assembler(Model([Body(space, law)])).parts
    (one,) = part.regions
    assert (one._volumes is None) == law.objective
    found = stiffness(space, law)
    monkeypatch.setattr(Region, "_volumes", None)
    expected = stiffness(space, law)
    assert np.abs(found - expected).max() < 1e-14 * np.abs(expected).max()


def single_elements(n, cylinder):
    yield cylinder(n)
    yield Rod(cylinder(n).axis, cylinder(n).control_points @ SHEAR.T)


@pytest.mark.parametrize("law", [NeoHookean(1.0, 0.3), LinearElastic(1.0, 0.3)], ids=["neo-Hooke", "linear"])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("p", [2, 3])
@pytest.mark.parametrize("n", range(3, 17))
def test_single_element_has_exactly_six_zero_eigenvalues(n, p, rule, law, cylinder):
    for rod in single_elements(n, cylinder):
        (matrix,) = stiffness(Space.paper(rod, degree=p, quadrature=rule), law)
        assert np.abs(matrix - matrix.T).max() < 1e-14 * np.abs(matrix).max()
        values = np.linalg.eigvalsh(matrix) / np.abs(matrix).max()
        assert np.abs(values[:6]).max() < 1e-14
        assert values[6] > 1e-4


@pytest.mark.parametrize("n", [3, 4, 8, 16])
def test_elements_of_the_spring_have_exactly_six_zero_eigenvalues_with_the_papers_rule(n):
    space = Space.paper(Spring(helix="paper", section_points=n, coils=1).rod(), quadrature="paper")
    for matrix in stiffness(space, NeoHookean(1.0, 0.3)):
        values = np.linalg.eigvalsh(matrix) / np.abs(matrix).max()
        assert np.abs(values[:6]).max() < 1e-13
        assert values[6] > 1e-4


@pytest.mark.parametrize("rule", RULES)
def test_rigid_motion_leaves_no_residual(rule):
    space = Space.paper(Spring(helix="paper", section_points=5, coils=1).rod(), elements=8, degree=3, quadrature=rule)
    assembler = Assembler(Model([Body(space, NeoHookean(1.0, 0.3))]))
    x, residual = assembler.vector(), assembler.vector()
    Q = turn([1.0, -2.0, 3.0], 2.5)
    x.array[:] = (nodes(space) @ (Q - np.eye(3)).T + [10.0, -20.0, 5.0]).ravel()
    assembler.residual(x, 0.0, residual)
    assert np.abs(residual.array_r).max() < 1e-13
    assert abs(assembler.energy(x, 0.0)) < 1e-13
    # what a motion that is not rigid leaves
    x.array[:] = 1.01 * x.array
    assembler.residual(x, 0.0, residual)
    assert np.abs(residual.array_r).max() > 1e-4
