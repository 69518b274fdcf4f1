"""Rods of catalogues are right by their files alone, which are short."""

import warnings

import pytest

from comparisons.catalogue import FOLDER, REFERENCES, compare
from comparisons.newcomer import lines
from isorod.command import cli
from isorod.files.scene import FileScene

FILES = sorted(FOLDER.glob("*.toml"))


def test_ten_files_of_twenty_lines():
    assert len(FILES) == 10
    assert max(map(lines, FILES)) <= 20
    assert {one.name for one in REFERENCES} <= {file.stem for file in FILES}
    assert all(FileScene(str(file)).analysis == "statics" for file in FILES)


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
