"""docker/install on a stage: a checkout of its own, every tool it may call a link or a stand-in, no network."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
APT_LINES = [line for line in (ROOT / "docker/apt.txt").read_text().splitlines() if not line.startswith("#")]
APT_NAMES = [line.split()[0] for line in APT_LINES]
TOOLS = (
    "bash sh env dirname basename realpath readlink cat sha256sum grep sed sort comm ls mkdir rm "
    "mktemp tail head flock cp chmod id"
)

PYTHON = """#!/bin/sh
# stands for /usr/bin/python3 and for one that is recent enough for wheels: makes a venv of stand-ins
[ "$1" != -I ] || exit 0
echo "python $*" >>"{log}"
for venv; do :; done
mkdir -p "$venv/bin"
cp "{stage}/venv-python" "$venv/bin/python"
cp "$venv/bin/python" "$venv/bin/pip" && chmod +x "$venv/bin/pip" "$venv/bin/python"
"""
VENV_PYTHON = """#!/bin/sh
echo "venv $*" >>"{log}"
[ ! -e "{stage}/pip-fails" ] || {{ echo "no such wheel" >&2; exit 1; }}
"""
DPKG = """#!/bin/sh
shift 2 # -W -f FORMAT NAME...
for name; do if grep -qx "$name" "{stage}/installed"; then echo "$name:amd64 installed"; fi; done
"""
APT = """#!/bin/sh
echo "apt $*" >>"{log}"
[ ! -e "{stage}/apt-fails" ] || {{ echo "E: no such mirror"; exit 100; }}
for name; do echo "$name" >>"{stage}/installed"; done
"""


class Stage:
    """A checkout with a blank in its path, and stand-ins that write down how they are called."""

    def __init__(self, folder):
        self.folder, self.log = folder, folder / "log"
        self.root = folder / "a checkout"
        self.tools = folder / "tools"
        self.tools.mkdir()
        for name in TOOLS.split():
            (self.tools / name).symlink_to(shutil.which(name))
        self.tool("python3", PYTHON)
        self.tool("dpkg-query", DPKG)
        self.tool("apt-get", APT)
        self.tool("id", "#!/bin/sh\necho 0\n")
        (folder / "venv-python").write_text(self.fill(VENV_PYTHON))
        (folder / "installed").write_text("")
        (folder / "os-release").write_text('ID=debian\nVERSION_ID="12"\n')
        (self.root / "docker").mkdir(parents=True)
        (self.root / "src/isorod/command").mkdir(parents=True)
        (self.root / "src/isorod/command/doctor.py").touch()
        for name in ("pyproject.toml", "docker/apt.txt", "docker/constraints.txt", "src/isorod/__init__.py"):
            shutil.copy(ROOT / name, self.root / name)
        script = (ROOT / "docker/install").read_text()
        changed = script.replace("python=/usr/bin/python3", f'python="{self.tools / "python3"}"')
        changed = changed.replace("release=/etc/os-release", f'release="{folder / "os-release"}"')
        assert changed.count(str(folder)) == 2
        self.install = self.root / "docker/install"
        self.install.write_text(changed)
        self.install.chmod(0o755)
        self.venv = self.root / ".venv"
        self.stamp = self.venv / ".isorod-installed"

    def fill(self, text):
        return text.format(stage=self.folder, log=self.log)

    def tool(self, name, text):
        path = self.tools / name
        path.unlink(missing_ok=True)
        path.write_text(self.fill(text))
        path.chmod(0o755)

    def run(self, *arguments, **environment):
        """Run the script; return the finished process with what its stand-ins were called with."""
        self.log.write_text("")
        done = subprocess.run(
            [self.root / "docker/install", *arguments],
            env={"PATH": str(self.tools), **environment},
            capture_output=True,
            text=True,
        )
        done.calls = self.log.read_text().splitlines()
        return done


@pytest.fixture
def stage(tmp_path):
    return Stage(tmp_path)


def test_first_run_installs_and_says_so_in_one_line(stage):
    done = stage.run()
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 1
    assert re.search(r"(\d+) of \1 apt packages", done.stdout)
    update, install, venv, *pip, compiling, doctor = done.calls
    assert update.endswith("update")
    assert "--no-install-recommends" in install
    assert "libopenblas0-serial" in install
    assert venv.startswith("python -m venv --system-site-packages")
    assert all("--only-binary=:all:" in call and "docker/constraints.txt" in call for call in pip)
    assert "--editable" in pip[-1]
    assert compiling == "venv -m isorod.command.compile"
    assert doctor == "venv -m isorod.command.doctor"
    assert stage.stamp.exists()


@pytest.mark.parametrize(("word", "code"), [("--help", 0), ("-h", 0), ("--wheels", 2)])
def test_an_option_makes_no_folder(stage, word, code):
    done = stage.run(word)
    assert (done.returncode, done.calls) == (code, [])
    said = done.stderr if code else done.stdout
    assert said.startswith("usage: ") and len(said.splitlines()) == 1
    assert not (stage.root / word).exists() and not (stage.folder / word).exists()


def test_second_run_does_nothing(stage):
    stage.run()
    done = stage.run()
    assert (done.returncode, done.stdout, done.stderr, done.calls) == (0, "", "", [])


def test_only_what_is_absent_is_asked_of_apt(stage):
    (stage.folder / "installed").write_text("\n".join(set(APT_NAMES) - {"python3-gmsh"}))
    install = next(call for call in stage.run().calls if " install " in call)
    assert install.endswith("--no-install-recommends python3-gmsh")


@pytest.mark.parametrize(("version", "there"), [("12", True), ("13", False), ("1", False)])
def test_a_package_of_one_release_is_asked_of_no_other(stage, version, there):
    (stage.folder / "os-release").write_text(f'ID=debian\nVERSION_ID="{version}"\n')
    done = stage.run(GROUND="apt")
    asked = [name for call in done.calls if " install " in call for name in call.split()]
    assert ("calculix-ccx" in asked) == there
    assert ("python3-dolfinx" in asked) == (version != "1")


def test_a_package_removed_later_is_noticed(stage):
    stage.run()
    left = (stage.folder / "installed").read_text().replace("libopenblas0-serial\n", "")
    (stage.folder / "installed").write_text(left)
    assert any(call.endswith("--no-install-recommends libopenblas0-serial") for call in stage.run().calls)


@pytest.mark.parametrize("changed", ["docker/constraints.txt", "docker/apt.txt", "pyproject.toml"])
def test_a_changed_list_is_installed(stage, changed):
    stage.run()
    with open(stage.root / changed, "a") as file:
        file.write("# more\n")
    assert any("--editable" in call for call in stage.run().calls)


def test_a_new_version_is_installed_as_such(stage):
    stage.run()
    code = stage.root / "src/isorod/__init__.py"
    text = code.read_text()
    code.write_text(text + "# more\n")
    assert stage.run().calls == []
    code.write_text(re.sub("^__version__ = .*", '__version__ = "9.9"', text, flags=re.MULTILINE))
    assert any("--editable" in call for call in stage.run().calls)


@pytest.mark.parametrize(("failing", "said"), [("apt-fails", "no such mirror"), ("pip-fails", "no such wheel")])
def test_a_failed_run_leaves_no_stamp_and_the_next_one_completes(stage, failing, said):
    (stage.folder / failing).touch()
    done = stage.run()
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.splitlines()[-1].startswith("docker/install: ")
    assert not stage.stamp.exists()
    (stage.folder / failing).unlink()
    assert stage.run().returncode == 0
    assert stage.stamp.exists()


def test_an_old_stamp_does_not_survive_a_failed_run(stage):
    stage.run()
    original = (stage.root / "pyproject.toml").read_text()
    (stage.root / "pyproject.toml").write_text(original + "# more\n")
    (stage.folder / "pip-fails").touch()
    assert stage.run().returncode == 2
    (stage.root / "pyproject.toml").write_text(original)
    assert stage.run().returncode == 2


def test_a_moved_checkout_gets_a_venv_of_its_own(stage):
    stage.run()
    (stage.venv / "left-over").touch()
    stage.root = stage.root.rename(stage.folder / "moved")
    done = stage.run()
    assert done.returncode == 0
    assert f"python -m venv --system-site-packages {stage.root}/.venv" in done.calls
    assert not (stage.root / ".venv/left-over").exists()


def test_the_venv_may_lie_elsewhere(stage):
    place = stage.folder / "else where"
    assert stage.run(str(place)).returncode == 0
    assert (place / ".isorod-installed").exists()
    assert not stage.venv.exists()


def test_sudo_where_not_root(stage):
    stage.tool("id", "#!/bin/sh\necho 1000\n")
    stage.tool("sudo", '#!/bin/sh\necho "sudo $*" >>"{log}"\nexec "$@"\n')
    done = stage.run(GROUND="apt")
    assert done.returncode == 0, done.stderr
    assert [call.split()[0] for call in done.calls[:4]] == ["sudo", "apt", "sudo", "apt"]


def took_wheels(done):
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 1
    assert "as wheels" in done.stdout
    venv, *pip, _, doctor = done.calls
    assert venv.startswith("python -m venv ") and "--system-site-packages" not in venv
    assert all("--only-binary=:all:" in call and "docker/constraints.txt" in call for call in pip)
    assert pip[-1].endswith("[compare,dev,docs,referee,view,wheels]")
    assert doctor == "venv -m isorod.command.doctor"
    return True


@pytest.mark.parametrize("place", ["no root", "no apt", "another Linux", "a later Debian"])
def test_wheels_where_apt_cannot_be(stage, place):
    if place == "no root":
        stage.tool("id", "#!/bin/sh\necho 1000\n")
    elif place == "no apt":
        (stage.tools / "apt-get").unlink()
    else:
        system = "ID=ubuntu" if place == "another Linux" else "ID=debian"
        (stage.folder / "os-release").write_text(f'{system}\nVERSION_ID="14"\n')
    assert took_wheels(stage.run())
    assert stage.run().calls == []


def test_apt_without_root_where_nothing_is_missing(stage):
    stage.tool("id", "#!/bin/sh\necho 1000\n")
    (stage.folder / "installed").write_text("\n".join(APT_NAMES))
    done = stage.run()
    assert done.returncode == 0, done.stderr
    assert done.calls[0].startswith("python -m venv --system-site-packages")


def mine(stage):
    stage.venv.mkdir()
    (stage.venv / "precious").touch()


def no_root(stage):
    stage.tool("id", "#!/bin/sh\necho 1000\n")


def no_apt(stage):
    (stage.tools / "apt-get").unlink()


def old(stage):
    stage.tool("python3", "#!/bin/sh\nexit 1\n")


@pytest.mark.parametrize(
    ("changed", "ground", "said"),
    [
        (mine, None, "was not made by this script"),
        (no_root, "apt", "not root and no sudo.*python3-dolfinx"),
        (old, "wheels", "no Python 3.12 to 3.14"),
        (no_apt, "apt", "wheels"),
        (no_apt, "rpm", "wheels"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_touched(stage, changed, ground, said):
    changed(stage)
    there = stage.venv.exists()
    done = stage.run(**{"GROUND": ground} if ground else {})
    assert done.returncode == 2
    assert re.fullmatch(f"docker/install: .*{said}.*\n", done.stderr), done.stderr
    assert done.calls == []
    assert changed is no_root or stage.venv.exists() is there
    assert changed is not mine or (stage.venv / "precious").exists()


def test_wheels_for_the_asking_and_they_stay(stage):
    assert took_wheels(stage.run(GROUND="wheels"))
    (stage.venv / "left-over").touch()
    done = stage.run()
    assert (done.returncode, done.stdout, done.calls) == (0, "", [])
    done = stage.run(GROUND="apt")
    assert done.returncode == 0, done.stderr
    assert any(call.startswith("apt ") and " install " in call for call in done.calls)
    assert not (stage.venv / "left-over").exists()


# The installation these tests run in, where docker/install made it.

own = pytest.mark.skipif(
    not (Path(sys.prefix) / ".isorod-installed").exists(), reason="this interpreter's venv is not docker/install's"
)


def constraints():
    """Name to version, as far as a line holds for this interpreter."""
    lines = (ROOT / "docker/constraints.txt").read_text().splitlines()
    found = [Requirement(line) for line in lines if line and not line.startswith("#")]
    return {
        canonicalize_name(pin.name): str(pin.specifier).removeprefix("==")
        for pin in found
        if pin.marker is None or pin.marker.evaluate()
    }


@own
def test_every_package_in_the_venv_is_pinned():
    place = next(path for path in sys.path if path.startswith(sys.prefix) and path.endswith("site-packages"))
    there = {canonicalize_name(d.metadata["Name"]): d.version for d in metadata.distributions(path=[place])}
    for name in ("isorod", "pip"):
        there.pop(name)
    ground = (Path(sys.prefix) / ".isorod-venv").read_text().splitlines()[0]
    systems = {"numpy", "scipy", "petsc4py", "mpi4py", "dolfinx-solver-real"}
    assert there.keys() & systems == (set() if ground == "apt" else systems - {"petsc4py"})
    pins = constraints()
    assert there == {name: pins.get(name) for name in there}


def test_what_the_project_asks_of_the_index_is_pinned():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    assert {canonicalize_name(Requirement(text).name) for text in asked} <= constraints().keys()


# The tasks


def make(*arguments):
    # a make that runs the tests hands its own arguments on, PYTHON=... in two ways
    inherited = ("MAKEFLAGS", "MAKEOVERRIDES", "MFLAGS", "PYTHON", "GROUND")
    env = {name: value for name, value in os.environ.items() if name not in inherited}
    command = ["make", "--no-print-directory", "-n", *arguments]
    return subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=True).stdout.splitlines()


@pytest.mark.parametrize("task", ["verify", "test", "test-all", "mutants", "lint"])
def test_each_task_sets_up_first(task):
    lines = make(task)
    assert lines[0] == "docker/install"
    assert all(line.startswith(".venv/bin/python -m ") for line in lines[1:])
    lines = make(task, "PYTHON=some-python")
    assert lines[0] == "true"
    assert all(line.startswith("some-python -m ") for line in lines[1:])


def test_the_image_knows_the_tasks_and_no_list_of_packages():
    tasks = re.search(r"^ +(help .*)\) exec make", (ROOT / "docker/entrypoint").read_text(), re.MULTILINE)
    known = re.search(r"^\.PHONY: (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert set(tasks[1].split(" | ")) == set(known[1].split()) - {"install", "clean"}
    lines = (ROOT / "docker/Dockerfile").read_text().splitlines()
    assert [line for line in lines if "apt-get" in line or "pip" in line] == []
    assert any(line.startswith("RUN docker/install") for line in lines)
    assert lines.index("RUN isorod compile") > lines.index("COPY . .")


def test_check_refuses_an_unknown_suite():
    done = subprocess.run([ROOT / "docker/check", "potato"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["docker/check: 'potato' is nothing known here: trixie, bookworm or wheels"]
