"""The gallery does as it says: each example is there, prints what stands below its command, and has a picture."""

import re
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest

from isorod.command.cli import main
from isorod.command.new import GALLERY

ROOT = Path(__file__).parent.parent
PAGE = ROOT / "docs" / "gallery.md"
PICTURES = PAGE.parent / "gallery"

# Those that take long.
SLOW = dict.fromkeys(("crossing", "wing", "cable", "screw", "valve", "stent"), pytest.mark.slow)

SECTION = r"""^\((?P<name>\w+)\)=
## [^\n]+

!\[[^\n]+\]\(gallery/(?P=name)\.png\)

.+?
```\{literalinclude\} \.\./src/isorod/files/examples/(?P=name)\.toml
:language: toml
```

```
(?P<command>[^\n]+)
```

```text
(?P<printed>.+?)
```
"""
SECTIONS = {one["name"]: one for one in re.finditer(SECTION, PAGE.read_text(), re.DOTALL | re.MULTILINE)}


def rows(printed):
    """Return the numbers of each label of what a run prints."""
    found, last = {"": []}, ""
    for line in printed.splitlines():
        label, rest = line[:20].strip(), line[20:]
        if label:
            last = label
            found[last] = []
        found[last] += map(float, re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[+-]?\d+)?(?![\w.])", rest))
    return found


def test_every_example_has_its_place():
    assert set(SECTIONS) == set(GALLERY)
    assert len(SECTIONS) >= 10


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW.get(name, ())) for name in SECTIONS])
@pytest.mark.filterwarnings("ignore:contact 0")
def test_an_example_prints_what_the_page_says(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for command in SECTIONS[name]["command"].split(" && "):
        program, *words = shlex.split(command)
        assert program == "isorod"
        capsys.readouterr()
        assert main(words) == 0
    compare(capsys.readouterr().out, SECTIONS[name]["printed"])


def test_the_first_rod_prints_what_the_start_page_says(tmp_path, monkeypatch, capsys):
    page = (ROOT / "docs" / "start.md").read_text()
    (section,) = re.findall(r"^```toml\n(section = .+)\n```$", page, re.MULTILINE)
    (printed,) = re.findall(r"^```text\n(deflection.+?)```$", page, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    assert main(["new", "beam.toml"]) == 0
    file = tmp_path / "beam.toml"
    changed, count = re.subn(r"^section = .*$", section, file.read_text(), flags=re.MULTILINE)
    assert count == 1
    file.write_text(changed)
    capsys.readouterr()
    assert main(["run", "beam.toml"]) == 0
    compare(capsys.readouterr().out, printed)


def compare(printed, page):
    """Hold what a run has printed against what the page says."""
    said, expected = rows(printed), rows(page)
    assert expected
    for label, numbers in expected.items():
        # An estimate, of results and maybe of stresses, is told to one digit; what is nothing is so beside what is not.
        relative = 0.6 if label == "error" else 3e-4
        scale = np.abs(numbers).max(initial=0.0)
        np.testing.assert_allclose(said[label], numbers, rtol=relative, atol=1e-4 * scale, err_msg=label)


@pytest.mark.parametrize("name", SECTIONS)
def test_a_picture_is_small_and_shows_something(name):
    image = pytest.importorskip("PIL.Image")
    file = PICTURES / f"{name}.png"
    assert file.stat().st_size < 100_000
    with image.open(file) as picture:
        assert max(picture.size) <= 1000
        grey = np.asarray(picture.convert("L"), dtype=float)
    # A rod is neither a blank sheet nor all over it.
    assert 0.01 < (grey < 250.0).mean() < 0.6


@pytest.fixture(scope="module")
def drawing():
    """What the program that draws the pictures has."""
    return runpy.run_path(str(PAGE.with_name("draw.py")))


def test_every_picture_can_be_drawn_again(drawing):
    assert set(drawing["VIEWS"]) == set(GALLERY)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["starter", "wing", "flower"])
def test_a_picture_is_that_of_its_example(drawing, name, tmp_path):
    image = pytest.importorskip("PIL.Image")
    pytest.importorskip("pyvista")
    found, kept = (
        np.asarray(image.open(file).convert("L"), dtype=float)
        for file in (drawing["draw"](name, tmp_path), PICTURES / f"{name}.png")
    )
    # Renderers differ in the edges of lines, and in letters.
    assert np.abs(found - kept).mean() < 2.0
