"""The blade's section, as printed and as a NACA 4-digit airfoil, and the rod swept with it."""

from itertools import pairwise

import numpy as np
import pytest
from refused import refused

from isorod import airfoil, naca
from isorod.geometry.disk import boundary_functions
from isorod.scenes.blade import Blade

# Lu & Zhou, CMAME 200 (2011) 233-241, appendix A: control points of the root section; the minus signs that print lost
# are put back.
SECTION = [
    [1.0, 0.0708625],
    [0.847759, 0.177017],
    [0.566454, 0.227835],
    [0.198912, 0.225],
    [-0.198912, 0.18125],
    [-0.566454, 0.116567],
    [-0.847759, 0.0531051],
    [-1.0, 0.00994562],
    [-1.0, 0.00397825],
    [-0.847759, 0.00566454],
    [-0.566454, 0.0],
    [-0.198912, -0.01],
    [0.198912, -0.02],
    [0.566454, -0.0254328],
    [0.847759, -0.0226582],
    [1.0, -0.00994562],
]


def test_section_has_the_control_points_printed():
    """To half a unit of the last of six printed digits."""
    assert np.abs(airfoil() - SECTION).max() < 1e-6


def test_rod_is_swept_with_twist_and_taper():
    points = Blade(length=5.0, twist=30.0, taper=0.4, chord=3.0).rod().control_points
    assert points.shape == (3, 16, 3)
    assert np.array_equal(points[:, :, 2], [[0.0] * 16, [2.5] * 16, [5.0] * 16])
    for layer, angle, size in zip(points, np.radians([0.0, 15.0, 30.0]), [1.5, 1.5 * 0.7, 1.5 * 0.4], strict=True):
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        assert np.abs(layer[:, :2] - size * np.array(SECTION) @ turn).max() < 2e-6


def naca_points(digits, theta, chord=1.0):
    """Points of the airfoil of Jacobs, Ward, Pinkerton (NACA Report 460, 1933) at x = (1 + cos theta) / 2."""
    m, p, t = int(digits[0]) / 100, int(digits[1]) / 10, int(digits[2:]) / 100
    points = []
    for angle in theta:
        x = (1 + np.cos(angle)) / 2
        half = t / 0.2 * (0.2969 * x**0.5 - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1015 * x**4)
        mean = slope = 0.0
        if m and x < p:
            mean, slope = m / p**2 * (2 * p * x - x**2), 2 * m / p**2 * (p - x)
        elif m:
            mean, slope = m / (1 - p) ** 2 * (1 - 2 * p + 2 * p * x - x**2), 2 * m / (1 - p) ** 2 * (p - x)
        side = 1 if np.sin(angle) > 0 else -1
        tilt = np.arctan(slope)
        points.append((x - side * half * np.sin(tilt) - 0.5, mean + side * half * np.cos(tilt)))
    return chord * np.array(points)


THETA = 2 * np.pi * (np.arange(2000) + 0.5) / 2000
FOILS = ["0012", "2412", "4415", "0006", "6409"]


@pytest.mark.parametrize("digits", FOILS)
def test_naca_outline_converges_to_the_formula(digits):
    """Away from the blunt trailing edge, whose step of 0.21 % of the thickness ratio a smooth outline rounds off."""
    exact = naca_points(digits, THETA)
    fore = exact[:, 0] < 0.35
    errors = []
    for n in (8, 16, 32, 64):
        distance = np.linalg.norm(boundary_functions(n, THETA) @ naca(digits, n) - exact, axis=1)
        errors.append(distance[fore].max())
        step = 2 * 0.0105 * int(digits[2:]) / 100
        assert distance.max() < step + errors[-1]
    print("errors", errors)
    assert errors[1] < 0.006 * int(digits[2:]) / 100 + 0.02 * int(digits[0]) / 100
    assert all(b < 0.6 * a for a, b in pairwise(errors))


@pytest.mark.parametrize(("digits", "n"), [(digits, n) for digits in FOILS for n in (16, 32)])
def test_naca_thickness_and_camber(digits, n):
    """Largest thickness and camber of the fitted outline, measured between its upper and lower side."""
    x, y = (boundary_functions(n, THETA) @ naca(digits, n)).T
    stations = np.linspace(-0.45, 0.35, 401)
    upper = np.interp(stations, x[:1000][::-1], y[:1000][::-1])
    lower = np.interp(stations, x[1000:], y[1000:])
    camber, thickness = int(digits[0]) / 100, int(digits[2:]) / 100
    # The thickness stands at right angles to the camber line, which tilts it by up to 4 camber / chord.
    assert (upper - lower).max() == pytest.approx(thickness, abs=0.003 * thickness + 8 * camber**2 * thickness)
    assert (upper + lower).max() / 2 == pytest.approx(camber, abs=0.0005 + 8 * camber * thickness**2)
    assert np.ptp(x) == pytest.approx(1.0, abs=1e-3)


def test_naca_section_lies_as_the_paper_draws_it():
    """Counter-clockwise, in proportion to the chord, the sharp end towards +x; without camber symmetric."""
    points = naca("2415", 24)
    following = np.roll(points, -1, axis=0)
    assert np.sum(points[:, 0] * following[:, 1] - points[:, 1] * following[:, 0]) > 0
    assert np.abs(naca("2415", 24, 3.5) - 3.5 * points).max() < 1e-14
    x, y = (boundary_functions(24, THETA) @ points).T
    blunt, sharp = (np.ptp(y[near]) for near in (np.abs(x + 0.45) < 0.02, np.abs(x - 0.45) < 0.02))
    assert blunt > 2 * sharp
    symmetric = naca("0015", 24)
    assert np.abs(np.roll(symmetric[::-1], 1, axis=0) * [1.0, -1.0] - symmetric).max() < 1e-13


@pytest.mark.parametrize("digits", ["0012", "2412", "4415", "0006"])
def test_a_blade_of_naca_section_does_not_fold(digits):
    assert Blade(airfoil=digits).rod().check() > 0


BAD_DIGITS = ["", "12", "241", "24123", "24x2", "-412", "+412", "2 12", "24.2", "2400", "0000", "0412", "2012", "NACA"]
test_naca_refuses_what_is_no_four_digit_number = refused(
    *(
        (digits, f"got {digits!r}, need a NACA 4-digit number such as 2412")
        for digits in (*BAD_DIGITS, "241\N{SUPERSCRIPT TWO}", "\N{ARABIC-INDIC DIGIT TWO}412")
    ),
    by=lambda digits: naca(digits, 16),
)
test_chord_must_be_a_length = refused(
    *(
        (make, chord, f"chord: got {chord:g}, need a positive length")
        for make in (lambda chord: naca("2412", 16, chord), lambda chord: Blade(chord=chord).rod())
        for chord in (0.0, -1.0, np.nan, np.inf)
    ),
    by=lambda make, chord: make(chord),
)
