"""Vibration modes: bad input, solvers that fail, shifts that lie badly, other eigensolvers."""

from dataclasses import replace

import numpy as np
import pytest
from petsc4py import PETSc
from vibrations import FREE, bars, clamped, matrices

from isorod import Body, InputError, Model, NeoHookean, SolveError, Space, Support, modal, options, statics
from isorod.checks import rigid_motions
from isorod.geometry import center_line, section
from isorod.modal.pencil import Pencil


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
    with pytest.raises(InputError, match=rf"modes: got {modes}, need 1 to 132 \(number of unknowns\)"):
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


def worst(modes, model):
    """Return how far off eigenvalues may be, relative, that are found with what is singular but for rounding.

    Such solves lose digits of the vectors, more or fewer as the smallest pivot has it.  An eigenvalue is no further
    from the exact one than the residual in the norm of the inverse mass, which is at most the root of the mass'
    condition times the relative one (Parlett, The Symmetric Eigenvalue Problem, Theorem 15.9.1).
    """
    return modes.residuals.max() * np.sqrt(np.linalg.cond(matrices(model)[1]))


MUMPS = {"st_pc_type": "cholesky", "st_pc_factor_mat_solver_type": "mumps"}


# Purified by one more solve with a singular matrix all vectors would turn into the same one: the shift is moved aside.
@pytest.mark.parametrize(
    ("name", "options"),
    [(name, options) for name in ("straight", "ring", "helix", 0, 2, 5) for options in ({}, MUMPS)]
    + [(mode, {"eps_purify": 1}) for mode in (0, 2, 5)],
)
def test_a_singular_pencil_does_no_harm(name, options, bar, petsc_options):
    """The shift is zero of a free body, or a mode's eigenvalue: its own direction blows up, no other."""
    model = FREE[name](bar) if name in FREE else bar(6.0, clamped)
    expected = modal.solve(model, 6).eigenvalues
    petsc_options(st_shift=0.0 if name in FREE else repr(float(expected[name])), **options)
    modes = modal.solve(model, 6)
    found, bound = modes.eigenvalues, worst(modes, model)
    assert found[modes.rigid :] == pytest.approx(expected[modes.rigid :], rel=bound)
    assert bound < 1e-3
    assert np.abs(found[: modes.rigid]).max(initial=0.0) < 1e-8 * found[modes.rigid]


def test_a_typed_shift_is_taken_where_none_is_found(bar, petsc_options, monkeypatch):
    """What the message of a free body without any flexible mode to place the shift by says to do."""
    model = FREE["straight"](bar)
    expected = modal.solve(model, 4)
    monkeypatch.setattr(Pencil, "_first_flexible", lambda self: None)
    with pytest.raises(SolveError, match=r"body 0 is free to .*add a support, or give a shift \(-st_shift\)"):
        modal.solve(model, 4)
    petsc_options(st_shift=repr(2.0 * expected.shift))
    found = modal.solve(model, 4)
    assert found.shift == 2.0 * expected.shift < 0.0
    assert found.eigenvalues[6:] == pytest.approx(expected.eigenvalues[6:], rel=1e-9)


@pytest.mark.parametrize("shift", [-1.0, -1e-3, 3.0, 20.0, 50.0])
def test_any_other_shift_gives_the_same_modes(shift, bar, petsc_options):
    """Below all eigenvalues, between the rigid and the first flexible one, 7.2, between others, and beyond 33.2."""
    model = FREE["straight"](bar)
    expected = modal.solve(model, 6)
    assert expected.eigenvalues[[6, 11]] == pytest.approx([7.2, 33.2], rel=5e-3)
    petsc_options(st_shift=shift)
    found = modal.solve(model, 6)
    assert np.abs(found.eigenvalues - expected.eigenvalues).max() < 1e-9 * expected.eigenvalues[6]
    assert (found.rigid, found.below) == (expected.rigid, expected.below) == (6, 12)


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


def test_an_error_of_petsc_within_a_system_error_is_one_line():
    """As slepc4py's methods end where they return beside raising; a system error that is not PETSc's passes."""
    with pytest.raises(InputError, match=r"^PETSc: .+ \(see -help\)$"), options.petsc_errors():
        raise SystemError("returned a result with an exception set") from PETSc.Error(62)
    with pytest.raises(SystemError, match="bad call"), options.petsc_errors():
        raise SystemError("bad call") from ValueError("of another")


def test_a_free_rod_too_thin_for_double_precision_is_refused_at_once():
    """The eigensolver looked for its first bending mode for minutes, deaf to signals."""
    line = center_line.straight(1e8)
    space = Space(line.sweep(section.circle(8)), order=1, elements=4, degree=3)
    model = Model([Body(space, NeoHookean(1.0, 0.3), 1.0)], [])
    with pytest.raises(
        InputError, match="modes: body 0 is unsupported and its section 2e-08 of its length, below 1e-07: "
    ):
        modal.solve(model, 4)
    # What is held bends against that: one that slides along itself alone is not refused.
    sliding = Model(model.bodies, [Support.end(space, "start", "xy")])
    loose = rigid_motions.free_motions(sliding)
    assert 0 < len(loose) < 6
    rigid_motions.refuse_thin(sliding, loose)
