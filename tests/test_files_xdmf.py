"""Meshes of XDMF in scene files: as dolfinx and meshio write them, and what is refused."""

import os
import re
import sys

import numpy as np
import pytest

pytest.importorskip("dolfinx")
import dolfinx.mesh
import solids
from dolfinx.io import XDMFFile
from mpi4py import MPI
from msh import box, content
from test_files_solids import SCENE

from isorod import InputError, fenics, statics
from isorod.command import solving
from isorod.fenics.groups import Groups, space_of
from isorod.fenics.solid import Solid
from isorod.files import xdmf
from isorod.files.document import Document
from isorod.files.scene import FileScene
from isorod.material import LinearElastic

ENCODINGS = [XDMFFile.Encoding.HDF5, XDMFFile.Encoding.ASCII]
LOADED = '[load.pull]\nend = "end"\nforce = [1e-6, 0.0, 1e-6]\n'


def of_meshio(points, cells, numbers=None):
    """Return what meshio writes of one kind of cells, and numbers of these, with its numbers in the file itself."""
    kind = {(8, False): "Hexahedron", (4, False): "Tetrahedron", (4, True): "Quadrilateral", (3, True): "Triangle"}

    def item(array, of):
        rows = "\n".join(" ".join(map(repr, row)) for row in np.atleast_2d(array.T).T.tolist())
        shape = " ".join(map(str, array.shape))
        return f'<DataItem DataType="{of}" Dimensions="{shape}" Format="XML" Precision="8">\n{rows}\n</DataItem>'

    name, size = kind[cells.shape[1], numbers is not None], 'NumberOfElements="{}" NodesPerElement="{}"'
    tagged = ""
    if numbers is not None:
        tagged = f'<Attribute Name="tags" AttributeType="Scalar" Center="Cell">{item(numbers, "Int")}</Attribute>'
    return (
        f'<Xdmf Version="3.0"><Domain><Grid Name="Grid"><Geometry GeometryType="XYZ">{item(points, "Float")}</Geometry>'
        f'<Topology TopologyType="{name}" {size.format(*cells.shape)}>{item(cells, "Int")}</Topology>{tagged}'
        "</Grid></Domain></Xdmf>"
    )


def tagged(domain, of, name="ends"):
    """Return mesh tags of facets, numbers of the facets of each."""
    facets, numbers = np.concatenate([*of.values()]), np.repeat([*of], [len(one) for one in of.values()])
    order = np.argsort(facets)
    found = dolfinx.mesh.meshtags(domain, 2, facets[order].astype(np.int32), numbers[order].astype(np.int32))
    found.name = name
    return found


def write(path, domain, tags, encoding=ENCODINGS[0]):
    """Write a mesh and its tags as dolfinx does."""
    cells = dolfinx.mesh.meshtags(domain, 3, np.arange(2, dtype=np.int32), np.arange(2, dtype=np.int32))
    cells.name = "cells"
    with XDMFFile(MPI.COMM_SELF, str(path), "w", encoding) as file:
        file.write_mesh(domain)
        for one in (cells, *tags):
            # The geometry is asked for since 0.7.
            more = [domain.geometry] if hasattr(one, "_cpp_object") else []
            file.write_meshtags(one, *more)


@pytest.fixture
def folder(tmp_path):
    """The scene on a mesh of gmsh, in a folder."""
    (tmp_path / "my.toml").write_text(SCENE + LOADED)
    (tmp_path / "block.msh").write_bytes(content(*box()))
    return tmp_path


def measured(folder, *changes):
    scene = FileScene(f"{folder}/my.toml", changes=changes)
    solution = statics.solve(scene.model(), **scene.settings())
    return np.concatenate([scene.measure(solution)[name] for name in ("tip", "force")])


@pytest.mark.parametrize("bricks", [False, True])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_mesh_of_dolfinx_is_that_of_gmsh(bricks, encoding, folder):
    points, cells, faces = box(bricks=bricks)
    (folder / "block.msh").write_bytes(content(points, cells, faces))
    groups = Groups(points, cells, "hexahedron" if bricks else "tetrahedron", 1, faces)
    both = tagged(groups.mesh, {3: groups.facets["bottom"], 5: groups.facets["top"]})
    lower = tagged(groups.mesh, {2: groups.facets["bottom"]}, "lower")
    write(folder / "block.xdmf", groups.mesh, [both, lower], encoding)
    expected = measured(folder, "solid.block.held=bottom")
    for held in ("3", "lower", "2"):
        changes = ["solid.block.mesh=block.xdmf", f'solid.block.held="{held}"', "tie.weld.master=block.5"]
        np.testing.assert_allclose(measured(folder, *changes), expected, rtol=1e-12, atol=1e-18)


def changes_of_meshio(folder):
    points, cells, faces = box(parts=(3, 2, 2))
    (folder / "block.msh").write_bytes(content(points, cells, faces))
    facets = np.concatenate([*faces.values()])
    numbers = np.repeat([11, 12], [len(one) for one in faces.values()])
    (folder / "block.xdmf").write_text(of_meshio(points, cells))
    (folder / "facets.xdmf").write_text(of_meshio(points, facets, numbers))
    files = ["solid.block.mesh=block.xdmf", "solid.block.facets=facets.xdmf"]
    return [*files, 'solid.block.held="11"', "tie.weld.master=block.12"]


def test_meshes_of_meshio_are_those_of_gmsh(folder):
    changes = changes_of_meshio(folder)
    scene = FileScene(str(folder / "my.toml"), changes=changes)
    assert [*scene.data] == ["block.xdmf", "facets.xdmf"]
    assert scene.solid_names() == ["block: block.xdmf and facets.xdmf, groups Grid, 11, 12"]
    expected = measured(folder, "solid.block.held=bottom")
    np.testing.assert_allclose(measured(folder, *changes), expected, rtol=1e-12, atol=1e-18)


def same(folder, changes, expected):
    np.testing.assert_allclose(measured(folder, *changes), expected, rtol=1e-9, atol=1e-14)


@pytest.mark.mpi
def test_ranks_read_the_same(folder, on_ranks):
    changes = changes_of_meshio(folder)
    expected = measured(folder, *changes).tolist()
    on_ranks(2, f"test_files_xdmf.same({str(folder)!r}, {changes!r}, {expected!r})")


@pytest.mark.parametrize("shape", solids.SHAPES)
@pytest.mark.parametrize("order", [1, 2])
def test_curved_meshes_keep_their_volume_and_surfaces(shape, order, tmp_path):
    domain = solids.mesh(shape, (2, 2, 1), order, solids.sector)
    inner = solids.where(domain, lambda x: np.hypot(x[0], x[1]) < 1.0 + 1e-9)
    write(tmp_path / "sector.xdmf", domain, [tagged(domain, {7: inner})])
    (tmp_path / "my.toml").write_text("title = 'none'")
    place = Document(str(tmp_path / "my.toml")).top / "mesh"
    try:
        grid = xdmf.mesh(place, "sector.xdmf")
    except InputError as problem:
        # What dolfinx writes of these it does not read.
        assert (shape, order) == ("hexahedron", 2)
        assert re.search(r"my.toml:1: mesh: sector.xdmf: dolfinx cannot read it: Cannot recognise cell", str(problem))
        return
    assert (grid.shape, grid.degree, [*grid.groups]) == (shape, order, ["ends", "7"])
    found = Groups(*grid)
    body, expected = (Solid(solids.space(one, 2), LinearElastic(1.0, 0.3)) for one in (found.mesh, domain))
    assert body.volume == pytest.approx(expected.volume, rel=1e-13)
    assert body.trace(found.facets["7"]).weights.sum() == pytest.approx(expected.trace(inner).weights.sum(), rel=1e-13)
    assert space_of(found, 2).dofmap.index_map.size_global == expected.nodes


def test_a_number_of_facets_within_is_refused_where_it_is_used(folder):
    """Who numbers all facets, most of them zero, can name the others."""
    groups = Groups(*(lambda p, c, f: (p, c, "tetrahedron", 1, f))(*box()))
    rest = np.setdiff1d(np.arange(groups.mesh.topology.index_map(2).size_local), groups.facets["top"])
    write(folder / "block.xdmf", groups.mesh, [tagged(groups.mesh, {0: rest, 5: groups.facets["top"]})])
    changes = ["solid.block.mesh=block.xdmf", "tie.weld.master=block.5"]
    assert FileScene(str(folder / "my.toml"), changes=changes).model().solids
    said = r"group 0: 72 of its 112 facets are none of the mesh's surface"
    with pytest.raises(InputError, match=rf"^\S+my.toml:\d+: solid.block.mesh: {said}$"):
        FileScene(str(folder / "my.toml"), changes=[*changes, 'solid.block.held="0"']).model()
    with pytest.raises(InputError, match=rf"^\S+my.toml:\d+: tie.weld: {said}$"):
        FileScene(str(folder / "my.toml"), changes=[changes[0], "tie.weld.master=block.0"]).model()


def test_numbers_of_two_tags_are_no_names(folder):
    groups = Groups(*(lambda p, c, f: (p, c, "tetrahedron", 1, f))(*box()))
    write(
        folder / "block.xdmf", groups.mesh, [tagged(groups.mesh, {1: groups.facets[one]}, one) for one in groups.facets]
    )
    with pytest.raises(InputError, match=r"tie.weld.master: 'block.1' is not known"):
        FileScene(str(folder / "my.toml"), changes=["solid.block.mesh=block.xdmf", "tie.weld.master=block.1"])
    measured(folder, "solid.block.mesh=block.xdmf", "solid.block.held=bottom")


POINTS, CELLS, FACES = box()
MESH = of_meshio(POINTS, CELLS)
ENDS = of_meshio(POINTS, FACES["top"], np.full(len(FACES["top"]), 4))
ORIGIN = "-1.0 -1.0 -1.0"


def other(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize(
    ("mesh", "facets", "said"),
    [
        ("<Xdmf", None, "mesh: bad.xdmf: no XDMF file: unclosed token"),
        ("<Xdmf/>", None, "mesh: bad.xdmf: no XDMF file: it has no Domain"),
        ("\xff", None, "mesh: bad.xdmf: no XDMF file: "),
        (f'<!DOCTYPE Xdmf [<!ENTITY a "b">]>{MESH}', None, "mesh: bad.xdmf: it defines entities"),
        (ENDS, None, "mesh: bad.xdmf: no grid of tetrahedra or hexahedra is in it"),
        (other(MESH, "Tetrahedron", "Mixed"), None, "mesh: bad.xdmf: grid Grid: cells of several kinds"),
        (other(MESH, "Tetrahedron", "Wedge"), None, "mesh: bad.xdmf: no grid of tetrahedra or hexahedra is in it"),
        (other(MESH, '"XYZ"', '"XY"'), None, "mesh: bad.xdmf: grid Grid: points of kind XY, need XYZ"),
        (other(MESH, '"27 3"', '"26 3"'), None, "mesh: bad.xdmf: grid Grid: Geometry has 81 numbers, need 78"),
        (
            other(MESH, '"27 3"', '"81"'),
            None,
            "mesh: bad.xdmf: grid Grid: Geometry has dimensions '81', need rows of 3",
        ),
        (other(MESH, ORIGIN, "-1.0 nan -1.0"), None, "mesh: bad.xdmf: grid Grid: point 0 is not finite"),
        (other(MESH, ORIGIN, "-1.0 one -1.0"), None, "mesh: bad.xdmf: dolfinx cannot read it: "),
        (other(MESH, ORIGIN, f"<!--a-->{ORIGIN}"), None, "mesh: bad.xdmf: grid Grid: Geometry has no DataItem of"),
        (of_meshio(POINTS[:-1], CELLS), None, "mesh: bad.xdmf: grid Grid: it has nodes that are none of its 26 points"),
        (
            of_meshio(np.insert(POINTS, 0, 9.0, axis=0), CELLS + 1),
            None,
            "mesh: bad.xdmf: grid Grid: 1 of its 28 points are in no cell",
        ),
        (other(MESH, 'Name="Grid"', ""), None, "mesh: bad.xdmf: grid without a name: need a name of its own"),
        (other(MESH, '"XML"', '"Binary"'), None, "mesh: bad.xdmf: grid Grid: "),
        (MESH, "", "facets: facets.xdmf: no XDMF file"),
        (MESH, MESH, "facets: facets.xdmf: no grid of facets with numbers is in it"),
        (
            MESH,
            other(ENDS, ORIGIN, "-1.0 -1.0 -1.1"),
            "facets: facets.xdmf: grid Grid: its points are not those of the",
        ),
        (MESH, other(ENDS, 'Name="Grid"', 'Name="4"'), "facets: facets.xdmf: 4 is the name of a grid and a number of"),
        (MESH, other(ENDS, 'Dimensions="8"', 'Dimensions="7"'), "facets: facets.xdmf: grid Grid: Attribute has 8 num"),
        (
            MESH,
            other(ENDS, 'DataType="Int" Dimensions="8"', 'DataType="Float" Dimensions="8"'),
            "of type Float, n",
        ),
        (
            MESH,
            of_meshio(POINTS, FACES["top"][[0, 1, 0]], np.ones(3, dtype=int)),
            "facets: facets.xdmf: grid Grid: 1 of its 3 facets are there twice",
        ),
        (
            MESH,
            of_meshio(POINTS, np.array([[0, 1, 26]]), np.ones(1, dtype=int)),
            "facets: facets.xdmf: grid Grid: 1 of its 1 facets are none of the mesh",
        ),
    ],
)
def test_files_that_cannot_be_are_refused_in_one_line(mesh, facets, said, folder, capfd):
    (folder / "bad.xdmf").write_text(mesh, encoding="latin-1")
    changes = ["solid.block.mesh=bad.xdmf"]
    if facets is not None:
        (folder / "facets.xdmf").write_text(facets)
        changes.append("solid.block.facets=facets.xdmf")
    with pytest.raises(InputError, match=rf"my.toml:\d+: solid.block.*{re.escape(said)}") as caught:
        FileScene(str(folder / "my.toml"), changes=changes)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().err == ""


def test_data_are_beside_the_mesh_and_the_scene(folder, capfd):
    """dolfinx reads the file of the mesh's own name, whatever is written: what it would not read is refused."""
    groups = Groups(POINTS, CELLS, "tetrahedron", 1, FACES)
    (folder / "below").mkdir()
    path = folder / "below" / "block.xdmf"
    write(path, groups.mesh, [tagged(groups.mesh, {1: groups.facets["top"]}, "top")])
    changes = ["solid.block.mesh=below/block.xdmf"]
    assert [*FileScene(str(folder / "my.toml"), changes=changes).data] == ["below/block.xdmf", "below/block.h5"]

    def refused(said):
        with pytest.raises(InputError, match=rf"^\S+my.toml:\d+: solid.block.mesh: {said}") as caught:
            FileScene(str(folder / "my.toml"), changes=changes)
        assert "\n" not in str(caught.value)

    text = path.read_text()
    for name in ("../block.h5", "/block.h5", "other.h5", ""):
        path.write_text(text.replace("block.h5:", f"{name}:"))
        refused(rf"below/block.xdmf: grid mesh: \w+ is in {re.escape(name)}, need block.h5")
    path.write_text(text.replace("block.h5:/Mesh", "block.h5:/Mush"))
    refused("below/block.xdmf: dolfinx cannot read it: ")
    path.write_text(text)
    data = path.with_suffix(".h5")
    whole = data.read_bytes()
    data.write_bytes(whole[: len(whole) // 2])
    refused("below/block.xdmf: dolfinx cannot read it: ")
    data.write_bytes(b"no" + whole)
    refused("below/block.h5: no file of HDF5")
    data.unlink()
    refused("below/block.h5: cannot be read")
    outside = folder.parent / f"{folder.name}.h5"
    outside.write_bytes(whole)
    os.symlink(outside, data)
    refused("below/block.h5: is neither beside the scene nor below")
    changes[:] = [f"solid.block.mesh=../{folder.name}.xdmf"]
    refused(f"../{folder.name}.xdmf: cannot be read")
    assert capfd.readouterr().err == ""


def test_without_dolfinx_there_is_one_line(folder, monkeypatch):
    (folder / "block.xdmf").write_text(MESH)
    monkeypatch.setitem(sys.modules, "isorod.fenics.xdmf", None)
    monkeypatch.delattr(fenics, "xdmf", raising=False)
    with pytest.raises(InputError, match=r"solid.block.mesh: finite element bodies need dolfinx, and \S+ is not inst"):
        solving.solve(FileScene(str(folder / "my.toml"), changes=["solid.block.mesh=block.xdmf"]), {})
