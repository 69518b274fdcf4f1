"""Meshes of gmsh: the same in every format, and one line where a file is none."""

import numpy as np
import pytest
from msh import box, content
from refused import refused

from isorod import InputError
from isorod.files import msh

FORMATS = [(version, binary) for version in ("2.2", "4.1") for binary in (False, True)]


def volume(grid):
    """Return the volume of cells of degree 1."""
    corners = grid.points[grid.cells]
    if grid.shape == "hexahedron":
        round_diagonal = [[1, 2], [2, 3], [3, 7], [7, 4], [4, 5], [5, 1]]
        corners = np.concatenate([corners[:, [0, *two, 6]] for two in round_diagonal])
    return (np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6.0).sum()


@pytest.mark.parametrize(("version", "binary"), FORMATS)
@pytest.mark.parametrize("bricks", [False, True])
def test_a_box_is_read_from_every_format(version, binary, bricks):
    points, cells, faces = box(bricks=bricks)
    grid = msh.read(content(points, cells, faces, version, binary))
    assert (grid.shape, grid.degree) == ("hexahedron" if bricks else "tetrahedron", 1)
    assert volume(grid) == pytest.approx(4.0, rel=1e-12)
    assert set(grid.groups) == {"bottom", "top"}
    for name, height in (("bottom", -1.0), ("top", 0.0)):
        assert len(grid.groups[name]) == len(faces[name])
        np.testing.assert_array_equal(grid.points[grid.groups[name]][..., 2], height)


@pytest.mark.parametrize(("version", "binary"), FORMATS)
@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("bricks", [False, True])
def test_what_gmsh_writes_is_read(version, binary, degree, bricks, tmp_path):
    gmsh = pytest.importorskip("gmsh")
    file = str(tmp_path / "block.msh")
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        face = gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 2.0, 1.0)
        gmsh.model.occ.extrude([(2, face)], 0.0, 0.0, 3.0, numElements=[2], recombine=bricks)
        gmsh.model.occ.synchronize()
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, [face]), "the bottom")
        gmsh.model.addPhysicalGroup(3, [1])
        for _, tag in gmsh.model.getEntities(2) if bricks else ():
            gmsh.model.mesh.setRecombine(2, tag)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 1.0)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.MshFileVersion", float(version))
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(degree)
        gmsh.write(file)
    finally:
        gmsh.finalize()
    with open(file, "rb") as handle:
        grid = msh.read(handle.read())
    assert grid.degree == degree and grid.shape == ("hexahedron" if bricks else "tetrahedron")
    assert volume(grid._replace(cells=grid.cells[:, : 8 if bricks else 4])) == pytest.approx(6.0, rel=1e-9)
    assert list(grid.groups) == ["the bottom"]
    np.testing.assert_allclose(grid.points[grid.groups["the bottom"]][..., 2], 0.0, atol=1e-12)


BOX = content(*box())
FLAT = content(*box()[:2], {}).replace(b"3 1 4\n", b"2 1 3\n")


test_what_is_no_mesh_is_refused = refused(
    (b"", "no mesh of gmsh: it does not begin with $MeshFormat"),
    (b'Point(1) = {0, 0, 0};\nSystemCall "touch run";\n', "no mesh of gmsh: it does not begin with $MeshFormat"),
    (BOX.replace(b"4.1 0", b"1.0 0", 1), "version 1.0 of gmsh's format, need 2.2 or 4.1"),
    (FLAT, "no tetrahedra or hexahedra are in it; need a mesh in 3-D"),
    (BOX[:-200], "damaged, or not as gmsh writes .msh files"),
    (BOX.replace(b"-1.0 ", b"nan ", 1), "damaged, or not as gmsh writes .msh files"),
    (BOX.replace(b"3 1 4\n", b"3 1 99\n", 1), "damaged, or not as gmsh writes .msh files"),
    by=msh.read,
)


@pytest.mark.parametrize(("version", "binary"), FORMATS)
def test_damaged_files_are_refused_in_one_line(version, binary):
    """A thousand bytes changed or cut off, by chance: a mesh, or an error that is one of ours."""
    whole, random = content(*box(parts=(1, 1, 1)), version, binary), np.random.default_rng(1)
    refused = 0
    for k in range(300):
        data = bytearray(whole)
        for _ in range(1 + k % 3):
            data[random.integers(len(data))] = random.integers(256)
        try:
            msh.read(bytes(data[: random.integers(len(data))] if k % 5 == 0 else data))
        except InputError as problem:
            assert "\n" not in str(problem)
            refused += 1
    assert refused > 60
