"""Vibration modes: bad input, solvers that fail, shifts that lie badly, other eigensolvers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from petsc4py import PETSc
from vibrations import FREE, bars, clamped

from isorod import modal, statics
from isorod.errors import InputError, SolveError
from isorod.model import Model, Support


@pytest.fixture
def bar(cylinder):
    """A circular bar along z."""
    return bars(cylinder)


def test_bodies_need_a_density(bar):
    good = bar(6.0, clamped)
    massless = Model([*good.bodies, replace(good.bodies[0], density=0.0)], good.supports)
    with pytest.raises(InputError, match="density of body 1: got 0, modes need a positive mass per volume"):
        modal.solve(massless)
    for density in (-1.0, np.nan, np.inf):
        with pytest.raises(InputError, match=f"density: got {density:g}, need a finite mass per volume"):
            replace(good.bodies[0], density=density)


@pytest.mark.parametrize("modes", [0, -1, 133, 10**9])
def test_number_of_modes_must_be_there(modes, bar):
    with pytest.raises(InputError, match=rf"modes: got {modes}, need 1 to 132 \(the unknowns there are\)"):
        modal.solve(bar(6.0, clamped), modes)


def test_rigid_modes_come_on_top_of_those_asked_for(bar):
    model = bar(6.0)
    with pytest.raises(InputError, match=f"need 1 to {model.unknowns - 6}"):
        modal.solve(model, model.unknowns - 5)


def test_a_model_held_everywhere_has_no_modes(bar):
    model = bar(6.0, lambda space: [Support(np.arange(space.nodes))])
    with pytest.raises(InputError, match=r"modes: got 1, .*unknowns"):
        modal.solve(model, 1)


def test_an_unconverged_solver_is_refused_with_what_to_do(bar, petsc_options):
    petsc_options(eps_max_it=1, eps_ncv=9)
    with pytest.raises(SolveError, match=r"modes: SLEPc found \d of 6 in 1 iterations .*raise -eps_max_it or -eps_ncv"):
        modal.solve(bar(6.0, clamped), 6)


FACTORS = [{}, {"st_pc_type": "cholesky", "st_pc_factor_mat_solver_type": "mumps"}]


@pytest.mark.parametrize("factors", FACTORS, ids=["default", "mumps"])
@pytest.mark.parametrize("name", ["straight", "ring", "helix"])
def test_a_singular_pencil_does_no_harm(name, factors, bar, petsc_options):
    """The shift that a user forces upon a free body is one of its eigenvalues, zero.

    Its own direction blows up, no other.
    """
    model = FREE[name](bar)
    expected = modal.solve(model, 4).eigenvalues
    petsc_options(st_shift=0.0, **factors)
    found = modal.solve(model, 4).eigenvalues
    # What is factorised is singular but for rounding (eps), which leaves errors of about eps^(1/2) = 1.5e-8, -eps_tol
    # 1e-12 or not.
    assert found[6:] == pytest.approx(expected[6:], rel=1e-7)
    assert np.abs(found[:6]).max() < 1e-8 * found[6]


@pytest.mark.parametrize("factors", FACTORS, ids=["default", "mumps"])
@pytest.mark.parametrize("mode", [0, 2, 5])
def test_a_shift_at_an_eigenvalue_does_no_harm(mode, factors, bar, petsc_options):
    model = bar(6.0, clamped)
    expected = modal.solve(model, 6).eigenvalues
    petsc_options(st_shift=repr(float(expected[mode])), **factors)
    assert modal.solve(model, 6).eigenvalues == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("mode", [0, 2, 5])
def test_nor_where_vectors_are_purified(mode, bar, petsc_options):
    """One more solve with a singular matrix would turn all vectors into the same one: the shift is moved aside."""
    model = bar(6.0, clamped)
    expected = modal.solve(model, 6).eigenvalues
    petsc_options(st_shift=repr(float(expected[mode])), eps_purify=1)
    assert modal.solve(model, 6).eigenvalues == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shift", [-1e-3, -1.0, 3.0, 20.0])
def test_any_other_shift_gives_the_same_modes_or_says_which_it_missed(shift, bar, petsc_options):
    model = FREE["straight"](bar)
    expected = modal.solve(model, 6).eigenvalues
    petsc_options(st_shift=shift)
    try:
        found = modal.solve(model, 6).eigenvalues
    except SolveError as problem:
        assert re.search(r"eigenvalues lie at or below .*but \d+ were found.*-st_shift", str(problem))
        assert shift > 0
    else:
        assert np.abs(found - expected).max() < 1e-9 * expected[6]


def test_modes_about_a_state_of_a_linear_body_are_refused(bar):
    """Its tangent knows no stress."""
    model = bar(6.0, lambda space: [Support.end(space, "start"), Support.end(space, "end", "xyz", (0.0, 0.0, 0.1))])
    with pytest.raises(InputError, match="body 0 is linear elastic"):
        modal.solve(model, 2, state=statics.solve(model))


def test_a_failed_solve_leaves_no_options(bar, petsc_options):
    before = PETSc.Options().getAll()
    with pytest.raises(SolveError):
        petsc_options(eps_max_it=1, eps_ncv=9)
        modal.solve(bar(6.0, clamped), 6)
    assert {name for name in PETSc.Options().getAll() if name not in before} == {"eps_max_it", "eps_ncv"}


def test_record_of_the_run(bar):
    modes = modal.solve(bar(6.0, clamped), 3)
    assert modes.built == ["tangent", "mass"]
    assert modes.solver["eps"] == "krylovschur"
    assert (modes.solver["st"], modes.solver["ksp"]) == ("sinvert", "preonly")
    assert {"assembly", "setup", "solve"} <= set(modes.seconds)
    assert min(modes.seconds.values()) > 0
    assert (modes.ranks, modes.shift) == (1, 0.0)
    assert modes.iterations >= 1
    assert modal.solve(bar(6.0, clamped), 3, lumped=True).built == ["tangent", "lumped mass"]


@pytest.mark.parametrize("kind", ["lobpcg", "gd", "jd", "rqcg"])
@pytest.mark.parametrize("held", [clamped, lambda space: []], ids=["clamped", "free"])
def test_preconditioned_eigensolvers_agree(kind, held, bar, petsc_options):
    model = bar(6.0, held, elements=6)
    expected = modal.solve(model, 5)
    petsc_options(eps_type=kind)
    found = modal.solve(model, 5)
    assert found.solver["eps"] == kind
    assert np.abs(found.eigenvalues - expected.eigenvalues).max() < 1e-6 * expected.eigenvalues[expected.rigid]
