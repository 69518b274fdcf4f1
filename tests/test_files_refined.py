"""Scene files and the error of their results: told, warned of, and refined until it is small enough."""

import json
import re

import pytest

from isorod import SolveError
from isorod.command import cli, solving

BAR = """
title = "a bar with a force at its end"
[analysis.{analysis}]

[rod.bar]
curve = {{straight = 10.0}}
section = {{circle = 1.0}}
law = {{LinearElastic = {{E = 100.0, nu = 0.3}}}}
density = 1.0
space = {{{space}}}

[support.wall]
rod = "bar"
end = "start"
"""
LOAD = """
[load.tip]
rod = "bar"
end = "end"
force = [0.0, -1e-3, 0.0]

[measure.tip]
rod = "bar"
displacement = {place}
"""
PULLED = LOAD.format(place="{}")
WIRE = """
[rod.wire]
curve = {straight = 4.0}
section = {circle = 0.5}
law = {LinearElastic = {E = 100.0, nu = 0.3}}

[support.foot]
rod = "wire"
end = "start"

[load.push]
rod = "wire"
end = "end"
force = [1e-4, 0.0, 0.0]
"""
COARSE = "section_degree = 1, degree = 2, elements = 2"


@pytest.fixture
def run(tmp_path, capsys):
    """Run a file's scene; return its record, and what was said besides."""

    def told(text, *options):
        path = tmp_path / "bar.toml"
        path.write_text(text)
        code = cli.main(["run", str(path), "--json", *options])
        out, err = capsys.readouterr()
        assert (code, bool(out)) == (0, True), err
        return json.loads(out), err

    return told


def bar(space="", analysis="statics", more=PULLED):
    return BAR.format(analysis=analysis, space=space) + more


def test_the_error_is_told_and_a_large_one_warned_of(run):
    record, said = run(bar())
    assert record["error_estimate"] < 0.005 and said == ""
    record, said = run(bar(COARSE))
    assert record["error_estimate"] > 0.01
    assert said.startswith("isorod: warning: estimated error ")
    record, said = run(bar(COARSE), "--no-estimate")
    assert "error_estimate" not in record and said == ""


def test_a_tolerance_is_reached(run):
    record, said = run(bar(COARSE), "--tolerance", "1e-3")
    assert record["error_estimate"] <= 1e-3 and said == ""
    assert {name for name, *_ in record["refinements"]} >= {"section_degree", "degree"}
    exact, _ = run(bar("section_degree = 5, degree = 6, elements = 4, continuity = 0"), "--no-estimate")
    assert record["tip"] == pytest.approx(exact["tip"], rel=2e-3, abs=1e-12)


def test_a_tolerance_is_that_of_load_steps_too(run, tmp_path, capsys):
    hung = PULLED.replace("[measure", "history = [[0, 0], [0.1, 1], [3, 1]]\n\n[measure")
    text = bar("section_degree = 3, degree = 4, elements = 4", "statics", hung).replace(
        "[analysis.statics]", "[analysis.statics]\nend_time = 3.0"
    )
    text = re.sub("law = .*", "law = {Viscoelastic = {E = 100.0, nu = 0.3, prony = [[0.5, 1.0]]}}", text)
    record, said = run(text, "--tolerance", "1e-2")
    assert record["error_estimate"] <= 1e-2 and said == ""
    many, _ = run(text, "--tolerance", "1e-2", "--load-steps", "16")
    assert record["tip"] == pytest.approx(many["tip"], rel=1e-2, abs=1e-12)
    assert cli.main(["run", str(tmp_path / "bar.toml"), "--tolerance", "1e-2", "--load-steps", "1"]) == 2
    assert "most of it by few load steps" in capsys.readouterr().err


def test_frequencies_reach_a_tolerance(run):
    record, _ = run(bar("degree = 2, elements = 2", "modal", ""), "--modes", "4", "--tolerance", "5e-3")
    fine = "section_degree = 4, degree = 6, elements = 4, continuity = 0"
    exact, _ = run(bar(fine, "modal", ""), "--modes", "4", "--no-estimate")
    assert record["frequencies"] == pytest.approx(exact["frequencies"], rel=5e-3)


def test_of_several_rods_the_coarse_ones_are_refined(run):
    record, _ = run(bar(COARSE) + WIRE, "--tolerance", "2e-3")
    first, second = record["discretisation"]
    assert first["section_degree"] > 1 and first["degree"] > 2
    assert (second["elements"], second["degree"]) == (5, 5)
    assert record["error_estimate"] <= 2e-3


TOUCHING = """
[obstacle.floor]
Plane = {point = [0.0, -1.0, 0.0], normal = [0.0, 1.0, 0.0]}

[contact.floor]
first = "bar"
second = "floor"
penalty = 1.0
"""


def test_in_contact_a_tolerance_is_reached(run):
    text = bar("order = 2, degree = 3, elements = 2", more=LOAD.format(place="{component = 'y'}") + TOUCHING)
    record, _ = run(text, "--tolerance", "0.05")
    assert record["error_estimate"] <= 0.05


@pytest.mark.parametrize("at", [1, 2])
def test_in_contact_too_a_refinement_that_fails_leaves_the_result_there_was(at, tmp_path, monkeypatch, capsys):
    true, calls = solving.solve, []

    def solve(*given, **named):
        calls.append(given)
        if len(calls) == at:
            raise SolveError("no way")
        return true(*given, **named)

    monkeypatch.setattr(solving, "solve", solve)
    path = tmp_path / "bar.toml"
    path.write_text(bar("order = 1, degree = 2, elements = 2", more=LOAD.format(place="{component = 'y'}") + TOUCHING))
    assert cli.main(["run", str(path), "--tolerance", "1e-9", "--json"]) == 2
    out, err = capsys.readouterr()
    if at == 1:
        assert (out, err) == ("", "isorod: no way\n")
        return
    record = json.loads(out)
    said = f"estimated error {record['error_estimate']:.2g} after 0 refinements; the refined model fails: no way"
    assert err.endswith(f"isorod: tolerance 1e-09 not reached: {said}\n")


def test_a_rule_of_the_file_that_does_not_follow_is_refused(tmp_path, capsys):
    path = tmp_path / "bar.toml"
    path.write_text(bar("degree = 2, elements = 4, quadrature = '3x2x3'"))
    assert cli.main(["run", str(path), "--tolerance", "1e-3"]) == 2
    assert "quadrature: got '3x2x3', refinement needs a rule that follows" in capsys.readouterr().err
