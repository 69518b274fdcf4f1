"""README and docs do as they say: every command as printed, in a clone, and every link."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from comparisons import __main__ as comparisons
from isorod.command.parser import split

ROOT = Path(__file__).parent.parent
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
# Its commands have a test file of their own.
GALLERY = ROOT / "docs" / "gallery.md"
# What a page marks so takes minutes.
# Commands that take ten seconds and more.
LONG = (
    "isorod run biceps --statics",
    "isorod sweep spring --travel 0:10:21",
    "isorod plot seen/blade --mode 2 --gif blade.gif --size 400x500",
    "isorod run coil",
    "isorod run creep",
    "isorod run set",
    "isorod run set --output results",
    "isorod plot results --curve --png loop.png",
    "isorod plot seen/spring --gif spring.gif --size 600x450",
    "mpirun -n 2 python -m comparisons.fem spring --degree 2 --around 8 --layers 48",
    "python -m comparisons.fem rods src/isorod/files/examples/starter.toml --level 1 --fields fields.npz",
)

# Words of commands that become another program, or end the process.
BECOMES = ("mesh", "compare", "--help")
MINUTES = re.compile(r"\bmin(utes)?\b")
# What docker/opponents installs; tests/test_opponents.py runs it where it is.
OPPONENTS = ("python -m comparisons.ngsolve",)


def blocks(page, language):
    """Return the code blocks of a page in a language, "" for commands."""
    # All of them: what ends one begins no other.
    found = re.findall(r"^```([^\n]*)\n(.*?)^```$", page.read_text(), re.MULTILINE | re.DOTALL)
    return [block for kind, block in found if kind == language]


def links(page):
    """Return where a page's links and pictures lead."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'<img src="([^"]+)"', text)


def anchors(page):
    """Return the places that links to a page may name: its headings as GitHub and Sphinx write them, and labels."""
    heads = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S), re.MULTILINE)
    slugs = (re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads)
    return {*slugs, *re.findall(r"^\((\w+)\)=$", page.read_text(), re.MULTILINE)}


def scripts(page):
    """Return the Python scripts of a page, each with what it prints where that stands below it, else None."""
    below = r"^```python\n(.*?)^```$(?:\n\n^```text\n(.*?)^```$)?"
    return [(one[1], one[2]) for one in re.finditer(below, page.read_text(), re.MULTILINE | re.DOTALL)]


def commands():
    """Return each command with the comment beside it, and its page."""
    for page in PAGES:
        for block in blocks(page, "") if page != GALLERY else ():
            for line in block.splitlines():
                command, _, comment = line.partition(" #")
                if command.strip():
                    yield pytest.param(command.strip(), comment, id=f"{page.stem}: {command.strip()}")


def ends_late(command, comment):
    """Return whether a command is for a person's patience, or for another machine than a test's."""
    return command.startswith(
        ("git clone", "source", "make", "docker", "pip", "conda", "GROUND=", "python -m comparisons ", *OPPONENTS)
    ) or (MINUTES.search(comment) or command in LONG)


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A clone of what is in the tree, with this interpreter's programs first on PATH."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no clone to be made here")
    if not Path(sys.executable).with_name("isorod").exists():
        pytest.skip("the isorod command is not beside this interpreter")
    place = tmp_path_factory.mktemp("documents") / "isorod"
    subprocess.run(["git", "-c", f"safe.directory={ROOT}", "clone", "-q", str(ROOT), str(place)], check=True)

    def run(command, timeout=120):
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        return subprocess.run(
            command,
            shell=True,
            cwd=place,
            env=os.environ | {"PATH": path},
            capture_output=True,
            text=True,
            timeout=timeout,
        )

    run.place = place
    return run


def isorods(line):
    """Return the words of the `isorod` commands of a line, none where PETSc's options or other programs are among them.

    Meshes and comparisons are such programs, whose process takes the place of the command's.
    """
    parts = [shlex.split(part) for part in line.split(" && ")]
    own = all(part[0] == "isorod" and not {part[1], part[-1]} & {*BECOMES} and not split(part[1:])[1] for part in parts)
    return [part[1:] for part in parts] if own else []


PRINTED = {one.values[0]: one for one in commands() if not ends_late(*one.values)}


@pytest.mark.parametrize(("line", "comment"), PRINTED.values())
def test_a_command_runs_as_printed(clone, line, comment, command, monkeypatch):
    """In this process where it is `isorod` alone: starting Python takes longer than most of them do."""
    monkeypatch.chdir(clone.place)
    for words in isorods(line):
        assert command.prints(*words)
    if not isorods(line):
        done = clone(line)
        assert done.returncode == 0, done.stderr
        assert done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "comment"),
    [
        one
        for one in commands()
        if one.values[0] in LONG or (ends_late(*one.values) and one.values[0].startswith("isorod "))
    ],
)
def test_a_command_of_minutes_runs_as_printed(clone, command, comment):
    done = clone(command, 1800)
    assert done.returncode == 0, done.stderr
    assert done.stdout


@pytest.mark.parametrize(
    ("command", "comment"), [one for one in commands() if one.values[0].startswith("python -m comparisons ")]
)
def test_a_study_is_known_as_printed(command, comment, capsys):
    # A study begins with its folder, which cannot be made here.
    words = command.replace("--case NAME", "").split()[3:]
    assert comparisons.main([*words, "--results", "/dev/null/results"]) == 2
    assert capsys.readouterr().err.startswith("comparisons: results folder /dev/null/results: ")


@pytest.mark.parametrize(("command", "comment"), [one for one in commands() if "make " in one.values[0]])
def test_a_task_is_known_as_printed(command, comment):
    task = shlex.split(command[command.index("make ") :])[1]
    assert subprocess.run(["make", "-n", task], cwd=ROOT, capture_output=True, check=False).returncode == 0


@pytest.mark.parametrize("page", [page for page in PAGES if scripts(page)], ids=lambda page: page.stem)
def test_scripts_run_as_printed(page, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for script, printed in scripts(page):
        exec(compile(script, page.name, "exec"), {})
        out = capsys.readouterr().out
        assert out == printed if printed else out


def test_a_trefoil_from_40_points_is_8_lines_and_meets_them(capsys):
    (script,) = (one for one, _ in scripts(ROOT / "docs" / "python.md") if "polyline" in one)
    assert sum(bool(line.strip()) for line in script.splitlines()) <= 8
    names = {}
    exec(script, names)
    assert capsys.readouterr().out.startswith("frequencies: ")
    knot = names["knot"]
    u = np.linspace(*knot.axis.breaks[[0, -1]], 40001)
    line = knot.points(np.zeros((u.size, 2)), u)
    distances = [np.linalg.norm(line - point, axis=1).min() for point in names["points"]]
    assert len(distances) == 40
    # The tolerance that the script names, and what lies between two of the places looked at.
    assert max(distances) <= 1e-3 + 1e-5


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_lead_somewhere(page):
    for link in links(page):
        if link.startswith("https://"):
            continue
        file, _, place = link.partition("#")
        target = page.parent / file if file else page
        assert target.exists(), link
        assert not place or place in anchors(target), link


def test_the_readme_begins_with_ten_lines_of_python():
    """On its first screen; `test_scripts_run_as_printed` runs them."""
    head = "\n".join((ROOT / "README.md").read_text().splitlines()[:40])
    ((script, printed),) = scripts(ROOT / "README.md")
    assert script in head and printed in head
    assert sum(bool(line.strip()) for line in script.splitlines()) <= 10


def test_the_glossary_names_files_that_are_there_and_is_linked():
    """From whoever contributes, and from each page of theory."""
    glossary = ROOT / "docs" / "glossary.md"
    files = [name for name in re.findall(r"`([^`]+)`", glossary.read_text()) if re.search(r"/$|\.py$", name)]
    assert len(files) > 40
    assert [name for name in files if not (ROOT / "src" / "isorod" / name).exists()] == []
    for page in (ROOT / "CONTRIBUTING.md", ROOT / "docs" / "index.md", *(ROOT / "docs" / "theory").glob("*.md")):
        assert glossary in {(page.parent / link.partition("#")[0]).resolve() for link in links(page)}, page


def test_the_gallery_and_the_start_are_linked_from_where_people_begin():
    assert {"start.md", "gallery.md"} <= set(links(ROOT / "docs" / "index.md"))
