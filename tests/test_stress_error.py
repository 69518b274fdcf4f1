"""The estimate of the error of stresses stands with every picture and file that shows stress, and in the record."""

import pytest
from conftest import straight

from isorod import statics
from isorod.command import cli
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.output import picture, reading, words
from isorod.space import Space

pytest.importorskip("pyvista")

SIZE = ["--size", "360x280"]
BAR = """
[rod.bar]
curve = {straight = 6.0}
section = {circle = 0.5}
law = {NeoHookean = {E = 2.0, nu = 0.3}}
[support.root]
end = "start"
[load.pull]
end = "end"
force = [0.0, 0.001, 0.0]
[analysis.statics]
load_steps = 2
"""


@pytest.fixture
def said(monkeypatch):
    """What is written into pictures."""
    found = []
    write = picture.write
    monkeypatch.setattr(
        picture, "write", lambda plotter, text, *more: (found.append(text), write(plotter, text, *more))
    )
    return found


def test_the_error_of_stresses_is_in_record_files_and_pictures(said, tmp_path):
    """Refined to a tolerance too; of the last state alone, whose it is."""
    (tmp_path / "bar.toml").write_text(BAR)
    place = str(tmp_path / "results")
    assert cli.main(["run", str(tmp_path / "bar.toml"), "--tolerance", "0.5", "--output", place]) == 0
    result = reading.find(place)
    known = result.record[words.STRESS_ERROR]
    assert 0.0 < known < 1.0 and len(result.steps) == 2
    kept = [reading.mesh(step.files[0]).field_data for step in result.steps]
    assert list(kept[1][words.STRESS_ERROR]) == [known] and words.STRESS_ERROR not in kept[0]
    file = str(tmp_path / "bar.png")
    for more, note in (
        ([], f"stress error\nabout {words.percent(known)}"),
        (["--time", "0.5"], "stress error\nnot estimated"),
    ):
        said.clear()
        assert cli.main(["plot", place, "--png", file, *SIZE, *more]) == 0
        assert said[-1].endswith(f"\n{note}")
    assert cli.main(["plot", place, "--png", file, *SIZE, "--colour", "displacement"]) == 0
    assert "stress" not in said[-1]


def test_a_picture_of_a_solution_says_its_error_once_it_is_estimated(said):
    space = Space(straight(4, radius=0.5, height=6.0), elements=3, degree=3, section_degree=2)
    ends = Support.end(space, "start"), Support.end(space, "end", displacement=(0.1, 0.0, 0.0))
    bent = statics.solve(Model([Body(space, NeoHookean(2.0, 0.3))], ends))
    bent.plot(size=(360, 280))
    assert said[-1].endswith("\nstress error\nnot estimated")
    error = bent.errors().stress
    bent.plot(size=(360, 280))
    assert said[-1].endswith(f"\nstress error\nabout {words.percent(error)}")
    bent.plot("displacement", size=(360, 280))
    assert "stress" not in said[-1]


@pytest.mark.parametrize(("error", "told"), [(0.0234, "about 2 %"), (4.87e-3, "about 0.5 %"), (None, "not estimated")])
def test_one_text_says_the_error_of_stresses(error, told):
    assert words.stress_error(error) == f"stress error {told}"
