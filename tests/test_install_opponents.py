"""docker/opponents on the stage of docker/install: what isorod is compared with, installed beside it, or left out."""

import re
import shutil
import subprocess

import pytest
from test_install import ROOT, VENV_PYTHON, Stage, constraints, make


@pytest.fixture
def stage(tmp_path):
    return Stage(tmp_path)


def opponents(stage):
    """Run docker/opponents on the stage, where the venv has no NGSolve until pip was asked for it."""
    stage.log.write_text("")
    there = stage.folder / "ngsolve-there"
    text = (
        VENV_PYTHON
        + f"""case "$*" in
*"ngsolve=="*) [ -e "{there}" ] ;;
*" install "*ngsolve) : >"{there}" ;;
esac
"""
    )
    (stage.folder / "venv-python").write_text(stage.fill(text))
    shutil.copy(ROOT / "docker/opponents", stage.root / "docker/opponents")
    command = [shutil.which("bash"), stage.root / "docker/opponents"]
    done = subprocess.run(command, env={"PATH": str(stage.tools)}, capture_output=True, text=True)
    done.calls = stage.log.read_text().splitlines()
    return done


def test_opponents_are_installed_beside_and_once(stage):
    done = opponents(stage)
    assert done.returncode == 0, done.stderr
    (ngsolve,) = (call for call in done.calls if " pip install " in call and call.endswith(" ngsolve"))
    assert "--only-binary=:all:" in ngsolve and "docker/constraints.txt" in ngsolve
    assert any(call.startswith("python -m venv") and call.endswith(".venv-wheels") for call in done.calls)
    again = opponents(stage)
    assert (again.returncode, again.stdout, again.stderr) == (0, "", "")
    assert not any("apt" in call or "install" in call for call in again.calls)


def test_what_cannot_be_installed_is_named_and_left_out(stage):
    stage.run()
    (stage.folder / "pip-fails").touch()
    done = opponents(stage)
    assert done.returncode == 0
    for what in ("NGSolve: pip found no wheel", "dolfinx 0.11: its wheels"):
        assert f"isorod compares without {what}" in done.stderr


def test_the_bench_installs_the_opponents_first_and_takes_the_other_dolfinx_where_it_is():
    lines = make("bench")
    assert lines[0] == "docker/opponents"
    assert lines[1].split()[:6] == [".venv/bin/python", "-m", "comparisons", "bench", "--level", "quick"]
    assert ("--dolfinx" in lines[1] + "".join(lines[2:])) is (ROOT / ".venv-wheels/bin/python").exists()
    assert make("bench", "PYTHON=some-python")[0] == "true"


def test_what_is_installed_beside_is_pinned():
    """The script asks the pins for the version it wants."""
    script = (ROOT / "docker/opponents").read_text()
    wanted = re.findall(r"wanted (\w+)\)", script)
    assert wanted == ["ngsolve"] and set(wanted) <= constraints().keys()
