"""A release: one version and date, requirements that agree wherever stated, packages that hold what they need."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from email import message_from_string
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from reference import SPRING_FORCE

import isorod

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def read_yaml(name):
    return pytest.importorskip("yaml").safe_load((ROOT / name).read_text())


def test_one_version_and_date():
    """The code says which version it is; the changelog and the citation say the same, and when it was released."""
    assert "version" not in PROJECT and PROJECT["dynamic"] == ["version"]
    found = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    released = [line for line in found if line != "Unreleased"]
    assert found[-len(released) :] == released
    citation = read_yaml("CITATION.cff")
    assert released[0] == f"{citation['version']} - {citation['date-released']}"
    assert citation["version"] == isorod.__version__
    dates = [line.partition(" - ")[2] for line in released]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", date) for date in dates) and dates == sorted(dates, reverse=True)
    assert citation["title"].partition(": ")[2] == PROJECT["description"].replace("Rods", "rods")
    assert citation["license"] == PROJECT["license"]["text"]


def test_conda_gets_what_pip_does():
    """Each package with the same lower bound; what conda-forge has is not asked of pip."""
    listed = read_yaml("environment.yml")["dependencies"]
    from_index = next(entry["pip"] for entry in listed if isinstance(entry, dict))
    texts = [text for text in [*listed, *from_index] if isinstance(text, str)]
    there = {
        one.name: one.specifier for one in map(Requirement, (t for t in texts if re.match(r"\w[^=]*(>=\S+)?$", t)))
    }
    extras = [text for name, one in PROJECT["optional-dependencies"].items() if name != "wheels" for text in one]
    wanted = [Requirement(text) for text in [*PROJECT["dependencies"], *extras]]
    assert {one.name: one.specifier for one in wanted} == {one.name: there.get(one.name) for one in wanted}
    assert there["python"] == PROJECT["requires-python"]
    assert {"petsc4py", "slepc4py", "mpi4py", "fenics-dolfinx", "python-gmsh"} <= there.keys()
    assert from_index[-1] == "--editable ."


@pytest.fixture(scope="module")
def tree():
    """Names of the files of the tree that are kept."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("no checkout")
    command = ["git", "-c", f"safe.directory={ROOT}", "ls-files", "-coz", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    return sorted(name for name in listed if name and (ROOT / name).is_file())


@pytest.fixture(scope="module")
def built(tree, tmp_path_factory):
    """The source distribution of the tree, and the wheel that is made of nothing else; their files' paths."""
    pytest.importorskip("setuptools")
    place = tmp_path_factory.mktemp("package")
    for name in tree:
        (place / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, place / "tree" / name)

    def build(what, folder):
        # As pip does it, with the setuptools that are here: nothing is asked of the network.
        code = f"from setuptools import build_meta; print(build_meta.build_{what}({str(place)!r}))"
        done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return place / done.stdout.splitlines()[-1]

    source = build("sdist", place / "tree")
    with tarfile.open(source) as archive:
        archive.extraction_filter = getattr(tarfile, "data_filter", None)
        archive.extractall(place / "unpacked")
    return source, build("wheel", place / "unpacked" / source.name.removesuffix(".tar.gz"))


def test_the_source_distribution_is_the_tree(built, tree):
    with tarfile.open(built[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames() if archive.getmember(name).isfile()}
    made = {"PKG-INFO", "setup.cfg"} | {name for name in names if name.startswith("isorod.egg-info/")}
    assert names - made == set(tree)


def test_the_wheel_holds_all_code_and_what_it_reads(built, tree):
    """No tests, no pictures of the pages; the license is there, and one version."""
    with zipfile.ZipFile(built[1]) as wheel:
        names = set(wheel.namelist())
        about = f"isorod-{isorod.__version__}.dist-info/"
        meta = message_from_string(wheel.read(f"{about}METADATA").decode())
        assert wheel.read(next(name for name in names if name.endswith("/LICENSE"))) == (ROOT / "LICENSE").read_bytes()
    kept = {
        name.removeprefix("src/")
        for name in tree
        if name.startswith(("src/", "comparisons/", "meshes/")) and not name.startswith("comparisons/gallery/")
    }
    assert {name for name in names if not name.startswith(about)} == kept
    assert {"isorod/py.typed", "isorod/files/examples/starter.toml", "comparisons/report/style.css"} <= kept
    assert meta["Version"] == isorod.__version__
    assert meta.get_all("Project-URL") == [f"{name}, {url}" for name, url in PROJECT["urls"].items()]
    assert set(meta.get_all("Provides-Extra")) == PROJECT["optional-dependencies"].keys()


@pytest.fixture(scope="module")
def elsewhere(built, tmp_path_factory):
    """Run Python in an empty folder in somebody else's repository, with the wheel's files before those of the tree."""
    site = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(built[1]) as wheel:
        wheel.extractall(site / ".venv/lib/python3/site-packages")
    git = ["git", "-C", str(site), "-c", "user.name=somebody", "-c", "user.email=somebody@example.org"]
    for command in (["init", "-q"], ["commit", "-q", "--allow-empty", "-m", "theirs"]):
        subprocess.run([*git, *command], check=True)
    home = site / "home"
    home.mkdir()
    fixed = {"PYTHONPATH": str(site / ".venv/lib/python3/site-packages"), "HOME": str(home), "PYTHONSAFEPATH": "1"}

    def run(*arguments, timeout=60):
        return subprocess.run(
            [sys.executable, *arguments],
            cwd=home,
            env={name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | fixed,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )

    return site, run


def test_the_wheel_runs_outside_of_the_tree(elsewhere):
    site, run = elsewhere
    done = run(
        "-c", "import isorod, comparisons, meshes; print(isorod.__file__, comparisons.__file__, meshes.__file__)"
    )
    assert done.stdout.count(f"{site}/") == 3, done
    assert run("-m", "isorod", "--version").stdout == f"isorod {isorod.__version__}\n"
    assert "spring" in run("-m", "isorod", "list").stdout
    done = run("-m", "isorod", "new", "rod.toml")
    assert done.returncode == 0 and (site / "home/rod.toml").exists(), done
    done = run("-m", "isorod", "run", "ring", "--json")
    assert done.returncode == 0, done
    assert json.loads(done.stdout)["scene"] == "ring"
    # The repository around an installation is not isorod's.
    done = run("-c", "from isorod.output.results import provenance; print(provenance()['commit'])")
    assert done.stdout == "None\n", done
    # What becomes `python -m comparisons` finds it.
    done = run("-m", "isorod", "compare", "--help")
    assert done.returncode == 0 and "usage" in done.stdout, done


@pytest.mark.slow
def test_the_wheel_computes_outside_of_the_tree(elsewhere):
    """Compiled where nothing is kept yet."""
    site, run = elsewhere
    run("-m", "isorod", "new", "own.toml")
    done = run("-m", "isorod", "run", "own.toml", "--json", timeout=580)
    assert done.returncode == 0, done
    done = run("-m", "isorod", "run", "spring", "--json", "--no-estimate", timeout=580)
    assert done.returncode == 0, done
    assert json.loads(done.stdout)["force"] == pytest.approx(SPRING_FORCE, rel=1e-3)
    assert list((site / ".venv").rglob("*.nbc"))
