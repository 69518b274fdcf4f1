"""Contact of bodies with the mixed formulation: exact derivatives, quadratic Newton, the same on several ranks."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from conftest import as_array, straight
from loads import assert_load_forces_are_differences
from test_derivatives import difference, moved, residual
from test_mixed import inf_sup

from comparisons.contact import crossed
from isorod import Body, Contact, Model, Muscle, NeoHookean, Plane, Rod, Space, Support, statics
from isorod.assembly.mixed import MixedAssembler
from isorod.space.closer import Patch, closer

ACROSS = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # z to x


def crossing(nu=0.4999, gap=-0.1, press=0.5, formulation="mixed", order=1, **contact):
    """Two crossing bars of radius 1, ends clamped; those of the second are pressed down on the first, which is mixed.

    The other one is not, if it is not nearly incompressible: what couples them has pressures on one side alone.
    """
    rod = straight(8, degree=3, breaks=(0.0, 1.0, 2.0, 3.0, 4.0), height=8.0)
    points = rod.control_points - [0.0, 0.0, 4.0]
    low = Space.paper(Rod(rod.axis, points), degree=3, order=order, quadrature="auto")
    high = Space.paper(
        Rod(rod.axis, points @ ACROSS.T + [0.0, 2.0 + gap, 0.0]), degree=3, order=order, quadrature="auto"
    )
    supports = [Support.end(low, "start"), Support.end(low, "end")]
    supports += [Support.end(high, end, displacement=(0.0, -press, 0.0), body=1) for end in ("start", "end")]
    law = NeoHookean(3000.0, nu)
    bodies = [Body(low, law, formulation=formulation), Body(high, NeoHookean(1000.0, 0.3))]
    return Model(bodies, supports, contacts=[Contact(0, 1, **{"penalty": 1e4, "points": (3, 4)} | contact)])


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("nu", [0.4999, 0.5])
def test_tangent_is_the_derivative_of_the_residual(nu, friction):
    model = crossing(nu, friction=friction)
    assembler = MixedAssembler(model)
    x = moved(assembler.vector(), 0.003 * np.random.default_rng(1).standard_normal(assembler.unknowns))
    if friction:
        # What sticks and slips has been somewhere before.
        assembler.residual(assembler.vector(), 0.2, assembler.vector())
        assembler.contact.accept(assembler.displacement(assembler.vector(), 0.2))
    assert assembler.symmetric == (not friction)
    matrix = assembler.matrix()
    assembler.tangent(x, 0.2, matrix)
    tangent = as_array(matrix)
    first, second = (
        assembler.state(np.where(np.arange(model.dofs) // (3 * model.first_node[1]) == b, 1.0, 0.0)).array > 0.0
        for b in (0, 1)
    )
    assert np.abs(tangent[np.ix_(first, second)]).max() > 1.0
    asymmetry = np.abs(tangent - tangent.T).max() / np.abs(tangent).max()
    assert asymmetry > 1e-6 if friction else asymmetry < 1e-12
    rng = np.random.default_rng(1)
    for _ in range(3):
        v = rng.standard_normal(assembler.unknowns)
        change = difference(lambda t, v=v: residual(assembler, moved(x, t * v), 0.2), 1e-6)
        np.testing.assert_allclose(tangent @ v, change, atol=1e-6 * np.abs(change).max())


def test_load_forces_include_contact_of_held_nodes():
    """The bar without pressures, all held, moves onto the other: its prescribed motion acts through contact alone."""
    model = crossing(gap=-0.02)
    high = model.bodies[1].space
    everything = Support(np.arange(high.nodes), "xyz", high.is_control_point[:, None] * np.array([0.0, -0.01, 0.0]), 1)
    assembler = MixedAssembler(replace(model, supports=[*model.supports[:2], everything]))
    assert_load_forces_are_differences(assembler)


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_newton_is_quadratic_and_forces_balance(friction, petsc_options):
    petsc_options(snes_rtol=1e-13)
    solution = statics.solve(crossing(gap=0.05, friction=friction), load_steps=2)
    norms = [norm for norm in solution.residual_norms[1:] if norm > 1e-10]
    orders = [np.log(c / b) / np.log(b / a) for a, b, c in zip(norms, norms[1:], norms[2:], strict=False)]
    print("residual norms", *(f"{norm:.2e}" for norm in solution.residual_norms))
    assert orders[-1] > 1.7
    down = solution.reactions[2:].sum(axis=0)
    np.testing.assert_allclose(solution.reactions[:2].sum(axis=0), -down, atol=1e-6)
    assert -down[1] > 30.0


def test_pressures_are_chosen_with_contact_as_without():
    """Fibres take them later; what knows none, and whoever says so, has displacements alone."""
    low = crossing().bodies[0].space
    for law, chosen in (
        (NeoHookean(1.0, 0.489), "displacement"),
        (NeoHookean(1.0, 0.49), "mixed"),
        (Muscle(1.0, 0.498), "displacement"),
        (Muscle(1.0, 0.499), "mixed"),
    ):
        body = Body(low, law)
        model = Model([body], contacts=[Contact(0, Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0)))])
        assert body.formulation == model.bodies[0].formulation == chosen
        assert model.in_motion("implicit").bodies[0].formulation == chosen
        assert model.in_motion("explicit").bodies[0].formulation == "displacement"


def test_pressures_too_poor_for_a_patch_are_warned_of():
    """With order 1 the largest pressure of crossing bars at ``nu`` 0.4999 is 660 in place of 2023, the force 2.5 % off.

    As many more waves as there are points for make the force 8 % too large, as it is of order 1 at ``nu`` 0.3.
    """
    with pytest.warns(UserWarning, match=r"^contact 0: .* linear across the section of body 0; .*; use order 2"):
        model = crossing()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        crossing(order=2)
        replace(model, contacts=[])
        crossing(nu=0.3, formulation="displacement")


@pytest.mark.slow
def test_nearly_incompressible_cylinders_are_those_of_hertz():
    """Radius by area and by the pressure's second moment, and largest pressure, at three control points across."""
    pair = crossed.Cylinders(0.499999, None, 3.0)
    model = pair.by_push()
    assert model.bodies[0].formulation == "mixed"
    found = pair.errors(crossed.solve(model))
    print(found)
    assert max(map(abs, found.values())) < 0.03


# Pressures


def test_inf_sup_constant_with_many_control_points_all_round_and_at_a_patch():
    """Pressures are as local as contact, and yet no displacement is lost to them."""
    many = Space.paper(straight(n=16, height=4.0), elements=2, degree=3, order=2)
    assert many.basis.pressure_count == 14
    patch = closer(straight(8, degree=2, height=2.0), [Patch(0.5, 0.3, 0.15, 0.15, 0.5)])
    assert patch.basis.order == 3
    found = [inf_sup(one) for one in (many, patch)]
    print(*(f"{beta:.3f}" for beta in found))
    assert min(found) > 0.3


def test_pressures_of_order_less_by_one_are_those_of_polynomials_of_few_points():
    """With eight control points and order 2, as before: those of degree 2."""
    xi = np.random.default_rng(2).uniform(-0.7, 0.7, (20, 2))
    found = Space.paper(straight(n=8, height=3.0), order=2).basis.pressures(xi)
    x, y = xi.T
    wanted = np.stack([x**0, x, y, x * x, x * y, y * y], axis=1)
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found @ np.linalg.lstsq(found, wanted, rcond=None)[0], wanted, atol=1e-13)
