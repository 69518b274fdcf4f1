"""A scene from a file loads nothing that it does not need."""

import pytest
from conftest import packages
from scene_files import MODES, text
from test_scenes import FOREIGN


def test_modes_of_a_passive_body_load_no_contact_dynamics_muscle_or_pictures(modules, tmp_path):
    (tmp_path / "my.toml").write_text(text({key: one for key, one in MODES.items() if key != "spin"}))
    found = modules("run", "my.toml", "--json", cwd=tmp_path)
    rooms = ("isorod.contact", "isorod.dynamics", "isorod.material.muscle")
    assert not [name for name in found if name.startswith((*rooms, "isorod.scenes.", "isorod.command.new"))]
    assert not packages(found) & (set(FOREIGN) - {"slepc4py"})


# What a scene has of the rooms of which most need none, besides those of its analysis.
ROOMS = "contact dynamics modal assembly.mixed space.ringed material.muscle".split()


@pytest.mark.parametrize(
    ("name", "rooms", "needed"),
    [
        ("arc", "", ""),
        ("taper", "space.ringed", ""),
        ("press", "contact", ""),
        ("muscle", "material.muscle", "vtkmodules"),
        ("trefoil", "modal", "slepc4py"),
    ],
)
def test_an_example_loads_what_it_needs(name, rooms, needed, modules, command, tmp_path, monkeypatch):
    """Each example written by ``isorod new`` in a folder of its own, and run there."""
    monkeypatch.chdir(tmp_path)
    command.prints("new", "my.toml", "--from", name)
    coarse = ["--elements", "4", "--degree", "3"] if name == "press" else []
    found = modules("run", "my.toml", "--json", *coarse)
    assert {one for one in ROOMS if any(each.startswith(f"isorod.{one}") for each in found)} == set(rooms.split())
    assert packages(found) & set(FOREIGN) == set(needed.split())
    assert not [one for one in found if one.startswith(("isorod.scenes.", "isorod.command.new", "isorod.output.vtk"))]


def test_a_scene_of_the_package_reads_no_files(modules):
    found = modules("run", "ring", "--json")
    assert not [name for name in found if name.startswith("isorod.files.")] and "tomllib" not in found
