"""NGSolve beside dolfinx: the same numbers on the same meshes; and what a comparison makes of records."""

from importlib import util

import numpy as np
import pytest

pytest.importorskip("rich")
pytest.importorskip("dolfinx")

from mpi4py import MPI

from comparisons import bench
from comparisons.bench import biceps, rods
from comparisons.fem import published, runs
from comparisons.measure import timing, work
from comparisons.measure.study import Run
from comparisons.measure.work import AS_RUN, MODULES
from comparisons.report import bench as report
from comparisons.spring import FINER
from isorod import scenes
from isorod.space.basis import PAPER, POLYHARMONIC, POLYNOMIALS

# No test needs it: docker/opponents brings it.
ngsolve = pytest.mark.skipif(util.find_spec("ngsolve") is None, reason="no NGSolve in this Python (docker/opponents)")


def ngsolved(words):
    return timing.run("comparisons.ngsolve", words.split())


# NGSolve


@ngsolve
@pytest.mark.parametrize(
    ("words", "more"),
    [
        ("--degree 2", {}),
        ("--degree 3", {"degree": 3}),
        ("--family S --quadrature irons14", {"family": "S", "quadrature": "irons14"}),
        ("--family S --degree 4 --quadrature 6", {"family": "S", "degree": 4, "quadrature": 6}),
        ("--cells tetrahedra", {"cells": "tetrahedra"}),
    ],
)
def test_ngsolve_finds_the_force_of_dolfinx_on_the_same_mesh(words, more):
    layers = 24
    configuration = published.Spring(around=4, layers=layers, rings=0, **more)
    wanted = configuration.solve(runs.distribute(configuration.mesh, MPI.COMM_WORLD))
    found = ngsolved(f"spring --around 4 --layers {layers} {words}")
    assert found["dofs"] == wanted.dofs
    np.testing.assert_allclose(found["reactions"], wanted.reactions, atol=1e-7 * np.abs(wanted.reactions).max())


@ngsolve
@pytest.mark.parametrize(
    ("words", "more"),
    [("--degree 2", {}), ("--quadrature irons14 --refinements 2", {"quadrature": "irons14"})],
)
def test_ngsolve_finds_the_frequencies_of_dolfinx_on_the_same_mesh(words, more):
    wanted = runs.run(published.Blade(along=4, layers=8, **more))
    found = ngsolved(f"blade --along 4 --layers 8 {words}")
    assert found["dofs"] == wanted["dofs"]
    np.testing.assert_allclose(found["frequencies"], wanted["frequencies"], rtol=1e-7)
    assert max(found["residuals"]) < 1e-6


@ngsolve
def test_what_is_inside_of_cells_alone_is_left_out_of_hollow_ones():
    whole, hollow = (
        ngsolved(f"blade --along 3 --layers 4 --degree 3 --family {one}") for one in ("Lagrange", "hollow")
    )
    assert whole["dofs"] - hollow["dofs"] == 3 * 8 * whole["cells"]
    # Fewer functions, stiffer modes.
    assert all(np.array(hollow["frequencies"]) > np.array(whole["frequencies"]))


# The comparison


def test_what_is_missing_is_named(monkeypatch):
    monkeypatch.setattr(bench.util, "find_spec", lambda name: None)
    here, absent = bench.opponents()
    assert here == [] and set(absent) == set(MODULES) - {"cylindrical", "fem"}


@pytest.mark.parametrize("level", ["quick", "full"])
def test_every_program_has_curves_and_isorod_one_with_nothing_chosen(level):
    for made in rods.scenes(level, ["ngsolve"], []):
        assert {curve.method for curve in made.curves} == set(MODULES)
        assert AS_RUN in made.curves and set(AS_RUN.arguments) <= set(biceps.OURS)
        best = {one for known in made.known.values() for one in known}
        assert best <= {arguments for curve in made.curves for arguments in curve.arguments}


def test_what_is_chosen_is_held_against_finer_spaces_of_the_same_kind(monkeypatch, tmp_path):
    """Nothing is written down that a step could be added to: the record says what was chosen."""
    asked = []

    def run(module, words, interpreter):
        asked.append(" ".join(words))
        (found,) = [body.discretisation for body in scenes.find("spring")().model().bodies]
        return {"method": "cylindrical", "discretisation": [found], "seconds": {"total": 1.0}}

    monkeypatch.setattr(work.timing, "run", run)
    study = Run("made-up", "quick", tmp_path)
    with study.progress(9) as steps:
        work.WorkPrecision(study, steps, "spring", FINER, lambda _: 0.0).run([AS_RUN], [1e-2], {1e-2: ()})
    chosen = "--section-degree {} --elements-per-turn {} --degree 5 --continuity 2"
    near = [f"spring {chosen.format(*one)} --repeat 1" for one in ((3, 16), (4, 8))]
    assert asked == ["spring --whole --repeat 6", *near, *3 * ["spring --whole --repeat 6"]]


def test_the_time_at_an_error_lies_on_the_line_between_two_meshes():
    """Time as the power -2 of the error."""
    records = [{"error": error, "seconds_motion": error**-2} for error in (0.1, 0.02, 0.005)]
    assert biceps.at(records, 0.01) == pytest.approx(1e4)
    assert biceps.at(records, 0.02) == pytest.approx(2500.0)
    assert biceps.at(records, 0.2) == pytest.approx(100.0)
    assert biceps.at(records, 0.001) is None


def made_up(method, seconds, check=None, holds=True, target=1e-3, **more):
    parts = {"total": seconds, "processor": seconds, "setup": 0.0, "assembly": 0.0, "solve": seconds}
    versions = {"ngsolve": "1"} | ({"dolfinx": "3"} if method == "fem" else {})
    return {
        "part": "confirm",
        "scene": "spring",
        "method": method,
        "arguments": f"{method} {seconds}",
        "seconds": parts | ({} if check is None else {"check": check}),
        "versions": versions,
        "target": target,
        "holds": holds,
        "error": 0.5 * target,
        "dofs": 100,
        "discretisation": [{"family": PAPER}],
    } | more


def test_the_share_is_that_of_the_best_of_all_programs_with_and_without_checks():
    plain = {"arguments": AS_RUN.arguments[0], "discretisation": [{"family": POLYNOMIALS}]}
    records = [
        made_up("cylindrical", 0.01, check=0.005),
        made_up("cylindrical", 0.2, check=0.02, **plain),
        made_up("fem", 1.0, check=0.5),
        made_up("ngsolve", 0.8),
        made_up("ngsolve", 0.1, holds=False),
    ]
    records[1]["seconds"]["estimate"] = 0.08
    names = [f"isorod, {PAPER}, chosen by hand", f"isorod, {POLYNOMIALS}, as isorod run has it"]
    _, rows = report.rows(records)
    assert [row[1] for row in rows] == [*names, "NGSolve 1", "dolfinx 3"]
    tuned, default = report.ratios(records, 1e-3)
    assert tuned == (records[0], pytest.approx(80.0), pytest.approx(100.0))
    # Without its check and its estimate 0.1 s.
    assert default == (records[1], pytest.approx(4.0), pytest.approx(5.0))
    assert [row[-4:] for row in rows[:3]] == [("",) * 4, ("",) * 4, ("1/80", "1/160", "1/80", "1/4")]
    assert report.ratios(records[2:], 1e-3) == []


def test_the_summary_says_how_isorods_elements_were_chosen_and_what_is_missing():
    setup = {"part": "opponents", "here": [], "absent": {"ngsolve": "not here"}, "load": 0.0}
    ours = {"part": "motion", "scene": "biceps", "method": "cylindrical", "curve": "isorod", "error": 5e-3}
    ours |= {"seconds_motion": 2.0, "seconds_steps": 1.6, "discretisation": [{"family": POLYHARMONIC}] * 2}
    motions = [
        {"part": "motion", "scene": "biceps", "method": "fem", "curve": "Q2", "error": 5e-3, "seconds_motion": 100.0},
        ours | {"arguments": "--order 2"},
        ours | {"arguments": AS_RUN.arguments[0], "seconds_motion": 200.0},
    ]
    records = [setup, made_up("cylindrical", 0.01), made_up("fem", 1.0), *motions]
    of, all_of = "the time of the best of all programs", "end forces of the motion to rest within 1 %: isorod, poly"
    assert report.summary(records) == [
        f"bench, spring, force within 0.1 %: isorod, {PAPER}, chosen by hand: 1/100 of {of}, 1/100 of it without "
        "checks",
        f"bench, biceps, {all_of}harmonic, chosen by hand: 1/50 of {of}, 1/62 of it without checks",
        f"bench, biceps, {all_of}harmonic, as isorod run has it: 2.0 times {of}, 1/62 of it without checks",
        "bench: not measured, ngsolve: not here",
    ]
