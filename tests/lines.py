"""Centre lines for tests, and what is measured along them and what is swept."""

import numpy as np

from isorod.geometry.fitting import evaluate

ANGLES = 2.0 * np.pi * np.arange(24) / 24
RIM = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)
KNOT = 2.0 * np.pi * np.arange(40) / 40
TREFOIL = np.stack(
    [np.sin(KNOT) + 2 * np.sin(2 * KNOT), np.cos(KNOT) - 2 * np.cos(2 * KNOT), -np.sin(3 * KNOT)], axis=1
)


def parameters(thing, each=40):
    breaks = thing.axis.breaks
    return np.unique(breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, each))


def along(line, each=40):
    """Places and unit tangents."""
    where, slope = evaluate(line.axis, line.centers, parameters(line, each))
    return where, slope / np.linalg.norm(slope, axis=1, keepdims=True)


def distances(points, line):
    """From each point to the line, which is taken for a chain of short chords."""
    dense, _ = along(line, 300)
    chords = np.diff(dense, axis=0)
    found = []
    for point in points:
        arms = point - dense[:-1]
        share = np.clip(np.einsum("ta,ta->t", arms, chords) / np.einsum("ta,ta->t", chords, chords), 0.0, 1.0)
        found.append(np.linalg.norm(arms - share[:, None] * chords, axis=1).min())
    return np.array(found)


def sections(rod, each=9):
    """Parameters, centres, and arms to the rim ``(t, 24, 3)``."""
    u = parameters(rod, each)
    x, _ = rod.grid(np.concatenate([[[0.0, 0.0]], RIM]), u)
    return u, x[:, 0], x[:, 1:] - x[:, :1]


def random_curve(seed, count, noise=0.0):
    """Points at random of a smooth random curve."""
    random = np.random.default_rng(seed)
    t = np.sort(random.random(count))
    waves = random.standard_normal((3, 4)) / np.arange(1.0, 5.0)
    k, phase = np.arange(1.0, 5.0), 2 * np.pi * random.random((3, 4))
    shape = (waves * np.sin(2 * np.pi * 0.7 * k * t[:, None, None] + phase)).sum(axis=2) + 3.0 * t[:, None]
    return shape + noise * random.standard_normal(shape.shape)
