"""Scenes from files: the same results as from Python, records that hold what is needed to get them again."""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
from scene_files import BEAM, LINE, MODES, MOTION, OUTLINE, PAIR, RING, VALID, text

from isorod import InputError, Pressure, files, modal, statics
from isorod.command import new, solving
from isorod.files import schema
from isorod.files.form import Form
from isorod.files.lines import lines
from isorod.files.scene import FileScene
from isorod.files.schema import RESERVED
from isorod.geometry import center_line, section
from isorod.scenes.flower import Flower
from isorod.scenes.ring import Ring
from isorod.scenes.spring import Spring

EXAMPLES = Path(new.__file__).parent.parent / "files" / "examples"


@pytest.fixture
def written(tmp_path):
    """Write a scene, and data files beside it; return the path."""

    def write(table, **data):
        for name, content in data.items():
            (tmp_path / name.replace("_", ".")).write_text(content)
        path = tmp_path / "my.toml"
        path.write_text(text(table) if isinstance(table, dict) else table)
        return str(path)

    return write


def test_the_spring_of_a_file_is_the_scene():
    scene = Spring(helix="paper", section_points=8, elements_per_turn=8, order=1, degree=3, quadrature="auto")
    own = statics.solve(scene.model())
    file = FileScene(str(EXAMPLES / "spring.toml"))
    found = statics.solve(file.model(), **file.settings())
    force = scene.measure(own)["force"]
    assert file.measure(found)["force"] == pytest.approx(force, rel=1e-12)
    np.testing.assert_allclose(found.displacement, own.displacement, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("name", "scene"), [("ring", Ring()), ("flower", Flower())])
def test_geometry_of_a_file_is_the_scene(name, scene):
    own, found = solving.geometry(scene), solving.geometry(FileScene(str(EXAMPLES / f"{name}.toml")))
    for key in ("volume", "smallest_jacobian", "control_points"):
        assert found[key] == pytest.approx(own[key], rel=1e-12)


def test_the_trefoil_has_few_lines_and_meets_its_points():
    path = EXAMPLES / "trefoil.toml"
    assert len(path.read_text().splitlines()) <= 25
    points = np.loadtxt(EXAMPLES / "trefoil.csv", delimiter=",", skiprows=1)
    assert points.shape == (40, 3)
    (rod,) = FileScene(str(path)).rods()
    u = np.linspace(*rod.axis.breaks[[0, -1]], 20001)
    line = rod.points(np.zeros((u.size, 2)), u)
    distances = [np.linalg.norm(line - point, axis=1).min() for point in points]
    # The curve's tolerance, and what lies between two of the points looked at.
    assert max(distances) <= 1e-2 + 1e-4
    assert rod.closed


def filled(path):
    """Return the lines of a file that are neither empty nor comments."""
    return [line for line in path.read_text().splitlines() if line.split("#")[0].strip()]


def test_the_page_tells_the_lines_of_each_example():
    page = (Path(__file__).parent.parent / "docs" / "files.md").read_text()
    told = dict(re.findall(r"^\| `(\w+)` \| (\d+) \|", page, re.MULTILINE))
    assert len(told) == 11
    assert told == {name: str(len(filled(EXAMPLES / f"{name}.toml"))) for name in told}


def test_examples_choose_no_space():
    """But for the scenes of the paper, with its own."""
    assert [name for name in new.GALLERY if "space =" in (EXAMPLES / f"{name}.toml").read_text()] == ["spring"]


@pytest.mark.parametrize("name", new.GALLERY)
def test_an_example_is_written_as_it_is(name, tmp_path, monkeypatch, command):
    """The gallery's test runs them."""
    monkeypatch.chdir(tmp_path)
    words = [] if name == new.STARTER else ["own.toml", "--from", name]
    file = words[0] if words else "my.toml"
    assert f"now: isorod run {file}" in command.prints("new", *words)
    assert Path(file).read_bytes() == (EXAMPLES / f"{name}.toml").read_bytes()


def test_what_pages_name_is_written_too_and_read(tmp_path, monkeypatch, command):
    """Rods of catalogues and of the page on contact, which take too long to be run here."""
    monkeypatch.chdir(tmp_path)
    others = set(new.EXAMPLES) - set(new.GALLERY)
    assert {"drum", "hose", "bend", "s_hook", "wave_spring"} <= others
    for name in others:
        command.prints("new", f"{name}.toml", "--from", name)
        assert FileScene(f"{name}.toml").model().bodies


# Spaces beside which what is chosen is coarse: degrees that are higher, and more elements.
SMOOTH = {"degree": 6, "continuity": 0}
FINE = {
    "arc": SMOOTH | {"elements": 12, "section_degree": 6},
    "coil": SMOOTH | {"elements": 24, "section_degree": 6},
    "taper": SMOOTH | {"elements": 24, "section_degree": 7},
    "wing": SMOOTH | {"elements": 6, "section_degree": 9},
    "trefoil": SMOOTH | {"elements": 58, "section_degree": 5},
    "press": {"elements": 24, "degree": 5, "continuity": 1, "order": 2, "section_points": 16},
    "crossing": {"elements": 24, "degree": 5, "continuity": 1, "order": 2, "section_points": 8},
    "cable": SMOOTH | {"elements": 12, "section_degree": 7, "degree": 5},
    "muscle": SMOOTH | {"elements": 16, "section_degree": 6},
    "bar": SMOOTH | {"elements": 12, "section_degree": 6},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FINE)
def test_what_is_chosen_for_an_example_is_within_half_a_percent(name):
    def measured(**space):
        scene = FileScene(str(EXAMPLES / f"{name}.toml"), **space)
        solution, _ = solving.solve(scene, scene.settings())
        found = scene.measure(solution)
        if "frequencies" in found:
            return {"frequencies": solution.frequencies[solution.rigid :]}
        return found

    fine = measured(**FINE[name])
    for key, value in measured().items():
        np.testing.assert_allclose(value, fine[key], rtol=5e-3, err_msg=key)


@pytest.mark.parametrize(
    ("words", "there", "said"),
    [
        ([], "my.toml", "my.toml: is there already, and is not overwritten"),
        (["a.toml", "--from", "trefoil"], "trefoil.csv", "trefoil.csv: is there already, and is not overwritten"),
        (["a.toml", "--from", "sprin"], None, "example 'sprin' is not known; there are: .*spring"),
        (["a.toml", "--from", "wing"], "wing.dat", "wing.dat: is there already, and is not overwritten"),
        (["a.toml", "--from", "muscle"], "muscle.vtk", "muscle.vtk: is there already, and is not overwritten"),
        (["a.txt"], None, "a.txt: need a name that ends in .toml"),
        (["no/a.toml"], None, "no/a.toml: cannot be written"),
    ],
)
def test_new_overwrites_nothing_and_leaves_nothing_half_done(words, there, said, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    if there:
        Path(there).write_text("mine")
    assert command.refuses("new", *words).startswith(said.split(".*")[0])
    assert [one.name for one in tmp_path.iterdir()] == ([there] if there else [])
    assert not there or Path(there).read_text() == "mine"


@pytest.mark.parametrize("name", VALID)
def test_a_record_holds_what_gives_the_same_result_again(name, written, command):
    first = command.record("run", written(VALID[name], outline_csv=OUTLINE, line_csv=LINE))
    again = command.record("run", written(first["options"]))
    assert first["options"] == VALID[name]
    assert again["options"] == first["options"]
    # No measure can have a name of the record.
    assert first.keys() - {*VALID[name].get("measure", ()), "frequencies"} <= RESERVED
    measured = {*VALID[name].get("measure", ()), "frequencies", "volume"} & first.keys()
    assert measured
    for key in measured:
        np.testing.assert_allclose(again[key], first[key], rtol=1e-9, atol=1e-15)


def test_a_record_has_the_sums_of_its_data(written, command):
    path = written(RING, outline_csv=OUTLINE)
    sums = [command.record("run", path)["data"] for _ in range(2)]
    assert sums[0] == sums[1]
    assert list(sums[0]) == ["outline.csv"]
    Path(path).with_name("outline.csv").write_text(OUTLINE.replace("1.0", "1.01"))
    assert command.record("run", path)["data"] != sums[0]


def test_what_is_measured_is_what_python_says(written):
    scene = FileScene(written(BEAM))
    solution = statics.solve(scene.model(), **scene.settings())
    found = scene.measure(solution)
    space = solution.model.bodies[0].space
    at = space.displacement(solution.model.nodal(solution.displacement), [[0.5, 0.0]], [1.0])[0][0, 0]
    assert found["tip"] == at[1] != 0.0
    assert found["force"] == solution.reactions[1, 2] != 0.0
    np.testing.assert_array_equal(found["moment"], solution.moments[0])
    assert scene.units == {"tip": "mm", "force": "", "moment": ""}


def test_a_motion_is_measured_at_each_output(written, command):
    record = command.record("run", written(MOTION))
    assert np.shape(record["tip"]) == (3, 3)
    assert np.ptp(record["tip"]) > 0.0


def test_without_measures_the_forces_of_the_supports_are_told(written, command):
    table = {key: value for key, value in BEAM.items() if key != "measure"}
    out = command.prints("run", written(table))
    assert all(f"reaction {name}" in out for name in table["support"])
    assert "scene               my, statics; beam\n" in out


def test_what_is_typed_wins_over_the_file(written, command):
    path = written(MODES)
    assert len(command.record("run", path)["frequencies"]) == 3
    assert len(command.record("run", path, "--modes", "2")["frequencies"]) == 2
    lumped = command.record("run", path, "--mass", "lumped")
    assert lumped["settings"]["lumped"] is True
    assert lumped["settings"]["modes"] == 3
    assert command.record("run", written(BEAM), "--load-steps", "2")["settings"] == {"load_steps": 2}


def test_spaces_may_be_typed_and_are_in_the_record(written, command):
    path = written(PAIR)
    record = command.record("run", path, "--elements", "8", "--degree", "3")
    spaces = [rod["space"] for rod in record["options"]["rod"].values()]
    assert spaces == [{"elements": 8, "degree": 3}] * 2
    again = command.record("run", written(record["options"]))
    assert (again["dofs"], again["touch"]) == (record["dofs"], record["touch"])
    assert record["dofs"] != command.record("run", written(PAIR))["dofs"]


@pytest.mark.parametrize(
    ("table", "words", "said"),
    [
        (BEAM, ["--elements", "3"], r"my.toml:9: rod.beam.space.elements: got 3, need a multiple of the 2"),
        (MOTION, ["--degree", "9"], r"my.toml:3: rod.muscle.space.degree: axis degree: got 9"),
        (RING, ["--elements", "8"], "option --elements is not known"),
        (BEAM, ["--degre", "3"], r"option --degre is not known; did you mean --degree\?"),
    ],
)
def test_what_is_typed_wrongly_is_refused(table, words, said, written, command):
    assert re.search(said, command.refuses("run", written(table, outline_csv=OUTLINE), *words))


def test_a_scene_says_what_its_spaces_have_in_common(written):
    scene = FileScene(written(PAIR))
    assert (scene.degree, scene.elements, scene.order) == (2, None, None)
    assert FileScene(scene.path, elements=8).content["rod"]["high"]["space"] == {"degree": 2, "elements": 8}


def test_results_are_written_under_the_name_of_the_file(written, tmp_path, command):
    command.prints("run", written(MODES), "--output", tmp_path / "results")
    assert {one.name for one in (tmp_path / "results").iterdir()} == {"results.jsonl", "my-0.vtu", "my.csv"}


def test_laws_in_a_list_are_those_of_the_elements_of_the_curve(written):
    """A bar of two materials, pulled: springs in series (nu = 0)."""
    table = {
        "analysis": "statics",
        "rod": {
            "bar": {
                "curve": {"straight": {"length": 2.0, "breaks": [0, 0.25, 1], "continuity": 0}},
                "section": {"circle": 0.5},
                "law": [{"LinearElastic": {"E": 100.0, "nu": 0.0}}, {"LinearElastic": {"E": 300.0, "nu": 0.0}}],
                "space": {"elements": 4},
            }
        },
        "support": {"a": {"end": "start"}, "b": {"end": "end", "displacement": [0, 0, 1e-3]}},
    }
    scene = FileScene(written(table))
    (body,) = scene.model().bodies
    assert [law.E for law in body.laws] == [100.0, 100.0, 300.0, 300.0]
    force = statics.solve(scene.model()).reactions[1, 2]
    area = np.pi * 0.25
    assert force == pytest.approx(1e-3 / (0.5 / (100.0 * area) + 1.5 / (300.0 * area)), rel=1e-10)


def test_a_tube_under_pressure_is_that_of_python(written):
    table = copy.deepcopy(BEAM)
    table["rod"]["beam"] |= {
        "curve": {"straight": 2.0},
        "rings": [0.5, 0.75, 1.0],
        "law": [{"LinearElastic": {"E": 100.0, "nu": 0.3}}, {"LinearElastic": {"E": 200.0, "nu": 0.3}}],
        "density": [1.0, 2.0],
        "space": {"section_degree": 4, "elements": 2},
    }
    del table["support"]["band"]
    table["load"] = {"inside": {"pressure": 0.1, "surface": "inner"}}
    model = FileScene(written(table)).model()
    (body,) = model.bodies
    assert body.space.rod.rings == (0.5, 0.75, 1.0)
    assert [law.E for law in body.laws] == [100.0, 200.0] * 2
    assert body.densities.tolist() == [1.0, 2.0] * 2
    np.testing.assert_array_equal(model.external.reshape(-1, 3), Pressure(0.1, "inner").nodal(body.space))
    table["rod"]["beam"]["law"] *= 2
    with pytest.raises(InputError, match=r"rod.beam.law: got 4 laws for the 2 rings of the section, need one, or one"):
        FileScene(written(table)).model()


@pytest.mark.parametrize(
    "said",
    [
        "{circle = {radius = 0.5, n = 6}}",
        "{circle = 0.5, n = 6}",
        "{circle = {radius = 0.5}, n = 6}",
        "{circle = {n = 6}, radius = 0.5}",
    ],
)
def test_a_choice_may_be_written_in_several_ways(said, written):
    path = written(f"analysis = 'geometry'\n[rod.bar]\ncurve = {{straight = 2.0}}\nsection = {said}\n")
    (rod,) = FileScene(path).rods()
    expected = center_line.straight(2.0).sweep(section.circle(6, 0.5))
    np.testing.assert_array_equal(rod.control_points, expected.control_points)


def test_what_is_new_in_the_package_is_one_line_of_the_schema(written, monkeypatch):
    own = Form(f"{__name__}:lens", defaults={"n": 8})
    monkeypatch.setitem(schema.SECTIONS, "lens", own)
    path = written("analysis = 'geometry'\n[rod.bar]\ncurve = {straight = 2.0}\nsection = {lens = 2.0, depth = 0.5}\n")
    (rod,) = FileScene(path).rods()
    assert rod.volume() == pytest.approx(2.0 * np.pi * 2.0 * 0.5, rel=1e-9)
    for wrong, said in (("lense = 2.0", "did you mean lens"), ("lens = 2.0, depht = 1", "did you mean depth")):
        with pytest.raises(InputError, match=said):
            FileScene(written(Path(path).read_text().split("section")[0] + f"section = {{{wrong}}}\n"))


def lens(n: int, width: float, depth: float = 1.0):
    """Return an ellipse."""
    return section.ellipse(n, width, depth)


def test_several_rods_obstacles_and_contacts_are_those_of_python(written):
    model = FileScene(written(PAIR)).model()
    assert [len(body.space.rod.axis.breaks) for body in model.bodies] == [2, 5]
    assert [support.body for support in model.supports] == [0, 0, 1, 1]
    assert [(one.first, type(one.second).__name__) for one in model.contacts] == [
        (0, "int"),
        (0, "Plane"),
        (0, "Cylinder"),
    ]


def test_a_muscle_may_be_slack_or_told_its_fibres(written):
    table = copy.deepcopy(MOTION)
    table["rod"]["muscle"]["law"]["Muscle"]["fibre"] = [0.0, 0.0, 2.0]
    (body,) = FileScene(written(table)).model().bodies
    np.testing.assert_array_equal(body.laws[0].fibre, [0.0, 0.0, 1.0])


def test_find_gives_scenes_and_files(written):
    assert files.find("spring") == Spring()
    assert isinstance(files.find(written(RING, outline_csv=OUTLINE)), FileScene)


@pytest.mark.parametrize(
    ("content", "path", "line"),
    [
        ("a = 1\nb = 2\n", ("b",), 2),
        ("# c\n\n[t]\n\n x.y = 1\n", ("t", "x", "y"), 5),
        ("[a.b]\nc = {d = 1, e = [\n1,\n2]}\nf = 3\n", ("a", "b", "c", "e", 1), 4),
        ("[a.b]\nc = {d = 1, e = [\n1,\n2]}\nf = 3\n", ("a", "b", "f"), 5),
        ("a = '''\n[b]\nc = 1'''\nd = 2\n", ("d",), 4),
        ('a = """\\"""\n[b]"""\nd = 2\n', ("d",), 3),
        ("[[a]]\nb = 1\n[[a]]\nb = 2\n[a.c]\nd = 1\n", ("a", 1, "b"), 4),
        ("[[a]]\nb = 1\n[[a]]\nb = 2\n[a.c]\nd = 1\n", ("a", 1, "c", "d"), 6),
        ("'a.b' = 1\n\"c d\".e = 2\n", ("c d", "e"), 2),
        ("a = 2020-01-01 10:00:00\nb = [{c = 1}, {c = 2}] # [d]\ne = 1\n", ("b", 1, "c"), 2),
        ("a = 2020-01-01 10:00:00\nb = [{c = 1}, {c = 2}] # [d]\ne = 1\n", ("e",), 3),
    ],
)
def test_the_line_of_a_key(content, path, line):
    assert lines(content)[path] == line


def test_modes_of_a_file_are_those_of_python(written):
    scene = FileScene(written(MODES))
    found = modal.solve(scene.model(), **scene.settings())
    np.testing.assert_array_equal(scene.measure(found)["frequencies"], found.frequencies)
