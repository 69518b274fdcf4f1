"""Lines of engine order across frequencies, where they meet these, and the sweep that tells them."""

import numpy as np
import pytest

from isorod.output import campbell, curves

BLADE = """
[rod.blade]
curve = {straight = 10.0}
section = {circle = 0.5}
law = {NeoHookean = {E = 1e6, nu = 0.3}}
density = 1.0
space = {elements = 2, degree = 4, section_degree = 3}

[support.root]
end = "start"

[spin]
velocity = [0.0, 0.0, 0.0]

[analysis.modal]
modes = 2
"""


def test_crossings_of_stiffened_blades_are_exact_on_few_speeds():
    """``f^2 = f0^2 + a (w / 2 pi)^2`` meets ``n w / 2 pi`` at ``f0 2 pi / sqrt(n^2 - a)``."""
    speed, f0, a = np.array([0.0, 20.0, 50.0]), 3.0, 1.2
    columns = {"spin.velocity.0": speed, "frequencies[0]": np.sqrt(f0**2 + a * (speed / (2.0 * np.pi)) ** 2)}
    found = campbell.crossings(columns)
    assert [one.order for one in found] == [2, 3, 4, 5, 6]
    for one in found:
        assert one.speed == pytest.approx(2.0 * np.pi * f0 / np.sqrt(one.order**2 - a), rel=1e-12)
        assert one.frequency == pytest.approx(one.order * one.speed / (2.0 * np.pi), rel=1e-12)
    back = campbell.crossings({"spin": -speed, "frequencies[0]": columns["frequencies[0]"]})
    assert [one.speed for one in back] == pytest.approx([-one.speed for one in found])
    mixed = campbell.crossings({"spin": speed[[1, 0, 2]], "frequencies[0]": columns["frequencies[0]"][[1, 0, 2]]})
    assert mixed == found
    columns["frequencies[0]"][1] = np.nan
    assert not campbell.crossings(columns)


@pytest.mark.parametrize(
    ("speeds", "said"), [((0.0, 40.0), True), ((0.0, 20.0, 40.0), True), ((26.0, 27.0, 28.0), False)]
)
def test_crossings_say_how_far_too_few_speeds_are_off(speeds, said):
    """Where ``f = f0 + b w``, as of a round shaft, order one is met where ``f0 = (1 / 2 pi - b) w``."""
    speed, f0, b = np.array(speeds), 3.0, 0.05
    one = campbell.crossings({"spin": speed, "frequencies[0]": f0 + b * speed})[0]
    exact = f0 / (0.5 / np.pi - b)
    assert one.speed * (1.0 + one.error) == pytest.approx(exact, rel=1e-12)
    assert ("% off: give more speeds there" in str(one)) == said


def test_a_sweep_of_modes_over_the_speed_tells_and_draws_them(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "blade.toml").write_text(BLADE)
    words = ("sweep", "blade.toml", "--no-estimate", "--set", "spin.velocity.0=0:30:3", "--output", "t.csv")
    code, out, _ = command._run((*words, "--png", "t.png"))
    assert code == 0
    columns = curves.read(tmp_path / "t.csv")
    found = campbell.crossings(columns)
    assert found and all(str(one) in out for one in found)
    assert columns["order 1"] == pytest.approx(np.array([0.0, 15.0, 30.0]) / (2.0 * np.pi))
    (panel,) = curves.panels(columns, {})
    assert panel.beside == "frequency (cycles per time)"
    assert (tmp_path / "t.png").stat().st_size > 0
    # Not with a spin about another axis too: orders are of all of the speed.
    (tmp_path / "blade.toml").write_text(BLADE.replace("[0.0, 0.0, 0.0]", "[0.0, 0.0, 1.0]"))
    code, out, _ = command._run(("sweep", "blade.toml", "--no-estimate", "--set", "spin.velocity.0=0:30:3"))
    assert code == 0
    assert "order" not in out
