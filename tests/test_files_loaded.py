"""A scene from a file loads nothing that it does not need."""

import json

import pytest

from tests.scene_files import MODES, OUTLINE, RING, text
from tests.test_scenes import FOREIGN, HEAVY

LOADED = """
import json, sys
from isorod.command import cli
assert cli.main({!r}) == 0
print(json.dumps(sorted(sys.modules)))
"""


@pytest.fixture
def modules(python, tmp_path):
    """Run a command in a fresh process; return the modules it has loaded in the end."""

    def run(*words):
        done = python(LOADED.format(list(words)), cwd=str(tmp_path))
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return run


def test_modes_of_a_passive_body_load_no_contact_dynamics_muscle_or_pictures(modules, tmp_path):
    (tmp_path / "my.toml").write_text(text({key: one for key, one in MODES.items() if key != "spin"}))
    found = modules("run", "my.toml", "--json")
    rooms = ("isorod.contact", "isorod.dynamics", "isorod.material.muscle")
    assert not [name for name in found if name.startswith((*rooms, "isorod.scenes.", "isorod.command.new"))]
    assert not {name.split(".")[0] for name in found} & (set(FOREIGN) - {"slepc4py"})


# What a scene has of the rooms of which most need none, besides those of its analysis.
ROOMS = "contact dynamics modal assembly.mixed space.ringed material.muscle".split()


@pytest.mark.parametrize(
    ("name", "rooms", "packages"),
    [
        ("arc", "", ""),
        ("taper", "space.ringed", ""),
        ("press", "contact", ""),
        ("muscle", "material.muscle", "vtkmodules"),
        ("trefoil", "modal", "slepc4py"),
    ],
)
def test_an_example_loads_what_it_needs(name, rooms, packages, modules, tmp_path):
    """Each example written by ``isorod new`` in a folder of its own, and run there."""
    assert modules("new", "my.toml", "--from", name)
    found = modules("run", "my.toml", "--json", *(["--elements", "4", "--degree", "3"] if name == "press" else []))
    assert {one for one in ROOMS if any(each.startswith(f"isorod.{one}") for each in found)} == set(rooms.split())
    assert {one.split(".")[0] for one in found} & set(FOREIGN) == set(packages.split())
    assert not [one for one in found if one.startswith(("isorod.scenes.", "isorod.command.new", "isorod.output.vtk"))]


def test_geometry_of_a_file_needs_numpy_and_scipy_alone(modules, tmp_path):
    (tmp_path / "outline.csv").write_text(OUTLINE)
    (tmp_path / "my.toml").write_text(text(RING))
    assert not {name.split(".")[0] for name in modules("run", "my.toml", "--json")} & set(HEAVY)


def test_a_scene_of_the_package_reads_no_files(modules):
    found = modules("run", "ring", "--json")
    assert not [name for name in found if name.startswith("isorod.files.")] and "tomllib" not in found


def test_writing_a_file_to_begin_with_loads_nothing_heavy(modules):
    assert not {name.split(".")[0] for name in modules("new")} & (set(HEAVY) - {"numpy", "scipy"})
