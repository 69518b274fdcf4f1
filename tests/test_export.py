"""Fields as VTK files."""

import json
import re
import sys
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import straight

from isorod import memory, statics
from isorod.command import cli
from isorod.errors import InputError, SolveError
from isorod.material import LinearElastic
from isorod.model import Body
from isorod.output import folder, results, vtk
from isorod.output.stress import cauchy, von_mises
from isorod.scenes.biceps import Biceps
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring
from isorod.space import Space

pyvista = pytest.importorskip("pyvista")

COARSE = ("--coils", "1", "--section-points", "4", "--elements-per-turn", "8")


@pytest.fixture(scope="module")
def solved():
    model = Spring(preset="paper", coils=1, section_points=4, elements_per_turn=4).model()
    return model.bodies[0], {"displacement": model.nodal(statics.solve(model).displacement)}


def test_every_element_has_points_and_cells_of_its_own(solved):
    mesh = vtk.grid(*solved, rings=2, around=8, slices=3)
    assert mesh.n_points == 4 * (3 + 1) * (1 + 2 * 8)
    assert mesh.n_cells == 4 * 3 * 2 * 8
    assert mesh.point_data["displacement"].shape == (mesh.n_points, 3)
    assert mesh.point_data["von_mises"].shape == (mesh.n_points,)


def test_points_and_fields_are_those_of_the_rod(solved):
    body, nodal = solved[0], solved[1]["displacement"]
    mesh = vtk.grid(body, {"displacement": nodal, "mode 1": 2 * nodal}, rings=2, around=8, slices=3)
    # point 5 of the section at the first slice of element 2: ring 1, angle 4/8
    k = 2 * 4 * 17 + 5
    xi, u = [[-0.5, 0.0]], [2.0]
    assert np.abs(mesh.points[k] - body.space.rod.points(xi, u)[0]).max() < 1e-6
    displacement, _ = body.space.displacement(nodal, xi, u)
    assert np.abs(mesh.point_data["displacement"][k] - displacement[0, 0]).max() < 1e-6
    assert np.array_equal(mesh.point_data["mode 1"], 2 * mesh.point_data["displacement"])
    assert mesh.point_data["von_mises"][k] == pytest.approx(von_mises(cauchy(body, nodal, xi, u))[0, 0], rel=1e-6)


def test_cells_fill_the_rod(solved):
    mesh = vtk.grid(*solved, rings=4, around=64, slices=16)
    sizes = mesh.compute_cell_sizes(length=False, area=False)["Volume"]
    assert sizes.min() > 0
    assert sizes.sum() == pytest.approx(solved[0].space.rod.volume(), rel=5e-3)


def test_clamped_end_does_not_move_and_the_other_end_moves_as_told(solved):
    mesh = vtk.grid(*solved, rings=1, around=8, slices=2)
    moved = mesh.point_data["displacement"].reshape(-1, 9, 3)
    assert np.abs(moved[0]).max() == 0
    assert np.abs(moved[-1] - [0, 0, 2.0]).max() < 1e-6


def write(path, *given):
    results.write_whole(path, vtk.content(vtk.grid(*given)))


def test_written_file_reads_back(solved, tmp_path):
    path = tmp_path / "wire.vtu"
    write(path, *solved)
    mesh, read = vtk.grid(*solved), pyvista.read(path)
    assert np.array_equal(read.points, mesh.points)
    for name in ("displacement", "von_mises"):
        assert np.array_equal(read.point_data[name], mesh.point_data[name])
    assert [file.name for file in tmp_path.iterdir()] == ["wire.vtu"]


def test_file_that_cannot_be_written_is_refused_in_one_line(solved, tmp_path):
    (tmp_path / "wire.vtu").mkdir()
    with pytest.raises(InputError, match=r"wire.vtu: cannot be written") as caught:
        write(tmp_path / "wire.vtu", *solved)
    assert "\n" not in str(caught.value)
    assert [file.name for file in tmp_path.iterdir()] == ["wire.vtu"]
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "no such folder" / "wire.vtu", *solved)


def test_a_full_disk_leaves_the_old_file(solved, tmp_path, room):
    path = tmp_path / "wire.vtu"
    write(path, *solved)
    good = path.read_bytes()
    for size in (0, 5000, len(good) - 1):
        with (
            room(size),
            pytest.raises(
                InputError, match=r"wire.vtu: cannot be written \(File too large\); make room there, or name"
            ),
        ):
            write(path, *solved)
        assert path.read_bytes() == good
        assert [file.name for file in tmp_path.iterdir()] == ["wire.vtu"]


def test_a_results_folder_takes_a_run_as_a_whole_or_not_at_all(solved, tmp_path, room):
    """Where there is no room for the fields, or, when they are written, for the record."""
    record, (body, fields) = {"scene": "spring", "force": 1.0}, solved
    states = [folder.Frame(0.5, [fields, fields]), folder.Frame(1.0, [fields, fields])]
    curves = {"load factor": np.array([0.5, 1.0])}

    def add():
        return folder.add(tmp_path, record, [body, body], states, curves)

    def there():
        return {file.relative_to(tmp_path): file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}

    for _ in range(2):
        before, folders = there(), {file for file in tmp_path.iterdir() if file.is_dir()}
        with room(5000), pytest.raises(InputError, match=r"spring-.*0-0000.vtu: cannot be written"):
            add()
        record["text"] = "x" * 1_000_000
        with room(900_000), pytest.raises(InputError, match=r"results.jsonl: cannot be written"):
            add()
        assert there() == before
        assert {file for file in tmp_path.iterdir() if file.is_dir()} == folders
        del record["text"]
        written = add()
        assert json.loads((tmp_path / "results.jsonl").read_text().splitlines()[-1]) == written
    names = [f"spring-run2-frames/{b}-000{k}.vtu" for b in range(2) for k in range(2)]
    assert written["files"] == [*names, "spring-run2.pvd", "spring-run2.csv"]
    assert re.findall(
        r'timestep="(\S+)" group="" part="(\d)" file="(\S+)"', (tmp_path / "spring-run2.pvd").read_text()
    ) == [
        (str(time), str(b), f"spring-run2-frames/{b}-000{k}.vtu") for k, time in enumerate([0.5, 1.0]) for b in range(2)
    ]
    assert (tmp_path / "spring-run2.csv").read_text() == "load factor\n0.5\n1.0\n"
    record["force"] = np.nan
    with pytest.raises(SolveError, match="force is not a finite number"):
        add()
    # The first run's file is that of its record wherever it is.
    (tmp_path / "spring-frames").rename(tmp_path / "mine")
    (tmp_path / "spring.pvd").unlink()
    record["force"] = 2.0
    assert add()["files"][-1] == "spring-run3.csv"


def test_the_command_says_that_the_disk_is_full_and_leaves_the_folder_as_it_was(tmp_path, room, capsys):
    words = ["run", "spring", *COARSE, "--output", str(tmp_path)]
    assert cli.main(words) == 0
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert before.keys() == {"results.jsonl", "spring-0.vtu", "spring.csv"}
    capsys.readouterr()
    with room(20_000):
        assert cli.main(words) == 2
    out, err = capsys.readouterr()
    # The result itself is not lost.
    assert out.startswith("force ")
    said = err.splitlines()[-1]
    assert re.fullmatch(r"isorod: \S*spring-run2-0.vtu: cannot be written \(File too large\); make room .*", said)
    assert all(one.startswith("isorod: warning: ") for one in err.splitlines()[:-1])
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


@pytest.mark.parametrize("name", ["a name with blanks", "ümlaut/in/it"])
def test_any_name_of_a_folder_will_do(name, tmp_path, capsys):
    assert cli.main(["run", "spring", *COARSE, "--json", f"--output={tmp_path / name}"]) == 0
    written, _ = json.loads(capsys.readouterr().out)["files"]
    assert pyvista.read(tmp_path / name / written).n_points


def test_without_pyvista_the_error_says_how_to_get_it(solved, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(InputError, match="pip install pyvista"):
        vtk.grid(*solved)


def test_closed_rod_is_exported_too():
    space = Space.paper(Ring(section_points=5).rod())
    fields = {"displacement": np.ones((space.nodes, 3))}
    mesh = vtk.grid(Body(space, LinearElastic(1.0, 0.3)), fields, rings=1, around=8, slices=2)
    assert np.abs(mesh.point_data["displacement"] - 1).max() < 1e-6
    assert np.abs(mesh.point_data["von_mises"]).max() < 1e-6


def test_every_element_shows_its_own_stress_up_to_its_ends():
    """An affine deformation, stiffness by element: each has one stress, its last points too, and all are in the rod."""
    laws = [LinearElastic(E, 0.3) for E in (1.0, 100.0, 10.0)]
    body = Body(Space.paper(straight(5, height=3.0), elements=3, continuity=0), laws)
    nodal = body.space.positions @ np.diag([0.0, 0.0, 0.01])
    mesh = vtk.grid(body, {"displacement": nodal}, rings=1, around=4, slices=3)
    found = mesh.point_data["von_mises"].reshape(3, -1)
    strain = np.diag([0.0, 0.0, 0.01])
    for row, law in zip(found, laws, strict=True):
        stress = law.stress(np.eye(3)[None] + strain)
        # Cauchy's stress is Piola's times F over det F.
        assert row == pytest.approx(von_mises(stress * [1.0, 1.0, 1.01] / 1.01)[0], rel=1e-9)
    heights = mesh.points[:, 2].reshape(3, 4, -1)
    assert heights.min() == 0.0 and heights.max() <= 3.0
    assert heights.max(axis=(1, 2)) == pytest.approx([1.0, 2.0, 3.0], abs=1e-6)
    assert np.ptp(heights, axis=2).max() < 1e-6


def test_load_factor_is_the_muscle_s_activation():
    model = Biceps(elements=5, activation=0.5).model()
    body = model.bodies[0]
    rest = {"displacement": np.zeros((body.space.nodes, 3))}
    for factor in (0.0, 0.6, 1.0):
        stresses = vtk.grid(body, rest, rings=1, around=4, slices=1, factor=factor).point_data["von_mises"]
        # Active fibres alone pull in an undeformed muscle, with up to 30 N/cm^2.
        assert stresses.max() == pytest.approx(0.5 * factor * 30.0, abs=1e-9)


def test_names_are_escaped_in_collections_and_tables():
    name = 'a&"<b-frames/0-0000.vtu'
    found = ElementTree.fromstring(folder._collection([(0.5, 0, name)]))
    assert [one.get("file") for one in found.iter("DataSet")] == [name]
    table = folder._table({"time": np.array([0.0, 1.0]), "force of =a, b": np.array([2.0, -3.0])})
    assert table == b'time,"force of =a, b"\n0.0,2.0\n1.0,-3.0\n'


def test_a_file_that_does_not_fit_into_memory_is_refused_before_it_is_made(solved, monkeypatch):
    monkeypatch.setattr(memory, "SMALL", 0.0)
    monkeypatch.setattr(memory, "available", lambda: 1e6)
    with pytest.raises(
        InputError, match=r"^a \.vtu file of 3,612 points needs about 0.0033\d* GB, 0.001 GB are free; "
    ):
        vtk.grid(*solved)
    monkeypatch.setattr(memory, "available", lambda: 4e6)
    assert vtk.grid(*solved).n_points == 3612


@pytest.mark.parametrize(
    ("problem", "said"), [(InputError("no room"), "no room"), (MemoryError(), memory.SHORT)], ids=["disk", "memory"]
)
def test_a_folder_that_nothing_came_into_is_not_there(problem, said, capsys, tmp_path, monkeypatch):
    def fail(*_):
        raise problem

    monkeypatch.setattr(folder, "_table", fail)
    words = ["run", "spring", *COARSE, "--no-estimate", "--json", "--output"]
    assert cli.main([*words, str(tmp_path / "new")]) == 2
    out, err = capsys.readouterr()
    assert (json.loads(out)["scene"], err) == ("spring", f"isorod: {said}\n")
    assert [*tmp_path.iterdir()] == []
    # One that was there stays.
    assert cli.main([*words, str(tmp_path)]) == 2
    assert [*tmp_path.iterdir()] == []
