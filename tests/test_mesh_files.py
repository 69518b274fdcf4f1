"""``isorod mesh``: bricks of any rods in files that CalculiX, gmsh and VTK read, and what it refuses."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from isorod import InputError
from isorod.command import beside, cli
from isorod.geometry import center_line, coils, section
from isorod.scenes.spring import Spring
from meshes import abaqus, files, rods
from meshes.__main__ import main
from meshes.mesh import Mesh, match

# A tube that is closed, of two layers, and a bar.
FILE = """analysis = "geometry"
[rod.tube]
curve = {arc = {radius = 4.0, angle = 360.0}}
section = {circle = 1.0}
closed = true
rings = [0.4, 0.7, 1.0]
[rod.bar]
curve = {straight = 3.0}
section = {circle = 1.0}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.toml").write_text(FILE)
    return tmp_path


def two():
    """The rods of the file."""
    tube = coils.arc(4.0, 360.0).sweep(section.circle(8, 1.0)).with_rings([0.4, 0.7, 1.0])
    return [tube, center_line.straight(3.0).sweep(section.circle(8, 1.0))]


def keywords(text):
    """Return the data below each keyword line of an input file."""
    found = {}
    for block in re.split(r"^\*", text, flags=re.MULTILINE)[1:]:
        head, _, body = block.partition("\n")
        found[head] = re.findall(r"[^,\s]+", body)
    return found


def test_sets_and_surfaces_are_the_rods_and_their_boundaries(folder):
    assert main(["my.toml", "--cell-order", "1", "my.inp", "--level", "1"]) == 0
    found = keywords((folder / "my.inp").read_text())
    mesh = rods.build(two(), 1, 1)
    elements = np.array(found["ELEMENT,TYPE=C3D8I,ELSET=EALL"], dtype=int).reshape(-1, 9)
    assert np.array_equal(elements[:, 0], np.arange(1, len(mesh.cells) + 1))
    for k, name in enumerate(("TUBE", "BAR")):
        first, last = map(int, found[f"ELSET,ELSET=ROD_{name},GENERATE"])
        assert np.array_equal(np.arange(first, last + 1), mesh.regions[f"rod {k}"] + 1)
    rings = [np.array(found[f"ELSET,ELSET=ROD_TUBE_RING_{r}"], dtype=int) - 1 for r in range(2)]
    assert np.array_equal(np.sort(np.concatenate(rings)), mesh.regions["rod 0"])
    radius = np.linalg.norm(mesh.parameters[mesh.cells, :2], axis=2).mean(axis=1)
    assert radius[rings[0]].max() < 0.7 < radius[rings[1]].min()
    names = {"rod tube lateral", "rod tube inner", "rod bar start", "rod bar end", "rod bar lateral"}
    assert {name for name in found if name.startswith("SURFACE")} == {
        f"SURFACE,NAME={abaqus.name_of(name)},TYPE=ELEMENT" for name in names
    }


def areas(corners):
    """Return the vector areas of quadrilaterals ``(m, 4, 3)``."""
    a, b, c, d = corners.transpose(1, 0, 2)
    return 0.5 * np.cross(c - a, d - b)


@pytest.mark.parametrize("element", ["C3D20R", "C3D8"])
def test_surfaces_have_the_nodes_of_their_sets(element, folder):
    """By the corners of an element's sides as Abaqus and CalculiX number them, clockwise from outside."""
    sides = {"S1": "1234", "S2": "5876", "S3": "1562", "S4": "2673", "S5": "3784", "S6": "4851"}
    order = abaqus.ELEMENTS[element].order
    mesh = rods.build(two(), 1, order)
    text, _ = abaqus.lines(mesh, element)
    rows = re.search(rf"TYPE={element}.*\n((?:[\d,\n]+))", text)[1].replace(",\n", ",").split()
    cells = {int(row.split(",")[0]): [int(node) for node in row.split(",")[1:]] for row in rows}
    for name, faces in mesh.faces.items():
        title = abaqus.name_of(name)
        nodes = {int(one) for one in re.findall(r"\d+", re.search(rf"NSET={title}\n([\d,\n]+)", text)[1])}
        surface = re.search(rf"NAME={title},TYPE=ELEMENT\n((?:\d+,S\d\n?)+)", text)[1].split()
        assert len(surface) == len(faces)
        seen = [[cells[int(cell)][int(c) - 1] for c in sides[side]] for cell, side in (x.split(",") for x in surface)]
        assert {node for side in seen for node in side} <= nodes
        if order == 1:
            assert {node for side in seen for node in side} == nodes
        table = re.search(r"\*NODE.*\n((?:[^*]*))", text)[1].split()
        place = {int(row.split(",")[0]): [float(x) for x in row.split(",")[1:]] for row in table}
        area = areas(np.array([[place[node] for node in side] for side in seen]))
        expected = areas(mesh.points[faces][:, [0, order, -1, -1 - order]])
        assert area == pytest.approx(-expected, abs=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3])
def test_vtk_reads_the_cells_as_they_are(order, folder):
    pyvista = pytest.importorskip("pyvista")

    assert main(["my.toml", "my.vtu", "--cell-order", str(order), "--level", "1"]) == 0
    read, mesh = pyvista.read(folder / "my.vtu"), rods.build(two(), 1, order)
    assert np.array_equal(read.points, mesh.points)
    # Each cell's nodes in the places where VTK says that they are.
    local, kind = read.GetCell(0).GetParametricCoords(), 12 if order == 1 else 72
    given = np.array([local[k] for k in range(3 * (order + 1) ** 3)]).reshape(-1, 3)
    cells = read.cells_dict[kind][:, match(given, mesh.reference)]
    again = Mesh("hexahedron", order, read.points, cells, mesh.reference, {}, mesh.face_reference)
    assert again.volume() == pytest.approx(mesh.volume(), rel=1e-14)
    assert again.volume() == pytest.approx(sum(rod.volume() for rod in two()), rel={1: 0.06, 2: 1.4e-2, 3: 1e-3}[order])

    where = rods.places(mesh, two())
    for column, name in enumerate(("rod", "element", "ring")):
        assert np.array_equal(read.cell_data[name], where[:, column])
    assert np.array_equal(np.column_stack([read.point_data["xi"], read.point_data["u"]]), mesh.parameters)


def test_vtk_finds_nothing_wrong_with_the_cells(folder):
    pyvista = pytest.importorskip("pyvista")
    from vtkmodules.vtkFiltersGeneral import vtkCellValidator

    (folder / "bar.toml").write_text(FILE[: FILE.index("[rod.tube]")] + FILE[FILE.index("[rod.bar]") :])
    assert main(["bar.toml", "bar.vtu"]) == 0
    read = pyvista.read(folder / "bar.vtu")
    validator = vtkCellValidator()
    validator.SetInputData(read)
    validator.Update()
    assert (pyvista.wrap(validator.GetOutput())["ValidityState"] == 0).all()
    # Cut into straight pieces they have the volume of the bar.
    assert read.tessellate(max_n_subdivide=2).volume == pytest.approx(two()[1].volume(), rel=2e-2)


def test_gmsh_reads_volumes_and_groups(folder):
    pytest.importorskip("gmsh")
    from meshes.gmsh_model import gmsh_session

    assert main(["my.toml", "--level", "1"]) == 0
    mesh = rods.build(two())
    with gmsh_session() as gmsh:
        gmsh.open(str(folder / "my.msh"))
        groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
        title = {"rod 0": "rod tube", "rod 1": "rod bar"}
        assert groups.keys() == {title[one[:5]] + one[5:] for one in (*mesh.regions, *mesh.faces)}
        volume = 0.0
        for name, cells in mesh.regions.items():
            for entity in gmsh.model.getEntitiesForPhysicalGroup(*groups[title[name]]):
                (kind,) = gmsh.model.mesh.getElementTypes(3, entity)
                where, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss6")
                _, det, _ = gmsh.model.mesh.getJacobians(kind, where, entity)
                found = np.asarray(det).reshape(-1, len(weights))
                assert len(found) == len(cells) and found.min() > 0.0
                volume += float(np.sum(found * weights))
    assert volume == pytest.approx(mesh.volume(), rel=1e-9)
    assert volume == pytest.approx(sum(rod.volume() for rod in two()), rel=1.5e-2)


def test_options_of_the_scene_are_those_of_the_rod(folder, capsys):
    assert main(["spring", "short.inp", "--coils", "1", "--wire-radius", "0.5", "again.inp"]) == 0
    rod = Spring(helix="paper", coils=1, wire_radius=0.5).rod()
    (first, _, second, _) = capsys.readouterr().out.splitlines()
    assert first.startswith("short.inp: ") and second.startswith("again.inp: ")
    assert float(re.search(r"volume ([\d.]+)", first)[1]) == pytest.approx(rod.volume(), rel=2e-2)
    assert (folder / "short.inp").read_bytes() == (folder / "again.inp").read_bytes()


def test_input_files_need_neither_gmsh_nor_vtk(folder, python):
    script = """
import sys
sys.modules |= dict.fromkeys(("gmsh", "pyvista", "vtkmodules", "dolfinx"))
from meshes.__main__ import main
sys.exit(main(["spring", "--coils", "1", "spring.inp"]))
"""
    done = python(script, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert (folder / "spring.inp").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("spring a.stl", "mesh file: got 'a.stl', need a name that ends in .msh or .py or .inp or .vtu"),
        ("spring nowhere/a.inp", "folder 'nowhere' does not exist"),
        ("spring folder.inp", "cannot write 'folder.inp'"),
        ("spring a.inp --level 0", "mesh: level: got 0"),
        ("spring a.vtu --cell-order 4", "mesh: order of the cells: got 4"),
        ("spring a.vtu a.inp --cell-order 3", "mesh file a.inp: got cells of order 3, need 1 or 2"),
        ("spring a.inp --element C3D8 --cell-order 2", "element C3D8: its cells have order 1, got 2"),
        ("spring a.inp --element C3D10", "--element: invalid choice"),
        ("spring a.inp --coil 3", "option --coil is not known; did you mean --coils"),
        ("spring a.inp --coil-radius 0.4", "folds in element"),
        ("none.toml a.inp", "none.toml"),
        ("a.inp", "scene 'a.inp' is not known"),
        ("--level 2", "scene missing; known: "),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(words, said, folder, capsys):
    (folder / "folder.inp").mkdir()
    assert main(words.split()) == 2
    out, err = capsys.readouterr()
    assert out == "" and re.fullmatch(r"isorod: .*\n", err) and said in err
    assert {one.name for one in folder.iterdir()} == {"my.toml", "folder.inp"}


@pytest.mark.parametrize(("name", "package"), [("a.msh", "gmsh"), ("a.vtu", "pyvista")])
def test_what_is_not_installed_is_said_before_anything_is_meshed(name, package, folder, monkeypatch):
    monkeypatch.setattr(files, "find_spec", lambda one: None if one == package else object())
    with pytest.raises(InputError, match=rf"needs {package}, which is not installed: .*pip install {package}; or .inp"):
        files.check(folder / name)


def test_a_full_disk_leaves_the_old_file(folder, room, capsys):
    for name in ("spring.inp", "spring.vtu"):
        assert main(["spring", "--coils", "1", name]) == 0
        before = (folder / name).read_bytes()
        with room(20_000):
            assert main(["spring", "--coils", "1", "--level", "2", name]) == 2
        assert "cannot be written (File too large)" in capsys.readouterr().err
        assert (folder / name).read_bytes() == before
    assert {one.name for one in folder.iterdir()} == {"my.toml", "spring.inp", "spring.vtu"}


def test_the_command_becomes_the_meshes(monkeypatch, folder, capsys):
    started = []
    with monkeypatch.context() as patch:
        patch.setattr(os, "execve", lambda *given: started.append(given))
        cli.command(["mesh", "spring", "spring.inp", "--coils", "1"])
    ((program, words, around),) = started
    assert (program, words[1:]) == (sys.executable, ["-m", "meshes", "spring", "spring.inp", "--coils", "1"])
    done = subprocess.run(words, env=around, capture_output=True, text=True)
    assert done.returncode == 0 and re.match(r"spring.inp: 960 hexahedra of order 2, ", done.stdout), done.stderr
    assert cli.main(["mesh", "spring", "-snes_monitor"]) == 2
    assert "PETSc options go with" in capsys.readouterr().err
    monkeypatch.setattr(beside, "CHECKOUT", folder)
    monkeypatch.setattr(beside, "find_spec", lambda _: None)
    assert cli.main(["mesh", "spring"]) == 2
    assert "the meshes are not installed" in capsys.readouterr().err
