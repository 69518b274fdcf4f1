"""PETSc options as a mapping: in force for one analysis, over those typed, and what nothing used is named."""

import warnings

import pytest
from conftest import straight
from petsc4py import PETSc

from isorod import dynamics, modal, statics
from isorod.errors import InputError
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.space import Space


@pytest.fixture(scope="module")
def model():
    space = Space(straight(4, height=4.0), elements=4)
    ends = [Support.end(space, "start"), Support.end(space, "end", displacement=(1.0, 0.0, 0.5))]
    return Model([Body(space, NeoHookean(1.0, 0.3), density=1.0)], ends)


@pytest.fixture(autouse=True)
def nothing_is_left():
    before = dict(PETSc.Options().getAll())
    yield
    assert dict(PETSc.Options().getAll()) == before


def test_options_are_in_force_for_one_solve(model, capfd):
    plain = statics.solve(model)
    given = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_rtol": 1e-12, "snes_rtol": 1e-3, "snes_monitor": None}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = statics.solve(model, petsc=given)
    assert (found.solver["ksp"], found.solver["pc"]) == ("cg", "jacobi")
    assert found.newton_iterations < plain.newton_iterations
    assert capfd.readouterr().out.count("SNES Function norm") == len(found.residual_norms) - 1
    after = statics.solve(model)
    assert (after.solver, after.newton_iterations) == (plain.solver, plain.newton_iterations)
    assert capfd.readouterr().out == ""


def test_options_win_over_those_typed_and_these_come_back(model, petsc_options):
    petsc_options(ksp_type="gmres", snes_rtol=1e-4)
    kept = dict(PETSc.Options().getAll())
    assert statics.solve(model, petsc={"ksp_type": "cg", "snes_mf": False}).solver["ksp"] == "cg"
    assert dict(PETSc.Options().getAll()) == kept
    assert statics.solve(model).solver["ksp"] == "gmres"


@pytest.mark.parametrize(
    "given",
    [
        {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"},
        {"ksp_type": "cg", "pc_type": "gamg"},
        {"snes_type": "newtontr"},
        {"snes_type": "qn", "snes_qn_scale_type": "jacobian", "snes_max_it": 200},
    ],
)
def test_other_solvers_agree_with_the_default(model, given):
    forces = [statics.solve(model, petsc=options).reactions[1] for options in (None, given)]
    assert abs(forces[1] / forces[0] - 1.0)[[0, 2]].max() < 1e-6


@pytest.mark.parametrize("given", [{"eps_type": "lobpcg"}, {"eps_type": "lanczos", "eps_lanczos_reorthog": "full"}])
def test_other_eigensolvers_agree_with_the_default(model, given):
    found = [modal.solve(model, 3, petsc=options).frequencies for options in (None, given)]
    assert abs(found[1] / found[0] - 1.0).max() < 1e-6


def test_modes_and_implicit_steps_take_them_too(model):
    modes = modal.solve(model, 2, petsc={"eps_nev": 4, "st_type": "sinvert"})
    assert len(modes) == 4
    free = Model(model.bodies, model.supports[:1])
    history = dynamics.solve(free, 0.02, 0.01, 1, integrator="implicit", petsc={"ksp_type": "gmres", "pc_type": "lu"})
    assert history.solver["ksp"] == "gmres"


def test_what_nothing_used_is_named_in_one_line_and_the_result_is_there(model):
    with pytest.warns(UserWarning) as said:
        found = statics.solve(model, petsc={"snes_rtoll": 1e-3, "ksp_type": "preonly", "eps_nev": 3})
    (warning,) = said
    assert str(warning.message) == "PETSc option snes_rtoll, eps_nev: nothing used it; check its spelling"
    assert warning.filename == __file__
    assert found.load_steps == 1


def test_what_was_used_before_counts_anew(model):
    given = {"snes_max_it": 20}
    statics.solve(model, petsc=given)
    with pytest.warns(UserWarning, match="snes_max_it"):
        modal.solve(model, 1, petsc=given, at_rest=True)


BAD = {
    "no mapping": (["-snes_rtol"], 'petsc: got list, need a mapping such as {"snes_rtol": 1e-10}'),
    "words": ("-snes_rtol 1", 'petsc: got str, need a mapping such as {"snes_rtol": 1e-10}'),
    "dash": ({"-snes_rtol": 1}, "PETSc option '-snes_rtol': need a name without a dash, such as 'snes_rtol'"),
    "blank": ({"snes rtol": 1}, "PETSc option 'snes rtol': need a name without a dash, such as 'snes_rtol'"),
    "number": ({3: 1}, "PETSc option 3: need a name without a dash, such as 'snes_rtol'"),
    "value": ({"snes_rtol": {}}, "PETSc option snes_rtol: got dict, need a number, a text, True or None"),
    "start": (
        {"log_view": None},
        "PETSc option log_view: PETSc reads it only when it starts; give it to isorod.options.initialize before "
        "anything imports petsc4py.PETSc",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_an_option_is_refused_in_one_line(case, model):
    given, said = BAD[case]
    with pytest.raises(InputError) as refusal:
        statics.solve(model, petsc=given)
    assert str(refusal.value) == said


def test_what_petsc_refuses_is_one_line_and_leaves_no_option(model):
    with pytest.raises(InputError, match=r"^PETSc: .*nonsense") as refusal:
        statics.solve(model, petsc={"ksp_type": "nonsense"})
    assert "\n" not in str(refusal.value)
    assert statics.solve(model).solver["ksp"] == "preonly"
