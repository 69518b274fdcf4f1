"""Rods of catalogues are right by their files alone, which are short."""

import pytest

from comparisons.catalogue import FOLDER, REFERENCES, compare
from comparisons.newcomer import lines
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
