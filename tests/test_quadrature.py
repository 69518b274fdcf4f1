"""Quadrature on disk x axis."""

import numpy as np
import pytest
from refused import refused

from isorod import Axis
from isorod.geometry.quadrature import Rule, axis_points, section_points

RULES = [Rule(2, 1, 3), Rule(1, 1, 1), Rule(3, 2, 3), Rule(4, 4, 3), Rule(6, 3, 3)]


def disk_monomial(a, b):
    """Integral of x^a y^b over the unit disk."""
    if a % 2 or b % 2:
        return 0.0
    ways = np.prod(np.arange(1, a, 2)) * np.prod(np.arange(1, b, 2)) / np.prod(np.arange(2, a + b + 1, 2))
    return 2 * np.pi * ways / (a + b + 2)


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("n", [3, 4, 7, 16])
def test_section_weights_are_positive_and_add_up_to_pi(n, rule):
    points, weights = section_points(n, rule)
    assert points.shape == (n * rule.radial * rule.angular, 2)
    assert weights.min() > 0
    assert np.hypot(*points.T).max() < 1
    assert weights.sum() == pytest.approx(np.pi, rel=1e-14)


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("n", [3, 4, 7, 16])
def test_section_rule_is_exact_for_monomials_below_its_degree(n, rule):
    """Radial Gauss takes r^(k+1), k <= 2 (radial) - 2; equal slices take every harmonic below n."""
    (x, y), weights = section_points(n, rule)[0].T, section_points(n, rule)[1]
    degree = min(n - 1, 2 * rule.radial - 2)
    for a in range(degree + 1):
        for b in range(degree + 1 - a):
            assert weights @ (x**a * y**b) == pytest.approx(disk_monomial(a, b), abs=1e-14)


@pytest.mark.parametrize("n", [3, 8])
def test_slices_are_the_arcs(n):
    """Slice i is arc i, centred on 2 pi i / n: one angular point stands in its middle, several stay within it."""
    points, _ = section_points(n, Rule.paper(2))
    middle = np.repeat(np.exp(2j * np.pi * np.arange(n) / n), 2)
    radii = np.tile([0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3)], n)
    assert np.abs(points @ [1, 1j] - radii * middle).max() < 1e-15
    points, _ = section_points(n, Rule(2, 5, 3))
    turned = (points @ [1, 1j]).reshape(n, 10) * np.exp(-2j * np.pi * np.arange(n) / n)[:, None]
    assert np.abs(np.angle(turned)).max() < np.pi / n


def test_paper_rule_misses_the_next_even_degree():
    (x, y), weights = section_points(8, Rule.paper(2))[0].T, section_points(8, Rule.paper(2))[1]
    assert abs(weights @ (x**2 + y**2) ** 2 - np.pi / 3) > 1e-2


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_axis_rule_is_exact_on_every_element(count):
    axis = Axis(2, [-1, -1, -1, 0.5, 2, 2, 7, 7, 7], np.ones(6))
    u, w = axis_points(axis, count)
    assert u.shape == w.shape == (3, count)
    assert np.all((u > axis.breaks[:-1, None]) & (u < axis.breaks[1:, None]))
    for k in range(2 * count):
        exact = np.diff(axis.breaks ** (k + 1)) / (k + 1)
        assert np.abs((w * u**k).sum(axis=1) - exact).max() < 1e-13 * max(1, np.abs(exact).max())


@pytest.mark.parametrize("degree", [1, 2, 3, 6])
def test_rules_by_name(degree):
    assert Rule.parse("paper", degree) == Rule(2, 1, degree + 1)
    assert Rule.parse("3x2x5", degree) == Rule(3, 2, 5)
    assert str(Rule.parse("3x2x5", degree)) == "3x2x5"
    assert Rule.parse("3x2", degree) == Rule(3, 2, degree + 1)
    full = Rule.full(4, degree)
    assert full.radial > 2
    assert full.angular > 1
    assert full.axial >= degree + 1


NO_RULES = ["", "paper ", "2x1x3\n", "2 x 1 x 3", *"Paper 2 2x 2x1x3x4 2x1x -2x1x3 2.0x1x3 nan 2X1X3".split()]
OUT_OF_RANGE = {"0x1x3": "radial", "2x0x3": "angular", "2x1x0": "axial", "2x1x65": "axial", "999x1x1": "radial"}
test_refuses_what_is_no_rule = refused(
    *((text, "quadrature: got .*, need .*'paper', 'full' or RxSxT") for text in NO_RULES),
    *((text, f"{name} points: got .* from 1 to 64") for text, name in OUT_OF_RANGE.items()),
    by=lambda text: Rule.parse(text, 2),
)
