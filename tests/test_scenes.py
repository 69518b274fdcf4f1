"""Every scene runs, and loads and builds nothing that it does not need."""

import dataclasses
import json
import re
from pathlib import Path

import pytest
from conftest import packages
from scene_files import OUTLINE, RING, text

import isorod
from isorod import scenes
from isorod.command import cli
from isorod.errors import InputError

# What makes a long run short.
SHORT = {
    "biceps": {"end_time": 0.0005},
    "clasp": {"travel": 0.01, "section_points": 8, "elements": 4},
    "coil": {"coils": 1, "travel": 5.0},
    "creep": {"coils": 0.5, "travel": 0.01, "section_degree": 2, "degree": 4},
    "knot": {"settling": 0.02},
    "rope": {"wrap": 2.0, "elements": 8},
    "set": {"coils": 0.5, "yield_stress": 121.0, "section_degree": 2, "degree": 4},
    "strand": {"length": 20.0},
}
# Those whose rods touch.
TOUCHING = ["clasp", "coil", "rope", "strand"]
# Those that flow, in many steps that say where they are.
FLOWING = ["creep", "set"]
SLOW = ("strand", "biceps", "rope", *FLOWING)
LONG = [pytest.param(name, marks=pytest.mark.slow) if name in FLOWING else name for name in scenes.SCENES]
GEOMETRY = [name for name in scenes.SCENES if scenes.find(name)().analysis == "geometry"]
SOLVED = [name for name in scenes.SCENES if name not in GEOMETRY]
STATICS = [name for name in SOLVED if scenes.find(name)().analysis == "statics" and name not in TOUCHING]
FOREIGN = "dolfinx ufl basix gmsh pyvista vtkmodules slepc4py matplotlib rich hypothesis pytest sympy".split()
HEAVY = ["petsc4py", "mpi4py", "numba", *FOREIGN]


def short(name):
    """Return the words that make a run short."""
    return [word for key, value in SHORT.get(name, {}).items() for word in ("--" + key.replace("_", "-"), str(value))]


@pytest.mark.parametrize("name", LONG)
def test_scene_runs_and_reports_one_json_line(name, capsys):
    assert cli.main(["run", name, *short(name), "--json"]) == 0
    out, err = capsys.readouterr()
    # What is coarse says so where rods touch.
    doubts = (
        r"(isorod: warning: (contact 0: |estimated (stress )?error |no error estimate: ).*\n)*"
        if name in TOUCHING
        else r"(isorod: (time|warning: estimated) .*\n)*"
        if name in FLOWING
        else ""
    )
    assert out.count("\n") == 1
    assert re.fullmatch(doubts, err)
    record = json.loads(out)
    scene = scenes.find(name)()
    assert record["scene"] == name
    assert record["analysis"] == scene.analysis
    assert record["options"] == dataclasses.asdict(scene) | SHORT.get(name, {})
    if name in STATICS:
        assert record["built"] == ["tangent"]


@pytest.mark.parametrize("name", scenes.SCENES)
def test_scene_says_what_it_is_and_its_fields_have_help(name):
    scene = scenes.find(name)
    assert scene.__doc__.strip()
    for field in dataclasses.fields(scene):
        assert field.metadata["help"]
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(scene(), dataclasses.fields(scene)[0].name, 1)


@pytest.mark.parametrize("name", scenes.SCENES)
def test_rod_of_a_scene_does_not_fold(name):
    scene = scenes.find(name)()
    for rod in scene.rods():
        assert rod.check() > 0


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.slow) if one in SLOW else one for one in SOLVED],
)
def test_solved_scene_loads_what_it_needs(name, modules):
    """One passive body takes no muscle, contact or dynamics; clasped rods no friction."""
    found = modules("run", name, *short(name), "--json")
    modal = scenes.find(name)().analysis == "modal"
    assert not packages(found) & (set(FOREIGN) - ({"slepc4py"} if modal else set()))
    unused = {"clasp": ("isorod.contact.friction",)}
    unused |= dict.fromkeys(STATICS, ("isorod.material.muscle", "isorod.contact", "isorod.dynamics"))
    assert not [one for one in found if one.startswith(unused.get(name, ()))]


def test_geometry_lists_and_files_to_begin_with_need_numpy_and_scipy_alone(modules, tmp_path):
    """Of the package and of files; also what is imported of geometry in scripts."""
    (tmp_path / "outline.csv").write_text(OUTLINE)
    (tmp_path / "my.toml").write_text(text(RING))
    files = (Path(isorod.__file__).parent / "geometry").glob("*.py")
    names = [f"isorod.geometry.{file.stem}" for file in files if not file.stem.endswith("_kernel")]
    assert len(names) >= 7
    names += ["isorod.space", "isorod.errors", "isorod.tensors", "isorod.scenes.spring"]
    lines = [*(f"run {name} --json" for name in [*GEOMETRY, "my.toml"]), "list", "new first.toml"]
    script = f"import {', '.join(names)}\nfrom isorod.command import cli\n"
    script += f"assert not any(cli.main(line.split()) for line in {lines!r})"
    assert not packages(modules(script=script, cwd=tmp_path)) & set(HEAVY)


@pytest.mark.parametrize("name", ["", "Spring", "spring ", "coils", "__init__"])
def test_an_unknown_scene_is_refused_with_the_names_there_are(name):
    with pytest.raises(InputError, match=", ".join(scenes.SCENES)) as caught:
        scenes.find(name)
    assert repr(name) in str(caught.value)
