"""Centre lines from files beside a scene: CSV, and polylines of VTK with their radii."""

import locale
import os
from types import SimpleNamespace

import numpy as np
import pytest

from isorod import InputError
from isorod.files import document
from isorod.files.scene import FileScene
from isorod.geometry import center_line, section

T = np.linspace(0.0, 1.0, 9)
LINE = np.stack([np.sin(T), T**2, 3.0 * T], axis=1)
RADIUS = 0.2 + 0.1 * T


@pytest.fixture(autouse=True)
def own_locale():
    """Return the locale as it is before VTK's writers of these tests, which leave that of C, and restore it."""
    kept = locale.setlocale(locale.LC_ALL)
    yield kept
    locale.setlocale(locale.LC_ALL, kept)


def scene(folder, file, more=""):
    path = folder / "my.toml"
    path.write_text(f"analysis = 'geometry'\n[rod.a]\ncurve = {{polyline = '{file}', tolerance = 0.0}}\n{more}\n")
    return FileScene(str(path))


def rows(table, mark=","):
    return "\n".join(mark.join(f"{value!r}" for value in row) for row in table.tolist()) + "\n"


@pytest.mark.parametrize(
    "content",
    [
        rows(LINE),
        "x,y,z\n" + rows(LINE),
        '"z";"x";"y"\r\n' + rows(LINE[:, [2, 0, 1]], ";").replace("\n", "\r\n"),
        "# a line\n\n" + rows(LINE, "   ") + "\n# the end\n",
        "\ufeffX, Y, Z\n" + rows(LINE, " , "),
    ],
)
def test_points_of_csv_are_those_of_python(content, tmp_path):
    (tmp_path / "line.csv").write_bytes(content.encode())
    (rod,) = scene(tmp_path, "line.csv", "section = {circle = 0.3}").rods()
    expected = center_line.polyline(LINE, 0.0).sweep(section.circle(8, 0.3))
    np.testing.assert_array_equal(rod.control_points, expected.control_points)


@pytest.mark.parametrize("content", [rows(np.c_[LINE, RADIUS]), "radius,x,y,z\n" + rows(np.c_[RADIUS, LINE])])
def test_a_radius_scales_the_section_which_is_a_circle_where_not_given(content, tmp_path):
    (tmp_path / "line.csv").write_text(content)
    line = center_line.polyline(LINE, 0.0)
    for more, outline in (
        ("", section.circle(8)),
        ("section = {ellipse = {a = 1.0, b = 0.5}}", section.ellipse(8, 1, 0.5)),
    ):
        (rod,) = scene(tmp_path, "line.csv", more).rods()
        expected = line.sweep(outline, scale=RADIUS)
        np.testing.assert_array_equal(rod.control_points, expected.control_points)
    with pytest.raises(InputError, match=r"my.toml:4: rod.a.scale: given twice: the curve's file has a radius"):
        scene(tmp_path, "line.csv", "scale = 2.0")


def polydata(pieces, name="Radius"):
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    points, cells, mesh = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetDataTypeToDouble()
    for point in LINE:
        points.InsertNextPoint(point)
    for piece in pieces:
        cells.InsertNextCell(len(piece))
        for number in piece:
            cells.InsertCellPoint(number)
    mesh.SetPoints(points)
    mesh.SetLines(cells)
    radius = numpy_to_vtk(RADIUS, deep=True)
    radius.SetName(name)
    mesh.GetPointData().AddArray(radius)
    return mesh


def write(file, pieces):
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkPolyDataWriter() if file.suffix == ".vtk" else vtkXMLPolyDataWriter()
    writer.SetFileName(str(file))
    writer.SetInputData(polydata(pieces))
    assert writer.Write()


WHOLE = [list(range(9))]
SEGMENTS = [[k, k + 1] for k in (3, 0, 1, 2)] + [[8, 7], [7, 6]] + [[4, 5], [5, 6]]


@pytest.mark.parametrize("pieces", [WHOLE, SEGMENTS, [[4, 5, 6, 7, 8], [4, 3, 2, 1, 0]]])
@pytest.mark.parametrize("ending", ["vtk", "vtp"])
def test_a_polyline_of_vtk_is_read_with_its_radius(pieces, ending, tmp_path, own_locale):
    pytest.importorskip("vtkmodules")
    write(tmp_path / f"line.{ending}", pieces)
    locale.setlocale(locale.LC_ALL, own_locale)
    (rod,) = scene(tmp_path, f"line.{ending}").rods()
    assert locale.setlocale(locale.LC_ALL) == own_locale
    expected = center_line.polyline(LINE, 0.0).sweep(section.circle(8), scale=RADIUS)
    np.testing.assert_allclose(rod.control_points, expected.control_points, atol=1e-6)


@pytest.mark.parametrize("ending", ["vtk", "vtp"])
@pytest.mark.parametrize(
    "content", [b"", b"nonsense\n", b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS"]
)
def test_what_vtk_cannot_read_is_one_line(content, ending, tmp_path, capfd):
    pytest.importorskip("vtkmodules")
    (tmp_path / f"line.{ending}").write_bytes(content)
    with pytest.raises(InputError, match=rf"my.toml:3: rod.a.curve.polyline: line.{ending}: no polyline is in it"):
        scene(tmp_path, f"line.{ending}")
    assert capfd.readouterr() == ("", "")


def test_lines_that_do_not_meet_are_refused(tmp_path):
    pytest.importorskip("vtkmodules")
    write(tmp_path / "line.vtk", [[0, 1, 2], [4, 5], [7, 8]])
    with pytest.raises(InputError, match=r"line.vtk: 3 lines that do not meet, need one polyline"):
        scene(tmp_path, "line.vtk")


def test_control_points_of_nurbs_may_come_from_a_file(tmp_path):
    (tmp_path / "line.csv").write_text(rows(LINE))
    path = tmp_path / "my.toml"
    path.write_text(
        "analysis = 'geometry'\n[rod.a]\ncurve = {nurbs = 'line.csv', degree = 2, weights = "
        f"{[1.0] * 4 + [2.0] + [1.0] * 4}}}\nsection = {{circle = 0.1}}\n"
    )
    (rod,) = FileScene(str(path)).rods()
    knots = [0.0, 0.0, *np.linspace(0.0, 1.0, 8), 1.0, 1.0]
    curve = SimpleNamespace(degree=2, knotvector=knots, ctrlpts=LINE, weights=[1.0] * 4 + [2.0] + [1.0] * 4)
    expected = center_line.nurbs(curve).sweep(section.circle(8, 0.1))
    np.testing.assert_array_equal(rod.control_points, expected.control_points)
    path.write_text(path.read_text().replace("degree = 2", "degree = 9"))
    with pytest.raises(InputError, match=r"my.toml:3: rod.a.curve.degree: nurbs: degree: got 9"):
        FileScene(str(path)).rods()


def test_data_lie_beside_the_scene_or_where_the_user_allows(tmp_path, monkeypatch):
    here, other = tmp_path / "here", tmp_path / "other"
    (here / "below").mkdir(parents=True)
    other.mkdir()
    for folder in (here / "below", other):
        (folder / "line.csv").write_text(rows(LINE))
    (here / "link.csv").symlink_to(other / "line.csv")
    (here / "own.csv").symlink_to(here / "below" / "line.csv")
    os.mkfifo(here / "pipe.csv")
    outline = "section = {circle = 0.3}"
    assert scene(here, "below/line.csv", outline).rods() and scene(here, "own.csv", outline).rods()
    for name, said in (
        ("../other/line.csv", "is neither beside the scene nor below; ISOROD_DATA=FOLDER allows others"),
        ("link.csv", "is neither beside the scene nor below"),
        (str(other / "line.csv"), "is neither beside the scene nor below"),
        ("/dev/zero", "is neither beside the scene nor below"),
        ("pipe.csv", "is no plain file"),
        ("below", "is no plain file"),
        ("none.csv", "cannot be read"),
    ):
        with pytest.raises(InputError, match=rf"my.toml:3: rod.a.curve.polyline: {name}: {said}"):
            scene(here, name)
    monkeypatch.setenv("ISOROD_DATA", f"{tmp_path / 'none'}{os.pathsep}{other}")
    assert scene(here, "../other/line.csv", outline).rods() and scene(here, str(other / "line.csv"), outline).rods()


def test_data_are_bounded_in_size(tmp_path, monkeypatch):
    monkeypatch.setattr(document, "_LARGEST", 100)
    (tmp_path / "line.csv").write_text(rows(LINE))
    with pytest.raises(InputError, match="longer than 100 bytes"):
        scene(tmp_path, "line.csv")


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ("2 0 1\n2 1 7\n", "a line has point 7, there are points 0 to 2"),
        ("2 0 1\n2 1 -2\n", "a line has point -2, there are points 0 to 2"),
        ("2 0 1\n2 1 2147483647\n", "a line has point 2147483647, there are points 0 to 2"),
        ("0\n0\n", "no polyline is in it"),
    ],
)
def test_numbers_of_points_that_are_not_there_are_refused(cells, said, tmp_path, capfd):
    size = len(cells.split())
    head = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 3 float\n0 0 0 0 0 1 0 0 2\n"
    (tmp_path / "line.vtk").write_text(f"{head}LINES 2 {size}\n{cells}")
    with pytest.raises(InputError, match=f"rod.a.curve.polyline: line.vtk: {said}$"):
        scene(tmp_path, "line.vtk").rods()
    assert capfd.readouterr().err == ""
