"""What would be a wrong number is refused, in one line; what looks like one and is none is not."""

import dataclasses
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from comparisons.stability.point import petsc
from comparisons.stability.rods import stiffness
from isorod import files, modal, statics
from isorod.checks import hourglass
from isorod.command import cli
from isorod.errors import FoldedRodError, InputError, SolveError
from isorod.geometry.center_line import straight
from isorod.geometry.section import circle
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.scenes.blade import Blade
from isorod.scenes.spring import Spring
from isorod.space import Space

BAR = Path(files.__file__).parent / "examples" / "bar.toml"


@pytest.mark.parametrize(
    "scene", [Blade(preset="paper", elements=4, quadrature="1x1x3"), Spring(preset="paper", quadrature="1x1x4")]
)
def test_one_radial_point_is_refused(scene):
    with pytest.raises(InputError, match="integrates half the bending stiffness"):
        scene.model().bodies[0].space.tabulate(0, 1)


def test_hourglass_modes_are_refused():
    with pytest.raises(SolveError, match="misses the strain energy"):
        modal.solve(Blade(preset="paper", elements=6, order=2, quadrature="paper").model(), 4)
    with pytest.raises(SolveError, match=r"2x1x1 has fewer points than 'auto'"):
        modal.solve(Blade(preset="paper", elements=6, quadrature="2x1x1").model(), 4)


@pytest.mark.parametrize(
    "scene",
    [
        Spring(preset="paper", quadrature="paper"),
        Spring(preset="paper", quadrature="2x1x2", degree=2, elements_per_turn=4),
    ],
)
def test_the_papers_rules_are_checked_and_pass(scene, monkeypatch):
    checked, check_energy = [], hourglass.check_energy
    monkeypatch.setattr(hourglass, "check_energy", lambda *given: checked.append(check_energy(*given)))
    found = statics.solve(scene.model())
    assert checked == [None] and found.seconds["check"] > 0.0
    assert scene.measure(found)["force"] == pytest.approx(6.057, rel=0.02)


def test_default_rules_are_not_checked(monkeypatch):
    monkeypatch.delattr(hourglass, "check_energy")
    statics.solve(dataclasses.replace(Spring(preset="paper"), coils=1).model())


@pytest.mark.parametrize("pull", [1e-300, 1e-20, 1e-13, 1e-10])
def test_displacements_that_leave_no_digits_are_refused(pull):
    with pytest.raises(SolveError, match="double precision"):
        statics.solve(Spring(preset="paper", travel=pull).model())


def test_small_displacements_are_right():
    force = {pull: statics.solve(Spring(preset="paper", travel=pull).model()).reactions[1, 2] for pull in (1e-3, 1e-8)}
    assert force[1e-8] / 1e-8 == pytest.approx(force[1e-3] / 1e-3, rel=1e-3)


def test_moments_alone_are_no_imbalance():
    space = Space.paper(straight(4.0).sweep(circle(8)), section_degree=2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stiffness(space, "weak", 1.0, 1.0, 4.0)


def test_a_translation_is_no_imbalance():
    space = Space.paper(straight(4.0).sweep(circle(8)), section_degree=2)
    ends = [Support.end(space, end, displacement=(1.0, 2.0, 3.0)) for end in ("start", "end")]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = statics.solve(Model([Body(space, NeoHookean(1.0, 0.3))], ends))
    assert np.abs(found.reactions).max() < 1e-13


@pytest.mark.parametrize("modulus", [1e-12, 1.0, 2e4, 1e12])
def test_loose_tolerances_are_refused(modulus):
    """Whatever forces are counted in."""
    with petsc({"snes_atol": 1e5 * modulus}), pytest.raises(SolveError, match="SNES tolerances are too loose"):
        statics.solve(Spring(preset="paper", travel=6.0, E=modulus).model())


@pytest.mark.parametrize("modulus", [1e-60, 1e-12, 1e60])
def test_units_do_not_matter(modulus):
    scaled, plain = (statics.solve(Spring(preset="paper", E=E).model()).reactions[1, 2] / E for E in (modulus, 1.0))
    assert scaled == pytest.approx(plain, rel=1e-6)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("blade --density 1e-300", r"density: got 1e-300, need 1e-100 to 1e100; choose other units"),
        ("blade --E 1e300", r"Young's modulus E: got 1e\+300, need 1e-100 to 1e100; choose other units"),
        ("spring --E 1e-300", r"Young's modulus E: got 1e-300"),
        ("blade --quadrature 1x1x1", r"one radial point"),
        ("spring --quadrature 2x1x1", r"quadrature 2x1x1 has fewer points than 'auto'"),
        ("spring --travel 1e-13", r"at round-off level of the model size"),
    ],
)
def test_the_command_fails_with_one_line(line, message, command):
    assert re.search(message, command.refuses("run", *line.split(), "--json"))


def test_a_fold_between_layers_is_an_input_error():
    assert issubclass(FoldedRodError, InputError)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "knot", "--radius=1e-98"], "radius: got 1e-98, need 1e-50 to 1e+50"),
        (["run", "knot", "--loop=1e9"], "loop: got 1e+09, need 6 rod radii and more, at most 1e5"),
        (["run", "knot", "--tail=1e9"], "tail: got 1e+09, need 0 to 100000"),
        (["run", "rope", "--E=0"], "E: got 0, need a positive number"),
        (["run", "rope", "--radius=1e99"], "radius: got 1e+99, need 1e-50 to 1e+50"),
        (["run", "strand", "--pitch=1e-98"], "length over pitch: got 5.75e+99, need 0 to 12500"),
        (["run", "coil", "--coil-radius=1e300"], "centre line radius: got 1e+300, need 1e-100 to 1e100"),
        (
            ["show", "spring", "--coil-radius=1e-300", "--png=a.png"],
            "centre line radius: got 1e-300, need 1e-100 to 1e",
        ),
        (["run", str(BAR), "--set", "a" * 5000], "need a path in the file"),
    ],
)
def test_sizes_that_cannot_be_computed_with_are_one_line(words, said, capsys):
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n"), said in err) == ("", 1, True)
    assert len(err) < 500
