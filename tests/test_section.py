"""Control polygons of sections."""

import numpy as np
import pytest
from refused import refused

from isorod import circle, ellipse, flower
from isorod.geometry.disk import boundary_functions
from isorod.geometry.section import from_points

THETA = np.linspace(0, 2 * np.pi, 97)


def outline(points, theta=THETA):
    return boundary_functions(len(points), theta) @ points


def round_points(count, start=0.0):
    theta = start + 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(theta), np.sin(theta)], axis=1)


@pytest.mark.parametrize("n", [3, 4, 7, 16, 40])
def test_circle_and_ellipse_are_exact(n):
    unit = np.stack([np.cos(THETA), np.sin(THETA)], axis=1)
    assert np.abs(outline(circle(n, 2.5)) - 2.5 * unit).max() < 1e-13
    assert np.abs(outline(ellipse(n, 2.0, 0.3)) - unit * [2.0, 0.3]).max() < 1e-13


@pytest.mark.parametrize("n", [3, 5, 8, 16])
def test_from_points_reproduces_a_circle_wherever_it_starts(n):
    points = 0.7 * round_points(5 * n, start=0.4) + [3.0, -1.0]
    assert np.abs(outline(from_points(points, n)) - 0.7 * outline_of_turned_circle(0.4) - [3.0, -1.0]).max() < 1e-13


# A circle, ten of whose points are all at one place.
CROWDED = np.insert(round_points(13), [1] * 9, round_points(1000)[1:10], axis=0)


def outline_of_turned_circle(start):
    return np.stack([np.cos(THETA + start), np.sin(THETA + start)], axis=1)


def test_from_points_interpolates_when_there_are_as_many_points():
    random = np.random.default_rng(3)
    points = round_points(25) * (1 + 0.02 * random.random((25, 1)))
    edges = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    theta = 2 * np.pi * np.concatenate([[0], np.cumsum(edges)[:-1]]) / edges.sum()
    assert np.abs(outline(from_points(points, 25), theta) - points).max() < 1e-12


def test_from_points_converges_to_an_ellipse_at_third_order():
    points = round_points(20000) * [2.0, 1.0]
    errors = []
    for n in (16, 32, 64):
        x, y = outline(from_points(points, n)).T
        errors.append(np.abs(np.hypot(x / 2, y) - 1).max())
    assert np.all(np.log2(np.divide(errors[:-1], errors[1:])) > 2.7)


def test_flower_of_no_depth_is_a_circle():
    assert np.array_equal(flower(12, 4, 1.5, 0.0), circle(12, 1.5))


def test_flower_is_symmetric_and_concave_between_its_petals():
    points = flower(16, 4, 1.0, 0.3)
    assert np.abs(np.roll(points, 4, axis=0) - points @ np.array([[0.0, -1.0], [1.0, 0.0]])).max() < 1e-14
    edges = np.roll(points, -1, axis=0) - points
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    assert turns.max() > 0
    assert turns.min() < 0
    x, y = outline(points).T
    assert np.hypot(x, y).max() > 1.2
    assert np.hypot(x, y).min() < 0.85


test_refuses_what_is_no_section = refused(
    (lambda: circle(2), "section control points: got 2"),
    (lambda: circle(4, 0.0), "got 0, need a positive length"),
    (lambda: circle(4, -1.0), "got -1, need a positive length"),
    (lambda: circle(4, np.nan), "got nan, need a positive length"),
    (lambda: ellipse(4, 1.0, np.inf), "half axis b: got inf"),
    (lambda: flower(2), "section control points: got 2"),
    (lambda: flower(16, depth=1.0), "depth: got 1, need 0 <= depth < 1"),
    (lambda: flower(16, depth=-0.1), "depth: got -0.1"),
    (lambda: flower(16, depth=np.nan), "depth: got nan"),
    (lambda: from_points(np.zeros((4, 3)), 3), r"shape \(4, 3\), need \(m, 2\)"),
    (lambda: from_points(round_points(12), 16), "m >= 16"),
    (lambda: from_points(round_points(9), 2), "section control points: got 2"),
    (lambda: from_points([[0, 0], [1, np.nan], [1, 1]], 3), "point 1 is not finite"),
    (lambda: from_points([[0, 0], [1, 0], [1, 0], [0, 1]], 3), "point 1 coincides with the next"),
    (lambda: from_points([[0, 0], [1, 0], [0, 1], [0, 0]], 3), "point 3 coincides with the next"),
    (lambda: from_points(round_points(8)[::-1], 4), "clockwise"),
    (lambda: from_points(CROWDED, 20), "only 1. of 20 control points"),
    *(
        (lambda petals=petals: flower(16, petals), "flower petals: got .*, need an integer from 0 to")
        for petals in (-1, 10**30, 2.5)
    ),
)
