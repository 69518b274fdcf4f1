"""When Newton's iterations stop: what the out-of-balance force is compared with, for each kind of model."""

import numpy as np
import pytest
from conftest import straight
from petsc4py import PETSc

from isorod import Body, Contact, Model, Muscle, NeoHookean, Plane, SolveError, Space, Support, statics
from isorod.assembly.assembler import Assembler
from isorod.assembly.mixed import MixedAssembler
from isorod.assembly.part import ROUNDING
from isorod.checks.reactions import check_balance, support_forces, support_moments
from isorod.statics.convergence import Convergence


def assembler(kind):
    space = Space.paper(straight(4, height=3.0), elements=2, degree=2)
    ends = [Support.end(space, "start"), Support.end(space, "end", displacement=(0.0, 0.0, 0.1))]
    if kind == "mixed":
        return MixedAssembler(Model([Body(space, NeoHookean(3.0, 0.4), formulation="mixed")], ends))
    far = [Contact(0, Plane((5.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), 1.0)] if kind == "contact" else []
    return Assembler(Model([Body(space, NeoHookean(3.0, 0.4))], ends, contacts=far))


def prepared(kind, scale):
    """Balance of a load step whose predictor's force has the norm given, and a residual of forces all the same."""
    made = assembler(kind)
    matrix, x, out = made.matrix(), made.vector(), made.vector()
    made.tangent(x, 0.0, matrix)
    carried = made.residual(x, 1.0, out)
    balance = Convergence(made)
    balance.carried_force = carried
    balance.update(matrix, scale)

    def reached(size):
        """Whether a force on all unknowns, of this norm in all, is small enough at a relative tolerance of 1e-6."""
        out.set(size / out.getSize() ** 0.5)
        return balance.reached(out, size, 1e-6)

    return reached, carried, matrix, balance


def test_forces_in_contact_are_compared_with_those_carried_or_with_rounding_of_the_largest_stiffness():
    reached, carried, *_ = prepared("contact", 1e7)
    assert carried < 1.0
    assert reached(0.9e-6 * carried) and not reached(1.1e-6 * carried)
    reached, _, matrix, balance = prepared("contact", 0.0)
    floor = ROUNDING * balance.size * matrix.norm(PETSc.NormType.INFINITY)
    assert reached(0.9 * floor) and not reached(1.1 * floor)


def test_forces_on_pressures_have_units_of_their_own_and_are_compared_with_the_predictor_alone():
    made = assembler("mixed")
    matrix, x, out = made.matrix(), made.vector(), made.vector()
    made.tangent(x, 0.0, matrix)
    balance, scale = Convergence(made), 1e7
    balance.carried_force = carried = made.residual(x, 1.0, out)
    assert carried < 1.0
    moves = made.state(np.ones(made.model.dofs)).array > 0.0
    for which, allowed in ((moves, 1e-6 * carried), (~moves, 1e-6 * scale)):
        balance.update(matrix, scale)
        for share, wanted in ((0.9, True), (1.1, False)):
            out.array[:] = which * share * allowed / np.sqrt(which.sum())
            assert balance.reached(out, out.norm(), 1e-6) == wanted
    floor = ROUNDING * balance.size * matrix.norm(PETSc.NormType.INFINITY)
    balance.update(matrix, 0.0)
    out.set(0.9 * floor / out.getSize() ** 0.5)
    assert balance.reached(out, 0.9 * floor, 1e-6) and not balance.reached(out, 1.1 * floor, 1e-6)


def test_displacements_are_compared_with_the_forces_carried():
    """However large the predictor's is; and with the predictor's where it is the smaller one."""
    reached, carried, *_ = prepared("plain", 1e7)
    assert reached(0.9e-6 * carried) and not reached(1.1e-6 * carried)
    reached, *_ = prepared("plain", 0.1 * carried)
    assert reached(0.9e-7 * carried) and not reached(1.1e-7 * carried)


def test_size_of_a_model_is_that_of_its_largest_body():
    small, large = (Space.paper(straight(4, height=height)) for height in (3.0, 7.0))
    law = NeoHookean(1.0, 0.3)
    for spaces in ((small, large), (large, small)):
        assert Convergence(Assembler(Model([Body(space, law) for space in spaces]))).size == pytest.approx(7.0)


@pytest.mark.parametrize("kind", ["plain", "contact", "mixed"])
def test_the_tangent_is_known_to_be_symmetric(kind):
    """So that solvers for symmetric matrices take it without a test."""
    assert assembler(kind).matrix().isSymmetricKnown() == (True, True)


def test_the_mass_operator_is_known_to_be_symmetric():
    space = Space.paper(straight(4, height=3.0), elements=2, degree=2)
    made = Assembler(Model([Body(space, NeoHookean(3.0, 0.3), 1.0)], [Support.end(space, "start")]))
    for operator in (made.mass(), made.mass_operator()):
        assert operator.isSymmetricKnown() == (True, True)


# What is right although supports carry nothing


def carrying_nothing(kind):
    """A muscle that shortens freely, and a rod that is carried along, held at one end."""
    space = Space.paper(straight(4, height=3.0), elements=2, degree=2, order=2, quadrature="auto")
    if kind == "muscle":
        law = Muscle(3.0, 0.4999, sigma_max=1.5, m1=1.0, m2=0.5, activation=0.6)
        return Model([Body(space, law, formulation="mixed")], [Support.end(space, "start")])
    away = Support.end(space, "start", displacement=(1.0, 2.0, 0.0))
    return Model([Body(space, NeoHookean(3.0, 0.5), formulation="mixed")], [away])


@pytest.mark.parametrize("kind", ["muscle", "rod"])
def test_a_mixed_model_whose_supports_carry_nothing_is_in_balance(kind):
    model = carrying_nothing(kind)
    with pytest.warns(UserWarning, match="support reactions are at round-off level"):
        solution = statics.solve(model)
    assert np.abs(solution.reactions).max() < 1e-11
    moved = solution.displacement.reshape(-1, 3)[model.is_control_point]
    if kind == "rod":
        np.testing.assert_allclose(moved, np.broadcast_to([1.0, 2.0, 0.0], moved.shape), atol=1e-9)
    else:
        assert moved[-1, 2] < -0.1


@pytest.mark.parametrize("size", [1e-7, 1e-4])
def test_it_is_refused_out_of_balance(size):
    """Even by little of the forces inside, which a muscle that shortens freely has."""
    model = carrying_nothing("muscle")
    with pytest.warns(UserWarning, match="at round-off level"):
        solution = statics.solve(model)
    made = MixedAssembler(model)
    x = made.state(solution.displacement, solution.pressures)
    assert made.inside(x, 1.0) > 0.1
    out = made.vector()
    made.residual(x, 1.0, out)
    assert out.norm() < 1e-9 * made.inside(x, 1.0)
    # The end is drawn out a little, as a load would.
    pulled = solution.displacement.reshape(-1, 3).copy()
    pulled[:, 2] += size * model.is_control_point * model.bodies[0].space.positions[:, 2]
    x = made.state(pulled.ravel(), solution.pressures)
    made.residual(x, 1.0, out)
    forces = made.reactions(x, 1.0)
    given = support_forces(model, forces), support_moments(model, pulled.ravel(), forces)
    with pytest.raises(SolveError, match="support reactions do not balance the loads"):
        check_balance(made, x, pulled.ravel(), *given, out.norm(), 1e-9)
