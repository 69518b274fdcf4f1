"""The finite element side: patch tests, the spring's force, ranks, solvers, and bad input."""

import json

import numpy as np
import pytest
from reference import SPRING_FORCE as CONVERGED

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

import ufl
from mpi4py import MPI
from test_fem_presets import configuration

from comparisons.fem import quadrature
from comparisons.fem.domain import Domain
from comparisons.fem.presets import spring as presets
from comparisons.fem.published import Spring as Configuration
from comparisons.fem.runs import distribute, run
from comparisons.fem.statics import Element, Held, solve
from isorod.errors import InputError, SolveError
from isorod.fenics.stored import energy_of
from isorod.material import LinearElastic, NeoHookean
from meshes.bricks import bricks
from meshes.template import o_grid
from meshes.tetrahedra import tetrahedra

AFFINE = np.array([[0.05, 0.02, 0.0], [-0.01, -0.03, 0.04], [0.02, 0.0, 0.08]])

SMALL = {"around": 4, "layers": 12, "rings": 1}


def patch(rod, kind: str) -> Domain:
    if kind.startswith("P"):
        return Domain.distribute(tetrahedra(rod, 6, 3, int(kind[1])))
    order = int(kind[1]) if kind.startswith("Q") else 1
    return Domain.distribute(bricks(rod, o_grid(4, 1, order), 3))


@pytest.mark.parametrize("law", [NeoHookean, LinearElastic])
@pytest.mark.parametrize(
    "kind, element",
    [
        ("Q1", Element(1)),
        ("Q2", Element(2)),
        ("S2", Element(2, "irons14", "S")),
        ("S2", Element(2, 4, "S")),
        ("E1", Element(1, 2, "enhanced")),
        ("P1", Element(1)),
        ("P2", Element(2)),
    ],
)
def test_patch(cylinder, kind, element, law):
    where = patch(cylinder(height=2.0), kind)
    held = [Held(face, lambda x: AFFINE @ x) for face in ("start", "end", "lateral")]
    found = solve(where, energy_of(law(100.0, 0.3)), held, element)
    exact = ufl.dot(ufl.as_matrix(AFFINE.tolist()), ufl.SpatialCoordinate(where.mesh))
    u = found.displacement
    # Relative to the largest displacement and gradient, about 0.1.
    strain = ufl.grad(u) - ufl.as_matrix(AFFINE.tolist())
    misfit = ufl.inner(u - exact, u - exact) + ufl.inner(strain, strain)
    assert np.sqrt(integral(misfit)) < 1e-10
    assert np.abs(found.reactions.sum(axis=0)).max() < 1e-8


def integral(value) -> float:
    import dolfinx.fem

    from isorod.fenics import compat

    form = compat.form(value * ufl.dx(metadata={"quadrature_degree": 4}), ("-O2",))
    return dolfinx.fem.assemble_scalar(form)


def test_faces_of_a_section_of_one_brick(cylinder):
    where = Domain.distribute(bricks(cylinder(), o_grid(4, 0, 2), 3))
    assert [len(where.facets(name)) for name in ("start", "end", "lateral")] == [1, 1, 12]
    with pytest.raises(InputError, match="'top', need one of start, end, lateral"):
        where.facets("top")


def test_irons_rule_is_exact_to_degree_5():
    points, weights = quadrature.irons14()
    for a, b, c in [(0, 0, 0), (4, 0, 0), (2, 2, 0), (2, 2, 1), (5, 0, 0), (1, 2, 2), (3, 2, 0)]:
        exact = 1.0 / ((a + 1) * (b + 1) * (c + 1))
        assert np.sum(weights * np.prod(points ** [a, b, c], axis=1)) == pytest.approx(exact, abs=1e-14)


def test_newton_converges_quadratically():
    norms = run(Configuration(**SMALL))["residual_norms"]
    assert norms[-1] < 1e-9 * norms[0]
    assert norms[-1] < 1e-3 * norms[-2]


def test_best_preset_gives_the_converged_force():
    found = record("best")
    assert found["force"] == pytest.approx(CONVERGED, rel=5e-4)
    assert found["seconds"]["assembly"] > 0.0 and found["seconds"]["solve"] > 0.0


def test_accurate_preset_is_accurate():
    assert record("accurate")["force"] == pytest.approx(CONVERGED, rel=1.5e-4)


def record(preset: str) -> dict:
    return run(configuration("spring", presets.PRESETS[preset])[0])


def test_trilinear_bricks_on_the_mesh_of_the_paper():
    # Near the converged value by chance: the missing volume softens what the element's shear stiffens.
    assert record("paper-q1")["force"] == pytest.approx(6.0935, rel=2e-4)


@pytest.mark.slow
def test_quadratic_displacement_on_the_mesh_of_the_paper():
    assert record("paper-q2")["force"] == pytest.approx(6.01, abs=0.03)


@pytest.mark.slow
def test_enhanced_bricks_on_the_mesh_of_the_paper():
    assert record("paper-enhanced")["force"] == pytest.approx(6.0436, rel=2e-4)


@pytest.mark.slow
def test_fine_cubic_bricks_extrapolate_to_the_converged_force():
    from comparisons.measure.convergence import richardson

    meshes = ((8, 24), (12, 36), (16, 48))
    forces = [run(Configuration(degree=3, around=around, layers=layers))["force"] for around, layers in meshes]
    limit = richardson([1.0 / layers for _, layers in meshes], forces)
    assert limit.value == pytest.approx(CONVERGED, rel=5e-5)
    assert 6.097 < limit.value < 6.103


@pytest.mark.parametrize(
    "solver",
    [
        {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "mumps"},
        {"ksp_type": "preonly", "pc_type": "lu", "pc_factor_mat_solver_type": "petsc"},
        pytest.param({"ksp_type": "cg", "ksp_rtol": 1e-10, "pc_type": "gamg"}, marks=pytest.mark.slow),
    ],
    ids=["lu", "petsc", "gamg"],
)
def test_solvers_agree(solver):
    where = distribute(Configuration(**SMALL).mesh, MPI.COMM_WORLD)
    direct = Configuration(**SMALL).solve(where).reactions
    other = Configuration(**SMALL, solver=solver).solve(where).reactions
    assert np.abs(other - direct).max() < 1e-7 * np.abs(direct).max()


def test_reactions_balance():
    where = distribute(Configuration(**SMALL).mesh, MPI.COMM_WORLD)
    for change in ({}, {"degree": 3, "family": "S", "quadrature": 5}):
        chosen = Configuration(**SMALL, **change) if change else Configuration(**SMALL, order=2)
        reactions = chosen.solve(where).reactions
        assert np.abs(reactions.sum(axis=0)).max() < 1e-6
        assert reactions[1, 2] > 1.0


# What ranks that wait call to run ``python -m comparisons.fem`` with their arguments.
ON_RANKS = "comparisons.fem.__main__.main(sys.argv[1:])"


@pytest.mark.mpi
def test_two_ranks_give_the_serial_force(on_ranks):
    parallel = json.loads(on_ranks(2, ON_RANKS, *"spring --around 4 --layers 12".split()))
    assert parallel["ranks"] == 2
    serial = run(Configuration(**SMALL))
    assert parallel["dofs"] == serial["dofs"]
    assert parallel["force"] == pytest.approx(serial["force"], rel=1e-9)


def test_failing_newton_is_one_line(petsc_options):
    petsc_options(snes_max_it=1)
    with pytest.raises(SolveError, match="SNES diverged after 1 iterations"):
        run(Configuration(**SMALL))


BAD = {
    "--around 5": "multiple of 4",
    "--layers 50": "multiple of the rod's 12",
    "--degree 9": "need 1 to 4",
    "--quadrature banana": "need a degree or irons14",
    "--quadrature 0": "need 1 to 20",
    "--family S --cells tetrahedra": "bricks only",
    "--family enhanced --degree 2": "--degree 1 --order 1",
    "--preset nope": "invalid choice",
    "--matrix nope": "need one of PETSc's",
    "-pc_type nope": "PETSc",
    "-snes_foo 1": "-snes_foo 1: nothing used it",
}


@pytest.mark.parametrize("arguments", BAD)
def test_bad_input_is_one_line(arguments, fem):
    small = [] if "--around" in arguments or "--layers" in arguments else ["--around", "4", "--layers", "12"]
    assert BAD[arguments] in fem.refuses("spring", *small, *arguments.split())
