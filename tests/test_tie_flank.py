"""Rods whose ends are welded to the flanks of others, and what is said where they begin within these."""

import json
import re

import numpy as np
import pytest
from scipy.integrate import quad

from isorod import LinearElastic, modal, statics
from isorod.checks import embedded
from isorod.command.cli import main
from isorod.model import Body, Model, Tie
from isorod.model.tie import EndFace

pytest.importorskip("dolfinx")
pytest.importorskip("gmsh")

from comparisons.joints import flank

RADIUS = 0.6


@pytest.mark.parametrize("start", [0.0, 0.5, 0.8])
def test_what_is_within_the_other_rod(start):
    """Its volume is that of a cylinder up to the saddle where both surfaces meet."""
    (part,) = embedded.parts(flank.model(RADIUS, start, 0))
    volume, _ = quad(lambda y: 2.0 * np.sqrt(RADIUS**2 - y**2) * (np.sqrt(1.0 - y**2) - start), -RADIUS, RADIUS)
    assert (part.tie, part.body, part.other) == (0, 1, 0)
    assert part.volumes.sum() == pytest.approx(volume, rel=0.1)
    assert part.depth == pytest.approx(1.0 - start, abs=RADIUS / 8.0)


def test_none_is_within_what_its_end_meets():
    one, other = (Body(body.space, flank.LAW) for body in flank.model(RADIUS, 1.0, 0).bodies)
    assert embedded.parts(Model([one, other], ties=[Tie(EndFace(1, "start"), EndFace(0, "end"), gap=10.0)])) == []


@pytest.mark.parametrize("start", [0.0, 0.5])
def test_the_share_is_the_error(start):
    """Of the compliance, beside one solid; relative to the energy that is found, as estimates are."""
    exact, found = flank.as_one(RADIUS, 0.1), flank.coupled(RADIUS, start, section_degree=4)
    errors = 1.0 - exact / found.compliances
    assert (found.estimates > 0.5 * errors).all() and (found.estimates < 2.0 * errors).all()


def test_an_estimate_has_the_share_but_of_one_direction():
    solved = statics.solve(flank.model(RADIUS, 0.5, 2))
    share = embedded.of(solved).error
    both = sum(solved.estimate(direction) for direction in ("section", "axis"))
    assert share > 0.1
    assert solved.estimate() == pytest.approx(both + share, rel=0.05)


def test_frequencies_have_half_the_share_of_works():
    """Of a strut that swings on a column: beside one that begins at the surface."""

    def swinging(start):
        made = flank.model(RADIUS, start, 0, section_degree=3)
        return modal.solve(
            Model([Body(one.space, flank.LAW, 1.0) for one in made.bodies], made.supports, ties=made.ties), 2
        )

    deep, shallow = swinging(0.0), swinging(0.8)
    error = (1.0 - deep.frequencies / shallow.frequencies).max()
    share = embedded.of(deep).error - embedded.of(shallow).error
    assert 0.05 < 0.5 * error < share < 2.0 * error
    assert deep.estimate() > share


@pytest.mark.parametrize("nu", [0.4999, 0.5])
def test_rods_that_are_nearly_incompressible_have_a_share_too(nu):
    """As large as that of others: bending strains them alike."""
    made = flank.model(RADIUS, 0.0, 1, section_degree=3)
    shares = []
    for law in (flank.LAW, LinearElastic(1000.0, nu)):
        bodies = [Body(one.space, law, 1.0) for one in made.bodies]
        modes = modal.solve(Model(bodies, made.supports, ties=made.ties), 2)
        solved = statics.solve(Model(bodies, made.supports, loads=made.loads, ties=made.ties))
        shares.append([embedded.of(modes).error, embedded.of(solved).error])
    assert shares[1] == pytest.approx(shares[0], rel=0.15)


SCENE = """
analysis = "statics"
[rod.column]
curve = {straight = 8.0}
section = {circle = 1.0}
law = {LinearElastic = {E = 1000.0, nu = 0.3}}
[rod.strut]
curve = {straight = {start = [0, 0, 4], end = [6, 0, 4]}}
section = {circle = 0.6}
law = {LinearElastic = {E = 1000.0, nu = 0.3}}
[support.low]
rod = "column"
end = "start"
[support.high]
rod = "column"
end = "end"
[load.push]
rod = "strut"
end = "end"
force = [0.0, 0.001, 0.0]
[tie.joint]
slave = "strut.start"
master = "column.outer"
"""


MOTION = """
[analysis.dynamics]
integrator = "implicit"
end_time = 1.0
time_step = 0.25
outputs = 4
"""


def test_a_motion_is_warned_of(tmp_path, capsys):
    path = tmp_path / "t.toml"
    scene = SCENE.replace('analysis = "statics"', "").replace("nu = 0.3}}", "nu = 0.3}}\ndensity = 1.0")
    path.write_text(scene + MOTION)
    assert main(["run", str(path)]) == 0
    assert re.search(r"rod strut is within rod column for 0\.9\d* .* an error of about \d\d %", capsys.readouterr().err)


@pytest.mark.parametrize("words", [(), ("--no-estimate",), ("--tolerance", "0.01")])
def test_a_file_whose_axes_meet_is_warned_of(words, tmp_path, capsys):
    path = tmp_path / "t.toml"
    path.write_text(SCENE)
    assert main(["run", str(path), *words]) == 0
    _, err = capsys.readouterr()
    assert re.search(
        r"warning: rod strut is within rod column for 0\.9\d* from the end on that is welded to it, and held at that "
        r"end alone: this makes an error of about \d\d %; end it where it leaves the other, "
        r"or tie its outer surface in the place of its end, along = \[0, 0\.7\d+\]",
        err,
    )


def test_what_is_advised_is_right_to_some_per_cent(tmp_path, capsys):
    """Beside one solid; nothing is said of it but the estimate."""
    path = tmp_path / "t.toml"
    measure = '[measure.tip]\ndisplacement = "strut"\ncomponent = "y"\n'
    path.write_text(SCENE.replace('slave = "strut.start"', 'slave = "strut.outer"\nalong = [0, 0.75]') + measure)
    assert main(["run", str(path), "--json"]) == 0
    out, err = capsys.readouterr()
    assert "is within" not in err
    assert json.loads(out)["tip"] == pytest.approx(1e-3 * flank.as_one(RADIUS, 0.1)[1], rel=0.03)
