"""The blade's modes by finite elements: converged values, presets, ranks, bad input."""

import json

import numpy as np
import pytest
from reference import BLADE_FREQUENCIES as CONVERGED

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from test_fem import ON_RANKS
from test_fem_presets import configuration as configured

from comparisons.fem.presets import blade as presets
from comparisons.fem.published import Blade as Configuration
from comparisons.fem.runs import run
from comparisons.measure import published
from isorod.errors import SolveError


def configuration(arguments: str) -> Configuration:
    return configured("blade", arguments)[0]


def test_best_preset_is_within_half_a_percent():
    record = run(configuration(presets.PRESETS["best"]))
    assert record["frequencies"] == pytest.approx(CONVERGED, rel=5e-3)
    assert record["sturm_count"] == 10 and record["residuals"].max() < 1e-6
    assert record["unknowns"] < record["dofs"] == 3321
    assert set(record["seconds"]) == {"mesh", "forms", "setup", "assembly", "solve", "check", "total", "processor"}


def test_accurate_preset_is_accurate():
    assert run(configuration(presets.PRESETS["accurate"]))["frequencies"] == pytest.approx(CONVERGED, rel=1e-3)


@pytest.mark.slow
def test_quadratic_bricks_extrapolate_to_the_converged_values():
    found = [run(configuration(arguments)) for arguments in presets.CONVERGED["quick"].arguments[:2]]
    fine, finer = (np.array(record["frequencies"]) for record in found)
    # Two meshes and the order seen on three.
    assert finer + (finer - fine) / (1.5**3.5 - 1.0) == pytest.approx(CONVERGED, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("level", presets.CONVERGED)
def test_three_meshes_extrapolate_to_the_converged_values(level):
    from comparisons.measure.convergence import richardson

    records = [run(configuration(arguments)) for arguments in presets.CONVERGED[level].arguments]
    sizes = [1.0 / record["options"]["layers"] for record in records]
    for values, exact in zip(zip(*(record["frequencies"] for record in records), strict=True), CONVERGED, strict=True):
        try:
            limit = richardson(sizes, values).value
        except SolveError:
            limit = values[-1]
        assert limit == pytest.approx(exact, rel=2e-4)


@pytest.mark.slow
def test_elements_on_the_mesh_of_the_papers_counts():
    found = {name: run(configuration(arguments)) for name, arguments in presets.PAPER.items()}
    trilinear, enhanced, quadratic = (np.array(record["frequencies"]) for record in found.values())
    # Shear locking: the first mode is more than twice too fast.
    assert trilinear[0] > 2.0 * CONVERGED[0]
    # The paper's own element on a section that is only a guess.
    assert enhanced == pytest.approx(published.BLADE_FEM_FREQUENCIES, rel=0.07)
    assert np.abs(enhanced / published.BLADE_FEM_FREQUENCIES - 1.0).mean() < 0.04
    assert quadratic == pytest.approx(CONVERGED, rel=0.025)


@pytest.mark.mpi
@pytest.mark.parametrize("arguments", ["--along 4 --layers 6", "--along 8 --layers 12 --degree 1 --family enhanced"])
def test_two_ranks_give_the_serial_modes(on_ranks, fem, arguments):
    words = ["blade", *arguments.split()]
    parallel = json.loads(on_ranks(2, ON_RANKS, *words))
    serial = json.loads(fem.prints(*words))
    assert parallel["ranks"] == 2 and parallel["sturm_count"] == serial["sturm_count"] == 10
    assert parallel["dofs"] == serial["dofs"] and parallel["unknowns"] == serial["unknowns"]
    # A frequency is known to half its residual: that of the enhanced bricks' first mode is rounding, 4e-8, which MUMPS
    # on two ranks rounds differently from run to run.
    known = (np.array(parallel["residuals"]) + serial["residuals"]) / 2.0
    assert known.max() < 1e-7
    change = np.array(parallel["frequencies"]) / serial["frequencies"] - 1.0
    assert (np.abs(change) < np.maximum(known, 1e-9)).all()


@pytest.mark.parametrize("family", [*presets.FULL, *presets.CONVERGED.values()], ids=lambda family: family.label)
def test_meshes_of_the_presets_are_positive(family):
    for arguments in family.arguments:
        assert configuration(arguments).mesh().check() >= 0.0


@pytest.mark.parametrize(
    "arguments, said",
    [
        (["--modes", "0"], "modes: got 0, need at least 1"),
        (["--along", "2", "--layers", "1", "--modes", "500"], "modes: got 500, need 1 to"),
        (["--grading", "0"], "grading: got 0"),
        (["--quadrature", "2", "--degree", "5"], "degree: got 5, need 1 to 4"),
        (["--family", "enhanced"], "it is of degree 1"),
        (["--layers", "6", "-eps_max_it", "1", "-eps_ncv", "13"], "SLEPc found"),
        (["--layers", "6", "-eps_typo", "3"], "-eps_typo 3: nothing used it"),
    ],
)
def test_bad_input_is_one_line(arguments, said, fem):
    assert said in fem.refuses("blade", *arguments)
