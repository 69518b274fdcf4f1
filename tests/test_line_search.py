"""Newton steps where points come into contact: their length, what it says, and their factorisation."""

import numpy as np
import pytest
from petsc4py import PETSc
from touching import pair

from isorod.assembly.assembler import Assembler
from isorod.model import Contact, Model, Plane, Support
from isorod.petsc.options import in_force
from isorod.statics.line_search import LineSearch, step_length
from isorod.statics.newton import Newton

ZERO = 1e-3


def kinked(fraction):
    """Work of a soft spring that meets a stiff one at ``ZERO``, before and behind which it is linear."""
    return 1.0 - fraction - 1e4 * max(0.0, fraction - ZERO)


def test_a_step_beyond_a_kink_ends_where_its_work_vanishes():
    calls = []

    def work(fraction):
        calls.append(fraction)
        return kinked(fraction)

    fraction = step_length(work, kinked(0.0))
    assert abs(kinked(fraction)) <= 0.1
    assert fraction == pytest.approx(ZERO, rel=0.2)
    assert len(calls) <= 25


@pytest.mark.parametrize("end", [0.9, 0.0, -0.8])
def test_a_full_step_that_does_stays(end):
    assert step_length(lambda fraction: 1.0 + fraction * (end - 1.0), 1.0) == 1.0


def test_a_step_ends_before_states_that_have_no_forces():
    fraction = step_length(lambda fraction: 1.0 - fraction if fraction < 0.3 else np.nan, 1.0)
    assert 0.25 < fraction < 0.3


def test_a_step_up_the_energy_is_taken_as_far_as_there_are_forces():
    assert step_length(lambda fraction: -5.0 * fraction, -1.0) == 1.0
    assert step_length(lambda fraction: -1.0 if fraction < 0.3 else np.nan, -1.0) == 0.25


def near_a_wall():
    """Return Newton's method for a bar that does not touch the wall it may touch."""
    body = pair().bodies[0]
    wall = Contact(0, Plane((0.0, 0.0, -50.0), (0.0, 0.0, 1.0)), 1.0)
    return Newton(Assembler(Model([body], [Support.end(body.space, "start")], contacts=[wall]), PETSc.COMM_SELF))


@pytest.mark.parametrize("typed", [None, 77])
def test_with_contact_mumps_does_not_scale_unless_it_is_asked_to(typed):
    with in_force({} if typed is None else {"mat_mumps_icntl_8": typed}):
        solver = near_a_wall()
        solver.advance(0.0, 1.0)
        assert solver.snes.getKSP().getPC().getFactorMatrix().getMumpsIcntl(8) == (typed or 0)
    assert not PETSc.Options().hasName("mat_mumps_icntl_8")


@pytest.mark.parametrize(("length", "fraction", "ends"), [(1e-9, 1.0, True), (1e-3, 1e-6, False), (1e-3, 0.0, False)])
def test_a_step_that_was_made_short_is_no_sign_of_equilibrium(length, fraction, ends):
    """Whatever is out of balance: how far a full step would have gone is what counts."""
    solver = near_a_wall()
    solver.snes.setUp()
    solver.snes.getFunction()[0].set(1.0)
    solver._line_search.fraction = fraction
    reason = solver._test(solver.snes, 1, (1.0, length * fraction, 1.0))
    reasons = PETSc.SNES.ConvergedReason
    assert reason == (reasons.CONVERGED_SNORM_RELATIVE if ends else reasons.CONVERGED_ITERATING)


@pytest.mark.parametrize("free", [1.0, 0.25])
def test_how_much_of_a_step_was_taken_is_kept(free):
    start, way, x = (PETSc.Vec().createSeq(1) for _ in range(3))
    start.set(kinked(0.0))
    way.set(1.0)

    class Solver:
        def setLineSearchPreCheck(self, check):
            self.check = check

        def getFunction(self):
            return (start,)

    solver = Solver()
    search = LineSearch(solver, lambda trial, out: out.set(kinked(-trial.array_r[0])), None, lambda x, end: free)
    assert solver.check(x, way)
    assert search.fraction == way.array_r[0] == pytest.approx(ZERO, rel=0.2)
    assert search.short == 1
