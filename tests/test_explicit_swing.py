"""The error of explicit steps in time: near the true one where it is large, and kept by checkpoints."""

from dataclasses import replace

import numpy as np
import pytest
from motions import mixed, swing

from isorod import dynamics
from isorod.dynamics.explicit.swing import Swing

TONES = [[(1.0, 1.0)], [(1.0, 1.0), (6.27, 1 / 39), (17.5, 1 / 307)], [(1.0, 1.0), (30.0, 1e-2)]]


@pytest.mark.parametrize("tones", TONES)
@pytest.mark.parametrize("periods", [3, 30])
@pytest.mark.parametrize("steps", [128, 512])
def test_error_of_what_swings_in_central_differences(tones, periods, steps):
    (w, size), dt = np.array(tones).T, 2.0 * np.pi / steps
    fast = 2.0 * np.arcsin(0.5 * w * dt) / dt
    times = np.arange(periods * steps + 1)[:, None] * dt
    found, exact = size * np.cos(fast * times), size * np.cos(w * times)
    swing = Swing()
    turned = size * np.sin(fast * times)
    for k in range(0, len(times), 7):
        squares = [np.sum((fast**order * (turned if order % 2 else found)[k]) ** 2) for order in (1, 2, 3)]
        swing.add(np.array(squares), np.sum((found[k] - found[0]) ** 2))
    largest = np.linalg.norm(found - found[0], axis=1).max()
    error = min(1.0, np.linalg.norm(found - exact, axis=1).max() / largest)
    # Where what is fast is faint it is taken for more than it is: three sums do not tell two tones apart.
    assert 0.8 * error < swing.error(times[-1, 0], dt) < (2.0 if len(tones) == 1 else 12.0) * error


def test_a_bar_that_swings():
    model = mixed(nu=0.3, length=4.0)
    model = replace(model, bodies=[replace(one, formulation="displacement") for one in model.bodies])

    def moved(step):
        return dynamics.solve(model, 40.0, step, outputs=40, velocity=swing(model, 0.05))

    longest = dynamics.solve(model, 1.0, outputs=1, velocity=swing(model, 0.05)).time_step
    found, exact = moved(longest), moved(longest / 5.0)
    size = np.abs(exact.displacement).max()
    error = np.abs(found.displacement - exact.displacement).max() / size
    assert 0.2 * error < found.time_error < 5.0 * error + 1e-4


def test_uniform_motion_has_none():
    swing = Swing()
    for k in range(3):
        swing.add(np.array([1.0, 0.0, 0.0]), float(k * k))
    assert swing.error(2.0, 0.1) == 0.0
