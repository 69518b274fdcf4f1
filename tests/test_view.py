"""Results in a browser: what is shown, and that numbers at a place are those of the solution."""

import io
import json
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest
from browser import browser
from conftest import COMMAND

from isorod.command import cli
from isorod.command.viewed import View
from isorod.errors import InputError
from isorod.output import picture, reading

pytest.importorskip("pyvista")
pytest.importorskip("trame_vtk")

SCENE = """
title = "bent and pulled"
[rod.beam]
curve = {straight = 100.0}
section = {circle = 5.0}
law = {StVenantKirchhoff = {E = 2.1e5, nu = 0.3}}
space = {elements = 2}
[support.wall]
end = "start"
[load.pull]
end = "end"
force = [0.0, -2000.0, 4000.0]
[analysis.statics]
outputs = 2
[measure.moved]
displacement = "beam"
u = 0.5
xi = [0.5, 0.0]
[measure.stress]
stress = "beam"
u = 0.5
xi = [0.5, 0.0]
"""


def solved(folder, text, *words):
    (folder / "scene.toml").write_text(text)
    results = folder / "out"
    assert cli.main(["run", str(folder / "scene.toml"), "--output", str(results), "--no-estimate", *words]) == 0
    return results, json.loads((results / "results.jsonl").read_text())


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """The results folder of a bent rod, and its record."""
    return solved(tmp_path_factory.mktemp("bent"), SCENE)


@pytest.fixture
def viewed():
    """Show a results folder on a stage; give the view and the stage."""
    picture.without_display()
    with ExitStack() as stages:

        def show(folder):
            plotter = stages.enter_context(picture.stage((400, 300)))
            return View(reading.find(str(folder)), plotter), plotter

        yield show


def told(view, state):
    return {name: float(text) for name, text in view.numbers(state)}


def test_numbers_at_a_place_are_what_the_run_measures_there(bent, viewed):
    folder, record = bent
    view, _ = viewed(folder)
    half, whole = view.states
    assert (half.name, whole.name) == ("load factor 0.50", "load factor 1.00")
    view.go(whole, 0, 0.5, (0.5, 0.0))
    assert (view.place.u, view.place.xi) == (pytest.approx(0.5, abs=1e-8), pytest.approx((0.5, 0.0), abs=1e-8))
    numbers = told(view, whole)
    assert [numbers[f"displacement {x}"] for x in "xyz"] == pytest.approx(record["moved"], rel=1e-4, abs=1e-9)
    assert numbers["displacement"] == pytest.approx(np.linalg.norm(record["moved"]), rel=1e-4)
    assert numbers["von Mises stress"] == pytest.approx(record["stress"], rel=1e-4)
    # Of the tensor, from which von Mises' stress follows.
    xx, yy, zz, xy, yz, xz = (numbers[f"Cauchy stress {one}"] for one in ("xx", "yy", "zz", "xy", "yz", "xz"))
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (xy**2 + yz**2 + xz**2)
    assert np.sqrt(square) == pytest.approx(record["stress"], rel=1e-3)
    assert 0.3 < told(view, half)["displacement"] / numbers["displacement"] < 0.7


def test_what_is_clicked_on_is_the_point_that_is_seen_there(bent, viewed):
    """A point of the surface, where it is on the screen as it is moved, twice as far as in truth."""
    view, plotter = viewed(bent[0])
    state = view.states[-1]
    view.draw(state, view.fields(state)["displacement y"], 2.0)
    view.fit((0.3, -1.0, 0.2))
    plotter.render()
    mesh = reading.mesh(view.result.steps[-1].files[0])
    at = 2.0 * mesh.point_data["displacement"] + mesh.points
    # The nearest to the eye of those in the middle of the rod.
    middle = np.flatnonzero(np.abs(mesh.points[:, 2] - 35.0) < 12.0)
    point = middle[np.argmax(at[middle] @ [0.3, -1.0, 0.2])]
    plotter.renderer.SetWorldPoint(*at[point], 1.0)
    plotter.renderer.WorldToDisplay()
    view.pick(state, *plotter.renderer.GetDisplayPoint()[:2])
    assert view.place.body == 0
    assert mesh.points[view.place.point] == pytest.approx(mesh.points[point], abs=1e-4)
    assert np.linalg.norm(view.place.xi) == pytest.approx(1.0)
    view.pick(state, 1, 1)
    assert view.place is None and view.numbers(state) == []


def test_a_mode_is_a_state_that_is_seen_and_has_displacement_alone(tmp_path, viewed):
    text = SCENE[: SCENE.index("[analysis")].replace("nu = 0.3}}", "nu = 0.3}}\ndensity = 7.85e-9")
    folder, record = solved(tmp_path, text + "[analysis.modal]\nmodes = 3\n")
    view, _ = viewed(folder)
    assert view.states[0].name == "equilibrium"
    assert [one.name for one in view.states[1:]] == [
        f"mode {k}: frequency {one:.5g}" for k, one in enumerate(record["frequencies"], 1)
    ]
    mode = view.states[2]
    assert list(view.fields(mode)) == ["displacement", "displacement x", "displacement y", "displacement z"]
    view.draw(mode, view.fields(mode)["displacement"], view.scale(mode))
    moved = view._drawn[0][1].faces.point_data["motion"]
    assert 5.0 < np.linalg.norm(moved, axis=1).max() < 30.0
    assert view.note(mode) == "" != view.note(view.states[0])


def test_a_place_is_followed_where_contact_moves_the_points(tmp_path, viewed):
    assert cli.main(["new", str(tmp_path / "press.toml"), "--from", "press"]) == 0
    folder, _ = solved(tmp_path, (tmp_path / "press.toml").read_text())
    view, _ = viewed(folder)
    first, last = view.states[0], view.states[-1]
    sizes = [reading.mesh(step.files[0]).n_points for step in view.result.steps]
    assert sizes[0] != sizes[-1]
    view.go(first, 0, 0.3, (0.0, 1.0))
    before = view.place
    view.draw(last, view.fields(last)["contact_pressure"], 1.0)
    assert view.place.u == pytest.approx(before.u, abs=0.02)
    assert view.place.xi == pytest.approx(before.xi, abs=0.1)


def test_a_body_without_axis_parameters_is_clicked_on(bent, tmp_path, viewed):
    """As finite elements are, and files of former versions."""
    import pyvista

    mesh = pyvista.read(reading.find(str(bent[0])).steps[-1].files[0])
    mesh.field_data.clear()
    mesh.save(tmp_path / "old.vtu")
    view, plotter = viewed(tmp_path / "old.vtu")
    (state,) = view.states
    with pytest.raises(InputError, match="body 0 has no axis parameters in its file; click on it"):
        view.go(state, 0, 0.5, (0.0, 0.0))
    with pytest.raises(InputError, match="body: got 1, need 0 to 0"):
        view.go(state, 1, 0.5, (0.0, 0.0))
    view.draw(state, view.fields(state)["von_mises"], view.scale(state))
    view.fit((0.3, -1.0, 0.2))
    plotter.render()
    view.pick(state, 125, 150)
    assert view.place.u is None
    assert told(view, state)["displacement"] > 0.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{empty}"], "no run has left its results there"),
        (["{bent}", "--port", "70000"], "--port: got 70000, need 0 to 65535"),
        (["{bent}", "--no-browser", "--port", "{taken}"], "--port: got .*, which cannot be used"),
        (["{bent}", "--run", "2"], "it has one alone"),
        (["{bent}", "--host", "0.0.0.0"], "option --host is not known"),
    ],
)
def test_what_cannot_be_shown_is_said_in_a_line(words, said, bent, tmp_path, capfd):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        known = {"empty": tmp_path, "bent": bent[0], "taken": other.getsockname()[1]}
        assert cli.main(["view", *(word.format(**known) for word in words)]) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1
    assert re.search(said, err)


def test_without_trame_the_extra_is_named(bent):
    code = (
        "import sys; sys.modules['trame_vtk'] = None\nfrom isorod.command import cli; sys.exit(cli.main(sys.argv[1:]))"
    )
    done = subprocess.run([sys.executable, "-c", code, "view", bent[0]], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (
        2,
        "isorod: view needs trame_vtk, which is not installed: pip install 'isorod[view]'\n",
    )


SET = "const e = document.querySelector(arguments[0]); e.value = arguments[1]; e.dispatchEvent(new Event(arguments[2]))"
ROWS = "[...document.querySelectorAll('#numbers tr')].map(row => [...row.cells].map(cell => cell.innerText))"


@contextmanager
def served(folder):
    """Let the command serve a folder; give its address, and interrupt it in the end."""
    words = [*COMMAND, "view", folder, "--no-browser"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        try:
            yield server.stdout.readline().split()[0]
        finally:
            server.send_signal(signal.SIGINT)
        assert server.wait(20) == 0
        assert server.stderr.read() == ""


def test_a_browser_shows_the_rod_and_tells_its_numbers(bent, tmp_path):
    folder, record = bent
    with browser(tmp_path) as page, served(folder) as address:
        host = address.split("/")[2]
        assert host.startswith("127.0.0.1:")
        page.ask("/url", url=address)
        # The picture has the page's size: what is typed before that may be written over.
        page.until("return document.querySelector('.picture img')?.naturalWidth > 600")
        page.until("return document.querySelector('#field').value === 'von_mises'")
        assert coloured(page) > 0.02
        page.run(SET, "#u", "0.5", "change")
        page.until(f"return {ROWS}.length === 11 && document.querySelector('#xi').value === '0, 0'")
        page.run(SET, "#xi", "0.5, 0", "change")
        page.until(f"return {ROWS}.length === 11 && document.body.innerText.includes('at rest at 2.5, 0, 50')")
        numbers = dict(page.run(f"return {ROWS}"))
        assert float(numbers["von Mises stress"]) == pytest.approx(record["stress"], rel=1e-4)
        assert float(numbers["displacement y"]) == pytest.approx(record["moved"][1], rel=1e-4)
        page.run(SET, "#step", "0", "input")
        page.until("return document.body.innerText.includes('load factor 0.50')")
        page.until(f"return {ROWS}[2][1] !== arguments[0]", numbers["displacement y"])
        numbers = dict(page.run(f"return {ROWS}"))
        assert 0.3 < float(numbers["displacement y"]) / record["moved"][1] < 0.7
        # Nothing comes from elsewhere, and who has no key is told nothing.
        names = page.run("return performance.getEntriesByType('resource').map(one => one.name)")
        assert {name.split("/")[2] for name in names if name.startswith("http")} == {host}
        page.ask("/url", url=address.partition("?")[0])
        time.sleep(1.0)
        assert "bent and pulled" not in page.run("return document.body.innerText")


def coloured(page):
    """Return the share of the picture's pixels, beside the scale of colours, that are no grey."""
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(page.picture())).convert("RGB"), dtype=int)[:, 300:-250]
    return float((np.ptp(pixels, axis=2) > 60).mean())
