"""Pictures of rods before anything is solved: ``isorod show`` and ``isorod.show``."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import straight
from scipy.cluster.hierarchy import fclusterdata
from scipy.ndimage import label

import isorod
from isorod import files
from isorod.command import cli
from isorod.errors import InputError
from isorod.files import schema
from isorod.model import Body, Contact, Cylinder, Model, Plane, SectionLoad, Sphere, Support, TriangleMesh
from isorod.output import picture, shape
from isorod.scenes import SCENES
from isorod.space import Space

pytest.importorskip("pyvista")
Image = pytest.importorskip("PIL.Image")

EXAMPLES = sorted((Path(files.__file__).parent / "examples").glob("*.toml"))
SIZE = (420, 320)


def seen(image, colour, within=40):
    """Return which pixels have a colour, or nearly so."""
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return (np.abs(np.asarray(image)[:, :, :3].astype(int) - wanted) < within).all(axis=2)


def greyish(image):
    """Return which pixels are grey, neither black nor white."""
    pixels = np.asarray(image)[:, :, :3].astype(int)
    return (np.ptp(pixels, axis=2) < 15) & (pixels.min(axis=2) > 100) & (pixels.max(axis=2) < 215)


def hue(image, channel):
    """Return which pixels have much of one colour, and less of others."""
    pixels = np.asarray(image)[:, :, :3].astype(int)
    return pixels[:, :, channel] > 50 + np.delete(pixels, channel, axis=2).max(axis=2)


def drawn(image):
    """Return the pixels left of the legend, between what is written above and below, that are not white."""
    return (np.asarray(image)[50:-30, : SIZE[0] - 190] < 250).any(axis=2)


@pytest.fixture
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)


def test_control_points_are_where_they_are():
    """Along a straight rod of seven there are seven, on a regular polygon round the middle."""
    rod = straight(7, radius=1.0, height=0.01)
    image = isorod.show(rod, view=(0.0, 0.0, 1.0), size=SIZE)
    assert image.size == SIZE
    marks, count = label(seen(image, "#901818", 50)[50:-30, : SIZE[0] - 190])
    sizes = np.bincount(marks.ravel())[1:]
    spots = np.array([np.argwhere(marks == k + 1).mean(axis=0) for k in range(count) if sizes[k] > 20])
    # Those that the net cuts in two are one.
    groups = fclusterdata(spots, 25.0, "distance")
    spots = np.array([spots[groups == k].mean(axis=0) for k in np.unique(groups)])
    assert len(spots) == 7
    middle = np.mean(spots, axis=0)
    angles = np.sort(np.arctan2(*(spots - middle).T))
    assert np.diff(angles) == pytest.approx(np.full(6, 2.0 * np.pi / 7), abs=0.1)
    assert np.linalg.norm(spots - middle, axis=1) == pytest.approx(np.full(7, 0.5 * np.ptp(spots, axis=0)[0]), rel=0.08)


@pytest.mark.parametrize("view", [(1.0, -1.4, 0.55), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
def test_a_thin_rod_fills_the_picture_from_all_sides(view):
    rod = isorod.arc(100.0, 90).sweep(isorod.circle(5, 0.5))
    rows, columns = np.nonzero(drawn(isorod.show(rod, view=view, size=SIZE)))
    assert np.ptp(rows) > 0.6 * (SIZE[1] - 80) or np.ptp(columns) > 0.7 * (SIZE[0] - 190)
    assert columns.min() > 0


def test_several_rods_have_several_colours():
    rods = [isorod.straight(start=(x, 0, 0), end=(x, 0, 4)).sweep(isorod.circle(4, 0.9)) for x in (0.0, 3.0)]
    image = isorod.show(rods, view=(0.0, -1.0, 0.0), size=SIZE)
    for k, tint in enumerate(shape._TINTS[:3]):
        assert (seen(image, tint, 25).sum() > 400) == (k < 2)
    low, high = (np.nonzero(seen(image, tint, 25))[1].mean() for tint in shape._TINTS[:2])
    assert low < high


def model(obstacle=None, **more):
    rod = isorod.straight(start=(0, 0, 0), end=(6, 0, 0)).sweep(isorod.circle(4, 0.4))
    space = Space(rod, degree=3, order=1, elements=2)
    contacts = [] if obstacle is None else [Contact(0, obstacle)]
    return Model([Body(space, isorod.NeoHookean(1.0, 0.3))], [Support.end(space, "start")], contacts=contacts, **more)


def test_what_holds_moves_and_loads_a_rod_is_marked():
    space = model().bodies[0].space
    bodies = model().bodies
    front = {"view": (-1.0, -0.6, 0.3), "size": SIZE}
    free = isorod.show(Model(bodies), **front)
    held = isorod.show(Model(bodies, [Support.end(space, "start")]), **front)
    assert seen(held, shape._HELD, 5).sum() > seen(free, shape._HELD, 5).sum() + 300
    pulled = Support.end(space, "start", displacement=(0.0, 0.0, 0.1))
    blue, none = (
        np.nonzero(hue(one, 2)[50:-30, : SIZE[0] - 190])
        for one in (isorod.show(Model(bodies, [pulled]), **front), held)
    )
    assert blue[0].size > 100 and none[0].size == 0
    # It points upwards, narrow in the end.
    assert np.ptp(blue[0]) > 2 * np.ptp(blue[1])
    assert np.ptp(blue[1][blue[0] < blue[0].min() + 2]) < 4
    loaded = isorod.show(Model(bodies, loads=[SectionLoad((0.0, 0.0, 1.0))]), **front)
    orange, none = (((one[..., 0] > 185) & (one[..., 1] < 110)).sum() for one in map(np.asarray, (loaded, held)))
    assert orange > none + 40


TETRAHEDRON = TriangleMesh(
    [[3, -2, -3], [5, 2, -3], [1, 2, -3], [3, 0, -1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
)
OBSTACLES = {
    "plane": Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)),
    "cylinder": Cylinder((3.0, 0.0, -1.4), (0.0, 1.0, 0.0), 1.0),
    "sphere": Sphere((3.0, 0.0, -1.6), 1.2),
    "mesh": TETRAHEDRON,
}


@pytest.mark.parametrize("name", OBSTACLES)
def test_obstacles_are_seen_below_the_rod(name):
    bare, with_it = (isorod.show(model(one), view=(0.1, -1.0, 0.25), size=SIZE) for one in (None, OBSTACLES[name]))
    grey = [greyish(image)[50:-30, : SIZE[0] - 190] for image in (bare, with_it)]
    assert grey[1].sum() > grey[0].sum() + 500
    rod = seen(with_it, shape._TINTS[0], 60)[50:-30]
    assert np.nonzero(grey[1])[0].mean() > np.nonzero(rod)[0].mean()


def test_a_huge_obstacle_does_not_make_the_rod_small():
    ball = Sphere((3.0, 0.0, -1000.4), 1000.0)
    image = isorod.show(model(ball), view=(0.1, -1.0, 0.25), size=SIZE)
    assert np.ptp(np.nonzero(seen(image, shape._TINTS[0], 60))[1]) > 100


@pytest.mark.parametrize(
    ("what", "said"),
    [
        ([], "show: got no rods, need at least one"),
        (3, "show: got int, need a Rod, several, or a Model"),
        ("spring", "show: got str, need a Rod, several, or a Model"),
    ],
)
def test_what_is_no_rod_is_refused(what, said):
    with pytest.raises(InputError, match=f"^{said}$"):
        isorod.show(what)


def test_the_command_writes_a_picture(tmp_path, capsys, no_display):
    file = tmp_path / "rod.png"
    assert cli.main(["show", "spring", "--coils", "1", "--png", str(file), "--size", "420x320"]) == 0
    assert capsys.readouterr().out == f"{file}: 420 x 320 pixels\n"
    with Image.open(file) as image:
        assert image.size == SIZE and image.format == "PNG"
        assert seen(image, shape._TINTS[0], 25).sum() > 1000
        assert drawn(image).any()
    before = file.read_bytes()
    assert (
        cli.main(["show", "spring", "--coils", "1", "--png", str(file), "--size", "420x320", "--view", "-1,0,0"]) == 0
    )
    assert file.read_bytes() != before
    assert [one.name for one in tmp_path.iterdir()] == ["rod.png"]


def looked_at(words, tmp_path, capsys):
    file = tmp_path / "one.png"
    assert cli.main(["show", *words, "--png", str(file), "--size", "420x320"]) == 0, capsys.readouterr().err
    with Image.open(file) as image:
        rows, columns = np.nonzero(drawn(image))
    assert np.ptp(rows) > 0.5 * (SIZE[1] - 80) or np.ptp(columns) > 0.6 * (SIZE[0] - 190)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_every_example_is_seen(file, tmp_path, capsys):
    cases = [f"--case={files.find(str(file)).cases[-1]}"] if file.stem == "valve" else []
    looked_at([str(file), *cases], tmp_path, capsys)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_every_scene_is_seen(name, tmp_path, capsys):
    looked_at([name], tmp_path, capsys)


def test_a_motion_is_shown_as_it_begins(tmp_path, capsys, no_display):
    """The knot is a straight rod, laid."""
    file = tmp_path / "knot.png"
    assert cli.main(["show", "knot", "--elements", "40", "--png", str(file), "--size", "420x320"]) == 0
    with Image.open(file) as image:
        assert seen(image, shape._LAID, 60).sum() > 200
    del capsys


BAD = {
    "no display": ([], "there is no display for a window; give --png FILE"),
    "view": (["--png", "a.png", "--view", "1,x"], r"argument --view: got '1,x', need a direction x,y,z such as .*"),
    "no view": (["--png", "a.png", "--view", "0,0,0"], r"show: got view .*, need a direction such as \(1, -1, 0.5\)"),
    "size": (["--png", "a.png", "--size", "big"], r"argument --size: got 'big', need width and height .*"),
    "small": (["--png", "a.png", "--size", "20x300"], r"show: width in pixels: got 20, need an integer from 200 .*"),
    "folder": (
        ["--png", "nowhere/a.png"],
        r"nowhere/a.png: cannot be written \(there is no such folder\); name another",
    ),
    "petsc": (["-snes_monitor"], r"option -snes_monitor: PETSc options go with .*"),
    "unknown": (["--pngs", "a.png"], r"option --pngs is not known; did you mean --png\? .*"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_used_is_one_line_and_nothing_is_written(case, tmp_path, capsys, monkeypatch, no_display):
    monkeypatch.chdir(tmp_path)
    words, said = BAD[case]
    assert cli.main(["show", "ring", *words]) == 2
    out, err = capsys.readouterr()
    assert out == "" and re.fullmatch(f"isorod: {said}\n", err), err
    assert not list(tmp_path.iterdir())


def test_a_display_that_is_not_there_is_said_before_vtk_looks_for_it(monkeypatch, capsys):
    monkeypatch.setenv("DISPLAY", ":987")
    assert cli.main(["show", "ring"]) == 2
    assert "give --png FILE" in capsys.readouterr().err


def test_with_a_display_a_window_opens(monkeypatch, capsys, no_display):
    """All but the window itself."""
    windows = []

    def stay(plotter):
        windows.append((plotter.off_screen, len(plotter.actors)))
        plotter.off_screen = True

    monkeypatch.setattr(picture, "need_display", lambda instead: None)
    monkeypatch.setattr(picture, "wait", stay)
    assert cli.main(["show", "ring"]) == 0
    ((off_screen, actors),) = windows
    assert not off_screen and actors > 3
    assert capsys.readouterr().out == ""


def test_without_pyvista_the_error_says_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert cli.main(["show", "ring", "--png", "a.png"]) == 2
    assert capsys.readouterr().err == "isorod: pictures need pyvista, which is not installed: pip install pyvista\n"


def test_help_names_the_options_and_no_petsc(capsys):
    with pytest.raises(SystemExit):
        cli.main(["show", "spring", "--help"])
    said = capsys.readouterr().out
    assert all(word in said for word in ("--png", "--view", "--size", "--coils")) and "PETSc" not in said


def test_every_kind_of_obstacle_can_be_drawn():
    """Those that files may name are those above."""
    assert len(schema.OBSTACLES) == len(OBSTACLES)


def test_lines_go_through_their_own_points():
    drawn = []
    plotter = type("Plotter", (), {"add_mesh": lambda self, mesh, **_: drawn.append(mesh)})()
    lines = [np.arange(6.0).reshape(2, 3), 10.0 + np.arange(9.0).reshape(3, 3)]
    picture.add_lines(plotter, lines, "black", 1.0)
    (mesh,) = drawn
    for k, line in enumerate(lines):
        assert mesh.get_cell(k).points == pytest.approx(line)
