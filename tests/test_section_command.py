"""``isorod section``: what it prints and writes, and what it answers in one line."""

import csv

import numpy as np
import pytest

import isorod

LAYERED = """
analysis = "statics"
[rod.cable]
curve = {straight = 10.0}
section = {circle = 2.0}
rings = [0.0, 0.5, 1.0]
law = [{LinearElastic = {E = 10.0, nu = 0.3}}, {LinearElastic = {E = 40.0, nu = 0.3}}]
density = [3.0, 1.0]
space = {section_degree = 2, elements = 2, degree = 2}
[rod.rubber]
curve = {arc = {radius = 5.0, angle = 90.0}}
section = {ellipse = {a = 1.0, b = 0.5}}
law = {NeoHookean = {E = 1.0, nu = 0.49}}
space = {section_degree = 2, elements = 2, degree = 2}
[support.wall]
rod = "cable"
end = "start"
[support.other]
rod = "rubber"
end = "start"
"""


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.toml").write_text(LAYERED)
    return tmp_path / "two.toml"


def test_words(command):
    out = command.prints("section", "blade", "--u", "end")
    assert max(map(len, out.splitlines())) <= 80
    body = isorod.scenes.find("blade")().model().bodies[0]
    found = isorod.section_properties(body, "end")
    rows = {line.split()[0]: line.split()[1:] for line in out.split("mass per length")[0].splitlines() if line}
    assert np.array(rows["T"], dtype=float) == pytest.approx(found.stiffness[3], rel=1e-4, abs=1e-6)
    assert "tension centre      (0, 0)" in out
    assert f"EA, GJ              {found.EA:.6g}, {found.GJ:.6g}" in out
    assert "estimated error     0.014 %, on polynomials of degree 8" in out


def test_rods_of_a_file(file, command):
    """The first one where none is named; by its name, and by its number."""
    record = command.record("section", "two.toml")
    assert (record["scene"], record["rod"], record["order"]) == ("two", "cable", ["N", "Q1", "Q2", "T", "M1", "M2"])
    assert record["EA"] == pytest.approx(np.pi * (10 + 40 * 3), rel=1e-8)
    assert record["mass"][0][0] == pytest.approx(np.pi * (3 + 1 * 3), rel=1e-12)
    assert {"versions", "commit", "time"} <= set(record)
    named = command.prints("section", "two.toml", "--rod", "rubber", "--u", "0.5")
    assert named.startswith("section of two, rod rubber, at u = 0.5 of 0 to 1; area 1.5708\n")
    assert "no mass: the rod has no density" in named
    assert command.prints("section", "two.toml", "--rod", "1", "--u", "0.5") == named


def test_table(file, command):
    record = command.record("section", "two.toml", "--output", "cable.csv")
    head, *rows = csv.reader((file.parent / "cable.csv").open())
    assert head == ["matrix", "row", *record["order"]]
    for name in ("stiffness", "mass"):
        matrix = [list(map(float, row[2:])) for row in rows if row[0] == name]
        assert matrix == record[name]
    assert [row[1] for row in rows] == 2 * record["order"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("two.toml --rod third", "--rod: got 'third', need one of cable, rubber"),
        ("two.toml --rod 2", "--rod: got '2', need one of cable, rubber"),
        ("two.toml --u 7", "axis parameter u: got 7, need numbers from 0 to 1, or 'start' or 'end'"),
        ("two.toml --u there", "axis parameter u: got 'there'"),
        ("two.toml --output table.txt", "--output: got table.txt, need a file that ends in .csv"),
        ("two.toml --output none/table.csv", "none/table.csv"),
        ("flower", "section: this scene is geometry alone"),
        ("sprig", "scene 'sprig' is not known"),
        ("two.toml -ksp_type cg", "option -ksp_type: PETSc options go with 'isorod run SCENE'"),
        ("spring --nu 0.5", "section properties: an incompressible law"),
    ],
)
def test_bad_words(words, said, file, command):
    assert said in command.refuses("section", *words.split())
    assert [one.name for one in file.parent.iterdir()] == ["two.toml"]


def test_help(command):
    assert command.prints("section", "--help").startswith("usage: isorod section SCENE")
