"""Meshes of rods: nodes on the Rod, positive cells, outward faces, and files that gmsh reads back."""

import numpy as np
import pytest

from isorod.errors import InputError
from isorod.scenes.spring import Spring
from meshes import spring
from meshes.bricks import bricks
from meshes.mesh import Mesh
from meshes.template import o_grid


def enclosed(mesh: Mesh) -> tuple[np.ndarray, float]:
    """Return the boundary's vector area, and the volume it encloses, of a mesh of order 1."""
    if mesh.shape == "tetrahedron":
        rules = [(np.array([1.0, 1.0, 1.0]) / 3.0, np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]), 0.5)]
    else:
        ticks = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
        rules = []
        for s in ticks:
            for t in ticks:
                values = np.array([(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t])
                slopes = np.array([[t - 1, 1 - t, -t, t], [s - 1, -s, 1 - s, s]])
                rules.append((values, slopes, 0.25))
    area, volume = np.zeros(3), 0.0
    for nodes in mesh.faces.values():
        corners = mesh.points[nodes]
        for values, slopes, weight in rules:
            normal = weight * np.cross(*np.einsum("an,fnb->afb", slopes, corners))
            area += normal.sum(axis=0)
            volume += np.sum(normal * np.einsum("n,fnb->fb", values, corners)) / 3.0
    return area, volume


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("around, rings", [(4, 0), (4, 1), (8, 0), (8, 2), (24, 2)])
def test_template_covers_the_disk(around, rings, order):
    grid = o_grid(around, rings, order)
    assert grid.quads.shape == ((around // 4) ** 2 + rings * around, (order + 1) ** 2)
    assert grid.rim.shape == (around, order + 1)
    assert np.abs(np.linalg.norm(grid.points[grid.rim], axis=2) - 1.0).max() < 1e-15
    assert np.linalg.norm(grid.points, axis=1).max() < 1.0 + 1e-15
    assert np.array_equal(np.unique(grid.quads), np.arange(len(grid.points)))
    a, b, c, d = (grid.points[grid.quads[:, k]] for k in (0, order, -1, -1 - order))
    diagonals = (c - a)[:, 0] * (d - b)[:, 1] - (c - a)[:, 1] * (d - b)[:, 0]
    assert diagonals.min() > 0.0


def test_template_of_the_paper():
    grid = o_grid(24, 2, 1)
    assert (len(grid.points), len(grid.quads)) == (97, 84)


@pytest.mark.parametrize("order, rate", [(1, 2.0), (2, 4.0), (3, 4.0)])
def test_volume_converges_to_that_of_the_rod(order, rate):
    exact = Spring(helix="paper").rod().volume()
    errors = [
        abs(spring.build(order=order, around=around, layers=layers).volume() / exact - 1.0)
        for around, layers in ((4, 12), (8, 24), (16, 48))
    ]
    found = -np.diff(np.log2(errors))
    assert found == pytest.approx([rate, rate], abs=0.35)
    assert found[-1] == pytest.approx(rate, abs=0.1)
    assert errors[-1] < {1: 0.051, 2: 1.2e-4, 3: 3e-5}[order]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("build", ["bricks", "tetrahedra"])
def test_lateral_nodes_lie_on_the_surface(cylinder, build, order):
    rod = cylinder(n=5, breaks=(0.0, 0.4, 1.0), radius=0.7, height=3.0)
    if build == "bricks":
        mesh = bricks(rod, o_grid(8, 1, order), 4)
    else:
        pytest.importorskip("gmsh")
        from meshes.tetrahedra import tetrahedra

        mesh = tetrahedra(rod, 8, 4, order)
    lateral = mesh.points[mesh.faces["lateral"]]
    assert np.abs(np.linalg.norm(lateral[..., :2], axis=-1) - 0.7).max() < 1e-12
    assert np.abs(mesh.points[mesh.faces["start"]][..., 2]).max() < 1e-12
    assert np.abs(mesh.points[mesh.faces["end"]][..., 2] - 3.0).max() < 1e-12
    assert np.linalg.norm(mesh.points[:, :2], axis=1).max() < 0.7 + 1e-12


@pytest.mark.parametrize("cells", ["bricks", "tetrahedra"])
def test_faces_point_outward_and_close(cells):
    if cells == "tetrahedra":
        pytest.importorskip("gmsh")
    mesh = spring.build(cells, order=1, layers=24)
    area, volume = enclosed(mesh)
    assert np.abs(area).max() < 1e-10
    assert volume == pytest.approx(mesh.volume(), rel=1e-10)


def test_tetrahedra_of_the_spring_are_positive():
    pytest.importorskip("gmsh")
    mesh = spring.build("tetrahedra", around=10, layers=48)
    assert mesh.cells.shape[1] == 10
    assert mesh.check() > 0.0
    assert mesh.volume() == pytest.approx(Spring(helix="paper").rod().volume(), rel=2e-3)


def test_mesh_of_the_paper():
    mesh = spring.build("paper")
    assert (len(mesh.points), len(mesh.cells), mesh.cells.shape[1]) == (7081, 6048, 8)
    # Straight sides: the wire is short of what lies between chords and arcs.
    assert mesh.volume() / Spring(helix="paper").rod().volume() - 1.0 == pytest.approx(-0.0227, abs=2e-4)


def test_inverted_cell_is_named():
    mesh = spring.build(order=1, layers=12)
    points = mesh.points.copy()
    points[mesh.cells[7, 0]], points[mesh.cells[7, 1]] = (
        points[mesh.cells[7, 1]].copy(),
        points[mesh.cells[7, 0]].copy(),
    )
    bad = Mesh(mesh.shape, 1, points, mesh.cells, mesh.reference, mesh.faces, mesh.face_reference)
    with pytest.raises(InputError, match=r"cell \d+ at \(.*\) is inverted"):
        bad.check()


@pytest.mark.parametrize("cells, order", [("bricks", 2), ("bricks", 3), ("tetrahedra", 2), ("paper", 1)])
def test_gmsh_reads_the_file_back(cells, order, tmp_path):
    pytest.importorskip("gmsh")
    from meshes import gmsh_model

    mesh = spring.build(cells, around=8, layers=24, order=order)
    path = tmp_path / "spring.msh"
    gmsh_model.write(mesh, path)
    assert [file.name for file in tmp_path.iterdir()] == ["spring.msh"]
    with gmsh_model.gmsh_session() as gmsh:
        gmsh.open(str(path))
        groups = {gmsh.model.getPhysicalName(*group): group for group in gmsh.model.getPhysicalGroups()}
        assert set(groups) == {"start", "end", "lateral", "volume"}
        for name, nodes in mesh.faces.items():
            entities = gmsh.model.getEntitiesForPhysicalGroup(*groups[name])
            assert sum(len(tags) for e in entities for tags in gmsh.model.mesh.getElements(2, e)[1]) == len(nodes)
        (kind,) = gmsh.model.mesh.getElementTypes(3)
        where, weights = gmsh.model.mesh.getIntegrationPoints(kind, f"Gauss{3 * order}")
        _, det, _ = gmsh.model.mesh.getJacobians(kind, where)
        volume = np.sum(np.asarray(det).reshape(len(mesh.cells), -1) * weights)
    # gmsh writes 16 digits; the rule is exact for the polynomial cells.
    assert volume == pytest.approx(mesh.volume(), rel=1e-9)


BAD = {
    "--around 5": "multiple of 4",
    "--around 0": "multiple of 4",
    "--around 2 --cells tetrahedra": "at least 3",
    "--layers 50": "multiple of the rod's 12",
    "--layers -12": "multiple of the rod's 12",
    "--order 7": "need 1 to 4",
    "--order 3 --cells tetrahedra": "need 1 or 2",
    "--rings -1": "0 or more",
    "--core 1.5": "less than 1",
    "--core nan": "less than 1",
    "--cells cubes": "need one of bricks, tetrahedra, paper",
    "-o nowhere/spring.msh": "does not exist",
    "-o spring.stl": ".msh",
}


@pytest.mark.parametrize("arguments", BAD)
def test_bad_input_is_one_line(arguments, tmp_path, monkeypatch, capsys):
    from meshes.study import main

    monkeypatch.chdir(tmp_path)
    try:
        code = main(["spring", *arguments.split()])
    except SystemExit as end:
        code = end.code
    said = capsys.readouterr()
    assert code == 2
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1
    assert BAD[arguments] in said.err
    assert list(tmp_path.iterdir()) == []
