"""The study of random scene files: what it draws can be read, one is right, and what is silent is found."""

import pytest

from comparisons.stability import random_files
from isorod.files.scene import FileScene


def test_what_is_drawn_is_read(tmp_path):
    kinds = set()
    for seed in range(120):
        kind, text = random_files.draw(seed)
        assert random_files.draw(seed) == (kind, text)
        path = tmp_path / f"{seed}.toml"
        path.write_text(text)
        scene = FileScene(str(path))
        assert scene.analysis == ("modal" if kind.startswith("modes") else "statics")
        kinds.add(kind)
    assert kinds == {*random_files.STATICS, *random_files.MODES}


def test_one_is_as_right_as_its_estimate_says():
    """A bar under pressure."""
    found = random_files.compare(219)
    assert found["error"] / 3.0 < found["estimate"] < 3.0 * found["error"]
    assert found["answers"] < 1e-3
    assert found["stress at places"] < 0.01
    assert not random_files.silent(found)
    (total,) = (row for row in random_files.table([found], {}) if row["kind"] == "all")
    assert (total["files"], total["counted"], total["within 3"], total["silent"]) == (1, 1, 1.0, [])


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, False),
        ({"answers": 0.01}, True),
        ({"answers": 0.01, "estimate": 0.02}, False),
        ({"answers": 0.01, "warned": ["so"]}, False),
        ({"answers": 0.01, "answers apart": 0.009}, False),
        ({"stress at places": 0.05, "stress estimate": 0.01}, True),
        ({"stress at places": 0.05, "stress estimate": 0.04}, False),
    ],
)
def test_what_is_silent(changes, expected):
    right = {"warned": [], "estimate": 1e-4, "answers": 1e-4, "answers apart": 1e-5}
    assert random_files.silent(right | changes) == expected
