"""Motions of files that name no steps: which are chosen, that they are right, and what is left as it is named."""

import numpy as np
import pytest

from isorod.command import solving, steps
from isorod.files.scene import FileScene

E, LENGTH, DENSITY = 100.0, 10.0, 1.0
SPEED = np.sqrt(E / DENSITY)
BAR = f"""
[rod.bar]
curve = {{straight = {LENGTH}}}
section = {{circle = 0.5}}
law = {{NeoHookean = {{E = {E}, nu = 0.0}}}}
density = {DENSITY}
space = {{elements = 5, degree = 3, order = 1}}
[support.wall]
end = "start"
[load.pull]
end = "end"
force = [0, 0, 0.01]
"""


def history(tmp_path, dynamics, more="", radius=0.5):
    path = tmp_path / "scene.toml"
    bar = BAR.replace("circle = 0.5", f"circle = {radius}").replace("0.01]", f"{0.04 * radius**2}]")
    path.write_text(f"{bar}{more}\n[analysis.dynamics]\n{dynamics}")
    scene = FileScene(str(path))
    return solving.solve(scene, scene.settings())[0]


def pulled(times, begin, radius=0.5):
    """Displacement of the end under a force that grows over a time, by the bar's modes along it."""
    w = (np.arange(400) + 0.5) * np.pi * SPEED / LENGTH
    slope = 2.0 / (DENSITY * np.pi * radius**2 * LENGTH * w**2)
    grown = lambda t: np.where(t > 0.0, t, 0.0) - np.sin(w * np.maximum(t, 0.0)) / w  # noqa: E731
    return np.array([0.04 * radius**2 * np.sum(slope * (grown(t) - grown(t - begin))) / begin for t in times])


@pytest.mark.parametrize(
    "radius, end, begin, integrator",
    [(0.5, 4.0, 1.0, "explicit"), (0.1, 600.0, 400.0, "implicit")],
)
def test_steps_that_are_chosen_are_right(tmp_path, radius, end, begin, integrator):
    """Waves are followed by explicit steps, a slow pull of a slender bar by implicit ones."""
    found = history(tmp_path, f"end_time = {end}\noutputs = 8", f"history = [[0, 0], [{begin}, 1]]", radius)
    assert found.solver["steps"].startswith(f"{integrator}, of {found.time_step:.3g}, chosen: ")
    tip = [one.at(0, "end")[2] for one in found]
    exact = pulled(found.times, begin, radius)
    assert tip == pytest.approx(exact, abs=0.005 * exact.max())


def test_an_implicit_motion_chooses_its_step(tmp_path):
    found = history(tmp_path, 'end_time = 4.0\noutputs = 8\nintegrator = "implicit"', "history = [[0, 0], [1, 1]]")
    assert found.solver["steps"].startswith("implicit")
    assert found.time_error < 0.005
    exact = pulled(found.times, 1.0)
    assert [one.at(0, "end")[2] for one in found] == pytest.approx(exact, abs=0.01 * exact.max())


@pytest.mark.parametrize("named", ["time_step = 0.01", 'integrator = "explicit"'])
def test_steps_that_are_named_are_taken(tmp_path, named):
    found = history(tmp_path, f"end_time = 0.1\noutputs = 2\n{named}")
    assert "steps" not in found.solver


def test_runs_with_a_checkpoint_name_their_steps(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(f"{BAR}\n[analysis.dynamics]\nend_time = 0.1")
    scene = FileScene(str(path))
    assert steps.are_open(scene, scene.settings())
    assert not steps.are_open(scene, scene.settings() | {"checkpoint": "c.h5"})
