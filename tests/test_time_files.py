"""Histories, spins and first velocities in scene files: as the docs write them, and wrong ones in one line."""

import numpy as np
import pytest

import isorod
from isorod.files.scene import FileScene

BAR = """
[rod.bar]
curve = {straight = 1.0}
section = {circle = 0.1, n = 4}
law = {NeoHookean = {E = 100.0, nu = 0.0}}
density = 3.0
space = {elements = 2, degree = 2, section_degree = 2}
"""
HUB = '[support.hub]\nend = "start"\n'
PUSH = '[load.push]\nend = "end"\nforce = [0.0, 0.0, 1e-3]\n'
STEPS = '[analysis.dynamics]\nend_time = 1.0\noutputs = 4\nintegrator = "implicit"\ntime_step = 0.05\n'


@pytest.fixture
def scene(tmp_path):
    def written(*parts, **beside):
        for name, text in beside.items():
            (tmp_path / f"{name}.csv").write_text(text)
        path = tmp_path / "scene.toml"
        path.write_text("".join(parts))
        return FileScene(str(path))

    return written


def solved(scene):
    return isorod.dynamics.solve(scene.model(), **scene.settings())


def test_a_table_in_a_file_is_that_in_the_scene(scene):
    rows, text = "[[0, 0], [0.25, 1]]", "time,factor\n0,0\n0.25 1  # then it stays\n"
    inline = solved(scene(BAR, HUB, PUSH, f"history = {rows}\n", STEPS))
    beside = solved(scene(BAR, HUB, PUSH, 'history = "ramp.csv"\n', STEPS, ramp=text))
    assert (inline.displacement == beside.displacement).all() and inline.displacement.any()


def test_a_rod_begins_as_its_table_says(scene):
    thrown = scene(BAR.replace("density", "velocity = [1.0, 0, 0]\nspin = [0, 0.1, 0]\ndensity"), STEPS)
    velocity = thrown.model().bodies[0].initial_velocity
    carriers = thrown.model().is_control_point
    places = thrown.model().bodies[0].space.positions[carriers]
    turned = np.cross([0.0, 0.1, 0.0], places - [0.0, 0.0, 0.5])
    assert velocity[carriers] - turned == pytest.approx(np.tile([1.0, 0.0, 0.0], (len(places), 1)), abs=1e-12)


WRONG = [
    (PUSH, "history = [[0, 0], [0.2, 1], [0.1, 1]]\n", "load.push.history: times run back from 0.2 to 0.1 (row 2)"),
    (PUSH, "history = []\n", "load.push.history: got [], need numbers"),
    (PUSH, "history = [[0, nan]]\n", "load.push.history[0][1]: got nan, need a finite number"),
    (PUSH, 'history = "none.csv"\n', "load.push.history: none.csv: cannot be read"),
    (PUSH, 'history = "wide.csv"\n', "load.push.history: wide.csv: 3 numbers a line, need time and factor"),
    (HUB, "history = [[0, 0], [1, 1]]\n", "support.hub.history: the support does not move"),
    (HUB, "displacement = [0, 0, 1]\nhistory = [[0, 0], [0, 1]]\n", "support.hub.history: a support cannot jump"),
    (HUB, "displacement = [0, 0, 1]\nspin = [0, 0, 1]\n", "spin: the support has a displacement or a rotation too"),
]


@pytest.mark.parametrize(("what", "more", "said"), WRONG)
def test_bad_tables_are_one_line(scene, what, more, said):
    with pytest.raises(isorod.InputError) as refused:
        scene(BAR, what, more, "" if what is HUB else HUB, STEPS, wide="0 0 1\n").model()
    assert said in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "more",
    [PUSH + "history = [[0, 0], [1, 1]]\n", HUB.replace("hub", "other").replace("start", "end") + "spin = [0, 0, 1]\n"],
)
def test_statics_have_no_time(scene, more):
    still = scene('analysis = "statics"\n', BAR, HUB, more)
    with pytest.raises(isorod.InputError, match="in statics"):
        isorod.statics.solve(still.model())
