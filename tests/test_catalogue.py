"""Rods of catalogues are right by their files alone, which are short."""

import warnings

import numpy as np
import pytest

from comparisons.catalogue import FOLDER, REFERENCES, compare
from comparisons.catalogue.computed import APART
from comparisons.newcomer import lines
from isorod import files
from isorod.command import cli
from isorod.files.scene import FileScene

FILES = sorted(FOLDER.glob("*.toml"))


def test_ten_files_of_twenty_lines():
    assert len(FILES) == 10
    assert max(map(lines, FILES)) <= 20
    assert {one.name for one in REFERENCES} <= {file.stem for file in FILES}
    assert all(FileScene(str(file)).analysis == "statics" for file in FILES)


def test_the_hanger_that_is_taken_apart_is_the_hanger():
    whole, apart = (files.find(str(file)).model() for file in (FOLDER / "coat_hanger.toml", APART["coat_hanger"]))
    for b, share in ((0, 0.5), (1, 1.0)):
        rod, other = whole.bodies[b].space.rod, apart.bodies[b].space.rod
        end = share * rod.axis.breaks[-1]
        assert other.axis.breaks[-1] == pytest.approx(end, rel=1e-6)
        u = np.linspace(0.0, end * (1.0 - 1e-6), 31)
        places, others = (one.grid([[0.0, 0.0]], u)[0] for one in (rod, other))
        assert others == pytest.approx(places, abs=2e-3)
    (coat,), (own, weight) = whole.loads, apart.loads
    volume = np.pi * 1.5**2 * float(whole.bodies[0].space.rod.axis.breaks[-1])
    assert own.density == coat.density
    assert weight.force == pytest.approx(volume * np.array(coat.density), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted({one.name for one in REFERENCES}))
def test_right_with_nothing_chosen(name):
    for row in compare([name]):
        assert abs(row.off) < row.reference.tolerance, row


@pytest.mark.parametrize(("pull", "warned"), [("0", True), ("0.1", False)])
def test_what_nothing_loads_or_moves_is_warned_of(pull, warned, capsys):
    words = [str(FOLDER / "s_hook.toml"), "--set", f"load.lower.force.2={pull}"]
    with warnings.catch_warnings():
        assert cli.main(["run", *words]) == 0
    assert ("nothing loads or moves the model" in capsys.readouterr().err) == warned
