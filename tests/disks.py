"""Points of the disk, and derivatives by differences, for tests of functions on it."""

import numpy as np

# Central differences of order 8: weights of f(x + k h) - f(x - k h), k = 1 .. 4.
DIFFERENCE = (4 / 5, -1 / 5, 4 / 105, -1 / 280)


def derivative(f, x, direction, h):
    return sum(w * (f(x + k * h * direction) - f(x - k * h * direction)) for k, w in enumerate(DIFFERENCE, 1)) / h


def disk_points(radius, count=60, seed=0):
    random = np.random.default_rng(seed)
    r, t = radius * np.sqrt(random.random(count)), 2 * np.pi * random.random(count)
    return np.stack([r * np.cos(t), r * np.sin(t)], axis=1)
