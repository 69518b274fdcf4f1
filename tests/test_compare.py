"""Comparing a scene of anyone's: the course of it, what it refuses, its page, and the command."""

import contextlib
import html
import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("rich")

from test_compare_numbers import FILE

from comparisons import __main__ as comparisons
from comparisons import compare
from comparisons.measure import rod, sampled, timing
from comparisons.measure.records import part
from comparisons.report import compare as report
from comparisons.report import page, plots, rod_pictures
from isorod.checks import stresses
from isorod.command import beside, cli
from isorod.command import compare as command
from isorod.files.scene import FileScene
from isorod.scenes.blade import Blade
from isorod.space.basis import FAMILIES
from meshes import rods

MODES = """
[rod.bar]
curve = {straight = 8.0}
section = {ellipse = {a = 1.0, b = 0.8}}
law = {LinearElastic = {E = 1.0, nu = 0.3}}
density = 1.0
[analysis.modal]
modes = 4
"""
MOTION = FILE.replace("[analysis.statics]", "[analysis.dynamics]\nend_time = 1.0").replace(
    "law =", "density = 1.0\nlaw ="
)


def fem(arguments):
    """Stand for finite elements: isorod's own solution, off by some quarter of the square of the cells' size."""
    word, level, file = arguments[1], int(arguments[3]), Path(arguments[-1])
    scene = rod.find(word, {})
    settings = scene.settings()
    solution, runs = rod.solve(scene, settings, 1)
    mesh = rods.build([body.space.rod for body in solution.model.bodies], level)
    off = 1.0 + 0.04 / level**2
    where, numbers = mesh.parameters, np.zeros(len(mesh.points), dtype=np.int64)
    arrays = {"points": mesh.points, "parameters": where, "node_rod": numbers, "cells": mesh.cells}
    arrays |= {"weights": mesh.node_volumes(), "order": np.array(mesh.order)}
    u, xi = np.array([]), np.zeros((0, 2))
    if scene.analysis == "statics":
        u, xi = stresses.away(solution.model, 0), stresses.around([1.0])
    rows = np.zeros(u.size * len(xi), dtype=np.int64), np.tile(xi, (u.size, 1)), u.repeat(len(xi))
    places = sampled.Places(numbers, where[:, :2], where[:, 2], *rows)
    found = {name: off * values for name, values in sampled.fields(solution, places).items()}
    if scene.analysis == "modal":
        found = {"modes": np.concatenate([np.ones((solution.rigid, len(numbers), 3)), found["modes"]])}
        found["frequencies"] = off * solution.frequencies
    else:
        arrays |= {"surface_parameters": np.column_stack(rows[1:]), "surface_rod": rows[0]}
        found["surface_von_mises"] = found.pop("von_mises")
    np.savez(file, **arrays, **found)
    record = rod.record(scene, solution, runs, settings)
    measured = {name: off * np.asarray(record[name]) for name in scene.units}
    seconds = record["seconds"] | {"total": 0.3 * level**3, "forms": 0.0}
    record |= {"method": "fem", "dofs": 3 * len(mesh.points), "seconds": seconds, **measured}
    record["versions"] |= {"dolfinx": "0.5.2"}
    return json.loads(json.dumps(record, default=lambda one: one.tolist()))


@pytest.fixture
def both(monkeypatch, tmp_path):
    """Compare a file in this process, finite elements and pictures being stood for; return records and folder."""

    def run(module, arguments, *_):
        asked.append((module, list(arguments)))
        if module == "comparisons.fem":
            return fem(arguments)
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            rod._main(arguments)
        return json.loads(said.getvalue().splitlines()[-1])

    def picture(study, *_):
        study.record("picture", {"file": "a.png", "alt": "both", "caption": "both sides"})

    asked = []
    monkeypatch.setattr(timing, "run", run)
    # What takes time, and shows no more.
    monkeypatch.setattr(compare, "LEVELS", (1, 2, 3))
    monkeypatch.setattr(compare, "REPEAT", 1)
    monkeypatch.setattr(rod_pictures, "write", picture)

    def study(text, code=0):
        (tmp_path / "my bar.toml").write_text(text)
        folder = tmp_path / "results"
        assert comparisons.main(["compare", str(tmp_path / "my bar.toml"), "--results", str(folder)]) == code
        lines = (folder / "compare-my-bar.jsonl").read_text().splitlines() if not code else []
        return [json.loads(line) for line in lines], folder, asked

    return study


def test_both_sides_run_and_the_answer_is_on_page_and_screen(both, capsys):
    records, folder, asked = both(FILE)
    work = part(records, "work")
    assert [one["label"] for one in work if one["method"] == "fem"] == ["mesh 1", "mesh 2", "mesh 3"]
    ours = [one for one in work if one["method"] == "cylindrical"]
    assert [one["label"] for one in ours] == ["default", "N−1, e/2", "N+1, 2e", "N−1", "N+1", "N+2", "e/2", "2e"]
    (quantity,) = part(records, "converged")[0]["quantities"]
    # What stands for finite elements converges to isorod's default with second order, from 4 % off.
    assert quantity["orders"] == pytest.approx([2.0], abs=1e-6)
    assert quantity["values"] == pytest.approx([ours[0]["force"]], rel=1e-9)
    assert quantity["uncertainties"] == pytest.approx([0.04 / 9.0 * ours[0]["force"]], rel=1e-6)
    assert [one["error"] for one in work[:3]] == pytest.approx([0.04, 0.01, 0.04 / 9.0], rel=1e-6)
    assert ours[0]["error"] < 1e-9 and ours[1]["error"] > ours[0]["error"]
    # On the finest mesh fields are so much larger.
    far = 0.04 / 9.0
    field = ours[0]["field"]
    assert [field["displacement"], ours[0]["stress"]] == pytest.approx([far / (1.0 + far)] * 2, rel=1e-6)
    for name in ("displacement", "stress"):
        off = [one["field"][name] for one in work[:3]]
        assert off == pytest.approx([(0.04 - far) / (1.0 + far), (0.01 - far) / (1.0 + far), 0.0], rel=1e-6)
    assert field["peak"] == pytest.approx(work[2]["field"]["peak"] / (1.0 + far), rel=1e-6)
    assert 0.0 < ours[0]["error_estimate"] < 0.1
    # Every run has its error of stress; the default's is told against isorod's finest space too.
    (finer,) = part(records, "finer")
    assert finer["label"] == "N+1, 2e" and finer["dofs"] == max(one["dofs"] for one in ours)
    assert all("stress" in one for one in work) and 0.0 < finer["stress"] < ours[1]["stress"]
    said = capsys.readouterr().out
    assert "my bar: default (polynomials) within 0.5 %: yes, stress within 3 %: yes; error of force 0 %; finite" in said
    assert "my bar: von Mises stress at surfaces, a diameter and more from edges, 0.44 % from dolfinx' finest" in said
    assert "which converged to 0.55 %, and" in said and "from isorod's finest space (N+1, 2e); isorod's own" in said
    assert "my bar stress within 1 %: isorod (" in said
    text = (folder / "report.html").read_text()
    for piece in (
        "within 0.5 %: <strong>yes</strong>, stress within 3 %: <strong>yes</strong>",
        "<h2 id=my-bar>my bar</h2>",
        "a.png",
        "isorod compare",
        "N+1, 2e",
    ):
        assert piece in text
    assert (folder / "compare-my-bar-errors.png").stat().st_size > 10_000
    assert "with nothing chosen by hand isorod (polynomials) is" in text
    assert "has it: polynomials, section degree " in text
    assert set(FAMILIES) <= set(re.findall("<dt>(.*?)</dt>", html.unescape(text)))
    chosen, silent = {"discretisation": [{"chosen": ["quadrature"]}]}, {"rod": {"beam": {"curve": {}}}}
    told = {"rod": {"beam": {"space": {"elements": 4}}}}
    assert report._by(chosen | {"options": told}) == "on the space that its file gives it"
    assert report._by(chosen | {"options": silent}) == "with nothing chosen by hand"
    assert all(arguments[-2] == "--fields" for _, arguments in asked)


def test_modes_are_paired_and_the_page_has_a_row_for_each(both, capsys, monkeypatch):
    monkeypatch.setattr(compare, "variants", lambda *_: [])
    records, folder, _ = both(MODES)
    default = next(one for one in part(records, "work") if one["label"] == "default")
    assert default["field"]["partner"] == [0, 1, 2, 3] and default["field"]["shape"] < 1e-9
    assert len(part(records, "converged")[0]["quantities"][0]["values"]) == 4
    assert "mode shapes within 0 % of dolfinx'" in capsys.readouterr().out
    assert (folder / "report.html").read_text().count("<td class=text>mode ") == 4


@pytest.mark.parametrize("most", [(30_000, 1e3), (10**6, 20.0)])
def test_meshes_that_are_too_large_are_left_out_and_said(most, both, monkeypatch):
    monkeypatch.setattr(compare, "LEVELS", (1, 2, 4))
    monkeypatch.setattr(compare, "variants", lambda *_: [])
    monkeypatch.setitem(compare.MOST, "quick", compare.Most(*most))
    records, folder, _ = both(FILE)
    assert [one["label"] for one in part(records, "work")][:-1] == ["mesh 1", "mesh 2", "mesh 3"]
    assert "--level 4 --degree 2: left out: about" in (folder / "report.html").read_text()


def test_what_finite_elements_refuse_is_one_line_and_nothing_is_written(both, monkeypatch, capsys):
    def refuse(module, arguments, *_):
        raise timing.Failed("python -m comparisons.fem ...: exit code 2: x", "my bar.toml: contact: not here")

    monkeypatch.setattr(timing, "run", refuse)
    _, folder, _ = both(FILE, code=2)
    said = capsys.readouterr().err.splitlines()
    assert said[-1].startswith("isorod: ") and said[-1].endswith("my bar.toml: contact: not here")
    assert not folder.exists()


def test_a_measurement_that_fails_or_takes_too_long_says_so_in_a_line():
    with pytest.raises(timing.Failed, match="exit code 2: ") as caught:
        timing.run("comparisons.measure.rod", ["sprig"])
    assert caught.value.last_line.startswith("scene 'sprig' is not known; there are")
    with pytest.raises(timing.Failed, match=r"python -m timeit .*: not done after 0\.2 s"):
        timing.run("timeit", ["-n1", "import time; time.sleep(9)"], timeout=0.2)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["compare"], "isorod: compare: no scene is named; name one: NAME.toml, spring or blade (see"),
        (["spring", "blade"], "comparisons: spring blade: only compare takes a scene (see"),
        (
            ["compare", "biceps"],
            "isorod: biceps: it moves, and presses on itself; its comparison is a study: python",
        ),
        (
            ["compare", "ring"],
            "isorod: ring: geometry alone, with nothing to solve; isorod run ring tells its vol",
        ),
        (["compare", "flower"], "isorod: flower: geometry alone"),
        (["compare", "sprig"], "isorod: scene 'sprig' is not known; there are: biceps, blade"),
        (["compare", "none.toml"], "isorod: none.toml: "),
        (
            ["compare", "moves.toml"],
            "isorod: moves.toml:12: analysis: integrator: finite elements take isorod's implicit steps; set integrator "
            '= "implicit" and time_step = ',
        ),
        (["spring", "--ranks", "2"], "comparisons: --ranks 2: only compare takes ranks (see"),
        (["compare", "moves.toml", "--ranks", "0"], "isorod: --ranks: got 0, need "),
    ],
)
def test_refusals_are_one_line(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("moves.toml").write_text(MOTION)
    assert comparisons.main(words) == 2
    out, error = capsys.readouterr()
    assert out == "" and error.startswith(said) and error.count("\n") == 1
    assert not Path("results").exists()


def run_of(method, label, total, error, dofs=100):
    named = {"method": method, "label": label, "curve": "isorod" if method == "cylindrical" else "Q2 bricks"}
    more = {"discretisation": [{"family": "polynomials"}], "seconds": {"total": total}}
    return named | more | {"error": error, "dofs": dofs}


def test_run_time_to_an_error_is_interpolated_between_meshes():
    meshes = [run_of("fem", f"mesh {k}", 10.0**k, 0.1**k, 100 * k) for k in (1, 2, 3)]
    assert report.at_equal_error(meshes, 10.0**-2.5) == (pytest.approx(10.0**2.5), "")
    assert report.at_equal_error(meshes, 1e-2) == (pytest.approx(100.0), "")
    assert report.at_equal_error(meshes, 1e-5) == (pytest.approx(1000.0), "more than")
    assert report.at_equal_error(meshes, 0.5) == (pytest.approx(10.0), "at most")
    assert report.at_equal_error([], 0.5) is None


def canned(error, doubt):
    quantity = {"name": "force", "values": [1.0], "uncertainties": [doubt], "orders": [2.0], "spread": 0.1}
    default = run_of("cylindrical", "default", 0.01, error) | {"part": "work"}
    return [default, {"part": "converged", "quantities": [quantity]}]


@pytest.mark.parametrize(
    ("error", "doubt", "said"),
    [
        (1e-3, 1e-4, "yes"),
        (4.9e-3, 1e-3, "yes, but finite elements converged to 0.1 % only"),
        (5.5e-3, 1e-3, "no, but finite elements converged to 0.1 % only"),
        (2e-2, 1e-3, "no"),
    ],
)
def test_the_verdict_says_how_far_finite_elements_tell(error, doubt, said):
    assert report.verdict(canned(error, doubt)) == said


def canned_stress(error, finer, before, measured=()):
    """Return records of a default, and of meshes of which the last one stands for the limit of stresses."""
    records = canned(1e-4, 1e-5)
    records[0]["stress"] = error
    meshes = [(0.1, 1.0), (before, 10.0), (0.0, 100.0)]
    for k, (stress, seconds) in enumerate(meshes):
        own = {"part": "work", "sequence": True, "stress": stress}
        records.append(run_of("fem", f"mesh {k}", seconds, 1e-3, 10 * k) | own)
    peak = {"name": "peak", "values": [2.0], "uncertainties": [0.002], "orders": [2.0], "spread": 0.1}
    records[1]["quantities"].append(peak)
    named = [{"part": "scene", "stresses": list(measured)}]
    return records + named + [{"part": "finer", "label": "2e", "stress": finer}]


@pytest.mark.parametrize(
    ("error", "finer", "before", "said"),
    [
        (0.01, 0.004, 5e-3, "yes"),
        # Nearer to dolfinx than to what is finer here.
        (0.01, 0.06, 5e-3, "no"),
        (0.02, 0.004, 0.025, "yes, but finite elements converged to 2.5 % only"),
    ],
)
def test_the_verdict_on_stress_is_against_both_references(error, finer, before, said):
    records = canned_stress(error, finer, before)
    assert report.verdict(records, "stress") == said and report.uncertainty(records, "stress") == before
    assert report.verdict(records) == "yes"
    # What a file measures is judged by the limit of the meshes, and is no part of the other error.
    measured = canned_stress(error, finer, before, ["peak"])
    assert (report.uncertainty(measured, "stress"), report.uncertainty(measured)) == pytest.approx((1e-3, 1e-5))


def test_run_times_to_an_error_of_stress_leave_the_reference_out():
    """The finest mesh is nought from itself."""
    said = report._beside(canned_stress(0.01, 0.004, 0.02), "stress")
    assert said.endswith("the 10,000 ms of dolfinx to 2 % of stress, which is as far as finite elements converged")


def test_stress_has_a_curve_of_its_own(tmp_path):
    """A third panel: what was two panels high 5.4 inches is two rows."""
    image = pytest.importorskip("PIL.Image")
    runs = [run_of("fem", "mesh 1", 1.0, 1e-2), run_of("cylindrical", "default", 0.01, 1e-3)]
    runs = [one | {"sequence": True, "field": {"displacement": 1e-3}, "stress": 0.02} for one in runs]
    path = tmp_path / "errors.png"
    plots.labelled(runs, {"error": 1e-4, "stress": 1e-3}, path)
    assert image.open(path).size == (1560, 1274)


def test_the_command_becomes_the_comparison_of_the_checkout(monkeypatch, tmp_path):
    """From another folder too, where something of the same name is not meant."""
    started = []
    monkeypatch.setattr(os, "execve", lambda *given: started.append(given))
    monkeypatch.setattr(command, "find_spec", lambda name: object())
    monkeypatch.chdir(tmp_path)
    cli.command(["compare", "my.toml", "--results", "here"])
    ((program, words, around),) = started
    assert (program, words[1:]) == (sys.executable, ["-m", "comparisons", "compare", "my.toml", "--results", "here"])
    (tmp_path / "comparisons.py").write_text("raise SystemExit(7)")
    done = subprocess.run([*words[:3], "--help"], env=around, capture_output=True, text=True)
    assert done.returncode == 0 and "a scene of yours" in done.stdout


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        (
            {"dolfinx"},
            "isorod: compare: dolfinx is not installed; Debian: apt install python3-dolfinx-real; elsewhere: pip",
        ),
        ({"rich", "pyvista"}, "isorod: compare: pyvista, rich are not installed; pip install 'isorod[compare]'\n"),
        ({"comparisons"}, "isorod: compare: the comparisons are not installed: pip install 'isorod[compare]', or run"),
    ],
)
def test_what_is_not_installed_is_said_with_how_to_get_it(missing, said, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(command, "find_spec", lambda name: None if name in missing else object())
    if "comparisons" in missing:
        monkeypatch.setattr(beside, "CHECKOUT", tmp_path)
        monkeypatch.setattr(beside, "find_spec", lambda _: None)
    monkeypatch.setattr(os, "execve", lambda *_: pytest.fail("started"))
    assert cli.main(["compare", "my.toml"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(said) and error.count("\n") == 1


def test_the_command_loads_nothing_of_comparisons_or_dolfinx(python):
    script = """
import os, sys
os.execve = lambda *_: print(sorted({name.split(".")[0] for name in sys.modules}))
from isorod.command import cli
cli.main(["compare", "my.toml"])
"""
    done = python(script)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stdout.replace("'", "").strip("[]\n").split(", "))
    assert "isorod" in loaded and not loaded & {"comparisons", "meshes", "dolfinx", "gmsh", "petsc4py", "pyvista"}


def test_petsc_options_are_not_for_the_comparison(capsys):
    assert cli.main(["compare", "my.toml", "-snes_monitor"]) == 2
    assert "PETSc options go with 'isorod run SCENE'" in capsys.readouterr().err


def test_a_scene_of_the_package_counts_its_elements_in_its_own_way(tmp_path):
    blade = rod.find("blade", {"elements": 3, "degree": None})
    assert isinstance(blade, Blade) and (blade.elements, blade.degree) == (3, None)
    (tmp_path / "bar.toml").write_text(FILE)
    bar = rod.find(str(tmp_path / "bar.toml"), {"degree": 4})
    assert isinstance(bar, FileScene) and bar.degree == 4 and bar.settings() == {}


@pytest.mark.slow
def test_a_file_from_end_to_end(tmp_path):
    """With dolfinx and pictures, from another folder."""
    pytest.importorskip("dolfinx")
    pytest.importorskip("pyvista")
    (tmp_path / "bar.toml").write_text(FILE.replace("straight = 8.0", "straight = 4.0"))
    program = [sys.executable, "-m", "isorod", "compare", "bar.toml"]
    done = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    assert "bar: default (polynomials) within 0.5 %: " in done.stdout and "report: results/report.html" in done.stdout
    for name in ("report.html", "compare-bar-picture.png", "compare-bar-errors.png"):
        assert (tmp_path / "results" / name).stat().st_size > 5_000
    # The page again, from the records alone.
    before = (tmp_path / "results" / "report.html").read_text()
    assert comparisons.main(["report", "--results", str(tmp_path / "results")]) == 0
    assert (tmp_path / "results" / "report.html").read_text() == before
    assert page.summary(tmp_path / "results")
