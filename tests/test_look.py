"""``isorod plot``: pictures of results from their files, animations, and what they refuse."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from conftest import straight

from isorod import dynamics, modal, statics
from isorod.command import cli
from isorod.errors import InputError
from isorod.material import NeoHookean
from isorod.model import Body, Model, Support
from isorod.output import animation, folder, picture, reading
from isorod.output.state import State
from isorod.space import Space

pytest.importorskip("pyvista")
Image = pytest.importorskip("PIL.Image")

SIZE = (360, 280)
# What the scale of colours leaves.
LEFT = SIZE[0] - 150
# Below the words.
TOP = 50
SHAPE = ["--size", "360x280", "--view", "0,-1,0"]


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)


def rod(start=0.0):
    line = straight(4, radius=0.5, height=6.0)
    moved = replace(line, control_points=line.control_points + np.array([start, 0.0, 0.0]))
    return Body(Space(moved, elements=3, degree=3, section_degree=2), NeoHookean(2.0, 0.3), 1.0)


@pytest.fixture(scope="module")
def model():
    body = rod()
    return Model([body], [Support.end(body.space, "start")])


def bending(model, size):
    """Return a displacement along x that grows with the square of the height."""
    positions = model.bodies[0].space.positions
    values = size * (model.bodies[0].space.is_control_point * (positions[:, 2] / 6.0) ** 2)
    return (values[:, None] * [1.0, 0.0, 0.0]).ravel()


def kept(place, model, sizes, analysis="dynamics", cells="auto", **more):
    """Write a run whose states have displacements of these sizes, at times 0, 0.5, 1 and so on."""
    states = [State(model, bending(model, size)) for size in sizes]
    frames = [folder.Frame(0.5 * k, [one.fields(b) for b in range(len(model.bodies))]) for k, one in enumerate(states)]
    place.mkdir(exist_ok=True)
    record = {"scene": "rod", "analysis": analysis, **more}
    return folder.add(place, record, model.bodies, frames, None, cells)


@pytest.fixture(scope="module")
def results(model, tmp_path_factory):
    """A folder with a motion of three outputs, and before it a run with one state."""
    place = tmp_path_factory.mktemp("results")
    kept(place, model, [1.5], "statics")
    kept(place, model, [0.0, 0.6, 2.0])
    return place


@pytest.fixture(scope="module")
def shapes(model, tmp_path_factory):
    """A folder with modes."""
    place = tmp_path_factory.mktemp("modes")
    modes = modal.solve(model, 3)
    record = {"scene": "rod", "analysis": "modal", "frequencies": modes.frequencies}
    folder.add(place, record, model.bodies, folder.frames(modes), modes.curves())
    return place


def plot(*words):
    return cli.main(["plot", *map(str, words), *SHAPE])


def pixels(file):
    with Image.open(file) as image:
        assert image.size == SIZE
        return np.asarray(image.convert("RGB")).astype(int)


def frames(file):
    with Image.open(file) as image:
        assert image.info["loop"] == 0
        found = []
        for k in range(image.n_frames):
            image.seek(k)
            found.append(np.asarray(image.convert("RGB")).astype(int))
    assert {one.shape for one in found} == {(SIZE[1], SIZE[0], 3)}
    return found


def coloured(image):
    """Return the pixels of the rod: neither white, nor grey as the rod at rest, nor black as lines."""
    return (np.ptp(image, axis=2) > 25)[TOP:, :LEFT]


def reach(image):
    """Return how far to the right the top of the rod is, over its width."""
    rows, columns = np.nonzero(coloured(image))
    low, high = (columns[rows == one] for one in (rows.max() - 5, rows.min() + 8))
    return (high.mean() - low.mean()) / np.ptp(low)


@pytest.mark.parametrize("cells", ["curved", "linear"])
def test_the_last_run_is_drawn_deformed(cells, model, tmp_path, capsys):
    kept(tmp_path / "results", model, [2.0], "statics", cells)
    file = tmp_path / "rod.png"
    assert plot(tmp_path / "results", "--png", file) == 0
    assert capsys.readouterr() == (f"{file}: 360 x 280 pixels\n", "")
    # The rod is 1 wide.
    assert reach(pixels(file)) == pytest.approx(2.0, abs=0.25)


def test_scale_run_and_time_choose_what_is_drawn(results, tmp_path):
    file = tmp_path / "rod.png"

    def drawn(*words):
        assert plot(results, "--png", file, *words) == 0
        return reach(pixels(file))

    assert drawn() == pytest.approx(2.0, abs=0.25)
    assert drawn("--time", 0.5) == pytest.approx(0.6, abs=0.2)
    assert drawn("--time", 0.3) == pytest.approx(0.6, abs=0.2)
    assert drawn("--run", 1) == pytest.approx(1.5, abs=0.25)
    assert drawn("--scale", 2) == pytest.approx(4.0, abs=0.4)
    assert drawn("--scale", 0) == pytest.approx(0.0, abs=0.1)
    assert drawn("--scale", "auto") == pytest.approx(0.12 * 6.0, abs=0.2)


def test_files_are_drawn_without_a_folder(results, tmp_path):
    file = tmp_path / "rod.png"
    assert plot(results / "rod-0.vtu", "--png", file) == 0
    assert reach(pixels(file)) == pytest.approx(1.5, abs=0.25)
    assert plot(results / "rod-run2.pvd", "--png", file, "--time", 1) == 0
    assert reach(pixels(file)) == pytest.approx(2.0, abs=0.25)


def test_colours_are_those_of_the_field(results, tmp_path):
    """The displacement grows with the height, and with it how bright the colours are."""
    file = tmp_path / "rod.png"
    assert plot(results, "--png", file, "--colour", "displacement") == 0
    image = pixels(file)[TOP:, :LEFT].mean(axis=2)
    rows = np.nonzero(coloured(pixels(file)))[0]
    parts = np.array_split(np.arange(rows.min(), rows.max()), 3)
    high, middle, low = (image[part][coloured(pixels(file))[part]].mean() for part in parts)
    assert high > middle + 10 > low + 20
    before = file.read_bytes()
    assert plot(results, "--png", file) == 0
    assert file.read_bytes() != before


def test_an_animation_has_one_scale_and_one_place_to_look_from(results, tmp_path, capsys):
    file = tmp_path / "rod.gif"
    assert plot(results, "--gif", file, "--colour", "displacement") == 0
    assert capsys.readouterr().out == f"{file}: 3 frames of 360 x 280 pixels\n"
    found = frames(file)
    assert len(found) == 3
    for one in found[1:]:
        assert np.array_equal(one[TOP:, LEFT + 10 :], found[0][TOP:, LEFT + 10 :])
        # Its foot is held.
        foot = [np.nonzero(coloured(image)) for image in (one, found[0])]
        assert foot[0][0].max() == foot[1][0].max()
        assert foot[0][1][foot[0][0] == foot[0][0].max() - 2].mean() == pytest.approx(
            foot[1][1][foot[1][0] == foot[1][0].max() - 2].mean(), abs=1.5
        )
        # The time.
        assert not np.array_equal(one[:TOP, :LEFT], found[0][:TOP, :LEFT])
    assert [reach(one) for one in found[1:]] == pytest.approx([0.6, 2.0], abs=0.25)
    # At rest all of it has the colour of zero.
    assert np.ptp(found[0][TOP:, :LEFT][coloured(found[0])], axis=0).max() < 60


def test_a_mode_swings_from_one_side_to_the_other(shapes, tmp_path, capsys):
    file = tmp_path / "mode.gif"
    view = ["--view", "-1,-1,0"]
    assert cli.main(["plot", str(shapes), "--gif", str(file), *SHAPE[:2], *view]) == 0
    assert "24 frames" in capsys.readouterr().out
    found = frames(file)
    at = [reach(found[k]) for k in (0, 6, 12, 18)]
    assert at[0] == pytest.approx(0.0, abs=0.1) and at[2] == pytest.approx(0.0, abs=0.1)
    assert abs(at[1]) > 0.2 and at[1] == pytest.approx(-at[3], abs=0.1)


def test_modes_are_as_large_as_can_be_seen(shapes, tmp_path):
    """Their size says nothing: where no scale is given it is that of ``auto``."""
    images = []
    for k, words in enumerate(([], ["--scale", "auto"], ["--scale", "0"])):
        assert plot(shapes, "--png", tmp_path / f"{k}.png", *words) == 0
        images.append(pixels(tmp_path / f"{k}.png"))
    assert np.array_equal(images[0], images[1])
    assert not np.array_equal(images[0], images[2])


def test_modes_are_chosen_from_one(shapes, tmp_path):
    files = [tmp_path / f"{k}.png" for k in range(3)]
    for file, words in zip(files, ([], ["--mode", 1], ["--mode", 3]), strict=True):
        assert plot(shapes, "--png", file, *words) == 0
    assert files[0].read_bytes() == files[1].read_bytes() != files[2].read_bytes()


def test_fields_that_one_body_has_alone_leave_the_other_without_colour(tmp_path):
    two = Model([rod(), rod(3.0)])
    states = [{"displacement": np.zeros((body.space.nodes, 3))} for body in two.bodies]
    states[1]["velocity"] = two.bodies[1].space.positions
    folder.add(tmp_path, {"scene": "two", "analysis": "statics"}, two.bodies, [folder.Frame(0.0, states)])
    file = tmp_path / "two.png"
    assert plot(tmp_path, "--png", file, "--colour", "velocity") == 0
    columns = np.nonzero(coloured(pixels(file)))[1]
    assert columns.min() > LEFT / 2


BAD = {
    "nothing": (["nowhere"], "nowhere: there is no such folder or file; isorod run SCENE --output DIR makes one"),
    "empty": (["EMPTY"], r"\S*: no run has left its results there; isorod run SCENE --output DIR does"),
    "other": (["OTHER"], r"\S*: need a results folder, or a .vtu, .pvd or .csv file"),
    "run": (["RESULTS", "--run", "3"], r"\S*: there is no run 3; need 1 to 2"),
    "no display": (["RESULTS"], "there is no display for a window; give --png FILE"),
    "field": (
        ["RESULTS", "--png", "a.png", "--colour", "heat"],
        r"--colour: rod has no field heat; there are .*von_mises.*",
    ),
    "mode": (["MODES", "--png", "a.png", "--mode", "4"], "--mode: got 4, need 1 to 3"),
    "mode 0": (["MODES", "--png", "a.png", "--mode", "0"], "--mode: got 0, need 1 to 3"),
    "no modes": (["RESULTS", "--png", "a.png", "--mode", "1"], "--mode: rod has no modes; there are .*"),
    "colour of modes": (
        ["MODES", "--png", "a.png", "--colour", "von_mises"],
        "--colour: got von_mises, a mode has displacement alone",
    ),
    "time": (["RESULTS", "--png", "a.png", "--time", "2"], "--time: got 2, need 0 to 1"),
    "one time": (["RESULTS", "--run", "1", "--png", "a.png", "--time", "0"], "--time: rod has a single state"),
    "still": (["RESULTS", "--run", "1", "--gif", "a.gif"], "--gif: rod has a single state, nothing to animate; .*"),
    "both": (["RESULTS", "--png", "a.png", "--gif", "a.gif"], "--png and --gif: give one of them"),
    "scale": (["RESULTS", "--png", "a.png", "--scale", "much"], "--scale: got 'much', need a number or auto"),
    "folder": (
        ["RESULTS", "--gif", "nowhere/a.gif"],
        r"nowhere/a.gif: cannot be written \(there is no such folder\).*",
    ),
    "no curves": (["RESULTS", "--curve", "--png", "a.png"], r"\S*: this run of rod wrote no curves \(.csv\)"),
    "curves move": (["MODES", "--curve", "--gif", "a.gif"], "--gif: curves have none; leave it out"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_drawn_is_one_line(case, results, shapes, tmp_path, monkeypatch, capsys):
    words, said = BAD[case]
    (tmp_path / "empty").mkdir()
    (tmp_path / "other.txt").touch()
    (tmp_path / "here").mkdir()
    places = {"RESULTS": results, "MODES": shapes, "EMPTY": tmp_path / "empty", "OTHER": tmp_path / "other.txt"}
    monkeypatch.chdir(tmp_path / "here")
    assert plot(*(places.get(word, word) for word in words)) == 2
    out, err = capsys.readouterr()
    assert out == "" and re.fullmatch(f"isorod: {said}\n", err), err
    assert not list((tmp_path / "here").iterdir())


def test_files_that_are_damaged_or_gone_are_one_line(model, tmp_path, capfd):
    kept(tmp_path, model, [1.0], "statics")
    path = tmp_path / "rod-0.vtu"
    content = path.read_bytes()
    for damaged in (b"", b"<VTKFile>", content[: len(content) // 2]):
        path.write_bytes(damaged)
        assert plot(tmp_path, "--png", tmp_path / "a.png") == 2
        err = capfd.readouterr().err
        assert re.fullmatch(r"isorod: \S*rod-0.vtu: no cells can be read from it; .*\n", err), err
    path.unlink()
    assert plot(tmp_path, "--png", tmp_path / "a.png") == 2
    assert re.fullmatch(r"isorod: \S*rod-0.vtu: there is no such file.*\n", capfd.readouterr().err)
    (tmp_path / "bad.pvd").write_text("<VTKFile><Coll")
    assert plot(tmp_path / "bad.pvd", "--png", tmp_path / "a.png") == 2
    assert re.fullmatch(r"isorod: \S*bad.pvd: cannot be read .*\n", capfd.readouterr().err)


def test_a_file_alone_is_a_result(tmp_path):
    (tmp_path / "rod.vtu").touch()
    (tmp_path / "rod.csv").touch()
    entries = "".join(
        f'<DataSet timestep="{time}" part="{part}" file="{time}-{part}.vtu"/>' for time in (2, 1) for part in (1, 0)
    )
    (tmp_path / "rod.pvd").write_text(f"<VTKFile><Collection>{entries}</Collection></VTKFile>")
    shape, series, curves = (reading.find(str(tmp_path / f"rod.{kind}")) for kind in ("vtu", "pvd", "csv"))
    assert shape == reading.Result("rod", {}, (reading.Step(0.0, (tmp_path / "rod.vtu",)),), None)
    steps = [reading.Step(float(t), (tmp_path / f"{t}-0.vtu", tmp_path / f"{t}-1.vtu")) for t in (1, 2)]
    assert series == reading.Result("rod", {}, tuple(steps), None)
    assert curves == reading.Result("rod", {}, (), tmp_path / "rod.csv")


def test_a_line_that_is_no_record_is_left_out_with_a_warning(tmp_path):
    """As a run that was killed may leave it."""
    records = [json.dumps({"scene": name, "files": []}) for name in "ab"]
    (tmp_path / folder.RECORDS).write_text("\n".join([records[0], '{"scene": "c", "fi', records[1], "[1]"]))
    with pytest.warns(UserWarning, match=r"results.jsonl:2: is no record of a run, and left out \(2 such lines\)$"):
        assert [reading.find(str(tmp_path), run).name for run in (None, 1)] == ["b", "a"]


def test_with_a_display_a_window_opens(results, monkeypatch, capsys):
    windows = []

    def stay(plotter):
        windows.append(plotter.off_screen)
        plotter.off_screen = True

    monkeypatch.setattr(picture, "need_display", lambda instead: None)
    monkeypatch.setattr(picture, "wait", stay)
    assert plot(results) == 0
    assert windows == [False] and capsys.readouterr().out == ""


def test_without_pyvista_the_error_says_how_to_get_it(results, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert plot(results, "--png", "a.png") == 2
    assert capsys.readouterr().err == "isorod: pictures need pyvista, which is not installed: pip install pyvista\n"


@pytest.mark.slow
def test_solutions_that_move_write_animations(model, tmp_path):
    """A motion, a mode and load steps, from Python."""
    view, size = (0.0, -1.0, 0.0), SIZE
    velocity = bending(model, 1.0)
    history = dynamics.solve(model, 0.5, outputs=4, velocity=velocity)
    history.animate(tmp_path / "motion.gif", "displacement", view=view, size=size)
    motion = frames(tmp_path / "motion.gif")
    assert len(motion) == 5
    assert np.all(np.diff([reach(one) for one in motion]) > 0.02)
    assert all(np.array_equal(one[TOP:, LEFT + 10 :], motion[0][TOP:, LEFT + 10 :]) for one in motion)

    modal.solve(model, 1)[0].animate(tmp_path / "mode.gif", view=view, size=size)
    assert len(frames(tmp_path / "mode.gif")) == animation.SWING

    end = Support.end(model.bodies[0].space, "end", displacement=(1.5, 0.0, 0.0))
    loaded = Model(model.bodies, [*model.supports, end])
    solution = statics.solve(loaded, load_steps=3, keep=True)
    solution.animate(str(tmp_path / "steps.gif"), view=view, size=size)
    assert len(frames(tmp_path / "steps.gif")) == len(solution.path)
    with pytest.raises(InputError, match=r"^animate: got a single state; statics.solve\(..., keep=True\)"):
        statics.solve(loaded).animate(tmp_path / "one.gif")
    with pytest.raises(InputError, match=r"^animate: got colour 'red', need 'von Mises' or 'displacement'$"):
        history.animate(tmp_path / "one.gif", "red")
    with pytest.raises(InputError, match="cannot be written"):
        history.animate(tmp_path / "nowhere" / "one.gif", size=size)
    assert not (tmp_path / "one.gif").exists()


@pytest.mark.parametrize(
    ("times", "shown"),
    [([0.0, 0.005, 0.01], "0.0050"), ([0.0, 0.5, 1.0], "0.50"), ([0.0, 10.0], "10"), ([0.0, 1e-9], "1.0000e-09")],
)
def test_times_are_written_alike(times, shown):
    assert f"{times[1]:{animation.written(times)}}" == shown


def test_palette_has_the_scale_and_white():
    colours = np.array(animation._palette().getpalette()).reshape(-1, 3)
    assert len(colours) == 256
    for wanted in ((255, 255, 255), (0, 0, 0), (68, 1, 84), (253, 231, 37)):
        assert np.abs(colours - wanted).sum(axis=1).min() <= 3
