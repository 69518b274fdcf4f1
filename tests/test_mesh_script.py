"""``isorod mesh x.toml x.py``: programs of dolfinx with the mesh and groups that they read."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from calculix import EXAMPLES

import isorod
from isorod import files
from meshes.__main__ import main

pytest.importorskip("gmsh")

BAR = """[rod.beam]
curve = {straight = 4.0}
section = {circle = 1.0}
law = {StVenantKirchhoff = {E = 100.0, nu = 0.3}}
density = 2.0
[support.foot]
end = "start"
"""
LOADS = """[support.hand]
end = "end"
components = "xy"
displacement = [0.2, 0.0, 0.0]
[load.press]
pressure = 0.5
follows = true
[load.weight]
body_force = [0.0, 0.0, -0.2]
[analysis.statics]
[measure.shear]
reaction = "hand"
component = "x"
[measure.elastic]
energy = "beam"
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def answers(name, *words):
    """Write the program of a file, run it, and return each measure by dolfinx and by isorod."""
    assert main([name, "job.py", *words]) == 0
    done = subprocess.run([sys.executable, "job.py"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    scene = files.find(name)
    own = scene.measure(isorod.statics.solve(scene.model(), **scene.settings()))
    rows = {line.split()[0]: line.split(maxsplit=1)[1] for line in done.stdout.splitlines()}
    found = {}
    for what, value in own.items():
        theirs = rows[what].replace("[", " ").replace("]", " ").split()[: np.size(value)]
        found[what] = np.array(theirs, dtype=float).reshape(np.shape(value)), np.asarray(value)
    return found


# Measured: 6.4e-3 of the cable; others at most 1.1e-3.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "bound"),
    [
        ("arc", 3e-3),
        ("bar", 3e-3),
        ("cable", 8e-3),
        ("coil", 3e-3),
        ("spring", 3e-3),
        ("starter", 3e-3),
        ("taper", 4e-3),
    ],
)
def test_dolfinx_finds_what_isorod_finds(name, bound):
    pytest.importorskip("dolfinx")
    for what, (theirs, ours) in answers(str(EXAMPLES / f"{name}.toml")).items():
        assert np.linalg.norm(theirs - ours) < bound * np.linalg.norm(ours), what


@pytest.mark.slow
def test_dolfinx_finds_other_supports_and_loads():
    pytest.importorskip("dolfinx")
    Path("my.toml").write_text(BAR + LOADS)
    for what, (theirs, ours) in answers("my.toml").items():
        assert np.linalg.norm(theirs - ours) < 5e-3 * np.linalg.norm(ours), what


def groups_of(path):
    """Areas of groups of facets, and volumes of those of cells, by gmsh."""
    from meshes.gmsh_model import gmsh_session

    found = {}
    with gmsh_session() as gmsh:
        gmsh.open(path)
        for group in gmsh.model.getPhysicalGroups():
            size = 0.0
            for entity in gmsh.model.getEntitiesForPhysicalGroup(*group):
                (kind,) = gmsh.model.mesh.getElementTypes(group[0], entity)
                where, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
                det = gmsh.model.mesh.getJacobians(kind, where, entity)[1]
                size += float(np.reshape(det, (-1, len(weights))).dot(weights).sum())
            found[gmsh.model.getPhysicalName(*group)] = size
    return found


def test_supports_and_loads_are_groups_of_gmsh_beside_the_rods_own():
    Path("my.toml").write_text(BAR + LOADS)
    assert main(["my.toml", "my.msh"]) == 0
    sizes = groups_of("my.msh")
    assert set(sizes) == {
        *("rod beam", "rod beam start", "rod beam end", "rod beam lateral"),
        *("support foot", "support hand", "load press"),
    }
    assert sizes["support foot"] == sizes["rod beam start"] == pytest.approx(np.pi, rel=2e-3)
    assert sizes["support hand"] == sizes["rod beam end"] == pytest.approx(np.pi, rel=2e-3)
    assert sizes["load press"] == sizes["rod beam lateral"] == pytest.approx(8.0 * np.pi, rel=2e-3)
    assert main(["my.toml", "alone.msh", "--mesh-only"]) == 0
    assert set(groups_of("alone.msh")) == {"rod beam", "rod beam start", "rod beam end", "rod beam lateral"}


def test_laws_are_groups_of_cells_where_there_are_several():
    assert main([str(EXAMPLES / "bar.toml"), "bar.msh", "--level", "1"]) == 0
    sizes = groups_of("bar.msh")
    whole = sizes["rod bar"]
    assert sizes["rod bar law 0"] == pytest.approx(0.4 * whole) and sizes["rod bar law 1"] == pytest.approx(0.6 * whole)


def test_energies_are_those_of_the_laws():
    """The text of a law's energy, with NumPy in the place of UFL."""
    from types import SimpleNamespace

    from isorod import LinearElastic, NeoHookean
    from isorod.material.mooney_rivlin import MooneyRivlin
    from isorod.material.ogden import Ogden
    from meshes.script import _energy

    class Matrix(np.ndarray):
        __mul__ = np.ndarray.__matmul__

    ufl = SimpleNamespace(det=np.linalg.det, tr=np.trace, ln=np.log, sqrt=np.sqrt, exp=np.exp)
    rng = np.random.default_rng(1)
    for law in (LinearElastic(2.0, 0.3), NeoHookean(2.0, 0.3), MooneyRivlin(2.0, 0.5, 9.0), Ogden((2.0,), (1.5,), 9.0)):
        F = np.eye(3) + 0.2 * rng.uniform(-1.0, 1.0, (3, 3))
        known = {"ufl": ufl, "stretches": lambda C: np.sqrt(np.linalg.eigvalsh(np.asarray(C)))}
        exec("\n".join(["def energy(F):", *_energy(law)]), known)
        assert known["energy"](F.view(Matrix)) == pytest.approx(float(law.energy(F[None])[0]), rel=1e-9)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("[analysis.modal]\n", "modal is not written to .py"),
        (
            '[load.a]\nend = "end"\nforce = [0, 0, 1]\nhistory = [[0, 0], [2, 1]]\n'
            "[analysis.statics]\nend_time = 1.0\n",
            "a history is not written to .py",
        ),
        ('[load.a]\nend = "end"\nmoment = [0,0,1]\n[analysis.statics]\n', "load a: moments"),
        (
            '[obstacle.o]\nPlane = {point = [0,0,9], normal = [0,0,-1]}\n[contact.c]\nfirst = "beam"\nsecond = "o"\n'
            "[analysis.statics]\n",
            "contact c is not written to .py",
        ),
        (
            '[support.h]\nend = "end"\ncomponents = "x"\nrotation = [0,0,9]\n[analysis.statics]\n',
            "support h: what turns",
        ),
    ],
)
def test_what_is_not_written_is_one_line(more, said, capsys):
    Path("my.toml").write_text(BAR + more)
    assert main(["my.toml", "my.py"]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1 and ".msh has the mesh" in err
    assert not Path("my.py").exists() and not Path("my.msh").exists()


def test_incompressible_laws_and_muscles_are_refused(capsys):
    for name, said in (("cord", "incompressible"), ("muscle", "law Muscle: fibres and activation")):
        assert main([str(EXAMPLES / f"{name}.toml"), "job.py"]) == 2
        assert said in capsys.readouterr().err
