"""When Newton's iterations stop: what the out-of-balance force is compared with, for each kind of model."""

import pytest
from conftest import straight
from petsc4py import PETSc

from isorod.assembly.assembler import Assembler
from isorod.assembly.mixed import MixedAssembler
from isorod.assembly.part import ROUNDING
from isorod.material import NeoHookean
from isorod.model import Body, Contact, Model, Plane, Support
from isorod.space import Space
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


@pytest.mark.parametrize("kind", ["contact", "mixed"])
def test_unknowns_with_units_of_their_own_are_compared_with_the_predictor_alone(kind):
    """Forces in contact with those carried; and both with rounding of the largest stiffness."""
    scale = 1e7
    reached, carried, *_ = prepared(kind, scale)
    assert carried < 1e-3 * scale
    allowed = 1e-6 * (scale if kind == "mixed" else carried)
    assert reached(0.9 * allowed) and not reached(1.1 * allowed)
    reached, _, matrix, balance = prepared(kind, 0.0)
    floor = ROUNDING * balance.size * matrix.norm(PETSc.NormType.INFINITY)
    assert reached(0.9 * floor) and not reached(1.1 * floor)


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
