"""The error of implicit steps that are too long: near the true one, and warned of."""

import warnings

import numpy as np
import pytest
from motions import mixed, swing

from isorod import dynamics
from isorod.dynamics.implicit.phase import Phase

# Frequencies and amplitudes: one, a rod struck at its tip, and what no step follows.
TONES = [[(1.0, 1.0)], [(1.0, 1.0), (6.27, 1 / 39), (17.5, 1 / 307), (34.4, 1 / 1183)], [(1.0, 1.0), (400.0, 3e-3)]]


@pytest.mark.parametrize("tones", TONES)
@pytest.mark.parametrize("periods", [2, 20])
@pytest.mark.parametrize("steps", [8, 32, 128])
def test_error_of_what_swings_in_steps_of_the_trapezoidal_rule(tones, periods, steps):
    (w, size), dt = np.array(tones).T, 2.0 * np.pi / steps
    k = np.arange(periods * steps + 1)[:, None]
    found, exact = size * np.cos(2.0 * k * np.arctan(0.5 * w * dt)), size * np.cos(k * w * dt)
    phase = Phase(lambda vector: vector, found[0], 0.0 * found[0])
    for one in found[1:]:
        phase.add(one)
    largest = np.linalg.norm(found - found[0], axis=1).max()
    error = min(1.0, np.linalg.norm(found - exact, axis=1).max() / largest)
    assert 0.9 * error < phase.error() < (1.25 if len(tones) == 1 else 4.0) * error


def test_uniform_motion_has_none():
    phase = Phase(lambda vector: vector, np.zeros(2), np.ones(2))
    for k in range(20):
        phase.add((k + 1.0) * np.ones(2))
    assert phase.error() == pytest.approx(0.0, abs=1e-12)


def moved(steps, **settings):
    """A bar that swings to one side and back."""
    model = mixed(nu=0.3, length=4.0)
    return dynamics.solve(model, 4.0, 4.0 / steps, velocity=swing(model, 0.05), integrator="implicit", **settings)


def test_long_steps_are_warned_of_and_short_ones_are_not():
    exact = moved(240, outputs=10).displacement
    for steps, warned in ((10, True), (120, False)):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = moved(steps, outputs=10)
        error = np.linalg.norm(found.displacement - exact, axis=1).max() / np.linalg.norm(exact, axis=1).max()
        print(error, found.time_error)
        assert error / 3.0 < found.time_error < 4.0 * error
        assert any("estimated displacement error" in str(one.message) for one in said) == warned
    assert moved(1, outputs=1).time_error is None


def test_a_run_that_is_continued_knows_its_steps(tmp_path):
    whole, file = moved(12, outputs=6), tmp_path / "kept.npz"
    model = mixed(nu=0.3, length=4.0)
    for end, resume in ((2.0, False), (4.0, True)):
        found = dynamics.solve(
            model,
            end,
            4.0 / 12.0,
            outputs=round(1.5 * end),
            velocity=swing(model, 0.05),
            integrator="implicit",
            checkpoint=file,
            resume=resume,
        )
    assert found.time_error == pytest.approx(whole.time_error, rel=1e-9)
